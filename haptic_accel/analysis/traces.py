# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals of a trial for plots and pages: parts of them, thinned or at full resolution.

The drawn data of a trial are kept as a `Portrait`, a few thousand numbers, so that a long
recording need not stay in memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXES, Axes
from haptic_accel.core.evaluation import metrics
from haptic_accel.core.evaluation.metrics import by_component, components, lengths
from haptic_accel.core.model import FloatArray

EXCERPT = 0.2
"""Length of the excerpt shown first, s: some strokes of texture with visible oscillations."""

ACTIVE = 0.5
"""Minimum RMS of a signal, relative to its largest RMS, in the excerpt of another trial for which
that excerpt is used."""

WHOLE_POINTS = 6000
"""Number of points of a whole trial: three per pixel on a wide screen."""

DETAIL = 2.0
"""Length of the part at full resolution, s."""

DETAIL_POINTS = 4000
"""Maximum number of points at full resolution; covers less than `DETAIL` above 2 kHz."""

MOST_POINTS = 4000
"""Maximum number of points in a scatter plot; more would overlap."""

PATH = 0.05
"""Length of a path in the planes of two axes, s: several periods of texture, which the eye can
distinguish."""

LEAST_R2 = metrics.ALIKE**2
"""Minimum R^2 for drawing a regression line, equal to the minimum correlation for a delay. Below
it the samples have almost nothing in common."""


@dataclass(frozen=True)
class Trace:
    """Signals over one period of time, all with the same number of points.

    Attributes
    ----------
    begin, step : float
        Time of the first point, and time between points, s.
    signals : dict of ndarray
        Values of each signal by name.
    """

    begin: float
    step: float
    signals: dict[str, FloatArray]

    @property
    def size(self) -> int:
        """Number of points."""
        return max(map(len, self.signals.values()), default=0)

    def thinned(self, points: int) -> Trace:
        """Return a trace with a maximum number of points that keeps all peaks."""
        found = {name: thinned(values, points) for name, values in self.signals.items()}
        step = next((step for _, step in found.values()), 1.0)
        kept = {name: values for name, (values, _) in found.items()}
        return Trace(self.begin, self.step * step, kept)

    def part(self, window: slice) -> Trace:
        """Return the points of a window."""
        signals = {name: values[window].copy() for name, values in self.signals.items()}
        return Trace(self.begin + window.start * self.step, self.step, signals)


@dataclass(frozen=True)
class Traces:
    """Signals of a trial over time.

    Attributes
    ----------
    whole : Trace
        Whole trial, thinned with all peaks.
    detail : Trace
        Samples around the excerpt.
    excerpt : float
        Start of the `EXCERPT` with the largest RMS of the desired acceleration, s.
    """

    whole: Trace
    detail: Trace
    excerpt: float

    @classmethod
    def of(
        cls,
        signals: Mapping[str, FloatArray],
        rate: float,
        shift: float,
        begin: float | None = None,
        axes: Axes = ACTUATOR_AXES,
    ) -> Traces:
        """Thin some signals; shift the signal ``actual`` back by the shift in s.

        The difference ``error``, actual minus desired, is added. The components of vectors are
        named as in ``desired_x``. See `excerpt_of` for `begin`.
        """
        if not signals:
            nothing = Trace(0.0, 1.0, {})
            return cls(nothing, nothing, 0.0)
        earlier = partial(_earlier, samples=shift * rate)
        moved = {
            name: by_component(earlier, values) if name == "actual" else values
            for name, values in signals.items()
        }
        if {"desired", "actual"} <= moved.keys():
            # After thinning, points of two signals have different times.
            moved["error"] = moved["actual"] - moved["desired"]
        every = Trace(0.0, 1 / rate, dict(named_components(moved, axes)))
        leading = lengths(moved.get("desired", next(iter(moved.values()))))
        excerpt = excerpt_of(leading, rate, begin)
        window = enclosing(excerpt, leading.size, min(round(DETAIL * rate), DETAIL_POINTS))
        start = excerpt.start / rate
        return cls(every.thinned(WHOLE_POINTS), every.part(window), start)

    def shrunk(self, points: int) -> tuple[Trace, Trace]:
        """Thin both traces to a maximum total of points; keep the excerpt complete."""
        detail = self.detail
        begin = round((self.excerpt - detail.begin) / detail.step)
        excerpt = slice(begin, min(begin + round(EXCERPT / detail.step), detail.size))
        window = enclosing(excerpt, detail.size, points * 4 // 10)
        return self.whole.thinned(min(points * 6 // 10, WHOLE_POINTS)), detail.part(window)


def named_components(
    signals: Mapping[str, FloatArray], axes: Axes
) -> Iterator[tuple[str, FloatArray]]:
    """Yield signals by name; several axes are named by component, as in ``desired_x``."""
    for name, values in signals.items():
        ends = [f"_{axis}" for axis in axes.names] if values.ndim > 1 else [""]
        for end, component in zip(ends, components(values), strict=True):
            yield name + end, component


def _earlier(values: FloatArray, samples: float) -> FloatArray:
    """Shift a signal to earlier times for display, with linear interpolation."""
    positions = np.arange(len(values), dtype=float)
    return np.interp(positions + samples, positions, values)


def thinned(values: FloatArray, points: int) -> tuple[FloatArray, float]:
    """Return the extremes of a signal, so that its drawing keeps all peaks.

    Parameters
    ----------
    values : ndarray, shape (n,)
    points : int
        Maximum number of points to keep; even, at least 2.

    Returns
    -------
    kept : ndarray
        The signal itself if it is short enough; otherwise minimum and maximum of equal pieces, in
        order of time.
    step : float
        Number of samples per point.
    """
    if len(values) <= points:
        return values, 1.0
    edges = np.linspace(0, len(values), points // 2 + 1).astype(int)[1:-1]
    pieces = np.split(values, edges)
    kept = np.concatenate([piece[sorted((piece.argmin(), piece.argmax()))] for piece in pieces])
    return kept, len(values) / len(kept)


def most_active(values: FloatArray, samples: int) -> slice:
    """Return the first window of a length with the largest RMS."""
    samples = min(max(samples, 1), values.size)
    energy = np.concatenate([[0.0], np.cumsum(values**2)])
    start = int(np.argmax(energy[samples:] - energy[:-samples]))
    return slice(start, start + samples)


def excerpt_of(values: FloatArray, rate: float, begin: float | None = None) -> slice:
    """Return the drawn `EXCERPT` of a signal.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rate : float
        Samples per second.
    begin : float, optional
        Start of another trial's excerpt, s. It is used if the signal is `ACTIVE` there, so that
        trials show the same time. Otherwise the excerpt with the largest RMS is used.
    """
    found = most_active(values, round(EXCERPT * rate))
    if begin is None:
        return found
    start = round(begin * rate)
    other = slice(start, start + found.stop - found.start)
    if not 0 <= start <= values.size - (found.stop - found.start):
        return found
    rms = [math.sqrt(float(np.mean(values[part] ** 2))) for part in (found, other)]
    return other if rms[1] >= ACTIVE * rms[0] else found


def enclosing(inner: slice, size: int, samples: int) -> slice:
    """Return a window of `samples`, among `size`, with `inner` at its centre.

    The window is shifted to stay within the ends, and is not shorter than `inner`.
    """
    length = inner.stop - inner.start
    samples = min(max(samples, length), size)
    start = inner.start - (samples - length) // 2
    start = min(max(start, 0), size - samples)
    return slice(start, start + samples)


def sampled(size: int, most: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the indices of a limited number of points of a cloud.

    They are drawn at random from a fixed seed, as every n-th point would alias a periodic signal.
    """
    if size <= most:
        return np.arange(size)
    return np.random.default_rng(0).choice(size, most, replace=False)


@dataclass(frozen=True)
class Portrait:
    """Drawn parts of a trial, after the shift.

    Attributes
    ----------
    rate : float
        Samples per second.
    evaluation : metrics.Evaluation
    spectra : Spectra
    begin : float
        Start of the excerpt, s.
    desired, actual : ndarray, shape (n,) for one axis or (n, k) for several
        Excerpt, m/s^2.
    cloud_desired, cloud_actual : ndarray, shape (m,) or (m, k)
        Samples drawn at random from the whole trial, m/s^2.
    mean_desired, mean_actual : float
        m/s^2.
    largest : float
        Largest magnitude in either signal, m/s^2.
    by_axis : dict of Portrait
        Portraits of vectors' components by axis, with the same excerpt and samples.
    """

    rate: float
    evaluation: metrics.Evaluation
    spectra: metrics.Spectra
    begin: float
    desired: FloatArray
    actual: FloatArray
    cloud_desired: FloatArray
    cloud_actual: FloatArray
    mean_desired: float
    mean_actual: float
    largest: float
    by_axis: Mapping[str, Portrait] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        desired: FloatArray,
        actual: FloatArray,
        rate: float,
        evaluation: metrics.Evaluation,
        begin: float | None = None,
        by_axis: Mapping[str, metrics.Evaluation] | None = None,
    ) -> Portrait:
        """Return the plotted parts of two aligned accelerations.

        See `excerpt_of` for `begin`; `by_axis` has the evaluation of each component of vectors.
        """
        window = excerpt_of(lengths(desired), rate, begin)
        whole = cls._of(desired, actual, rate, evaluation, window)
        own = {}
        if by_axis:
            parts = zip(by_axis.items(), components(desired), components(actual), strict=True)
            own = {axis: cls._of(d, a, rate, found, window) for (axis, found), d, a in parts}
        return replace(whole, by_axis=own)

    @classmethod
    def _of(
        cls,
        desired: FloatArray,
        actual: FloatArray,
        rate: float,
        evaluation: metrics.Evaluation,
        window: slice,
    ) -> Portrait:
        points = sampled(len(desired), MOST_POINTS)
        found, begin = metrics.spectra(desired, actual, rate), window.start / rate
        excerpt = desired[window].copy(), actual[window].copy()
        cloud = desired[points], actual[points]
        means = float(desired.mean()), float(actual.mean())
        largest = extent((desired, actual))
        return cls(rate, evaluation, found, begin, *excerpt, *cloud, *means, largest)

    @property
    def regressed(self) -> bool:
        """True if the signals have enough in common for a regression line."""
        return self.evaluation.r2 >= LEAST_R2


Portraits = Mapping[tuple[str, str], Portrait]
"""Portraits by controller and surface; some combinations may be missing."""


def extent(signals: Iterable[FloatArray]) -> float:
    """Return the largest magnitude in some signals, or 1 if all are zero."""
    return max((float(np.abs(signal).max()) for signal in signals), default=0.0) or 1.0
