# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.tick.loss_concealment import HISTORY, RIDGE, LossConcealment


def bridge_over(samples: list[float]) -> LossConcealment:
    bridge = LossConcealment()
    for sample in samples:
        bridge.put(sample)
    return bridge


@pytest.mark.parametrize("frequency", [60.0, 120.0, 200.0])
def test_a_lost_sample_of_a_vibration_is_predicted_better_than_by_holding(
    frequency: float,
) -> None:
    time = np.arange(HISTORY + 3) / 1000
    wave = np.sin(2 * np.pi * frequency * time) + 0.3 * np.sin(2 * np.pi * 2.3 * frequency * time)
    known, lost = wave[:HISTORY], wave[HISTORY:]
    predicted = np.array(bridge_over([9.81] * 9 + known.tolist()).predict(3))
    assert np.abs(predicted - lost).max() < 0.25 * np.abs(known[-1] - lost).max()


def test_without_samples_zero_is_predicted_and_rest_stays_rest() -> None:
    assert LossConcealment().predict(2) == [0.0, 0.0]
    assert bridge_over([math.nan, math.inf, -math.inf]).predict(2) == [0.0, 0.0]
    assert bridge_over([9.81] * 10).predict(3) == pytest.approx([9.81] * 3)


def test_two_samples_go_on_by_their_correlation() -> None:
    # They are -1 and 1 from their mean: as large a product as power, which noise increases.
    (predicted,) = bridge_over([0.0, 2.0]).predict(1)
    assert predicted == pytest.approx(1.0 - 0.5 / (1.0 + RIDGE), rel=1e-9)


@given(st.lists(st.floats(-1e3, 1e3), max_size=2 * HISTORY))
def test_a_prediction_does_not_grow(samples: list[float]) -> None:
    predicted = np.array(bridge_over(samples).predict(500))
    known = np.array(samples[-HISTORY:] or [0.0])
    assert np.abs(predicted - known.mean()).max() <= 20 * np.abs(known - known.mean()).max() + 1e-6
    assert abs(predicted[-1] - known.mean()) <= np.abs(known - known.mean()).max() + 1e-6
