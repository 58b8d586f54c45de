"""The command ``haptic-accel``: which verbs there are."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import INTERRUPTED, WRONG_ARGUMENTS

VERBS = {
    "teleop": "run the teleoperation graph",
    "control": "change controller, surface or grip of a graph that runs",
    "record": "start, pause, split and stop the recording of a graph that runs",
    "bag": "what is in a bag, and mending one that was cut off",
    "scope": "serve a page that shows a graph while it runs",
    "estop": "emergency stop of a graph that runs, and its release",
    "design": "what inverse, feedback or adaptive will do, before anything runs",
    "experiment": "run the paper's experiment and report Table II",
    "identify": "find the handle's parameters with the paper's sweep",
    "replay": "play a bag once more, through any controller",
    "analyze": "turn bags into the paper's table, figures and a page",
    "emulate": "hardware that is not there, behind real drivers",
    "calibrate": "an accelerometer's gain and offset, from gravity",
    "bench": "measure the graph's latency, CPU and losses",
    "doctor": "what on this machine hurts real time, and how to mend it",
}
"""What each does; its arguments are in the file of its name in `commands`."""


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    words = sys.argv[1:] if words is None else words
    try:
        arguments = _parser(words).parse_args(words)
        sys.exit(arguments.run(arguments))
    except ParameterError as error:
        print(f"haptic-accel: {error}", file=sys.stderr)
        sys.exit(WRONG_ARGUMENTS)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return what parses a command line: only the verb in it is complete.

    An emergency stop must not wait for what draws figures to be imported.
    """
    parser = argparse.ArgumentParser(
        prog="haptic-accel", description="Feel what a remote tool touches."
    )
    verbs = parser.add_subparsers(title="verbs", required=True, metavar="VERB")
    for verb, summary in VERBS.items():
        if verb in words[:1]:
            import_module(f"haptic_accel.cli.commands.{verb}").add(verbs, summary)
        else:
            verbs.add_parser(verb, help=summary)
    return parser


if __name__ == "__main__":
    main()
