# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.coupling.engagement import STEP_PERIOD, Engagement, EngagementParameters
from haptic_accel.core.coupling.passive import CouplingParameters
from haptic_accel.core.model import ZERO, FloatArray, Vector
from haptic_accel.core.sampling import RELEASED
from haptic_accel.core.tick import (
    MASTER,
    SLAVE,
    ArmSample,
    CountObserver,
    CouplingPart,
    PositionPositionCoupling,
)
from haptic_accel.core.topics import ARMS

RATE = 1000.0
PARAMETERS = CouplingParameters(k_m=100.0, k_sl=50.0, scale=1.0, damping=0.0)


@pytest.fixture
def part() -> CouplingPart:
    engagement = Engagement(EngagementParameters(), now=0.0)
    for arm in (MASTER, SLAVE):
        engagement.arm_stopped(arm, False)
    return CouplingPart(PositionPositionCoupling(PARAMETERS), engagement, RATE, longest=10)


def put(part: CouplingPart, tick: int, arm: str, height: float, speed: float = 0.0) -> None:
    sample = ArmSample(tick * 1_000_000, (0.0, 0.0, height), (0.0, 0.0, speed))
    sample.arm = ARMS.index(arm)
    part.put(sample, tick / RATE)


def commands(part: CouplingPart) -> list[tuple[str, int, Vector]]:
    part.forces.clear()
    part.couple()
    forces = (force for caused in part.forces for force in caused.each)
    return [(ARMS[arm], stamp, force) for arm, stamp, force in forces]


def test_arms_are_free_until_they_engage_where_they_are_then(part: CouplingPart) -> None:
    put(part, 1, MASTER, 0.05)
    put(part, 1, SLAVE, 0.2)
    assert commands(part) == []
    assert (part.engaged, part.pairing.waiting) == (False, False)
    assert part.poll(0.001, listeners=1).engage
    assert [part.is_due(moment) for moment in (0.002, 0.0209, 0.0211)] == [False, False, True]
    for tick, height in ((2, 0.05), (3, 0.06)):
        put(part, tick, MASTER, height)
        put(part, tick, SLAVE, 0.2)
    *at_rest, on_master, on_slave = commands(part)
    assert at_rest == [(arm, 2_000_000, ZERO) for arm in (MASTER, SLAVE)]
    assert on_master[:2] == (MASTER, 3_000_000)
    assert on_master[2] == pytest.approx((0.0, 0.0, -1.0))  # 100 N/m times 10 mm
    assert on_slave[2] == pytest.approx((0.0, 0.0, 0.5))


def test_a_sample_waits_for_that_of_the_other_arm(part: CouplingPart) -> None:
    put(part, 1, MASTER, 0.0)
    put(part, 1, SLAVE, 0.0)
    part.poll(0.001, listeners=1)
    commands(part)
    put(part, 2, MASTER, 0.0)
    assert commands(part) == []
    assert part.pairing.waiting
    put(part, 2, SLAVE, 0.0)
    assert len(commands(part)) == 2
    assert not part.pairing.waiting


def test_without_longer_queues_the_newest_sample_counts(part: CouplingPart) -> None:
    part = CouplingPart(PositionPositionCoupling(PARAMETERS), part.engagement, RATE)
    put(part, 1, MASTER, 0.0)
    put(part, 1, SLAVE, 0.0)
    part.poll(0.001, listeners=1)
    commands(part)
    for tick in (2, 3):
        put(part, tick, MASTER, 0.0)
    put(part, 2, SLAVE, 0.0)
    caused = [stamp for _, stamp, _ in commands(part)]
    assert caused == [2_000_000, 1_000_000], "the master's of that tick was dropped"


@pytest.mark.parametrize("silent", [True, False])
def test_arms_that_were_released_stay_free(part: CouplingPart, silent: bool) -> None:
    put(part, 1, MASTER, 0.0)
    put(part, 1, SLAVE, 0.0)
    part.poll(0.001, listeners=1)
    commands(part)
    assert part.engaged
    last = 2
    if silent:
        last = round((0.001 + RELEASED + STEP_PERIOD) * RATE)
    else:
        part.engagement.request(False)
    assert part.poll(last / RATE, listeners=1).release
    for tick in (last, last + 1):
        put(part, tick, MASTER, 0.0)
        put(part, tick, SLAVE, 0.0)
    assert commands(part) == []
    assert (part.engaged, part.pairing.waiting) == (False, False)


@pytest.mark.parametrize("arm", [MASTER, SLAVE])
def test_a_jump_of_one_arm_causes_no_force_and_is_decided_on_at_once(
    part: CouplingPart, arm: str
) -> None:
    for tick in (1, 2, 3):
        for each in (MASTER, SLAVE):
            put(part, tick, each, 0.5 if tick > 1 and each == arm else 0.0)
        if tick == 1:
            part.poll(0.001, listeners=1)
            commands(part)
            assert not part.is_due(0.002)
    assert commands(part) == []
    assert not part.pairing.waiting
    assert part.is_due(0.003)
    assert part.poll(0.003, listeners=1).release


def test_a_silence_that_nobody_looked_at_ends_the_engagement(part: CouplingPart) -> None:
    put(part, 1, MASTER, 0.0)
    put(part, 1, SLAVE, 0.0)
    part.poll(0.001, listeners=1)
    commands(part)
    for tick in range(8001, 8021):
        put(part, tick, MASTER, 0.05)  # moved by 50 mm meanwhile: 5 N
        put(part, tick, SLAVE, 0.0)
        assert commands(part) == []
    decision = part.poll(8.02, listeners=1)
    assert decision.release
    assert decision.warning == "uncoupled: no position of slave for 8 s"
    ticks = itertools.count(8021)
    while not part.poll((tick := next(ticks)) / RATE, listeners=1).engage:
        put(part, tick, MASTER, 0.05)
        put(part, tick, SLAVE, 0.0)
    assert {force for _, _, force in commands(part)} == {ZERO}


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_the_force_due_to_rounding_is_that_of_counts_less_that_of_the_motion(scale: float) -> None:
    engagement = Engagement(EngagementParameters(), now=0.0)
    for arm in (MASTER, SLAVE):
        engagement.arm_stopped(arm, False)
    parameters = CouplingParameters(k_m=100.0, k_sl=50.0, scale=scale, damping=0.0)
    part = CouplingPart(PositionPositionCoupling(parameters), engagement, RATE, longest=10)
    count, differing, wanted_forces = 55e-6, [], []
    for tick in range(3000):
        now = tick / RATE
        # Both arms vibrate, at frequencies of their own, while they creep.
        places = []
        for arm, hertz in ((MASTER, 40.0), (SLAVE, 55.0)):
            turn = 2 * math.pi * hertz
            height = 1e-3 * now + 40e-6 * math.sin(turn * now)
            speed = 1e-3 + 40e-6 * turn * math.cos(turn * now)
            counted = round(height / count) * count
            sample = ArmSample(
                tick * 1_000_000, (counted, -counted, counted), (speed, -speed, speed)
            )
            sample.arm = ARMS.index(arm)
            part.put(sample, now)
            places.append(counted - height)
        part.poll(now, listeners=1)
        commands(part)
        if tick > 1000:
            wanted = 100.0 * (places[1] / scale - places[0])
            wanted_forces.append(wanted)
            differing.append(part.count_z - wanted)
        assert (part.count_x, -part.count_y) == (part.count_z, part.count_z)
    assert math.hypot(*differing) < 0.4 * math.hypot(*wanted_forces)
    # As it is let go, nothing is left.
    part.poll(3.0 + RELEASED + STEP_PERIOD, listeners=1)
    assert part.count_z == 0.0


COUNT = 55e-6
"""Step of the arm's encoders, m."""


def moved(rate: float, seconds: float = 3.0) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of a tip that vibrates at 40 Hz while it creeps, m and m/s."""
    time = np.arange(round(seconds * rate)) / rate
    turn = 2 * math.pi * 40.0
    return (1e-3 * time + 30e-6 * np.sin(turn * time), 1e-3 + 30e-6 * turn * np.cos(turn * time))


def rounding(observer: CountObserver, position: Vector, velocity: Vector) -> Vector:
    observer.observe(ArmSample(0, position, velocity))
    return observer.x, observer.y, observer.z


def estimated(measured: FloatArray, velocity: FloatArray, rate: float) -> FloatArray:
    observer = CountObserver(rate)
    pairs = zip(measured.tolist(), velocity.tolist(), strict=True)
    errors = [rounding(observer, (-x, x, x), (-v, v, v)) for x, v in pairs]
    assert all(-x == y == z for x, y, z in errors)
    return measured - np.array([z for _, _, z in errors])


def rounded(position: FloatArray) -> FloatArray:
    return np.asarray(np.round(position / COUNT) * COUNT)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_between_counts_the_velocity_tells_where_the_arm_is(rate: float) -> None:
    position, velocity = moved(rate)
    error = estimated(rounded(position), velocity, rate) - position
    settled = round(rate)
    # Rounding alone has the standard deviation of a uniform distribution.
    assert np.std(error[settled:]) < 0.4 * COUNT / math.sqrt(12)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_a_smooth_arm_is_where_it_is_measured(rate: float) -> None:
    position, velocity = moved(rate)
    assert np.array_equal(estimated(position, velocity, rate), position)


def test_an_arm_without_velocity_is_where_it_is_measured() -> None:
    position, _ = moved(1000.0)
    measured = rounded(position)
    assert estimated(measured, np.zeros(len(measured)), 1000.0) == pytest.approx(measured)


def test_a_velocity_from_differences_changes_nothing() -> None:
    position, _ = moved(1000.0)
    measured = rounded(position)
    velocity = np.diff(measured, prepend=measured[0]) * 1000.0
    # The mean of two such velocities is half a sample late.
    assert estimated(measured, velocity, 1000.0) == pytest.approx(measured, abs=COUNT)


@given(
    steps=st.lists(st.floats(-1e-3, 1e-3), min_size=2, max_size=100),
    speeds=st.lists(st.floats(-1.0, 1.0), min_size=100, max_size=100),
)
def test_the_estimate_is_never_farther_away_than_the_largest_unexplained_step(
    steps: list[float], speeds: list[float]
) -> None:
    rate = 1000.0
    measured = np.cumsum(steps)
    velocity = np.array(speeds[: len(steps)])
    explained = (velocity[1:] + velocity[:-1]) / 2 / rate
    largest = max(abs(np.diff(measured) - explained))
    error = estimated(measured, velocity, rate) - measured
    assert max(abs(error)) <= largest + 1e-12


def test_a_count_fades_with_one_time_constant_and_bounds_the_rest_with_another() -> None:
    observer, still = CountObserver(1000.0), (1e-300,) * 3

    def rest(places: list[float]) -> float:
        return [rounding(observer, (place,) * 3, still)[2] for place in places][-1]

    # Lags of 20 ms and of 1 s by backward Euler: T / (T + 1 ms) remains after a sample.
    assert rest([0.0] + [COUNT] * 50) == pytest.approx(COUNT * (20 / 21) ** 50)
    # Half a count in each sample would add up to ten; the whole one, 100 samples ago, bounds it.
    observer.restart()
    places = [0.0] + [COUNT * (1.0 + 0.5 * sample) for sample in range(101)]
    assert rest(places) == pytest.approx(COUNT * (1000 / 1001) ** 100, rel=1e-9)


def test_after_a_restart_the_measured_position_counts() -> None:
    observer = CountObserver(1000.0)
    for tick in range(100):
        rounding(observer, (0.0, 0.0, COUNT * (tick // 7)), (0.0, 0.0, COUNT * 1000 / 7))
    observer.restart()
    assert rounding(observer, (0.0, 1.0, -1.0), (0.1, 0.1, 0.1)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("place", [0.1, math.nan, math.inf])
def test_a_jump_is_no_count(place: float) -> None:
    observer = CountObserver(1000.0)
    for tick in range(100):
        rounding(observer, (0.0, 0.0, COUNT * (tick // 7)), (0.0, 0.0, COUNT * 1000 / 7))
    for position in (place, 0.0, 0.0):
        assert rounding(observer, (0.0, 0.0, position), (0.0, 0.0, 0.01)) == pytest.approx(
            (0.0, 0.0, 0.0), abs=2e-5
        )
