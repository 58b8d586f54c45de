# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics of vectors against known answers, and against those of one axis."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.evaluation import metrics
from haptic_accel.core.evaluation.metrics import estimate_delay, indistinguishable, shift_back
from haptic_accel.core.evaluation.statistics import nrmse_interval
from haptic_accel.core.model import FloatArray

RATE = 1000.0
EVALUATIONS: Any = [
    metrics.nrmse,
    metrics.regress,
    lambda d, a: metrics.evaluate(d, a, RATE, 0.0),
    lambda d, a: metrics.band_nrmse(d, a, RATE, metrics.bands(RATE)),
    lambda d, a: indistinguishable(d, a, RATE),
    lambda d, a: nrmse_interval(d, a, RATE).low,
    lambda d, a: estimate_delay(d, a, RATE),
    lambda d, a: vars(metrics.spectra(d, a, RATE)),
    lambda d, a: dict(zip("da", map(np.ravel, shift_back(d, a, RATE, 0.4e-3)), strict=True)),
]


def vibration(seed: int = 0, seconds: float = 8.0) -> FloatArray:
    """Return noise in three axes of unlike strength, m/s^2."""
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (round(seconds * RATE), 3))
    return np.asarray(noise * [1.0, 0.2, 3.0])


def turned(vectors: FloatArray, degrees: float) -> FloatArray:
    """Rotate vectors about y."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.asarray(vectors @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]))


@pytest.mark.parametrize("metric", EVALUATIONS)
def test_a_vector_of_one_component_has_the_metrics_of_the_component(metric: Any) -> None:
    desired = vibration()[:, 2]
    actual = 0.7 * np.roll(desired, 1) + vibration(1)[:, 0]
    alone, vector = metric(desired, actual), metric(desired[:, None], actual[:, None])
    if isinstance(alone, dict):
        assert all(np.array_equal(alone[name], vector[name], equal_nan=True) for name in alone)
    else:
        assert alone == vector


@pytest.mark.parametrize("metric", EVALUATIONS[:7])
def test_components_without_vibration_change_no_metric(metric: Any) -> None:
    desired = vibration()[:, 2]
    actual = 0.7 * np.roll(desired, 1) + vibration(1)[:, 0]
    alone = metric(desired, actual)
    along_x = metric(*(np.outer(one, [1.0, 0.0, 0.0]) for one in (desired, actual)))
    numbers = [vars(one) if hasattr(one, "__dict__") else one for one in (alone, along_x)]
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-9, nan_ok=True)


@pytest.mark.parametrize("degrees", [0.001, 3.0, 10.0, 90.0, 170.0])
def test_a_rotation_has_its_angle_and_its_chord_as_errors(degrees: float) -> None:
    desired = vibration() * [1.0, 0.0, 1.0]
    actual = turned(desired, degrees)
    assert metrics.direction_error(desired, actual) == pytest.approx(degrees, rel=1e-6)
    chord = 2 * math.sin(math.radians(degrees / 2))
    assert metrics.nrmse(desired, actual) == pytest.approx(chord, rel=1e-9)


def test_a_rotation_of_10_degrees_is_an_error_of_17_4_percent() -> None:
    desired = vibration() * [1.0, 0.0, 1.0]
    evaluation = metrics.evaluate(desired, turned(desired, 10.0), RATE, 0.0)
    assert evaluation.nrmse_percent == pytest.approx(17.43, abs=0.01)


def test_vectors_are_not_lines() -> None:
    assert metrics.direction_error(vibration(), -vibration()) == pytest.approx(180.0)


def test_strength_is_no_error_of_direction() -> None:
    assert metrics.direction_error(vibration(), 0.1 * vibration()) == pytest.approx(0.0, abs=1e-9)


def test_direction_of_weak_vectors_does_not_count() -> None:
    desired = vibration()
    length = np.linalg.norm(desired, axis=1)
    weak = length < metrics.DIRECTION_SHARE * math.sqrt(np.mean(length**2))
    actual = np.where(weak[:, None], -desired, turned(desired * [1.0, 0.0, 1.0], 5.0))
    assert np.mean(weak) > 0.2
    assert metrics.direction_error(desired * [1.0, 0.0, 1.0], actual) == pytest.approx(5.0)


@pytest.mark.parametrize("scale", [(0.0, 1.0), (1.0, 0.0)])
def test_vectors_of_zero_have_no_direction(scale: tuple[float, float]) -> None:
    assert math.isnan(metrics.direction_error(scale[0] * vibration(), scale[1] * vibration()))


def test_the_error_of_each_axis_is_its_own() -> None:
    desired = vibration()
    found = metrics.evaluate_axes(desired, desired * [0.9, 0.5, 1.2], RATE)
    assert [each.nrmse_percent for each in found] == pytest.approx([10.0, 50.0, 20.0])
    assert [each.slope_actual_on_desired for each in found] == pytest.approx([0.9, 0.5, 1.2])


def test_an_axis_that_is_not_to_vibrate_has_no_error_of_its_own() -> None:
    desired = vibration() * [1.0, 0.0, 1.0]
    found = metrics.evaluate_axes(desired, desired + vibration(1), RATE)
    assert found[1] is metrics.NO_EVALUATION
    assert math.isfinite(found[0].nrmse_percent)


def test_spectra_add_the_power_of_the_axes() -> None:
    desired = vibration()
    whole = metrics.spectra(desired, desired, RATE)
    alone = [metrics.spectra(one, one, RATE).desired ** 2 for one in desired.T]
    assert whole.desired**2 == pytest.approx(np.sum(alone, axis=0))
    assert whole.coherence == pytest.approx(np.ones(len(whole.frequency)))


def test_a_hand_feels_the_power_of_all_axes() -> None:
    time = np.arange(4000) / RATE
    tone = np.outer(np.sin(2 * np.pi * 100 * time), [1.0, 0.0, 0.0])
    assert indistinguishable(tone, turned(tone, 60.0), RATE) == 1.0
    both = tone + np.outer(np.sin(2 * np.pi * 100 * time), [0.0, 1.0, 0.0])  # 3 dB more
    assert indistinguishable(tone, both, RATE) == 0.0


def test_the_axes_of_a_vector_have_one_delay() -> None:
    desired = vibration()
    actual = np.roll(desired, 3, axis=0) + 0.3 * vibration(1)
    assert estimate_delay(desired, actual, RATE).seconds == pytest.approx(3e-3, abs=2e-5)
    first, second = shift_back(desired, np.roll(desired, 3, axis=0), RATE, 3e-3)
    assert np.array_equal(first, second)
