# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tracking error of all controllers on every rig, grip and input.

``python benchmarks/fidelity.py`` prints it for the paper's surfaces, hand models and changing
grips; ``--help`` lists all conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
from fidelity_trials import (
    CONDITIONS,
    DEFAULT_CONDITIONS,
    Wanted,
    inputs,
    progress,
    run_case,
    summary,
    tables,
    with_controllers,
)

from haptic_accel import ParameterError
from haptic_accel.cli.options import controllers_option
from haptic_accel.cli.studies import journal_of
from haptic_accel.commands import (
    Workers,
    json_option,
    one_of,
    print_table,
    run,
    run_side_by_side,
    save,
    verb,
    workers_options,
)
from haptic_accel.controllers import CONTROLLERS
from haptic_accel.setup import graph
from haptic_accel.setup.node_parameters import HIGHEST_RATE


@verb(
    "python benchmarks/fidelity.py",
    "python benchmarks/fidelity.py textures taps --controllers none,inverse --json figures.json",
    "python benchmarks/fidelity.py recordings --recording drag.csv --recording-rate 10000",
)
@click.argument("conditions", nargs=-1, metavar="[CONDITION ...]")
@controllers_option(CONTROLLERS, default=CONTROLLERS)
@click.option("--rig", default="", metavar="RIG", help="Virtual rig of all conditions.")
@click.option(
    "--rate", type=click.FloatRange(50.0, HIGHEST_RATE), metavar="HZ", help="Rate of all, Hz."
)
@click.option(
    "--recording",
    "recordings",
    multiple=True,
    metavar="FILE",
    help="CSV or WAV file of a tool acceleration, in place of the simulated surfaces; may be given"
    " many times.",
)
@click.option(
    "--recording-rate",
    "recording_rates",
    multiple=True,
    type=float,
    metavar="HZ",
    help="Sampling rate of each CSV file, or once for all, Hz.",
)
@click.option("--hands", type=click.IntRange(0, 1000), default=50, help="Number of hand models.")
@click.option("--seed", default=1, help="Seed of hand parameters and of inputs.")
@workers_options
@json_option
def fidelity(
    *,
    conditions: Sequence[str],
    controllers: Sequence[str],
    rig: str,
    rate: float | None,
    recordings: Sequence[str],
    recording_rates: Sequence[float],
    hands: int,
    seed: int,
    workers: Workers,
    json_file: Path | None,
) -> None:
    """Measure the tracking error of all controllers in lockstep.

    Conditions are surfaces (both rigs, also at 4 kHz), rates (1 to 8 kHz, each with more
    delay granted), hands, wide (unusual hands), grips (that change), textures, taps,
    modes (of a handle that the controllers do not know) and recordings (scaled); surfaces, hands
    and grips by default. Prints errors beside the lowest that a causal linear filter could reach,
    without limits and within them, the share of the vibration whose strength a hand could not tell
    from the desired one, and how much worse than without controller any two seconds are. Families
    of inputs, handles and sensors have a benchmark of their own, families.py.
    """
    names = [one_of(CONDITIONS)(name) for name in conditions] or DEFAULT_CONDITIONS
    if "recordings" in names and not recordings:
        raise ParameterError("recordings: needs --recording")
    wanted = Wanted(inputs(recordings, recording_rates), rig, rate or 0.0, hands, seed)
    trials = [case for name in dict.fromkeys(names) for case in CONDITIONS[name](wanted)]
    cases = [case for trial in trials for case in with_controllers(trial, controllers)]
    for case in trials:
        graph(case.arguments)  # so that a wrong file is named before all trials
    found, end = run_side_by_side(
        workers, run_case, cases, "trials", progress, journal_of(json_file)
    )
    if rows := [*found.values()]:
        means = summary(rows)
        for each in tables(means):
            print_table(each)
        save({"rows": rows, "summary": means}, json_file)
    if end:
        raise end


if __name__ == "__main__":
    run(fidelity, "fidelity")
