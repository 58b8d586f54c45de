"""``haptic-accel analyze``: bags into the paper's table, figures and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
from rich.console import Console

from haptic_accel.analysis.comparison import RUNS, check_comparison, compared
from haptic_accel.analysis.loading import Analysis, analyse, find_bags
from haptic_accel.analysis.metrics import Shift
from haptic_accel.analysis.writing import as_json, write_analysis, write_json
from haptic_accel.cli.options import FILE, Verb, json_option, out_option
from haptic_accel.cli.output import results_folder
from haptic_accel.cli.running import progress_bar
from haptic_accel.cli.tables import print_analysis
from haptic_accel.core.process import DONE, FAILED


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel analyze bags/",
        "haptic-accel analyze bags/ --compare controller:constant,inverse",
        "haptic-accel analyze monday tuesday --compare",
    ],
)
@click.argument("places", metavar="BAG...", type=FILE, nargs=-1, required=True)
@click.option(
    "--shift",
    default="paper",
    metavar="paper|measured|MS",
    help="Time by which the actual acceleration is shifted back before it is compared: one sample"
    " as in the paper, the delay measured in each trial, or milliseconds.",
)
@click.option(
    "--compare",
    "comparison",
    is_flag=False,
    flag_value=RUNS,
    metavar="controller:A,B",
    help="Test whether two controllers differ or, without a value, whether the two bags or folders"
    " given do; paired by trial.",
)
@click.option(
    "--no-perceptual",
    "perceptual",
    is_flag=True,
    flag_value=False,
    default=True,
    show_default=False,
    help="Leave out ST-SIM and SPQI, which take longest.",
)
@json_option
@out_option
def analyze(
    places: Sequence[Path],
    *,
    shift: str,
    comparison: str | None,
    perceptual: bool,
    out: Path | None,
    json_file: Path | None,
) -> int:
    """Analyse bags, grouped by controller and surface.

    Takes any number of bags, or folders with bags. Prints Table II, and writes a page, plots
    for a paper, and tables.
    """
    chosen = Shift.read(shift)
    if comparison:
        check_comparison(comparison, places)
    for place in places:
        find_bags(place)
    folder = results_folder(out)
    console = Console()
    analysis = _analysed(places, chosen, perceptual, console)
    found = compared(analysis, comparison, places) if comparison else None
    page = write_analysis(analysis, folder, found)
    if json_file:
        write_json(as_json(analysis, found), json_file)
    print_analysis(analysis, found, console)
    console.print(f"report: {page}", soft_wrap=True, highlight=False)
    return DONE if analysis.trials else FAILED


def _analysed(
    places: Sequence[Path], shift: Shift, perceptual: bool, console: Console
) -> Analysis:
    """Analyse all bags, with a bar that says which and how long is left."""
    with progress_bar(console) as progress:
        bar = progress.add_task("", total=None)

        def begun(done: int, total: int, name: str) -> None:
            progress.update(
                bar, completed=done, total=total, description=f"{done} of {total}: {name}"
            )

        analysis = analyse(places, shift, perceptual=perceptual, begun=begun)
        progress.update(bar, completed=analysis.bags, description="bags")
    return analysis
