"""``haptic-accel analyze``: bags into the paper's table, figures and a page."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from haptic_accel.analysis.comparison import RUNS, Comparison, check_comparison, compare
from haptic_accel.analysis.finding import find_bags
from haptic_accel.analysis.loading import AnalysedTrial, Analysis, analyse
from haptic_accel.analysis.measures import Shift
from haptic_accel.analysis.plots import number
from haptic_accel.analysis.summary import AVERAGE, averages, summary
from haptic_accel.analysis.tables import FIGURES, Group, groups
from haptic_accel.analysis.writing import as_json, write_analysis, write_json
from haptic_accel.cli.options import FILE, Verb, json_option, out_option
from haptic_accel.cli.output import check_writable, make_folder
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II
from haptic_accel.core.evaluation.statistics import Interval, mean_interval
from haptic_accel.core.process import DONE, FAILED

SHOWN = (
    "slope_desired_on_actual",
    "slope_actual_on_desired",
    "r2",
    "delay_ms",
    "st_sim",
    "spqi",
    "force_rms_N",
    "travel_mm",
    "latency_p99_us",
)
"""Figures of the second table, by controller over all its trials."""


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
    folder = out or Path("results") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    make_folder(folder)
    if json_file:
        check_writable(json_file)
    console = Console()
    analysis = _analysed(places, chosen, perceptual, console)
    compared = compare(analysis.trials, comparison, places) if comparison else None
    page = write_analysis(analysis, folder, compared)
    if json_file:
        write_json(as_json(analysis, compared), json_file)
    _print(analysis, compared, console)
    console.print(f"report: {page}", soft_wrap=True, highlight=False)
    return DONE if analysis.trials else FAILED


def _analysed(
    places: Sequence[Path], shift: Shift, perceptual: bool, console: Console
) -> Analysis:
    """Analyse all bags, with a bar that says which and how long is left."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.completed} of {task.total}"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("", total=None)

        def begun(done: int, total: int, name: str) -> None:
            progress.update(bar, completed=done, total=total, description=name)

        analysis = analyse(places, shift, perceptual=perceptual, begun=begun)
        progress.update(bar, completed=analysis.bags, description="bags")
    return analysis


def _print(analysis: Analysis, comparison: Comparison | None, console: Console) -> None:
    found = groups(analysis.trials)
    if found:
        console.print(_table_two(found))
        console.print(_figures(found))
    for sentence in summary(analysis, comparison):
        console.print(sentence, highlight=False, markup=False)
    for name, lines in analysis.problems.items():
        for line in lines:
            console.print(f"{name}: {line}", highlight=False, markup=False, soft_wrap=True)


def _table_two(found: Sequence[Group]) -> Table:
    """Return Table II as found, the paper's beside it."""
    table = Table(title="Table II: error of the handle's acceleration, % (paper's in brackets)")
    surfaces = list(dict.fromkeys(group.surface for group in found))
    table.add_column("controller")
    table.add_column("trials", justify="right")
    for surface in (*surfaces, *([AVERAGE] if len(surfaces) > 1 else [])):
        table.add_column(surface, justify="right")
    by_key = {(group.controller, group.surface): group for group in found}
    means = averages(found)
    for controller in dict.fromkeys(group.controller for group in found):
        cells = []
        for surface in surfaces:
            group = by_key.get((controller, surface))
            interval = group.interval("nrmse_percent") if group else None
            cells.append(_cell(interval, TABLE_II.get((surface, controller))))
        if len(surfaces) > 1:
            cells.append(_cell(means[controller][0], means[controller][1], ends=False))
        count = sum(len(group.trials) for group in found if group.controller == controller)
        table.add_row(controller, str(count), *cells)
    return table


def _cell(interval: Interval | None, paper: float | None, *, ends: bool = True) -> str:
    """Return a figure, half its interval's width, and the paper's value behind it."""
    shown = number(interval.value, 1) if interval else number(None)
    if interval and ends and interval.low == interval.low:
        shown += f" ± {number((interval.high - interval.low) / 2, 1)}"
    return shown if paper is None else f"{shown} ({paper:.1f})"


def _figures(found: Sequence[Group]) -> Table:
    """Return other figures as rows, a column for each controller, over all surfaces."""
    table = Table(title="means over all trials (paper's in brackets)")
    table.add_column("")
    trials: dict[str, list[AnalysedTrial]] = {}
    for group in found:
        trials.setdefault(group.controller, []).extend(group.trials)
    for controller in trials:
        table.add_column(controller, justify="right")
    for name in SHOWN:
        figure = FIGURES[name]
        heading = f"{figure.label}, {figure.unit}" if figure.unit else figure.label
        cells = []
        for controller, own in trials.items():
            mean = mean_interval([figure.of(trial.measures) for trial in own]).value
            paper = _PAPER.get(name, {}).get(controller)
            beside = f" ({paper:.2f})" if paper is not None else ""
            cells.append(number(mean, figure.digits) + beside)
        table.add_row(heading, *cells)
    return table


_PAPER = {
    "slope_desired_on_actual": {name: slope for name, (slope, _) in REGRESSION.items()},
    "r2": {name: r2 for name, (_, r2) in REGRESSION.items()},
}
