"""The command ``haptic-accel``: its verbs and their arguments."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from haptic_accel.core.parameters import ParameterError
from haptic_accel.tools import experiment, teleop
from haptic_accel.tools.teleop import INTERRUPTED, WRONG_ARGUMENTS


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    arguments = _parser().parse_args(words)
    try:
        sys.exit(arguments.run(arguments))
    except ParameterError as error:
        print(f"haptic-accel: {error}", file=sys.stderr)
        sys.exit(WRONG_ARGUMENTS)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="haptic-accel", description="Feel what a remote tool touches."
    )
    verbs = parser.add_subparsers(title="verbs", required=True, metavar="VERB")
    _add_teleop(verbs)
    _add_experiment(verbs)
    return parser


def _add_teleop(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    verb = verbs.add_parser(
        "teleop",
        help="run the teleoperation graph",
        description="Run the five nodes of the teleoperation graph until Ctrl-C.",
        epilog=teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.add_argument("words", nargs="*", metavar="key:=value", help="arguments of the graph")
    verb.set_defaults(run=lambda arguments: teleop.teleop(arguments.words))


def _add_experiment(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    verb = verbs.add_parser(
        "experiment",
        help="run the paper's experiment and report Table II",
        description="Run the paper's three surfaces under its three controllers, print Table II"
        " beside the paper's, and write a report with its figures 9, 10 and 11.",
        epilog=f"surface and controller restrict the conditions; duration is that of one"
        f" condition (default here: {experiment.DURATION:g}).\n\n" + teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.add_argument("words", nargs="*", metavar="key:=value", help="arguments of the graph")
    verb.add_argument(
        "--lockstep", action="store_true", help="without ROS, faster than real time, repeatable"
    )
    verb.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of the report (default: results/<time>)"
    )
    verb.set_defaults(
        run=lambda arguments: experiment.experiment(
            arguments.words,
            lockstep=arguments.lockstep,
            json_file=arguments.json,
            out=arguments.out,
        )
    )


if __name__ == "__main__":
    main()
