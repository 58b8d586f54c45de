# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
    assert grid_for(1000.0).spacing <= 0.2
    assert grid_for(50.0, taps=4000).points >= 16000
