# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Excursion control: what is predicted, what is given up, and what stays exact."""

from __future__ import annotations

import functools
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.compensation import CompensationParameters
from haptic_accel.core.control.controllers import Loop
from haptic_accel.core.control.controllers.fixed import InverseController, InverseParameters
from haptic_accel.core.control.filters import high_pass
from haptic_accel.core.control.inversion import TRAVEL_CORNERS, InverseBank, design_bank
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray, HandleParameters, Suspension
from haptic_accel.core.parameters import Checked
from haptic_accel.core.tick import CUSHION, ActuatorGuard, TravelEstimator
from haptic_accel.core.tick.control import (
    EXCURSION_FADING,
    HORIZON,
    LASTING,
    PERSISTING,
    PREDICTION_RATE,
    REVERSION,
    ExcursionControl,
    TravelPredictor,
)
from one_coil import OneCoil

RATE = 1000.0
RATES = [1000.0, 4000.0]
LIMIT = CUSHION * ActuatorParameters.travel
SUSPENSION = Suspension()


def steps(forces: list[float]) -> InverseBank:
    """Return members whose force is the input times these, at once, on a handle that rests."""
    taps = np.zeros((len(forces), 20))
    taps[:, 0] = forces
    return InverseBank(np.zeros((2, 6)), taps, np.zeros_like(taps))


def control(forces: list[float], limit: float = LIMIT) -> ExcursionControl:
    """Return a selection that has found little travel to be needed for long."""
    bank = steps(forces)
    found = ExcursionControl(bank.taps, bank.motion, SUSPENSION, limit, RATE)
    found.position = found.target = 0.0
    return found


@functools.cache
def bank(rate: float) -> InverseBank:
    return design_bank(Plant(), rate)


def texture(low: float, high: float, rms: float, rate: float, seconds: float = 3.0) -> FloatArray:
    """Return noise between two frequencies that begins and ends softly, m/s^2."""
    count = round(seconds * rate)
    lines = np.fft.rfft(np.random.default_rng(1).normal(size=count))
    frequency = np.fft.rfftfreq(count, 1 / rate)
    lines[(frequency < low) | (frequency > high)] = 0.0
    values = np.fft.irfft(lines, count)
    return np.asarray(rms / values.std() * values * signal.windows.tukey(count, 0.1))


class Follower:
    """An inverse with its guard, on an actuator whose handle moves as the plant says."""

    def __init__(self, rate: float, travel: float = ActuatorParameters.travel) -> None:
        actuator = ActuatorParameters(travel=travel)
        options: dict[str, Checked] = {"actuator": actuator}
        parameters = CompensationParameters(controller="inverse")
        self._compensation = OneCoil(parameters, rate, options, latency=0)
        self._estimator = TravelEstimator(actuator, rate)
        self._plant = signal.cont2discrete(
            _state_space(Plant().coupled().handle), 1.0 / rate, method="zoh"
        )

    @property
    def guard(self) -> ActuatorGuard:
        return self._compensation.guard

    def run(self, tool: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return desired acceleration, force and travel by sample."""
        a, b, c, d, _ = self._plant
        state, seen = np.zeros(4), 0.0
        signals = []
        for value in tool.tolist():
            desired, force = self._compensation.sample(value, seen)
            seen = float((c @ state + d[:, 0] * force)[0])
            signals.append((desired, force, state[2] - state[0]))
            state = a @ state + b[:, 0] * force
        desired, force, travel = np.array(signals).T
        return desired, force, travel


def _state_space(h: HandleParameters) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Eqs. (1) and (2): position and velocity of handle and actuator; output the handle's a."""
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-(h.k_s + h.k_u) / h.m_h, -(h.b_s + h.b_u) / h.m_h, h.k_s / h.m_h, h.b_s / h.m_h],
            [0.0, 0.0, 0.0, 1.0],
            [h.k_s / h.m_a, h.b_s / h.m_a, -h.k_s / h.m_a, -h.b_s / h.m_a],
        ]
    )
    b = np.array([[0.0], [1.0 / h.m_h], [0.0], [-1.0 / h.m_a]])
    return a, b, a[1:2], b[1:2]


# The prediction


@pytest.mark.parametrize("rate", RATES)
def test_a_pulse_of_force_is_predicted_to_swing_as_eq_1_says(rate: float) -> None:
    predictor = TravelPredictor(SUSPENSION, rate)
    predictor.expect(np.eye(1, round(0.02 * rate)))
    predictor.reset()
    impulse, samples = 2e-3, round(2e-3 * rate)  # N s, over two milliseconds
    for _ in range(samples):
        predictor.observe(impulse / 2e-3)
    # d = p / (m w) exp(-b t / 2m) sin(w t): the first peak, of which some is not believed.
    m, k, b = SUSPENSION.m_a, SUSPENSION.k_s, SUSPENSION.b_s
    w = math.sqrt(k / m - (b / (2 * m)) ** 2)
    time = math.atan2(w, b / (2 * m)) / w
    peak = impulse / (m * w) * math.exp(-b * time / (2 * m)) * math.sin(w * time)
    found = predictor.largest(0)
    assert 0.7 * peak < found < peak


def test_an_input_that_persists_is_expected_to_last() -> None:
    rate, step = PREDICTION_RATE, 1.0 / PREDICTION_RATE
    predictor, estimator = TravelPredictor(SUSPENSION, rate), TravelEstimator(SUSPENSION, rate)
    predictor.expect(np.eye(1, 20))
    predictor.reset()
    for _ in range(round(PERSISTING / step)):
        predictor.observe(1.0)
        now = estimator.observe(1.0, 0.0)
    lead = np.arange(round(HORIZON / step))
    forces = np.where(lead < round(LASTING / step), 1.0, 0.0)
    ahead = [now, *(estimator.observe(force, 0.0) for force in forces[:-1].tolist())]
    believed = np.abs(ahead) / (1.0 + lead * step / REVERSION)
    assert predictor.largest(0) == pytest.approx(believed.max(), rel=1e-6)
    # One sample of the other sign, and nothing is expected but the past.
    before = predictor.largest(0)
    predictor.observe(-1e-9)
    assert predictor.largest(0) < 0.7 * before


inputs = st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=200)


@settings(max_examples=50, deadline=None)
@given(inputs, st.floats(0.1, 10.0))
def test_what_travels_now_is_within_what_is_predicted(values: list[float], gain: float) -> None:
    rate = PREDICTION_RATE  # at which no samples are taken together
    predictor, estimator = TravelPredictor(SUSPENSION, rate), TravelEstimator(SUSPENSION, rate)
    predictor.expect(gain * np.eye(1, 20))
    predictor.reset()
    scale = gain * sum(map(abs, values))
    for value in values:
        travel = estimator.observe(gain * value, 0.0)
        predictor.observe(value)
        # Beyond what the response is kept for, a few thousandths of it are left.
        assert abs(travel) <= predictor.largest(0) + 1e-4 * scale + 1e-12


@settings(max_examples=50, deadline=None)
@given(inputs)
def test_the_place_is_within_the_bank_and_the_same_every_time(values: list[float]) -> None:
    one, other = control([1.0, 0.5, 0.1]), control([1.0, 0.5, 0.1])
    for value in values:
        force = one.process(value)
        assert force == other.process(value)
        assert 0.0 <= one.position <= 2.0
        assert abs(force) <= abs(value)
    one.restart(one.taps)
    assert one.position == 2.0
    assert [one.process(0.0) for _ in range(50)] == [0.0] * 50


@settings(max_examples=50, deadline=None)
@given(inputs)
def test_within_the_limit_the_first_member_is_used(values: list[float]) -> None:
    # No bounded force takes more travel than the sum of its response: less than 2 / k_s.
    scale = LIMIT * SUSPENSION.k_s / 2.0 / max(1e-9, *map(abs, values))
    quiet = control([1.0, 0.5, 0.1])
    for value in values:
        assert quiet.process(scale * value) == pytest.approx(scale * value, rel=1e-12)
        assert quiet.position == 0.0


def test_as_much_is_given_up_as_the_limit_needs() -> None:
    # On the spring, 1.0 N would travel 3.76 mm and more: 0.5 of it is 1.88 mm.
    found = control([1.0, 0.5, 0.1], limit=2.5e-3)
    force = [found.process(1.0) for _ in range(400)]
    # The force was as large for the first milliseconds; at last the spring holds what is left.
    assert 0.5 < found.position < 1.0
    assert force[-1] == pytest.approx(1.0 - 0.5 * found.position)
    assert force[-1] <= 2.5e-3 * SUSPENSION.k_s
    # Later, without any input, it comes back.
    for _ in range(20_000):
        found.process(0.0)
    assert found.position == 0.0


def test_what_no_member_keeps_gets_the_last_one() -> None:
    found = control([1.0, 0.5, 0.1])
    for _ in range(200):
        force = found.process(1e3)
    assert found.position == 2.0
    assert force == pytest.approx(100.0)


# Other taps


def test_other_taps_are_faded_in() -> None:
    found = control([1.0, 0.5])
    other = 3.0 * np.asarray(found.taps)
    found.replace(other)
    assert found.left
    count = round(EXCURSION_FADING * RATE)
    forces = [found.process(1e-3) for _ in range(count)]
    assert not found.left
    assert forces == pytest.approx(1e-3 * (1.0 + 2.0 * np.arange(1, count + 1) / count))
    assert found.taps == pytest.approx(other)


def test_the_travel_of_other_taps_is_predicted_at_once() -> None:
    found = control([1.0, 0.1])
    found.replace(10.0 * np.asarray(found.taps))
    for _ in range(100):
        found.process(0.5)
    assert found.position > 0.5


# The whole inverse


@pytest.mark.parametrize("rate", RATES)
def test_all_members_follow_high_frequencies_and_give_up_more_of_the_low(rate: float) -> None:
    taps, motion = bank(rate).taps, bank(rate).motion
    turned = np.exp(-2j * np.pi * np.outer([20.0, 120.0], np.arange(taps.shape[1])) / rate)
    low, high = np.abs(motion @ turned.T).T
    kept = TRAVEL_CORNERS.index(4.0)
    assert low[0] == pytest.approx(1.0, rel=0.05)
    assert high[: kept + 1] == pytest.approx(1.0, rel=0.06)
    # From there on the low ones go first.
    assert (np.diff(low)[kept:] < 0.0).all()
    assert (low / high)[-1] < 0.2


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("velocity", [0.05, -0.1, 0.2])
def test_a_landing_stays_within_the_travel(rate: float, velocity: float) -> None:
    rig = Follower(rate)
    # The tool's velocity changes within 2 ms; it bounces and comes to rest within 20 ms.
    time = np.arange(round(1.5 * rate)) / rate - 0.5
    within = (time >= 0.0) & (time < 2e-3)
    after = (time >= 2e-3) & (time < 22e-3)
    tool = np.zeros(len(time))
    tool[within], tool[after] = velocity / 2e-3, -0.5 * velocity / 20e-3
    _, _, travel = rig.run(tool)
    assert np.abs(travel).max() < ActuatorParameters.travel
    if abs(velocity) < 0.1:
        assert rig.guard.cushioned == 0


@pytest.mark.parametrize("rate", RATES)
def test_a_low_texture_gives_up_what_is_low_and_nothing_else(rate: float) -> None:
    low, high = texture(8.0, 14.0, 1.7, rate), texture(80.0, 200.0, 1.0, rate)
    rig, alone = Follower(rate), Follower(rate, travel=0.1)
    _, force, travel = rig.run(low + high)
    _, wanted, free = alone.run(low + high)
    assert np.abs(free).max() > ActuatorParameters.travel > np.abs(travel).max()
    band = signal.butter(4, 60.0, "highpass", fs=rate, output="sos")
    kept, expected = signal.sosfilt(band, force), signal.sosfilt(band, wanted)
    assert np.std(kept - expected) < 0.15 * np.std(expected)


@pytest.mark.parametrize("rate", RATES)
def test_a_change_of_member_is_no_jump_in_force(rate: float) -> None:
    controller = InverseController(InverseParameters(), Loop(rate))
    free = InverseController(InverseParameters(), Loop(rate, travel=0.1))
    desired = signal.sosfilt(high_pass(15.0, rate), texture(8.0, 40.0, 4.0, rate))
    recent: deque[float] = deque(maxlen=2)
    limited, wanted = [], []
    for value in desired.tolist():
        limited.append(controller.force(value, 0.0))
        wanted.append(free.force(value, 0.0))
        recent.append(limited[-1])
    assert limited != wanted
    # A millisecond's change is not far above the largest of the texture itself.
    ahead = round(1e-3 * rate)
    step, own = (np.abs(np.subtract(x[ahead:], x[:-ahead])).max() for x in (limited, wanted))
    assert step < 2.0 * own


def test_the_horizon_holds_a_swing_of_the_actuator() -> None:
    assert 0.9 * 2 * math.pi * math.sqrt(SUSPENSION.m_a / SUSPENSION.k_s) < HORIZON
