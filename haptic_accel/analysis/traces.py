"""What a page draws of a trial over time: all of it thinned, and its liveliest part in full."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from haptic_accel.analysis.plots import EXCERPT
from haptic_accel.analysis.thinning import around, liveliest, thinned
from haptic_accel.core.model import FloatArray

WHOLE_POINTS = 6000
"""Points of a whole trial: three to each pixel of a wide screen."""

DETAIL = 2.0
"""Length of the part that is kept in full, s."""

DETAIL_POINTS = 4000
"""Most points of it: less than `DETAIL` at rates above 2 kHz."""


@dataclass(frozen=True)
class Trace:
    """Some signals of one stretch of time, all of the same number of points.

    Attributes
    ----------
    begin, step : float
        Of the first point, and from one to the next, s.
    signals : dict of ndarray
        By name.
    """

    begin: float
    step: float
    signals: dict[str, FloatArray]


@dataclass(frozen=True)
class Traces:
    """A trial over time.

    Attributes
    ----------
    whole : Trace
        Thinned so that no peak is lost.
    detail : Trace
        What lies around the excerpt.
    excerpt : float
        Where the `EXCERPT` begins in which the desired acceleration has its largest RMS, s.
    """

    whole: Trace
    detail: Trace
    excerpt: float

    @classmethod
    def of(cls, signals: Mapping[str, FloatArray], rate: float, shift: float) -> Traces:
        """Thin some signals; the one named ``actual`` is drawn earlier by the shift, in s."""
        if not signals:
            nothing = Trace(0.0, 1.0, {})
            return cls(nothing, nothing, 0.0)
        moved = {
            name: _earlier(values, shift * rate) if name == "actual" else values
            for name, values in signals.items()
        }
        leading = moved.get("desired", next(iter(moved.values())))
        excerpt = liveliest(leading, round(EXCERPT * rate))
        window = around(excerpt, leading.size, min(round(DETAIL * rate), DETAIL_POINTS))
        thin = {name: thinned(values, WHOLE_POINTS) for name, values in moved.items()}
        (step,) = {step for _, step in thin.values()}
        return cls(
            Trace(0.0, step / rate, {name: kept for name, (kept, _) in thin.items()}),
            Trace(window.start / rate, 1 / rate, {n: v[window].copy() for n, v in moved.items()}),
            excerpt.start / rate,
        )


def _earlier(values: FloatArray, samples: float) -> FloatArray:
    """Move a signal to earlier times for the eye: between samples by straight lines."""
    places = np.arange(len(values), dtype=float)
    return np.interp(places + samples, places, values)
