# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loss by each reduction, where it is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_accel.core.evaluation.metrics import LIVE_PRINCIPAL, kept_powers
from haptic_accel.core.model import FloatArray

RATE = 1000.0
TIME = np.arange(8000) / RATE


def noise(seed: int) -> FloatArray:
    return 3.0 * np.random.default_rng(seed).standard_normal(len(TIME))


def test_of_two_independent_axes_one_direction_keeps_half_and_the_sum_all() -> None:
    found = kept_powers(np.column_stack([noise(1), 0 * TIME, noise(2)]), RATE)
    assert found["dft321"] == pytest.approx(1.0)
    assert found["axis"] == pytest.approx(0.5, abs=0.03)
    assert found["sum"] == pytest.approx(1.0, abs=0.05)
    assert found["principal"] == pytest.approx(0.5, abs=0.05)


def test_opposite_components_cancel_in_the_sum_alone() -> None:
    wave = noise(1)
    found = kept_powers(np.column_stack([wave, 0 * TIME, -wave]), RATE)
    assert found["sum"] < 1e-12
    assert found["principal"] == pytest.approx(1.0)
    assert found[LIVE_PRINCIPAL] > 0.9


def test_gravity_is_no_vibration() -> None:
    found = kept_powers(np.column_stack([9.8 + 0 * TIME, 0 * TIME, noise(1)]), RATE)
    assert found["axis"] == pytest.approx(1.0)
    assert found[LIVE_PRINCIPAL] == pytest.approx(1.0)


def test_nothing_that_vibrates_has_no_loss() -> None:
    assert all(math.isnan(power) for power in kept_powers(np.zeros((8000, 3)), RATE).values())
