"""The arguments of ``haptic-accel bag``."""

from __future__ import annotations

from pathlib import Path

from haptic_accel.cli import bag
from haptic_accel.cli.commands.options import Verbs, take_json


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser("bag", help=summary)
    actions = verb.add_subparsers(title="actions", required=True, metavar="ACTION")
    info = actions.add_parser(
        "info",
        help="what is in a bag",
        description="Show a bag's topics, what it says of how it was recorded, and whether it is"
        " whole.",
    )
    info.add_argument("bag", type=Path, metavar="BAG", help="folder")
    take_json(info)
    info.set_defaults(run=lambda arguments: bag.info(arguments.bag, arguments.json))
    repair = actions.add_parser(
        "repair",
        help="make bags whole whose recording was cut off",
        description="Make bags whole whose recording was cut off by kill -9, a power cut or a full"
        " disk: keep every message that is intact, write index and metadata.yaml. What is replaced"
        " is kept beside with .damaged behind its name; a whole bag stays as it is.",
    )
    repair.add_argument("bags", type=Path, nargs="+", metavar="BAG", help="folder")
    take_json(repair)
    repair.set_defaults(run=lambda arguments: bag.mend(arguments.bags, arguments.json))
