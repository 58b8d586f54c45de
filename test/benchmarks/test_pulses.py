# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reduction of a vibration to pulses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pulses import played, pulse, pulses

from haptic_accel.core.evaluation.metrics import indistinguishable
from haptic_accel.core.model import FloatArray

RATE = 1000.0


def tone(frequency: float, amplitude: float, seconds: float = 1.0) -> FloatArray:
    moments = np.arange(round(seconds * RATE)) / RATE
    return np.asarray(amplitude * np.sin(2 * np.pi * frequency * moments))


@given(st.floats(60.0, 400.0), st.floats(1.0, 20.0))
def test_a_tone_is_kept(frequency: float, amplitude: float) -> None:
    found = pulse(tone(frequency, amplitude, 0.1), RATE)
    assert found.frequency == pytest.approx(frequency, rel=0.05)
    assert found.amplitude == pytest.approx(amplitude, rel=0.1)
    assert found.duration == pytest.approx(0.1)


def test_a_hand_does_not_tell_a_tone_from_its_pulses() -> None:
    desired = tone(200.0, 3.0)
    actual = played(pulses(desired, RATE, 20.0), RATE)
    assert indistinguishable(desired, actual, RATE) == 1.0


def test_the_strength_is_that_of_all_axes_however_they_are_turned() -> None:
    one = tone(150.0, 2.0, 0.1)
    turned = np.outer(one, [0.6, 0.0, -0.8])
    assert pulse(turned, RATE) == pytest.approx(pulse(one, RATE))


def test_frames_that_are_no_whole_number_of_samples_lose_no_time() -> None:
    found = pulses(tone(100.0, 1.0), RATE, 60.0)
    assert len(found) == 60
    assert math.fsum(each.duration for each in found) == pytest.approx(1.0)


UNFIT = [(np.zeros(1), 60.0), (np.full(50, np.nan), 60.0), (np.ones(9), 0.0)]


@pytest.mark.parametrize(("samples", "frames"), UNFIT)
def test_no_pulse_is_made_of_what_is_no_vibration(samples: FloatArray, frames: float) -> None:
    with pytest.raises(ValueError, match=r"must be|positive"):
        pulses(samples, RATE, frames) if frames == 0.0 else pulse(samples, RATE)
