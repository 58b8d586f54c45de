# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exposure of hand and arm, against the weights that ISO 5349-1:2001 prints in table A.2."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.exposure import DAY, WeightedDose, daily_exposure, weights

WH = {
    **{6.3: 0.727, 8: 0.873, 10: 0.951, 12.5: 0.958, 16: 0.896, 20: 0.782, 25: 0.647},
    **{31.5: 0.519, 40: 0.411, 50: 0.324, 63: 0.256, 80: 0.202, 100: 0.160, 125: 0.127},
    **{160: 0.101, 200: 0.0799, 250: 0.0634, 315: 0.0503, 400: 0.0398, 500: 0.0314},
    **{630: 0.0245, 800: 0.0186, 1000: 0.0135, 1250: 0.00894},
}
"""Weighting factors by nominal frequency of the third octave, Hz."""

TOLERANCE = 0.11
"""Tolerance of the weighting of instruments, ISO 8041: -11 to +12 %."""


def exact(nominal: float) -> float:
    """Return the exact centre of a third octave, Hz."""
    return float(10 ** (round(10 * np.log10(nominal)) / 10))


def measured_weight(frequency: float, rate: float) -> float:
    """Return the root of the dose of 8 s of a sine of RMS 1 m/s^2, whose first 2 s are waited."""
    sine = np.sqrt(2) * np.sin(2 * np.pi * frequency * np.arange(int(10 * rate)) / rate)
    dose = WeightedDose(rate)
    dose.add(sine[: int(2 * rate)])
    before = dose.dose
    dose.add(sine[int(2 * rate) :])
    return float(np.sqrt((dose.dose - before) / 8))


def test_the_weights_are_those_of_the_standard() -> None:
    found = weights([exact(nominal) for nominal in WH])
    assert found == pytest.approx([*WH.values()], rel=0.006)  # their last printed digit


@pytest.mark.parametrize("rate", [500.0, 1000.0, 2000.0, 5000.0])
def test_the_filter_keeps_the_tolerance_of_instruments(rate: float) -> None:
    for nominal, weight in WH.items():
        if exact(nominal) <= min(0.3 * rate, 1000):
            found = measured_weight(exact(nominal), rate)
            assert found == pytest.approx(weight, rel=TOLERANCE), f"{nominal} Hz"


def test_the_dose_does_not_depend_on_the_blocks() -> None:
    samples = np.random.default_rng(1).normal(size=(1000, 3))
    whole, parts = WeightedDose(1000.0), WeightedDose(1000.0)
    whole.add(samples)
    for part in np.array_split(samples, 7):
        parts.add(part)
    assert parts.dose == pytest.approx(whole.dose, rel=1e-12)


def test_axes_add_up() -> None:
    axis = np.random.default_rng(2).normal(size=500)
    one, three = WeightedDose(1000.0), WeightedDose(1000.0)
    one.add(axis)
    three.add(np.column_stack([axis] * 3))
    assert three.dose == pytest.approx(3 * one.dose)


def test_missing_samples_leave_the_dose_finite() -> None:
    dose = WeightedDose(1000.0)
    dose.add([1.0, np.nan, np.inf, 1.0])
    dose.add([1.0])
    assert 0 < dose.dose < 1


def test_half_the_time_takes_four_times_the_squared_acceleration() -> None:
    eight_hours, four_hours = 2.5**2 * 8 * 3600, 3.54**2 * 4 * 3600
    assert daily_exposure(eight_hours) == 2.5
    assert daily_exposure(four_hours) == pytest.approx(2.5, abs=0.005)
    assert DAY == 24 * 3600


def test_a_rate_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match="^rate = 0"):
        WeightedDose(0.0)
