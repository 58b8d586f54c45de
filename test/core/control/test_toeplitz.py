# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Toeplitz equations solved piece by piece, against Levinson's recursion."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_toeplitz

from haptic_accel.core.control.inversion import improved
from haptic_accel.core.model import FloatArray


def autocorrelation(length: int, seed: int, corner: float) -> FloatArray:
    """Return the first lags of a first-order process with some white noise."""
    kept = np.exp(-2 * np.pi * corner)
    lags = np.asarray(kept ** np.arange(length), dtype=np.float64)
    lags[0] += np.random.default_rng(seed).uniform(1e-3, 1.0)
    return lags


def solutions(column: FloatArray, right: FloatArray, start: FloatArray) -> Iterator[FloatArray]:
    """Yield the solutions of one system of equations."""
    pieces = improved(column[np.newaxis], right, start[np.newaxis])
    return (each[0] for each in pieces if each is not None)


@given(st.integers(1, 80), st.integers(0, 1000), st.floats(0.005, 0.4))
def test_it_ends_at_the_solution(length: int, seed: int, corner: float) -> None:
    column = autocorrelation(length, seed, corner)
    right = np.random.default_rng(seed + 1).standard_normal(length)
    *_, last = islice(solutions(column, right, np.zeros(length)), 200)
    assert last == pytest.approx(solve_toeplitz(column, right), rel=1e-6, abs=1e-6)


def test_every_step_lowers_the_quadratic_form() -> None:
    column, right = autocorrelation(200, 1, 0.01), np.ones(200)
    place = np.arange(200)
    matrix = column[abs(place[:, None] - place)]
    forms = [
        x @ matrix @ x - 2 * right @ x for x in islice(solutions(column, right, 0 * right), 8)
    ]
    assert all(after <= before + 1e-9 for before, after in pairwise(forms))
    best = -right @ np.linalg.solve(matrix, right)
    assert forms[-1] == pytest.approx(best, rel=1e-3)


def test_nothing_wanted_is_nothing() -> None:
    assert list(solutions(np.array([1.0, 0.5]), np.zeros(2), np.zeros(2))) == []


def test_each_of_several_is_solved_as_if_it_were_alone() -> None:
    columns = np.stack([autocorrelation(60, seed, 0.02 * seed) for seed in (1, 2, 3)])
    right = np.random.default_rng(4).standard_normal(60)
    starts = np.stack([np.zeros(60), right, solve_toeplitz(columns[2], right)])
    together = [each for each in islice(improved(columns, right, starts), 60) if each is not None]
    for row in range(3):
        alone = solutions(columns[row], right, starts[row])
        for several, one in zip(together, alone, strict=False):
            np.testing.assert_array_equal(several[row], one)
    np.testing.assert_allclose(together[-1][2], starts[2], rtol=1e-9)
