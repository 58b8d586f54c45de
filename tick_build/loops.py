# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Text of `haptic_accel.core.tick.kernels` for the compiler: the same sums in loops.

The order of sums is numpy's, to the last bit. Python can run this text, too, though slowly.
"""

from __future__ import annotations

from haptic_accel.core.model import FloatArray

FloatMatrix = FloatArray

BLOCK: int = 128
"""Most products that are summed without halving them."""


def own_floor(value: float) -> int:
    """Return the largest whole number that is not above a value."""
    whole: int = int(value)
    return whole - 1 if value < whole else whole


def own_isfinite(value: float) -> bool:
    """Return whether a value is a number and not infinite."""
    return value - value == 0.0


def own_isnan(value: float) -> bool:
    """Return whether a value is no number."""
    return value != value


def pairwise(taps: FloatArray, past: FloatArray, start: int, first: int, count: int) -> float:
    """Return the sum of `count` products from the first tap, in numpy's order."""
    if count > BLOCK:
        half: int = count // 2
        half -= half % 8
        one = pairwise(taps, past, start, first, half)
        return one + pairwise(taps, past, start, first + half, count - half)
    total = 0.0
    at: int = first
    end: int = first + count
    if count >= 8:
        a = taps[at] * past[start + at]
        b = taps[at + 1] * past[start + at + 1]
        c = taps[at + 2] * past[start + at + 2]
        d = taps[at + 3] * past[start + at + 3]
        e = taps[at + 4] * past[start + at + 4]
        f = taps[at + 5] * past[start + at + 5]
        g = taps[at + 6] * past[start + at + 6]
        h = taps[at + 7] * past[start + at + 7]
        at += 8
        while at + 8 <= end:
            a += taps[at] * past[start + at]
            b += taps[at + 1] * past[start + at + 1]
            c += taps[at + 2] * past[start + at + 2]
            d += taps[at + 3] * past[start + at + 3]
            e += taps[at + 4] * past[start + at + 4]
            f += taps[at + 5] * past[start + at + 5]
            g += taps[at + 6] * past[start + at + 6]
            h += taps[at + 7] * past[start + at + 7]
            at += 8
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    while at < end:
        total += taps[at] * past[start + at]
        at += 1
    return total


def dot(taps: FloatArray, past: FloatArray, start: int, products: FloatArray) -> float:
    """Return the sum of taps times the same number of values from a start."""
    return pairwise(taps, past, start, 0, len(taps))


def row_dot(
    rows: FloatMatrix, row: int, past: FloatArray, start: int, products: FloatArray
) -> float:
    """Return `dot` with one row of a matrix as the taps."""
    taps: FloatArray = rows[row]
    return pairwise(taps, past, start, 0, len(taps))


def dots(
    rows: FloatMatrix, past: FloatArray, start: int, products: FloatMatrix, sums: FloatArray
) -> None:
    """Write `dot` with each row of a matrix as the taps to `sums`."""
    row: int = 0
    while row < len(sums):
        taps: FloatArray = rows[row]
        sums[row] = pairwise(taps, past, start, 0, len(taps))
        row += 1


def product(
    rows: FloatMatrix, first: int, factors: FloatMatrix, products: FloatMatrix, sums: FloatArray
) -> None:
    """Write the sum of rows times factors to `sums`; in the order of the rows."""
    width: int = len(sums)
    count: int = len(factors)
    at: int = 0
    row: int = 1
    factor = factors[0, 0]
    # The sums may be among the factors.
    while at < width:
        products[0, at] = rows[first, at] * factor
        at += 1
    while row < count:
        factor = factors[row, 0]
        at = 0
        while at < width:
            products[0, at] += rows[first + row, at] * factor
            at += 1
        row += 1
    at = 0
    while at < width:
        sums[at] = products[0, at]
        at += 1


def add_scaled(
    rows: FloatMatrix, row: int, factor: float, sums: FloatArray, start: int, products: FloatArray
) -> None:
    """Add a factor times one row of a matrix to as many of the sums from a start."""
    count: int = len(products)
    at: int = 0
    while at < count:
        sums[start + at] += rows[row, at] * factor
        at += 1


def peak(
    ahead: FloatArray, start: int, step: int, held: FloatArray, share: float, kept: FloatArray
) -> float:
    """Return the largest magnitude of (ahead + share * held) * kept."""
    most = 0.0
    count: int = len(kept)
    at: int = 0
    while at < count:
        value = ahead[start + at * step]
        if share != 0.0:
            value += share * held[at * step]
        value = abs(value * kept[at])
        if value > most:
            most = value
        at += 1
    return most


def add_rows(rows: FloatMatrix, sums: FloatMatrix) -> None:
    """Add a matrix to another in place."""
    row: int = 0
    while row < rows.shape[0]:
        at: int = 0
        while at < rows.shape[1]:
            sums[row, at] += rows[row, at]
            at += 1
        row += 1
