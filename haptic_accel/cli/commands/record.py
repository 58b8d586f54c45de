"""The arguments of ``haptic-accel record``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import record, teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "record",
        help=summary,
        description="Start, pause, split and stop the recording of a graph that runs.",
    )
    actions = verb.add_subparsers(title="actions", required=True, metavar="ACTION")
    for action, text in record.ACTIONS.items():
        kind = actions.add_parser(
            action,
            help=text,
            description=text.capitalize() + ".",
            epilog=teleop.help_text(record.RecordArguments),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        take_words(kind)
        kind.set_defaults(
            run=lambda arguments, action=action: record.record(action, arguments.words)
        )
