"""The arguments of ``haptic-accel emulate``."""

from __future__ import annotations

import argparse

from haptic_accel.cli import emulate_can, emulate_serial, teleop
from haptic_accel.cli.commands.options import Verbs, take_words


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "emulate",
        help=summary,
        description="Emulate hardware with the virtual rig behind it.",
    )
    kinds = verb.add_subparsers(title="hardware", required=True, metavar="HARDWARE")
    can = kinds.add_parser(
        "can",
        help="two arms of ODrives on CAN",
        description="Emulate a master's and a slave's arm of ODrives on CAN, as slcan adapters on"
        " pseudo-terminals or on any bus of python-can, until Ctrl-C.",
        epilog=teleop.help_text(emulate_can.EmulateCanArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(can)
    can.set_defaults(run=lambda arguments: emulate_can.emulate_can(arguments.words))
    serial = kinds.add_parser(
        "serial",
        help="a handle and a tool on USB serial",
        description="Emulate a handle's and a tool's board on pseudo-terminals, until Ctrl-C.",
        epilog=teleop.help_text(emulate_serial.EmulateSerialArguments),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    take_words(serial)
    serial.set_defaults(run=lambda arguments: emulate_serial.emulate_serial(arguments.words))
