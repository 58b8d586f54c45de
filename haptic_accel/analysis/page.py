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

"""Page of an analysis: one file that contains its plots and their data."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.analysis import frames
from haptic_accel.analysis.frames import Comparison
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.metrics import METRICS, MILLI, PERCENT, VECTOR_METRICS, AnalysedTrial
from haptic_accel.analysis.plots import PATH, Portrait
from haptic_accel.analysis.provenance import provenance
from haptic_accel.analysis.summary import summary
from haptic_accel.analysis.traces import EXCERPT, Trace, sampled
from haptic_accel.core.evaluation.metrics import REGRESSION
from haptic_accel.core.evaluation.statistics import CONFIDENCE
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tables import ResultTable, number
from haptic_accel.pages import write

POINTS = 100_000
"""Number of points for the time traces of a page, shared by its trials: about a megabyte for five
signals."""

FEWEST_POINTS = 500
"""Minimum number of points of each trial."""

CLOUD_POINTS = 1500
"""Number of points for a trial's regression."""

FULL_SCALE = 32767
"""Maximum integer for stored signals; finer than the resolution of any screen."""

_OMITTED = "nrmse_percent delay_correlation shift_ms age_p50_us age_max_us"
PER_TRIAL = tuple(name for name in METRICS if name not in _OMITTED.split())
"""Columns of the table of trials after the error."""

PER_GROUP = (
    *("indistinguishable_percent", "slope_desired_on_actual", "slope_actual_on_desired", "r2"),
    *("delay_ms", "delay_correlation"),
    *("deadlines_missed_percent", "late_time_percent"),
)
"""Columns of the table of groups, each with its interval over trials."""

_UNITS = {"travel": MILLI}  # of signals over time, if not SI


@dataclass(frozen=True)
class Setting:
    """Text of a page in addition to the metrics.

    Attributes
    ----------
    title : str
        Heading of the page.
    notes : sequence of str
        Paragraphs below Table II.
    settings : mapping of str to str
        Arguments of the run, shown as a table.
    pictures : mapping of str to str
        Captions of picture files beside the page, by file name.
    beside : ResultTable, optional
        Errors of the same trials from another run.
    """

    title: str = "Haptic display of tool contact: analysis"
    notes: Sequence[str] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    pictures: Mapping[str, str] = field(default_factory=dict)
    beside: ResultTable | None = None


def write_page(
    analysis: Analysis,
    file: Path,
    comparison: Comparison | None = None,
    *,
    setting: Setting | None = None,
    files: Sequence[str] = (),
) -> None:
    """Write an analysis as a page without external scripts or network access.

    Parameters
    ----------
    analysis : Analysis
    file : Path
    comparison : Comparison, optional
    setting : Setting, optional
    files : sequence of str
        Names of linked files beside `file`.
    """
    setting = setting or Setting()
    found = sorted(analysis.trials, key=lambda t: frames.ranks((t.controller, t.surface)))
    ordered = replace(analysis, trials=found)
    frame, grouped = frames.trials(ordered), frames.groups(ordered)
    of_vectors = frames.vector_metrics(ordered)
    write(
        file,
        "analysis.html.j2",
        setting=setting,
        settings={**setting.settings, **provenance()},
        summary=summary(analysis, comparison),
        analysis=analysis,
        confidence=f"{PERCENT * CONFIDENCE:g} %",
        table=frames.table_two(grouped),
        metrics={**METRICS, **VECTOR_METRICS},
        per_trial=(*of_vectors, *PER_TRIAL),
        per_group=(*of_vectors, *PER_GROUP),
        with_vectors=bool(of_vectors),
        trials=frame.to_dict("records"),
        groups=grouped.to_dict("records"),
        published=REGRESSION,
        bands={name: frames.band_column(name) for name in frames.band_names(ordered)},
        forces=[
            (*key, own.force_rms_N.mean(), own.force_peak_N.max(), own.travel_mm.max())
            for key, own in frames.by_condition(frame)
            if own.force_rms_N.notna().any()
        ],
        free=MILLI * min((t.segment.actuator.travel for t in found), default=math.nan),
        losses=_losses(found),
        comparison=comparison,
        notes={
            t.name: lines for t in found if (lines := [*t.notes, *t.segment.delivery.warnings])
        },
        files=files,
        figure=number,
        finite=math.isfinite,
        data=_embedded(_data(found)),
    )


def _losses(found: Sequence[AnalysedTrial]) -> list[tuple[str, str, int]]:
    """Return trial, topic, and number of lost samples for each loss."""
    rows = []
    for name, delivery in ((trial.name, trial.segment.delivery) for trial in found):
        rows += [(name, topic, lost) for topic, lost in delivery.lost.items()]
        rows += [
            (name, f"samples of the {arm} without any message", missed)
            for arm, missed in delivery.missed.items()
        ]
    return [row for row in rows if row[2]]


def _data(found: Sequence[AnalysedTrial]) -> dict[str, Any]:
    """Return the data for the page's script; the trial with the least error is shown first."""
    share = max(POINTS // max(len(found), 1), FEWEST_POINTS)
    errors = [t.error.value if math.isfinite(t.error.value) else math.inf for t in found]
    return {
        "excerpt": EXCERPT,
        "path": PATH,
        "first": errors.index(min(errors)) if errors else 0,
        "trials": [_drawn(trial, share) for trial in found],
    }


def _drawn(trial: AnalysedTrial, points: int) -> dict[str, Any]:
    whole, detail = trial.traces.shrunk(points)
    axes = trial.segment.axes.names
    by_axis = trial.portrait.by_axis if trial.portrait else {}
    return {
        "name": trial.name,
        "controller": trial.controller,
        "surface": trial.surface,
        "whole": _packed_trace(whole),
        "detail": _packed_trace(detail),
        "begin": trial.traces.excerpt,
        **_likeness(None if by_axis else trial.portrait),
        "free": trial.segment.actuator.travel * MILLI,
        "axes": {axis: _likeness(by_axis.get(axis)) for axis in axes} if len(axes) > 1 else None,
    }


def _likeness(portrait: Portrait | None) -> dict[str, Any]:
    """Return regression and spectra of one axis."""
    return {"cloud": portrait and _cloud(portrait), "spectra": portrait and _spectra(portrait)}


def _packed_trace(trace: Trace) -> dict[str, Any]:
    signals = {
        name: _packed(values * _UNITS.get(name.split("_")[0], 1.0))
        for name, values in trace.signals.items()
    }
    return {"begin": trace.begin, "step": trace.step, "signals": signals}


def _packed(values: FloatArray) -> dict[str, Any]:
    """Return a signal as base64-encoded 16-bit integers, and the value of one step."""
    scale = (float(np.max(np.abs(values))) if values.size else 0.0) / FULL_SCALE or 1.0
    numbers = np.round(values / scale).astype("<i2")
    return {"scale": scale, "data": base64.b64encode(numbers.tobytes()).decode("ascii")}


def _cloud(portrait: Portrait) -> dict[str, Any]:
    points = sampled(portrait.cloud_actual.size, CLOUD_POINTS)
    points = points[np.argsort(portrait.cloud_actual[points])]
    return {
        "actual": _packed(portrait.cloud_actual[points]),
        "desired": _packed(portrait.cloud_desired[points]),
        "slope": portrait.evaluation.slope_desired_on_actual if portrait.regressed else None,
        "middle": [portrait.mean_actual, portrait.mean_desired],
        "r2": portrait.evaluation.r2 if math.isfinite(portrait.evaluation.r2) else 0.0,
    }


def _spectra(portrait: Portrait) -> dict[str, Any]:
    found = portrait.spectra
    return {
        "step": float(found.frequency[1]),
        "desired": [float(f"{value:.4g}") for value in found.desired.tolist()],
        "actual": [float(f"{value:.4g}") for value in found.actual.tolist()],
        "coherence": [round(value, 4) for value in found.coherence.tolist()],
    }


def _embedded(data: Mapping[str, Any]) -> str:
    """Return data as JSON that cannot close its HTML element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
