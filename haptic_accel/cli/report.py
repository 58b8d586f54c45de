# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Analyses bags for a verb: prints tables and sentences, writes the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console

from haptic_accel.analysis import frames
from haptic_accel.analysis.comparison import Comparison, check_comparison, compared
from haptic_accel.analysis.loading import Analysis, Spread, analyse
from haptic_accel.analysis.metrics import METRICS, AnalysedTrial, Shift
from haptic_accel.analysis.parting import Parting, find_parting
from haptic_accel.analysis.plots import number
from haptic_accel.analysis.summary import summary
from haptic_accel.analysis.writing import as_json, write_analysis, write_json
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.jobs import side_by_side
from haptic_accel.cli.output import results_folder
from haptic_accel.cli.running import stop_on_signal
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import INTERRUPTED
from haptic_accel.graph.arguments import GraphArguments
from haptic_accel.graph.processes import graph_parameters, rig_parameters

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
    rig: str | None,
    rate: float | None,
    jobs: int,
    out: Path | None,
    file: Path | None,
) -> None:
    """Analyse bags, print tables, and write report and JSON; see the help of ``analyze``.

    Raises
    ------
    ParameterError
        An argument is wrong.
    StoppedError
        No trial could be analysed, or the user asked to stop.
    """
    chosen = Shift.read(shift)
    if comparison:
        check_comparison(comparison, places)
    parameters = rig_parameters(graph_parameters(GraphArguments(rig=rig))) if rig else None
    folder = results_folder(out)
    with stop_on_signal() as stop:
        spread = spread_over(jobs, stop)
        try:
            analysis = analyse(
                places,
                chosen,
                perceptual=perceptual,
                rig=parameters,
                rate=rate,
                spread=spread,
                ended=_print_trials,
            )
        except ParameterError:
            folder.rmdir()
            raise
        partings = list(_partings(analysis, spread)) if lockstep else []
        interrupted = stop()
    found = compared(analysis, comparison, places) if comparison else None
    page = write_analysis(analysis, folder, found)
    if file:
        content = as_json(analysis, found)
        if lockstep:
            content["lockstep"] = [asdict(each) | {"bag": str(each.bag)} for each in partings]
        write_json(content, file)
    print_analysis(analysis, found, *(each.sentence for each in partings), f"report: {page}")
    if interrupted:
        raise StoppedError(f"interrupted after {analysis.bags} bags", INTERRUPTED)
    if not analysis.trials:
        raise StoppedError


def spread_over(jobs: int, stop: Callable[[], bool]) -> Spread:
    """Return what analyses bags in so many processes, and ends early once it has to stop."""

    def spread(function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        with suppress(StoppedError):
            yield from side_by_side(function, items, jobs, stop)

    return spread


def _print_trials(done: int, total: int, name: str, trials: Sequence[AnalysedTrial]) -> None:
    """Print the errors of a bag's trials."""
    if not trials:
        print(f"{done} of {total}: {name}: no trial", flush=True)
    for trial in trials:
        condition = f"{trial.name}: {trial.controller} on {trial.surface}"
        error, *bounds = (
            number(trial.metrics[name], 1) for name in ("nrmse_percent", *frames.BOUNDS)
        )
        against = f"limited bound {bounds[0]}, bound {bounds[1]}"
        print(f"{done} of {total}: {condition} {error} % ({against})", flush=True)


def _partings(analysis: Analysis, spread: Spread) -> Iterator[Parting]:
    """Compare the bags with lockstep; print why one cannot be."""
    for found in spread(_parting, list(dict.fromkeys(t.segment.bag for t in analysis.trials))):
        if isinstance(found, Parting):
            yield found
        else:
            print(found)


def _parting(bag: Path) -> Parting | str:
    try:
        return find_parting(bag)
    except ParameterError as error:
        return str(error)


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
