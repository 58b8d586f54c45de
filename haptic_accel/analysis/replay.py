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

"""Bags played in lockstep through a controller, and the resulting errors."""

from __future__ import annotations

import shutil
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from haptic_accel.analysis.description import surface_of
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tables import Column, Row
from haptic_accel.core.track import Track
from haptic_accel.core.trial import Trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.replay import Replay, ReplayArguments, replayed_track
from haptic_accel.setup.setup import Setup

COLUMNS = (
    Column("bag", "bag", value=lambda row: Path(row["bag"]).name),
    Column("surface", "surface"),
    Column("controller", "controller"),
    Column("after_samples", "after\nsamples"),
    Column("nrmse_percent", "NRMSE\n%", digits=2),
    Column("slope_actual_on_desired", "slope\na on d", digits=3),
    Column("slope_desired_on_actual", "slope\nd on a", digits=3),
    Column("r2", "R²", digits=3),
)
"""Columns of the table; the slopes are of actual on desired, and the reverse."""


@dataclass(frozen=True)
class PlayedCondition:
    """A bag, the graph that plays it, and the bag of the result."""

    own: ReplayArguments
    graph: GraphArguments
    touched: str
    out: Path | None


def play(condition: PlayedCondition) -> Row:
    """Play a bag through a controller; record the result if a bag is given for it."""
    start = time.time_ns()
    track = replayed_track(condition.own, condition.graph)
    setup = Setup.of(condition.graph)
    trial = lockstep_trial(setup, track=track)
    trial = replace(trial, surface=condition.touched)
    metrics = _metrics(condition.own.bag, trial, track)
    if condition.out:
        shutil.rmtree(condition.out, ignore_errors=True)  # that of a lost process
        record_trial(condition.out, trial, setup, start)
    return metrics


def progress(row: Row) -> str:
    """Return a condition's error for a reader."""
    return f"{Path(row['bag']).name} / {row['controller']}: {row['nrmse_percent']:.2f} %"


def touching(asked: Replay) -> Replay:
    """Return a replay with its bag's surface, without the bag itself."""
    touched = surface_of(asked.bag) if asked.bag else asked.graph.surface
    return replace(asked, bag=None, touched=touched)


def _metrics(bag: str, trial: Trial, track: Track) -> Row:
    """Return the metrics of a bag played through a controller."""
    try:
        evaluation = trial.evaluate()
    except ValueError as error:
        raise ParameterError(f"{bag}: {error}") from None
    return {
        "bag": bag,
        "surface": trial.surface,
        "controller": trial.controller,
        **asdict(evaluation),
        "seconds": trial.seconds,
        "rate_hz": trial.rate,
        "latency_samples": trial.latency,
        "after_samples": trial.after,
        "lost": int(track.lost.sum()),
    }
