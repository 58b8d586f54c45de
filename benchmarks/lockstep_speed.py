# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed of a trial in lockstep, relative to real time: ``python benchmarks/lockstep_speed.py``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from haptic_accel.cli.main import run
from haptic_accel.cli.options import Verb, json_option, words
from haptic_accel.cli.output import save
from haptic_accel.core.process import DONE
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.lockstep import lockstep_trial


@click.command(cls=Verb)
@words(GraphArguments)
@click.option("--rate", type=float, default=1000.0, help="Sampling rate, Hz.")
@click.option("--seconds", type=float, default=10.0, help="Length of the trial, s.")
@json_option
def lockstep_speed(
    words: Sequence[str], *, rate: float, seconds: float, json_file: Path | None
) -> int:
    """Run one trial in lockstep on one core, and print its duration."""
    arguments = replace(parse_arguments(words), rate=rate, duration=seconds)
    lockstep_trial(replace(arguments, duration=10 / rate))  # imports and tables are loaded once
    start = time.perf_counter()
    trial = lockstep_trial(arguments)
    wall = time.perf_counter() - start
    results = {
        "rate_hz": rate,
        "simulated_seconds": trial.seconds,
        "wall_seconds": wall,
        "times_real_time": trial.seconds / wall,
    }
    print(
        f"{arguments.rig} rig, {trial.surface}, {trial.controller}: {trial.seconds:g} s at"
        f" {rate:g} Hz in {wall:.2f} s, {results['times_real_time']:.1f} times real time"
    )
    save(results, json_file)
    return DONE


if __name__ == "__main__":
    run(lockstep_speed, "lockstep_speed.py")
