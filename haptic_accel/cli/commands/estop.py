"""The arguments of ``haptic-accel estop``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import estop, teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "estop",
        help=summary,
        description="Take all forces off both devices at once, and have them refuse others until"
        " release:=true.",
        epilog=teleop.help_text(estop.StopArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.set_defaults(run=lambda arguments: estop.estop(arguments.words))
