"""The arguments of ``haptic-accel design``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import design, teleop
from haptic_accel.cli.commands.options import Verbs, take_json, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "design",
        help=summary,
        description="Design a controller for compensator.plant and print what it predicts: error,"
        " the least there can be, force, travel, gain and phase, and the feedback's margins.",
        epilog=teleop.help_text(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(verb)
    take_json(verb)
    verb.set_defaults(
        run=lambda arguments: design.design(arguments.words, json_file=arguments.json)
    )
