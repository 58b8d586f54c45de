# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Output of trials on a terminal: a line per analysed trial, then tables and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from haptic_accel.analysis import frames
from haptic_accel.analysis.frames import Comparison
from haptic_accel.analysis.loading import Analysis, Spread
from haptic_accel.analysis.metrics import AnalysedTrial
from haptic_accel.analysis.replay import Divergence, find_divergence
from haptic_accel.analysis.summary import summary, tables
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError, printable
from haptic_accel.core.tables import number


def print_trials(done: int, total: int, name: str, trials: Sequence[AnalysedTrial]) -> None:
    """Print the errors of a bag's trials."""
    if not trials and total > 1:  # for a single bag, the error has the reason
        print(f"{done} of {total}: {name}: no trial", flush=True)
    for trial in trials:
        condition = printable(f"{trial.name}: {trial.controller} on {trial.surface}")
        names = ("nrmse_percent", "indistinguishable_percent", *frames.BOUNDS)
        error, share, *bounds = (number(trial.metrics[name], 1) for name in names)
        against = f"limited bound {bounds[0]}, bound {bounds[1]}"
        angle = trial.metrics.get("direction_error_deg")
        turned = "" if angle is None else f", direction {number(angle, 1)}°"
        print(
            f"{done} of {total}: {condition} {error} % ({against}){turned},"
            f" {share} % indistinguishable",
            flush=True,
        )


def divergences(analysis: Analysis, spread: Spread) -> Iterator[Divergence]:
    """Compare the bags with lockstep; print any obstacle."""
    for found in spread(_divergence, list(dict.fromkeys(t.segment.bag for t in analysis.trials))):
        if isinstance(found, Divergence):
            yield found
        else:
            print(found)


def _divergence(bag: Path) -> Divergence | str:
    try:
        return find_divergence(bag)
    except ParameterError as error:
        return str(error)


def print_analysis(analysis: Analysis, comparison: Comparison | None, *last: str) -> None:
    """Print tables, sentences, undetermined quantities, and additional lines."""
    for table in tables(analysis):
        print_table(table)
    console = Console()
    for sentence in summary(analysis, comparison):
        console.print(printable(sentence), highlight=False, markup=False)
    problems = [f"{name}: {line}" for name, lines in analysis.problems.items() for line in lines]
    print(*problems, *last, sep="\n")
