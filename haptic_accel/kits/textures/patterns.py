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

"""Waveforms of vibration patterns for phones and controllers: AHAP and ``.haptic`` files."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from haptic_accel.core.document import Document, read_json_document
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, Specification

DULLEST, SHARPEST = 65.0, 300.0
"""Frequencies for sharpness 0 and 1, Hz, as in the reference encoder of MPEG-I haptics."""

TRANSIENT = 0.03
"""Duration of a transient, s."""

TRANSIENT_DECAY = 150.0
"""Decay rate of a transient, 1/s: to a hundredth within its duration."""

LONGEST_PATTERN = 60.0
"""Maximum duration of a pattern, s."""

MOST_EVENTS = 10_000
"""Maximum number of events in a pattern; most have a hundred."""

LONGEST_IN_ALL = 1200.0
"""Maximum total duration of the events in a pattern, s: twenty at once during the longest
pattern."""

_INTENSITY, _SHARPNESS = 1.0, 0.5  # defaults of events
_SECONDS = Specification("time", "s", 0.0, LONGEST_PATTERN)
_RELATIVE = Specification("relative value", "", -1.0, 1.0)


@dataclass(frozen=True, eq=False)
class _Envelope:
    """Values between points of increasing time; `before` applies ahead of the first point."""

    before: float
    times: FloatArray = field(default_factory=lambda: np.empty(0))
    values: FloatArray = field(default_factory=lambda: np.empty(0))
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def through(cls, before: float, points: Iterable[tuple[float, float]]) -> _Envelope:
        times, values = np.array(sorted(points)).reshape(-1, 2).T
        return cls(before, times, values)

    def at(self, time: FloatArray) -> FloatArray:
        found = np.full(len(time), self.before)
        if len(self.times):
            found = np.interp(time, self.times, self.values, left=self.before)
        return np.asarray(self.factor * found + self.offset)


@dataclass(frozen=True)
class _Event:
    """Vibration with envelopes of relative intensity and sharpness."""

    start: float
    duration: float
    decay: float
    intensity: _Envelope
    sharpness: _Envelope


def read_pattern(path: Path, rate: float) -> FloatArray:
    """Return the waveform of an AHAP or ``.haptic`` file.

    Continuous events are sinusoids, transients decay, and sharpness determines the frequency.
    Sounds and keys of other programs are ignored.

    Parameters
    ----------
    path : Path
        File; its suffix gives the format.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (n,)
        Waveform; 1 is an event of full intensity.

    Raises
    ------
    ParameterError
        The file cannot be read, or a value is invalid; the message is one line.
    """
    read = _haptic_events if path.suffix.lower() == ".haptic" else _ahap_events
    events = list(itertools.islice(read(read_json_document(path)), MOST_EVENTS + 1))
    if len(events) > MOST_EVENTS:
        raise ParameterError(f"{path}: must have at most {MOST_EVENTS} events")
    if (total := sum(event.duration for event in events)) > LONGEST_IN_ALL:
        raise ParameterError(
            f"{path}: its events take {total:g} s together: must be at most {LONGEST_IN_ALL:g} s"
        )
    end = max((event.start + event.duration for event in events), default=0.0)
    time = np.arange(math.ceil(end * rate)) / rate
    wave = np.zeros(len(time))
    for event in events:
        span = slice(round(event.start * rate), round((event.start + event.duration) * rate))
        wave[span] += _vibration(event, time[span], rate)
    if not wave.any():
        raise ParameterError(f"{path}: is silent: must have an event of intensity above 0")
    return wave


def _vibration(event: _Event, time: FloatArray, rate: float) -> FloatArray:
    share = np.clip(event.sharpness.at(time), 0, 1)
    phase = 2 * np.pi * np.cumsum(DULLEST + (SHARPEST - DULLEST) * share) / rate
    amplitude = np.clip(event.intensity.at(time), 0, 1) * np.exp(
        -event.decay * (time - event.start)
    )
    return np.asarray(amplitude * np.sin(phase))


def _ahap_events(file: Document) -> Iterator[_Event]:
    items = list(file.at("Pattern").items())
    curves = [item.at("ParameterCurve") for item in items if "ParameterCurve" in item]
    control = {
        kind: _Envelope.through(neutral, _control_points(curves, f"Haptic{kind}Control"))
        for kind, neutral in (("Intensity", 1.0), ("Sharpness", 0.0))
    }
    for event in (item.at("Event") for item in items if "Event" in item):
        kind = event.at("EventType").text()
        if kind not in ("HapticTransient", "HapticContinuous"):
            continue
        brief = kind == "HapticTransient"
        own = _parameters(event)
        yield _Event(
            event.at("Time").number(_SECONDS),
            TRANSIENT if brief else event.at("EventDuration").number(_SECONDS),
            TRANSIENT_DECAY if brief else 0.0,
            replace(control["Intensity"], factor=own.get("Intensity", _INTENSITY)),
            replace(control["Sharpness"], offset=own.get("Sharpness", _SHARPNESS)),
        )


def _parameters(event: Document) -> Mapping[str, float]:
    """Return an event's values by the names of their kind, without "Haptic"."""
    listed = event.at("EventParameters").items() if "EventParameters" in event else ()
    return {
        each.at("ParameterID").text().removeprefix("Haptic"): each.at("ParameterValue").number(
            _RELATIVE
        )
        for each in listed
        if each.at("ParameterID").text() in ("HapticIntensity", "HapticSharpness")
    }


def _control_points(curves: Iterable[Document], kind: str) -> Iterator[tuple[float, float]]:
    for curve in curves:
        if curve.at("ParameterID").text() == kind:
            start = curve.at("Time").number(_SECONDS)
            for point in curve.at("ParameterCurveControlPoints").items():
                time = start + point.at("Time").number(_SECONDS)
                yield time, point.at("ParameterValue").number(_RELATIVE)


def _haptic_events(file: Document) -> Iterator[_Event]:
    envelopes = file.at("signals", "continuous", "envelopes")
    points = list(envelopes.at("amplitude").items())
    amplitude = _breakpoints(points, "amplitude", 0.0)
    frequency = _breakpoints(
        envelopes.at("frequency").items() if "frequency" in envelopes else (),
        "frequency",
        _SHARPNESS,
    )
    end = float(amplitude.times.max(initial=0.0))
    yield _Event(0.0, end, 0.0, amplitude, frequency)
    for point in points:
        if "emphasis" in point:
            emphasis = point.at("emphasis")
            yield _Event(
                point.at("time").number(_SECONDS),
                TRANSIENT,
                TRANSIENT_DECAY,
                _Envelope(emphasis.at("amplitude").number(_RELATIVE)),
                _Envelope(emphasis.at("frequency").number(_RELATIVE)),
            )


def _breakpoints(points: Iterable[Document], key: str, before: float) -> _Envelope:
    pairs = ((each.at("time").number(_SECONDS), each.at(key).number(_RELATIVE)) for each in points)
    return _Envelope.through(before, pairs)
