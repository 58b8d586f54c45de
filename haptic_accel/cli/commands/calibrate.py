"""The arguments of ``haptic-accel calibrate``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import calibrate, teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "calibrate",
        help=summary,
        description="Measure an accelerometer behind a serial board with one axis held up, then"
        " down, and write its gain and offset as a parameter file for config:=FILE.",
        epilog=teleop.help_text(calibrate.CalibrateArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.set_defaults(run=lambda arguments: calibrate.calibrate_board(arguments.words))
