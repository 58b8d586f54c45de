"""The arguments of ``haptic-accel teleop``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "teleop",
        help=summary,
        description="Run the five nodes of the teleoperation graph until Ctrl-C.",
        epilog=teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.set_defaults(run=lambda arguments: teleop.teleop(arguments.words))
