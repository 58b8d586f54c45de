# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vibration patterns of phones and controllers as waveforms: AHAP and ``.haptic`` files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, Specification, checked, shown

DULLEST, SHARPEST = 65.0, 300.0
"""Frequencies of sharpness 0 and 1, Hz, as in the reference encoder of MPEG-I haptics."""

TRANSIENT = 0.03
"""Duration of a transient, s."""

TRANSIENT_DECAY = 150.0
"""Decay of a transient, 1/s: to a hundredth within its duration."""

LONGEST = 60.0
"""Longest pattern, s."""

MOST_BYTES = 10_000_000
"""Largest file; patterns are a few kilobytes."""

_INTENSITY, _SHARPNESS = 1.0, 0.5  # where an event states none
_SECONDS = Specification("time", "s", 0.0, LONGEST)
_RELATIVE = Specification("relative value", "", -1.0, 1.0)


@dataclass(frozen=True)
class _Envelope:
    """Values between points in time; `before` holds ahead of the first one."""

    before: float
    points: tuple[tuple[float, float], ...] = ()

    def at(self, time: FloatArray) -> FloatArray:
        if not self.points:
            return np.full(len(time), self.before)
        times, values = zip(*self.points, strict=True)
        return np.asarray(np.interp(time, times, values, left=self.before))

    def changed(self, factor: float = 1.0, offset: float = 0.0) -> _Envelope:
        points = ((time, factor * value + offset) for time, value in self.points)
        return _Envelope(factor * self.before + offset, tuple(points))


@dataclass(frozen=True)
class _Event:
    """A vibration with envelopes of relative intensity and sharpness."""

    start: float
    duration: float
    decay: float
    intensity: _Envelope
    sharpness: _Envelope


def read_pattern(path: Path, rate: float) -> FloatArray:
    """Return the waveform of an AHAP or ``.haptic`` file.

    Continuous events are sinusoids, transients decay; sharpness gives the frequency. Sounds and
    the keys of other programs are left out.

    Parameters
    ----------
    path : Path
        Its suffix tells which of the two it is.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (n,)
        1 is an event of full intensity.

    Raises
    ------
    ParameterError
        The file cannot be read, or a value is not allowed: in one line.
    """
    content = read_json(path)
    read = _haptic_events if path.suffix.lower() == ".haptic" else _ahap_events
    events = list(read(JsonValue(str(path), content)))
    end = max((event.start + event.duration for event in events), default=0.0)
    time = np.arange(math.ceil(end * rate)) / rate
    wave = np.zeros(len(time))
    for event in events:
        span = slice(round(event.start * rate), round((event.start + event.duration) * rate))
        wave[span] += _vibration(event, time[span], rate)
    if not wave.any():
        raise ParameterError(f"{path}: is silent: must have an event of intensity above 0")
    return wave


def read_json(path: Path) -> Any:
    """Return what a file of JSON holds.

    Raises
    ------
    ParameterError
        It cannot be read.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ParameterError(f"{path}: must have at most {MOST_BYTES} bytes")
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ParameterError(f"{path}: must be a readable file: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(f"{path}: must be JSON: {shown(str(error))}") from None


class JsonValue:
    """A value in a file of JSON, with its place for messages."""

    def __init__(self, place: str, value: Any) -> None:
        self._place = place
        self._value = value

    def __contains__(self, key: str) -> bool:
        """Return True for a mapping that has a key."""
        return isinstance(self._value, dict) and key in self._value

    def at(self, *keys: str) -> JsonValue:
        """Return the value behind some keys."""
        found = self
        for key in keys:
            if key not in found:
                raise ParameterError(f"{found._place}: {key} = nothing: must be there")
            found = JsonValue(f"{found._place}: {key}", found._value[key])
        return found

    def items(self) -> Iterator[JsonValue]:
        """Yield the values of a list."""
        if not isinstance(self._value, list):
            raise ParameterError(f"{self._place} = {shown(repr(self._value))}: must be a list")
        for index, value in enumerate(self._value):
            yield JsonValue(f"{self._place}[{index}]", value)

    def number(self, key: str, specification: Specification) -> float:
        """Return the number behind a key, in its range."""
        return self.at(key).as_number(specification)

    def as_number(self, specification: Specification) -> float:
        """Return the value, a number in its range."""
        return float(checked(self._place, self._value, 0.0, specification))

    def word(self, key: str) -> str:
        """Return a value as text."""
        return str(self.at(key)._value)


def _vibration(event: _Event, time: FloatArray, rate: float) -> FloatArray:
    share = np.clip(event.sharpness.at(time), 0, 1)
    phase = 2 * np.pi * np.cumsum(DULLEST + (SHARPEST - DULLEST) * share) / rate
    amplitude = np.clip(event.intensity.at(time), 0, 1) * np.exp(
        -event.decay * (time - event.start)
    )
    return np.asarray(amplitude * np.sin(phase))


def _ahap_events(file: JsonValue) -> Iterator[_Event]:
    items = list(file.at("Pattern").items())
    curves = [item.at("ParameterCurve") for item in items if "ParameterCurve" in item]
    control = {
        kind: _Envelope(neutral, tuple(sorted(_control_points(curves, f"Haptic{kind}Control"))))
        for kind, neutral in (("Intensity", 1.0), ("Sharpness", 0.0))
    }
    for event in (item.at("Event") for item in items if "Event" in item):
        kind = event.word("EventType")
        if kind not in ("HapticTransient", "HapticContinuous"):
            continue
        brief = kind == "HapticTransient"
        own = _parameters(event)
        yield _Event(
            event.number("Time", _SECONDS),
            TRANSIENT if brief else event.number("EventDuration", _SECONDS),
            TRANSIENT_DECAY if brief else 0.0,
            control["Intensity"].changed(factor=own.get("Intensity", _INTENSITY)),
            control["Sharpness"].changed(offset=own.get("Sharpness", _SHARPNESS)),
        )


def _parameters(event: JsonValue) -> Mapping[str, float]:
    """Return the values of an event by the names of their kind, without "Haptic"."""
    listed = event.at("EventParameters").items() if "EventParameters" in event else ()
    return {
        each.word("ParameterID").removeprefix("Haptic"): each.number("ParameterValue", _RELATIVE)
        for each in listed
        if each.word("ParameterID") in ("HapticIntensity", "HapticSharpness")
    }


def _control_points(curves: Iterable[JsonValue], kind: str) -> Iterator[tuple[float, float]]:
    for curve in curves:
        if curve.word("ParameterID") == kind:
            start = curve.number("Time", _SECONDS)
            for point in curve.at("ParameterCurveControlPoints").items():
                time = start + point.number("Time", _SECONDS)
                yield time, point.number("ParameterValue", _RELATIVE)


def _haptic_events(file: JsonValue) -> Iterator[_Event]:
    envelopes = file.at("signals", "continuous", "envelopes")
    points = list(envelopes.at("amplitude").items())
    amplitude = _breakpoints(points, "amplitude", 0.0)
    frequency = _breakpoints(
        envelopes.at("frequency").items() if "frequency" in envelopes else (),
        "frequency",
        _SHARPNESS,
    )
    end = max((time for time, _ in amplitude.points), default=0.0)
    yield _Event(0.0, end, 0.0, amplitude, frequency)
    for point in points:
        if "emphasis" in point:
            emphasis = point.at("emphasis")
            yield _Event(
                point.number("time", _SECONDS),
                TRANSIENT,
                TRANSIENT_DECAY,
                _Envelope(emphasis.number("amplitude", _RELATIVE)),
                _Envelope(emphasis.number("frequency", _RELATIVE)),
            )


def _breakpoints(points: Iterable[JsonValue], key: str, before: float) -> _Envelope:
    pairs = ((each.number("time", _SECONDS), each.number(key, _RELATIVE)) for each in points)
    return _Envelope(before, tuple(sorted(pairs)))
