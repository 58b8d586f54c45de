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

"""Amplitude, ends and band of the sweep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from haptic_accel.core.identification.sweep import SweepParameters, excitation, kept_repeats, sweep
from haptic_accel.core.parameters import ParameterError

RATE = 1000.0
SHORT = SweepParameters(duration=0.2)

untimed = settings(deadline=None, max_examples=50)


@st.composite
def sweeps(draw: st.DrawFn) -> tuple[SweepParameters, float]:
    """Any sweep of at least ten cycles, and a rate that can carry it."""
    start = draw(st.floats(5.0, 50.0))
    end = start * draw(st.floats(1.5, 20.0))
    parameters = SweepParameters(
        start_frequency=start,
        end_frequency=end,
        duration=draw(st.floats(10.0 / start, 20.0 / start)),
        start_amplitude=draw(st.floats(0.1, 1.0)),
        end_amplitude=draw(st.floats(0.1, 2.0)),
    )
    return parameters, end * draw(st.floats(2.1, 10.0))


# The force


@untimed
@given(sweeps())
def test_the_force_stays_within_its_amplitude_and_is_zero_at_both_ends(
    case: tuple[SweepParameters, float],
) -> None:
    parameters, rate = case
    force = sweep(parameters, rate)
    time = np.arange(len(force)) / rate
    first, last = parameters.start_amplitude, parameters.end_amplitude
    amplitude = first + (last - first) * time / parameters.duration
    assert (np.abs(force) <= amplitude * (1 + 1e-12)).all()
    assert force[0] == 0.0
    assert force[-1] == 0.0


@untimed
@given(sweeps())
def test_its_energy_lies_within_the_band(case: tuple[SweepParameters, float]) -> None:
    parameters, rate = case
    assume(rate > 3 * parameters.end_frequency)  # room above the band
    power = np.abs(np.fft.rfft(sweep(parameters, rate))) ** 2
    frequency = np.fft.rfftfreq(2 * (len(power) - 1), 1 / rate)
    # An octave part beside the band for what any sudden start and end costs.
    inside = (frequency > 0.7 * parameters.start_frequency) & (
        frequency < 1.4 * parameters.end_frequency
    )
    assert power[inside].sum() > 0.95 * power.sum()


def test_the_frequency_grows_by_equal_ratios_in_equal_times() -> None:
    parameters = SweepParameters()
    rate = 100e3
    force = sweep(parameters, rate)
    rising = np.flatnonzero((force[:-1] <= 0) & (force[1:] > 0)) / rate
    middle = (rising[1:] + rising[:-1]) / 2
    expected = 10.0 * 20.0 ** (middle / 2.0)
    assert 1 / np.diff(rising) == pytest.approx(expected, rel=5e-3)


def test_the_papers_sweep_grows_from_0_24_to_1_68_n() -> None:
    force = sweep(SweepParameters(), RATE)
    assert len(force) == 2000
    assert 0.24 < np.abs(force[:100]).max() < 0.24 + 0.72 * 0.1
    assert np.abs(force[-100:]).max() == pytest.approx(1.68, abs=0.06)


def test_repeats_follow_one_another() -> None:
    one, all_of_them = sweep(SHORT, RATE), excitation(SHORT, RATE)
    assert (all_of_them == np.concatenate([one, one, one])).all()
    kept = kept_repeats(all_of_them, SHORT, RATE)
    assert (kept == np.concatenate([one, one])).all()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"start_frequency": 200.0, "end_frequency": 100.0},
            "^end_frequency = 100: must be above start_frequency = 200 Hz$",
        ),
        (
            {"start_frequency": 200.0},
            "^end_frequency = 200: must be above start_frequency = 200 Hz$",
        ),
        (
            {"start_frequency": 0.5, "end_frequency": 1.0, "duration": 1.0},
            "^duration = 1: must hold at least one cycle of the sweep, of 0.5 to 1 Hz$",
        ),
        ({"repeats": 2}, "^repeats = 2: must be a whole number, from 3 to 100$"),
        ({"end_amplitude": 0.0}, "^end_amplitude = 0.0: must be above 0 to 100 N$"),
        ({"duration": math.nan}, "^duration = nan: must be from 0.1 to 60 s$"),
    ],
)
def test_an_impossible_sweep_is_refused(fields: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        SweepParameters(**fields)


def test_a_rate_that_cannot_carry_the_sweep_is_refused() -> None:
    message = "^end_frequency = 200: must be below half the rate, 200 Hz$"
    with pytest.raises(ParameterError, match=message):
        sweep(SweepParameters(), 400.0)
    with pytest.raises(ParameterError, match="^rate = nan: must be above 0 Hz$"):
        sweep(SweepParameters(), math.nan)


def test_a_signal_shorter_than_the_excitation_is_refused() -> None:
    with pytest.raises(ParameterError, match="^signal: 599 samples, must be at least 600$"):
        kept_repeats(np.zeros(599), SHORT, RATE)
