"""The arguments of ``haptic-accel replay``."""

from __future__ import annotations

import argparse
from pathlib import Path

from haptic_accel.cli import replay
from haptic_accel.cli.commands.options import Verbs, listed_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "replay",
        help=summary,
        description="Play the tool's acceleration and the slave's motion from a bag, or an"
        " acceleration from a CSV\nor WAV file, through the graph in place of the slave device."
        " All else is as it was when the bag\nwas recorded, and what happens is recorded anew. The"
        " master's user holds and moves the handle,\nwhich the coupler draws to the recorded path."
        " rate is the speed, as of `ros2 bag play`; the\ngraph's sampling rate is the bag's.",
        epilog="with --lockstep any number of bags may be given.\n\n" + replay.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.add_argument(
        "words",
        nargs="*",
        metavar="BAG | key:=value",
        help="a bag's folder or file, or CSV or WAV file; arguments",
    )
    verb.add_argument(
        "--lockstep", action="store_true", help="without ROS, the same result every time"
    )
    verb.add_argument(
        "--controllers",
        type=listed_words,
        default=[],
        metavar="NAME,NAME,...",
        help="with --lockstep, several that play the same bags",
    )
    verb.add_argument(
        "--json", type=Path, metavar="FILE", help="with --lockstep, write the figures as JSON"
    )
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="with --lockstep, write a bag per condition"
    )
    verb.set_defaults(
        run=lambda arguments: replay.replay(
            arguments.words,
            lockstep=arguments.lockstep,
            controllers=arguments.controllers,
            json_file=arguments.json,
            out=arguments.out,
        )
    )
