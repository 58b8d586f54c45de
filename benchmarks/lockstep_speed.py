# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed of a trial in lockstep, relative to real time: ``python benchmarks/lockstep_speed.py``.

What runs in every sample may be compiled; the same trial is then measured in plain Python as well,
in a process of its own. The shares of the sections are those of plain Python, by a profile, which
makes short functions look longer.
"""

from __future__ import annotations

import cProfile
import json
import math
import os
import pstats
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from haptic_accel.commands import DONE
from haptic_accel.core.process import BLAS_THREADS

# As in a verb, before numpy is loaded: one core, as stated.
for variable in BLAS_THREADS:
    os.environ.setdefault(variable, "1")

from haptic_accel import GraphArguments, Setup, lockstep_trial  # noqa: E402
from haptic_accel.commands import Verb, json_option, run, save, words  # noqa: E402
from haptic_accel.core.tick import COMPILED, TICK  # noqa: E402
from haptic_accel.setup.arguments import parse_arguments  # noqa: E402


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
    setup, wall, work = Setup.of(arguments), math.inf, math.inf
    # Imports and tables are loaded once.
    lockstep_trial(Setup.of(replace(arguments, duration=10 / rate)))
    for _ in range(runs):
        start, worked = time.perf_counter(), time.process_time()
        trial = lockstep_trial(setup)
        wall = min(wall, time.perf_counter() - start)
        work = min(work, time.process_time() - worked)
    results: dict[str, object] = {
        "tick": TICK,
        "rate_hz": rate,
        "simulated_seconds": trial.seconds,
        "wall_seconds": wall,
        "times_real_time": trial.seconds / wall,
        "processor_us_per_sample": 1e6 * work / len(trial.time),
    }
    print(
        f"{arguments.rig} rig, {trial.surface}, {trial.controller}, {TICK}: {trial.seconds:g} s at"
        f" {rate:g} Hz in {wall:.2f} s at best, {trial.seconds / wall:.1f} times real time,"
        f" {1e6 * work / len(trial.time):.1f} us of processor time a sample"
    )
    if TICK == COMPILED:
        results["plain"] = _in_plain_python()
    else:
        shares = _shares(setup)
        print(", ".join(f"{name} {part:.0f} %" for name, part in shares.items()))
        results["shares_percent"] = shares
    save(results, json_file)
    return DONE


def _in_plain_python() -> object:
    """Repeat this command in plain Python; print its lines, and return its results."""
    command = [sys.executable, *sys.argv, "--json", "/dev/stderr"]
    plain = {**os.environ, "HAPTIC_ACCEL_PLAIN": "1"}
    run = subprocess.run(command, env=plain, capture_output=True, text=True, check=True)
    print(run.stdout, end="")
    return json.loads(run.stderr)


def _shares(setup: Setup[GraphArguments]) -> dict[str, float]:
    """Return the share of each section in the time of a trial, percent, the largest first."""
    profile, times = cProfile.Profile(), Counter[str]()
    profile.runcall(lockstep_trial, setup)
    for (file, *_), (_, _, own, _, callers) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        # The time of a built-in function is its callers'.
        parts = {file: own} if file != "~" else {}
        for (caller, *_), (_, _, spent, _) in callers.items() if file == "~" else ():
            parts[caller] = parts.get(caller, 0.0) + spent
        for name, spent in parts.items():
            path = Path(name)
            times[path.stem if path.parent.name == "tick" else "slow work and others"] += spent
    total = sum(times.values())
    return {name: 100 * spent / total for name, spent in times.most_common()}


if __name__ == "__main__":
    run(lockstep_speed, "lockstep_speed.py")
