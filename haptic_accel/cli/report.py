"""Analyses bags for a verb: prints tables and sentences, writes the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd
from rich.console import Console

from haptic_accel.analysis import frames
from haptic_accel.analysis.comparison import Comparison, check_comparison, compared
from haptic_accel.analysis.loading import Analysis, analyse
from haptic_accel.analysis.metrics import METRICS, Shift
from haptic_accel.analysis.parting import Parting, find_parting
from haptic_accel.analysis.plots import number
from haptic_accel.analysis.summary import summary
from haptic_accel.analysis.writing import as_json, write_analysis, write_json
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.output import results_folder
from haptic_accel.cli.running import progress_bar
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError

SHOWN = (
    "slope_desired_on_actual",
    "slope_actual_on_desired",
    "r2",
    "delay_ms",
    "st_sim",
    "spqi",
    "force_rms_N",
    "travel_mm",
    "deadlines_missed_percent",
)
"""Metrics of the second table, by controller over all its trials."""


def report(
    places: Sequence[Path],
    shift: str,
    comparison: str | None,
    *,
    perceptual: bool,
    lockstep: bool,
    out: Path | None,
    file: Path | None,
) -> None:
    """Analyse bags, print tables, and write report and JSON; see the help of ``analyze``.

    Raises
    ------
    ParameterError
        An argument is wrong.
    StoppedError
        No trial could be analysed.
    """
    chosen = Shift.read(shift)
    if comparison:
        check_comparison(comparison, places)
    folder = results_folder(out)
    with progress_bar(Console()) as progress:
        bar = progress.add_task("", total=None)

        def begun(done: int, total: int, name: str) -> None:
            label = f"{done} of {total}: {name}"
            progress.update(bar, completed=done, total=total, description=label)

        analysis = analyse(places, chosen, perceptual=perceptual, begun=begun)
        progress.update(bar, completed=analysis.bags, description="bags")
        partings = list(_partings(analysis)) if lockstep else []
    found = compared(analysis, comparison, places) if comparison else None
    page = write_analysis(analysis, folder, found)
    if file:
        content = as_json(analysis, found)
        if lockstep:
            content["lockstep"] = [asdict(each) | {"bag": str(each.bag)} for each in partings]
        write_json(content, file)
    print_analysis(analysis, found, *(each.sentence for each in partings), f"report: {page}")
    if not analysis.trials:
        raise StoppedError


def _partings(analysis: Analysis) -> Iterator[Parting]:
    """Compare the bags with lockstep; note why one cannot be."""
    for bag in dict.fromkeys(trial.segment.bag for trial in analysis.trials):
        try:
            yield find_parting(bag)
        except ParameterError as error:
            print(error)


def print_analysis(analysis: Analysis, comparison: Comparison | None, *last: str) -> None:
    """Print tables, sentences, what could not be determined, and further lines."""
    table = frames.table_two(frames.groups(analysis))
    if table.rows:
        rows = [
            (controller, str(table.counts[controller]), *map(_cell, cells))
            for controller, cells in table.rows.items()
        ] + [
            (name, "", *(number(value, 1) for value in values))
            for name, values in table.bounds.items()
        ]
        print_table(
            ("controller", "trials", *table.columns),
            rows,
            title=f"Table II: error of the handle's acceleration after {analysis.after}, %"
            " (paper's in brackets)",
            caption=f"± half of the 95 % interval ({table.methods})",
        )
        print_table(
            ("", *table.rows),
            _means(frames.trials(analysis), list(table.rows)),
            title="regression over all surfaces, and other metrics: means (paper's in brackets)",
        )
    console = Console()
    for sentence in summary(analysis, comparison):
        console.print(sentence, highlight=False, markup=False)
    problems = [f"{name}: {line}" for name, lines in analysis.problems.items() for line in lines]
    print(*problems, *last, sep="\n")


def _cell(cell: frames.Cell) -> str:
    """Return an error, half its interval's width, and the paper's value behind it."""
    shown = number(cell.value, 1)
    if cell.low == cell.low:
        shown += f" ± {number((cell.high - cell.low) / 2, 1)}"
    return shown if cell.paper is None else f"{shown} ({cell.paper:.1f})"


def _means(frame: pd.DataFrame, controllers: Sequence[str]) -> Iterator[list[str]]:
    """Yield a row for each metric: its heading, and its mean under each controller."""
    frame = frame[frame.contact]
    # The paper's averages are over its own surfaces.
    paper = frames.PAPER_REGRESSION if set(frame.surface) == frames.PAPER_SURFACES else {}
    means = frame.groupby("controller")[list(SHOWN)].mean()
    for name in SHOWN:
        published = paper.get(name, {})
        yield [METRICS[name].heading] + [
            number(means[name][controller], METRICS[name].digits)
            + (f" ({published[controller]:.2f})" if controller in published else "")
            for controller in controllers
        ]
