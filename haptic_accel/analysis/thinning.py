"""Fewer points that look the same when drawn."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray


def thinned(values: FloatArray, points: int) -> tuple[FloatArray, float]:
    """Return the extremes of a signal, so that a drawing of it loses no peak.

    Parameters
    ----------
    values : ndarray, shape (n,)
    points : int
        How many to leave at most; even, at least 2.

    Returns
    -------
    kept : ndarray
        The signal itself where it is short enough; otherwise smallest and largest of each of equal
        pieces, in the order in which they came.
    step : float
        Samples of the signal from one point to the next.
    """
    if len(values) <= points:
        return values, 1.0
    edges = np.linspace(0, len(values), points // 2 + 1).astype(int)[:-1]
    lowest, highest = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    ends = np.append(edges[1:], len(values))
    rising = np.array(
        [
            np.argmin(values[low:high]) <= np.argmax(values[low:high])
            for low, high in zip(edges, ends, strict=True)
        ]
    )
    kept = np.empty(2 * len(edges))
    kept[0::2] = np.where(rising, lowest, highest)
    kept[1::2] = np.where(rising, highest, lowest)
    return kept, len(values) / len(kept)


def liveliest(values: FloatArray, samples: int) -> slice:
    """Return the first window of so many samples that has the largest RMS."""
    samples = min(max(samples, 1), values.size)
    energy = np.concatenate([[0.0], np.cumsum(values**2)])
    start = int(np.argmax(energy[samples:] - energy[:-samples]))
    return slice(start, start + samples)


def around(inner: slice, size: int, samples: int) -> slice:
    """Return a window of so many samples, of `size` there are, with another in its middle.

    It is moved where it would reach beyond the ends, and never shorter than the other.
    """
    length = inner.stop - inner.start
    samples = min(max(samples, length), size)
    start = inner.start - (samples - length) // 2
    start = min(max(start, 0), size - samples)
    return slice(start, start + samples)


def some(size: int, most: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the indices of at most so many of a cloud's points.

    They are drawn by lot, from a fixed seed, because every n-th would beat with a periodic
    signal.
    """
    if size <= most:
        return np.arange(size)
    return np.random.default_rng(0).choice(size, most, replace=False)
