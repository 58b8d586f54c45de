"""The arguments of ``haptic-accel experiment``."""

from __future__ import annotations

import argparse
from pathlib import Path

from haptic_accel.cli import experiment, teleop
from haptic_accel.cli.commands.options import (
    Verbs,
    as_words,
    listed_words,
    take_json,
    take_words,
)
from haptic_accel.core.control.controllers import CONTROLLERS


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "experiment",
        help=summary,
        description="Run the paper's three surfaces under its three controllers, print Table II"
        " beside the paper's, and write a report with its figures 9, 10 and 11.",
        epilog=f"surface and controller restrict the conditions; duration is that of one"
        f" condition (default here: {experiment.DURATION:g}).\n\n" + teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.add_argument(
        "--lockstep", action="store_true", help="without ROS, faster than real time, repeatable"
    )
    verb.add_argument(
        "--controllers",
        type=listed_words,
        default=experiment.PAPER_CONTROLLERS,
        metavar="NAME,NAME,...",
        help=f"of {', '.join(CONTROLLERS)} (default: {','.join(experiment.PAPER_CONTROLLERS)})",
    )
    for name in ("rig", "rate", "grip"):
        verb.add_argument(f"--{name}", metavar="VALUE", help=f"the same as {name}:=VALUE")
    verb.add_argument(
        "--recording", metavar="FILE", help="the same as surface:=recording recording:=FILE"
    )
    verb.add_argument("--recording-rate", metavar="HZ", help="the same as recording_rate:=HZ")
    verb.add_argument(
        "--seeds", type=int, default=1, help="users and pieces of material, each in lockstep"
    )
    take_json(verb)
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of the report (default: results/<time>)"
    )
    verb.set_defaults(
        run=lambda arguments: experiment.experiment(
            [
                *arguments.words,
                *(["surface:=recording"] if arguments.recording else []),
                *as_words(arguments, ["rig", "rate", "grip", "recording", "recording_rate"]),
            ],
            seeds=arguments.seeds,
            controllers=arguments.controllers,
            lockstep=arguments.lockstep,
            json_file=arguments.json,
            out=arguments.out,
        )
    )
