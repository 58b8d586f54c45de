"""The arguments of ``haptic-accel doctor``."""

from __future__ import annotations

from haptic_accel.cli import doctor
from haptic_accel.cli.commands.options import Verbs, take_json


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "doctor",
        help=summary,
        description="Look for what hurts real time on this machine, say how to mend it, and"
        " measure how late a 1 kHz timer is. Changes nothing.",
    )
    verb.add_argument("--seconds", type=float, default=5.0, help="to measure (default: 5)")
    take_json(verb)
    verb.set_defaults(run=lambda arguments: doctor.doctor(arguments.seconds, arguments.json))
