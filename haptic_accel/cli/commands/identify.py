"""The arguments of ``haptic-accel identify``."""

from __future__ import annotations

import argparse
from pathlib import Path

from haptic_accel.cli import identify, teleop
from haptic_accel.cli.commands.options import (
    Verbs,
    as_words,
    listed_words,
    take_json,
    take_words,
)
from haptic_accel.core.identification import DEFAULT_FREE, SweepParameters
from haptic_accel.core.parameters import schema
from haptic_accel.graph.arguments import IdentifyArguments


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "identify",
        help=summary,
        description="Excite the handle with the paper's sweep, fit its model, and write a"
        " parameter file for config:=FILE, with the paper's figures 4 and 5.",
        epilog=teleop.help_text(IdentifyArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.add_argument("--lockstep", action="store_true", help="without ROS, simulated handle")
    verb.add_argument(
        "--grips",
        type=listed_words,
        default=[],
        metavar="GRIP,GRIP,...",
        help="ways to hold the handle, one after the other, fitted one by one and pooled",
    )
    verb.add_argument(
        "--from",
        dest="sources",
        action="append",
        default=[],
        metavar="[GRIP=]FILE",
        help="evaluate a bag of an identification, or a CSV file with columns"
        f" {' and '.join(identify.COLUMNS)}, in place of a run; may be given many times",
    )
    verb.add_argument(
        "--recording-rate", type=float, default=0.0, metavar="HZ", help="of CSV files"
    )
    verb.add_argument(
        "--free",
        type=listed_words,
        default=list(DEFAULT_FREE),
        metavar="NAME,NAME,...",
        help=f"what is fitted (default: {','.join(DEFAULT_FREE)})",
    )
    shortened = {**schema(SweepParameters), "trials": schema(IdentifyArguments)["trials"]}
    shortened["rig"] = schema(IdentifyArguments)["rig"]
    for name in shortened:
        verb.add_argument(
            f"--{name.replace('_', '-')}", metavar="VALUE", help=f"the same as {name}:=VALUE"
        )
    take_json(verb)
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of what is written (default: results/<time>)"
    )
    verb.set_defaults(
        run=lambda arguments: identify.identify(
            [*arguments.words, *as_words(arguments, shortened)],
            lockstep=arguments.lockstep,
            grips=arguments.grips,
            sources=arguments.sources,
            recording_rate=arguments.recording_rate,
            free=arguments.free,
            json_file=arguments.json,
            out=arguments.out,
        )
    )
