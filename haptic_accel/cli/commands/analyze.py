"""The arguments of ``haptic-accel analyze``."""

from __future__ import annotations

from pathlib import Path

from haptic_accel.analysis import comparison
from haptic_accel.cli import analyze
from haptic_accel.cli.commands.options import Verbs, take_json


def add(verbs: Verbs, summary: str) -> None:
    """Add the verb and its arguments."""
    verb = verbs.add_parser(
        "analyze",
        help=summary,
        description="Analyse any number of bags, grouped by controller and surface: print Table"
        " II, and write a page, figures for a paper, and tables.",
    )
    verb.add_argument(
        "bags", nargs="+", type=Path, metavar="BAG", help="a bag, or a folder in which to look"
    )
    verb.add_argument(
        "--shift",
        default="paper",
        metavar="paper|measured|MS",
        help="time by which the actual acceleration is shifted back before it is compared: one"
        " sample as in the paper, the delay found in each trial, or milliseconds (default: paper)",
    )
    verb.add_argument(
        "--compare",
        nargs="?",
        const=comparison.RUNS,
        metavar="controller:A,B",
        help="test whether two controllers differ, or, with two bags or folders before it and"
        " nothing behind, whether these do; paired by trial",
    )
    verb.add_argument(
        "--no-perceptual",
        dest="perceptual",
        action="store_false",
        help="without ST-SIM and SPQI, which take longest",
    )
    take_json(verb)
    verb.add_argument(
        "--out", type=Path, metavar="FOLDER", help="of the report (default: results/<time>)"
    )
    verb.set_defaults(
        run=lambda arguments: analyze.analyze(
            arguments.bags,
            shift=arguments.shift,
            comparison=arguments.compare,
            perceptual=arguments.perceptual,
            out=arguments.out,
            json_file=arguments.json,
        )
    )
