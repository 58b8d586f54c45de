# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Speed of a trial in lockstep, relative to real time: ``python benchmarks/lockstep_speed.py``."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from haptic_accel.core.process import BLAS_THREADS, DONE

# As in a verb, before numpy is loaded: one core, as stated.
for variable in BLAS_THREADS:
    os.environ.setdefault(variable, "1")

from haptic_accel.cli.main import run  # noqa: E402
from haptic_accel.cli.options import Verb, json_option, words  # noqa: E402
from haptic_accel.cli.output import save  # noqa: E402
from haptic_accel.setup.arguments import GraphArguments, parse_arguments  # noqa: E402
from haptic_accel.setup.lockstep import lockstep_trial  # noqa: E402
from haptic_accel.setup.setup import Setup  # noqa: E402


@click.command(cls=Verb)
@words(GraphArguments)
@click.option("--rate", type=float, default=1000.0, help="Sampling rate, Hz.")
@click.option("--seconds", type=float, default=10.0, help="Length of the trial, s.")
@click.option("--runs", type=click.IntRange(1), default=3, help="Runs; the fastest counts.")
@json_option
def lockstep_speed(
    words: Sequence[str], *, rate: float, seconds: float, runs: int, json_file: Path | None
) -> int:
    """Run one trial in lockstep on one core several times, and print the shortest duration."""
    arguments = replace(parse_arguments(words), rate=rate, duration=seconds)
    setup, wall = Setup.of(arguments), math.inf
    # Imports and tables are loaded once.
    lockstep_trial(Setup.of(replace(arguments, duration=10 / rate)))
    for _ in range(runs):
        start = time.perf_counter()
        trial = lockstep_trial(setup)
        wall = min(wall, time.perf_counter() - start)
    results = {
        "rate_hz": rate,
        "simulated_seconds": trial.seconds,
        "wall_seconds": wall,
        "times_real_time": trial.seconds / wall,
    }
    print(
        f"{arguments.rig} rig, {trial.surface}, {trial.controller}: {trial.seconds:g} s at"
        f" {rate:g} Hz in {wall:.2f} s at best, {results['times_real_time']:.1f} times real time"
    )
    save(results, json_file)
    return DONE


if __name__ == "__main__":
    run(lockstep_speed, "lockstep_speed.py")
