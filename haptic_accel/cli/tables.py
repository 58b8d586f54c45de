"""Prints an analysis: Table II, the other metrics, and a summary."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from haptic_accel.analysis.comparison import Comparison
from haptic_accel.analysis.frames import (
    PAPER_REGRESSION,
    PAPER_SURFACES,
    Cell,
    TableTwo,
    groups,
    table_two,
    trials,
)
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.metrics import METRICS
from haptic_accel.analysis.plots import number
from haptic_accel.analysis.summary import summary

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
"""Metrics of the second table, by controller over all its trials."""


def print_analysis(analysis: Analysis, comparison: Comparison | None, console: Console) -> None:
    """Print tables, sentences, and what could not be determined."""
    if analysis.trials:
        table = table_two(groups(analysis))
        console.print(_errors(table))
        console.print(_means(analysis, list(table.rows)))
    for sentence in summary(analysis, comparison):
        console.print(sentence, highlight=False, markup=False)
    for name, lines in analysis.problems.items():
        for line in lines:
            console.print(f"{name}: {line}", highlight=False, markup=False, soft_wrap=True)


def _errors(found: TableTwo) -> Table:
    """Return Table II as found, the paper's beside it."""
    table = Table(
        title="Table II: error of the handle's acceleration, % (paper's in brackets)",
        caption="± half of the 95 % interval",
    )
    table.add_column("controller")
    for heading in ("trials", *found.columns):
        table.add_column(heading, justify="right")
    for controller, cells in found.rows.items():
        table.add_row(controller, str(found.counts[controller]), *map(_cell, cells))
    return table


def _cell(cell: Cell) -> str:
    """Return an error, half its interval's width, and the paper's value behind it."""
    shown = number(cell.value, 1)
    if cell.low == cell.low:
        shown += f" ± {number((cell.high - cell.low) / 2, 1)}"
    return shown if cell.paper is None else f"{shown} ({cell.paper:.1f})"


def _means(analysis: Analysis, controllers: list[str]) -> Table:
    """Return other metrics as rows, a column for each controller, over all surfaces."""
    frame = trials(analysis)
    # The paper's averages are over its own surfaces.
    paper = PAPER_REGRESSION if set(frame.surface) == PAPER_SURFACES else {}
    table = Table(
        title="regression over all surfaces, and other metrics: means (paper's in brackets)"
    )
    table.add_column("")
    for controller in controllers:
        table.add_column(controller, justify="right")
    for name in SHOWN:
        means = frame.groupby("controller")[name].mean()
        cells = []
        for controller in controllers:
            published = paper.get(name, {}).get(controller)
            beside = f" ({published:.2f})" if published is not None else ""
            cells.append(number(means[controller], METRICS[name].digits) + beside)
        table.add_row(METRICS[name].heading, *cells)
    return table
