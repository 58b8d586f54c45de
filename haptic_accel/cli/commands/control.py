"""The arguments of ``haptic-accel control``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import control, teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "control",
        help=summary,
        description="Let another controller take over, freeze or reset the adaptation, put another"
        " surface under the simulated tool, hold the simulated handle otherwise, let the arms go"
        " or couple them, while the graph runs.",
        epilog=teleop.help_text(control.ControlArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    verb.set_defaults(run=lambda arguments: control.control(arguments.words))
