# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Grids of frequencies against the definition of the discrete Fourier transform."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.handle.grid import Grid, grid_for


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_a_grids_sequences_are_those_of_its_spectra(rate: float) -> None:
    grid = Grid(rate, 64)
    sequence = np.random.default_rng(0).normal(size=50)
    spectrum = grid.spectrum(sequence)
    turned = np.exp(-2j * np.pi * np.outer(grid.frequency / rate, np.arange(50)))
    assert spectrum == pytest.approx(turned @ sequence)
    assert grid.sequence(spectrum)[:50] == pytest.approx(sequence)
    assert grid.spectrum(np.eye(5)[3]) == pytest.approx(grid.delay(3))


def test_a_grid_is_fine_enough_and_long_enough() -> None:
    assert grid_for(1000.0).step <= 0.2
    assert grid_for(50.0, taps=4000).points >= 16000
