# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The high-pass against the analytic Butterworth, the inverse against the model it inverts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy import signal

from haptic_accel.core.control import filters
from haptic_accel.core.model import ApproximateModel, ComplexArray, FloatArray
from haptic_accel.core.tick.control import SampleFilter

untimed = settings(deadline=None)
signals = arrays.arrays(np.float64, st.integers(1, 200), elements=st.floats(-1e3, 1e3))


def response(sections: FloatArray, frequency: FloatArray, rate: float) -> ComplexArray:
    """Frequency response of a filter, from the impulse response that it really has."""
    seconds = 2.0  # every pole here has decayed by 1e-19 by then
    stream = SampleFilter(sections)
    count = int(seconds * rate)
    impulse = np.array([stream.process(float(index == 0)) for index in range(count)])
    turn = np.exp(-2j * np.pi * np.outer(frequency, np.arange(count)) / rate)
    return np.asarray(turn @ impulse)


# The high-pass


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_the_high_pass_is_a_butterworth_of_fourth_order(rate: float) -> None:
    frequency = np.array([0.0, 1.0, 5.0, 10.0, 15.0, 20.0, 50.0, 100.0, 200.0, 400.0])
    # The bilinear transform maps f to tan(pi f / rate); the corner stays where it is.
    ratio = np.tan(np.pi * frequency / rate) / np.tan(np.pi * 15.0 / rate)
    expected = np.sqrt(ratio**8 / (1 + ratio**8))
    magnitude = np.abs(
        response(filters.high_pass(filters.HIGH_PASS_FREQUENCY, rate), frequency, rate)
    )
    assert magnitude == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
@pytest.mark.parametrize(
    ("frequency", "gain"), [(0.0, 0.0), (1.5, 0.0), (5.0, 0.5), (15.0, 1.0), (100.0, 1.0)]
)
def test_hand_motion_goes_and_what_is_felt_stays_in_phase(
    rate: float, frequency: float, gain: float
) -> None:
    time = np.arange(round(4 * rate)) / rate
    wave = np.cos(2 * np.pi * frequency * time)
    middle = slice(round(rate), -round(rate))
    found = filters.without_hand_motion(9.81 + wave, 15.0, rate)
    assert found[middle] == pytest.approx(gain * wave[middle], abs=2e-3)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
@pytest.mark.parametrize("frequency", [7.0, 22.0, 49.0, 180.0])
@pytest.mark.parametrize("axes", [1, 3])
def test_a_handle_that_moves_as_desired_has_no_error(
    rate: float, frequency: float, axes: int
) -> None:
    time = np.arange(round(6 * rate)) / rate
    sway = 9.81 + 0.5 * np.sin(2 * np.pi * 0.7 * time + 1.0)
    desired = np.sin(2 * np.pi * frequency * time + 0.3)
    if axes == 3:
        desired, sway = np.outer(desired, (1.0, -0.5, 0.2)), np.outer(sway, (0.1, 0.2, 1.0))
    expected, actual = filters.comparable(desired, desired + sway, 15.0, rate)
    assert np.linalg.norm(actual - expected) < 1e-3 * np.linalg.norm(expected)
    assert np.linalg.norm(expected) > 0.9 * np.linalg.norm(desired)


@untimed
@given(signals)
def test_hand_motion_can_be_taken_out_of_any_signal(values: FloatArray) -> None:
    found = filters.without_hand_motion(values, 15.0, 1000.0)
    assert found.shape == values.shape
    assert np.isfinite(found).all()


# One sample at a time


@untimed
@given(signals, st.floats(1.0, 400.0), st.integers(1, 4))
def test_a_stream_equals_the_whole_signal(
    values: FloatArray, frequency: float, order: int
) -> None:
    sections = np.asarray(signal.butter(order, frequency, fs=1000.0, output="sos"))
    stream = SampleFilter(sections)
    output = [stream.process(value) for value in values.tolist()]
    assert np.array(output) == pytest.approx(signal.sosfilt(sections, values), abs=1e-9)


@given(signals, signals)
def test_reset_forgets_the_past(past: FloatArray, values: FloatArray) -> None:
    sections = filters.high_pass(15.0, 1000.0)
    fresh, used = SampleFilter(sections), SampleFilter(sections)
    for value in past.tolist():
        used.process(value)
    used.reset()
    assert [used.process(v) for v in values.tolist()] == [
        fresh.process(v) for v in values.tolist()
    ]


# The inverse of the approximate model


@pytest.mark.parametrize(
    ("rate", "low", "high", "tolerance"),
    [
        # The bilinear transform squeezes the frequency axis, at 1 kHz by 15 % at 200 Hz, where
        # the inverse is nearly flat.
        (1000.0, 1.0, 120.0, 0.005),
        (1000.0, 120.0, 200.0, 0.0075),
        (4000.0, 1.0, 200.0, 0.0005),
        (4000.0, 200.0, 800.0, 0.002),
    ],
)
def test_the_inverse_times_the_model_is_one(
    rate: float, low: float, high: float, tolerance: float
) -> None:
    frequency = np.linspace(low, high, 100)
    inverse = response(filters.inverse_of(ApproximateModel(), rate), frequency, rate)
    product = inverse * ApproximateModel().model().response(frequency)
    assert np.abs(product - 1).max() < tolerance


@untimed
@given(
    st.lists(st.floats(2.0, 50.0), min_size=4, max_size=4),
    st.lists(st.floats(0.1, 1.0), min_size=4, max_size=4),
    st.floats(0.1, 10.0),
)
def test_any_model_is_inverted_where_it_acts(
    frequencies: list[float], damping: list[float], gain: float
) -> None:
    model = ApproximateModel(
        gain=gain,
        **{f"{pair}_frequency": f for pair, f in zip(PAIRS, frequencies, strict=True)},
        **{f"{pair}_damping": d for pair, d in zip(PAIRS, damping, strict=True)},
    )
    frequency = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 50.0])
    _, inverse = signal.sosfreqz(filters.inverse_of(model, 20e3), frequency, fs=20e3)
    assert np.abs(inverse * model.model().response(frequency) - 1).max() < 1e-3


PAIRS = ("zero_1", "zero_2", "pole_1", "pole_2")
