# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Array functions for every sample, with the same order of summation on all machines.

A linear algebra library chooses its order by the processor. Here sums along memory are pairwise,
as in numpy: eight sums of every eighth value in blocks of at most 128, and a binary tree of the
blocks. Sums of rows are in the order of the rows. The caller provides buffers for products, so
that nothing is allocated; their content has no meaning. In the compiled form, `kernels.pyx`
replaces this file.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from haptic_accel.core.model import FloatArray

FloatMatrix = FloatArray

INFINITE: float = float("inf")
UNKNOWN: float = float("nan")

_multiply: Any = np.multiply
_sum: Any = np.add.reduce
_largest: Any = np.maximum.reduce


def dot(taps: FloatArray, past: FloatArray, start: int, products: FloatArray) -> float:
    """Return the sum of taps times as many values from a start index; pairwise."""
    return float(_sum(_multiply(taps, past[start : start + len(taps)], products)))


def row_dot(
    rows: FloatMatrix, row: int, past: FloatArray, start: int, products: FloatArray
) -> float:
    """Return `dot` with one row of a matrix as the taps."""
    return dot(rows[row], past, start, products)


def dots(
    rows: FloatMatrix, past: FloatArray, start: int, products: FloatMatrix, sums: FloatArray
) -> None:
    """Write `dot` with each row of a matrix as the taps to `sums`."""
    _multiply(rows, past[start : start + rows.shape[1]], products)
    _sum(products, 1, None, sums)


def product(
    rows: FloatMatrix, first: int, factors: FloatMatrix, products: FloatMatrix, sums: FloatArray
) -> None:
    """Write the sum of rows times factors to `sums`, in the order of the rows.

    Parameters
    ----------
    rows : ndarray, shape (k, m), m > 1
        Columns of one or more matrices, one below the other.
    first : int
        Row of the first factor.
    factors : ndarray, shape (n, 1)
    products : ndarray, shape (n, m)
    sums : ndarray, shape (m,)
    """
    _sum(_multiply(rows[first : first + len(factors)], factors, products), 0, None, sums)


def add_scaled(
    rows: FloatMatrix, row: int, factor: float, sums: FloatArray, start: int, products: FloatArray
) -> None:
    """Add one row of a matrix, times a factor, to as many sums from a start index."""
    seen = sums[start : start + len(products)]
    np.add(seen, _multiply(rows[row], factor, products), seen)


def add_rows(rows: FloatMatrix, sums: FloatMatrix) -> None:
    """Add all rows of a matrix to those of another one."""
    np.add(sums, rows, sums)


def peak(
    ahead: FloatArray, start: int, step: int, held: FloatArray, share: float, kept: FloatArray
) -> float:
    """Return the largest magnitude of (ahead + share * held) * kept.

    Parameters
    ----------
    ahead, held : ndarray
        Every `step`-th value is used, in `ahead` from `start` on.
    kept : ndarray, shape (n,)
    """
    seen = ahead[start : start + step * len(kept) : step]
    if share:
        seen = seen + share * held[::step]
    return float(_largest(np.abs(seen * kept)))
