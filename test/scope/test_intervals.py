# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measures of an interval of the signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.axes import ALL_AXES
from haptic_accel.core.model import GRAVITY, FloatArray
from haptic_accel.scope.windows import GraphSettings, IntervalMeasures, Windows, measure

RATE = 1000.0
PERIOD = 1_000_000
"""Period, ns."""

START = 1_700_000_000_000_000_000
BEGIN, END = START + 1000 * PERIOD, START + 2000 * PERIOD
SHIFT = GraphSettings().after

TIME = np.arange(3000) / RATE
TEXTURE = 2.0 * np.sin(2 * np.pi * 100.0 * TIME)
"""Desired acceleration of 1.41 m/s^2 RMS."""


def filled(
    desired: FloatArray, share: float, windows: Windows | None = None, lost: slice = slice(0)
) -> Windows:
    """Return the signals of a handle that follows with a share of what is desired."""
    windows = windows or Windows()
    stamps = START + PERIOD * np.arange(len(desired))
    handle = GRAVITY + share * np.roll(desired, SHIFT)
    kept = np.ones(len(stamps), bool)
    kept[lost] = False
    windows.handle.extend(stamps[kept], handle[kept])
    windows.desired.extend(stamps, desired)
    windows.force.extend(stamps, 0.1 * desired)
    return windows


def measured(windows: Windows) -> IntervalMeasures:
    found = measure(windows, BEGIN, END, RATE)
    assert found is not None
    return found


def test_a_handle_that_follows_with_nine_tenths_has_an_error_of_ten_percent() -> None:
    found = measured(filled(TEXTURE, 0.9))
    assert (found.begin, found.end) == (BEGIN, END)
    assert found.error == pytest.approx(10.0, abs=0.2)
    assert found.desired_rms == pytest.approx(np.sqrt(2.0), rel=0.01)
    assert found.rms == pytest.approx(0.9 * np.sqrt(2.0), rel=0.01)
    assert found.peak == pytest.approx(0.9 * TEXTURE.max(), rel=0.02)
    assert (found.clipped, found.lost) == (0.0, 0.0)


def test_what_is_outside_does_not_count() -> None:
    inner = np.where((TIME >= 1.0) & (TIME <= 2.0), TEXTURE, 0.1 * TEXTURE)
    assert measured(filled(inner, 1.0)).peak == pytest.approx(TEXTURE.max(), rel=0.02)


def test_without_a_desired_acceleration_there_is_no_error() -> None:
    found = measured(filled(0.0 * TEXTURE, 1.0))
    assert found.error is None
    assert found.rms == pytest.approx(0.0, abs=1e-6)


def test_forces_at_the_limit_and_missing_samples_are_counted() -> None:
    windows = filled(TEXTURE, 1.0, lost=slice(1500, 1520))
    actuator = windows.settings.actuator
    windows.settings = GraphSettings(
        actuator=replace(actuator, peak_force=0.19, continuous_force=0.1)
    )
    found = measured(windows)
    assert found.lost == pytest.approx(2.0, abs=0.1)
    # Two samples of ten are at the crests of both signs.
    assert found.clipped == pytest.approx(40.0, abs=1.0)


def test_of_three_axes_the_vectors_are_compared() -> None:
    windows = Windows()
    windows.show_axes(ALL_AXES)
    for (axis, each), share in zip(windows.by_axis.items(), (1.0, 1.0, 0.0), strict=True):
        assert each.axis == axis
        filled(TEXTURE, share, each)
    found = measured(windows)
    assert found.desired_rms == pytest.approx(np.sqrt(6.0), rel=0.01)
    assert found.rms == pytest.approx(2.0, rel=0.01)
    assert found.error == pytest.approx(100.0 / np.sqrt(3.0), rel=0.01)


def test_without_samples_there_are_no_measures() -> None:
    assert measure(Windows(), BEGIN, END, RATE) is None
