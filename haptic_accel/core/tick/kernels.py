# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Functions of arrays for every sample, with an order of sums that is the same on all machines.

A library for linear algebra chooses its order by the processor. Here sums along memory are
pairwise, as numpy's: eight sums of every eighth value in blocks of at most 128, the blocks in
halves. Sums of rows are in the order of the rows. Buffers for products are given, so that nothing
is allocated, and their content has no meaning. Compiled, `kernels.pyx` takes this file's place.
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
    """Return the sum of taps times the same number of values from a start; pairwise."""
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
    """Write the sum of rows times factors to `sums`; in the order of the rows.

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
    """Add a factor times one row of a matrix to as many of the sums from a start."""
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
        Every `step`-th value is taken, of `ahead` from `start`.
    kept : ndarray, shape (n,)
    """
    seen = ahead[start : start + step * len(kept) : step]
    if share:
        seen = seen + share * held[::step]
    return float(_largest(np.abs(seen * kept)))
