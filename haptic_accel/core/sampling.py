"""Stamped samples on the sampling grid that their stamps lie on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from haptic_accel.core.model import FloatArray

NANOSECONDS = 1_000_000_000

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def places(stamps: IntArray, start: int, rate: float) -> IntArray:
    """Return on which sample of a grid each stamp lies.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        ns.
    start : int
        Of the grid, ns.
    rate : float
        Samples per second of the grid.
    """
    return np.round((stamps - start) * (rate / NANOSECONDS)).astype(np.int64)


def on_grid(where: IntArray, values: FloatArray, length: int) -> tuple[FloatArray, BoolArray]:
    """Put samples at their places; one that is missing has the value of the one before.

    Parameters
    ----------
    where : ndarray of int64, shape (n,)
        Place of each sample; those outside the grid are not used.
    values : ndarray, shape (n,)
        At least one lies on the grid.
    length : int
        Of the grid.

    Returns
    -------
    held : ndarray, shape (length,)
        Before the first sample, its value.
    seen : ndarray of bool, shape (length,)
        Which samples are there.
    """
    within = (where >= 0) & (where < length)
    source = np.full(length, -1)
    source[where[within]] = np.flatnonzero(within)
    seen = source >= 0
    source = np.maximum(np.maximum.accumulate(source), int(np.argmax(within)))
    return np.asarray(values[source]), seen
