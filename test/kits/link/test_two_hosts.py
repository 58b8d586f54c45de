# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two hosts in lockstep: what a network between them does to vibration, force and energy."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache

import numpy as np
import pytest

from haptic_accel.core import topics
from haptic_accel.core.coupling.passive import CouplingParameters, PassiveParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.sampling import RELEASED
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import Crossing, Trial, run_trial
from haptic_accel.kits.link.endpoint import Motion, State
from haptic_accel.kits.link.two_hosts import CATCH_UP, ArmEndpoint
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup
from nightly import rest_slow

SETTLED = 1000
"""Samples after which playout knows the network."""


def textured() -> RigParameters:
    return Setup.of(GraphArguments(rig="ideal", surface="text")).rig()


@lru_cache
def trial(
    channel: ChannelParameters | None = None, blackouts: tuple[tuple[float, float], ...] = ()
) -> Trial:
    return run_trial(
        "inverse", textured(), duration=4.0, seed=3, channel=channel, blackouts=blackouts
    )


def crossing(of: Trial) -> Crossing:
    assert of.crossing
    return of.crossing


def nrmse(of: Trial) -> float:
    return of.evaluate(SETTLED).nrmse_percent


def given(of: Trial) -> float:
    """Return the greatest net energy that the motors of both arms gave, J."""
    total = np.zeros(len(of.time) - 1)
    for arm in (topics.MASTER, topics.SLAVE):
        force, place = of.arms[arm.arm_force.name], of.arms[arm.position.name]
        acting = np.roll(force, of.latency, axis=0)
        acting[: of.latency] = 0.0
        total += np.sum(acting[:-1] * np.diff(place, axis=0), axis=1)
    return float(np.cumsum(total).max())


def test_a_network_without_delay_is_as_one_host() -> None:
    one, two = trial(), trial(ChannelParameters())
    met = crossing(two).kinds.index("true")
    assert met == 2, "a packet of each host, and one that answers it"
    assert set(crossing(two).kinds[met:]) == {"true"}
    assert crossing(two).age[met:] == pytest.approx(1 / two.rate)
    played = two.tool_acceleration.astype(np.float32)
    assert np.array_equal(crossing(two).played[met:], played[met:])
    assert nrmse(two) == pytest.approx(nrmse(one), abs=1.0)


@pytest.mark.parametrize(
    ("loss", "points"), rest_slow([(0.05, 4.0), (0.0, 1.0), (0.01, 2.0), (0.1, 8.0)])
)
def test_what_is_lost_costs_little_and_what_is_late_a_few_milliseconds(
    loss: float, points: float
) -> None:
    network = ChannelParameters(delay=0.02, jitter=0.01, loss=loss)
    found = trial(network)
    assert nrmse(found) <= nrmse(trial(ChannelParameters(delay=0.02))) + points
    assert np.quantile(crossing(found).age[SETTLED:], 0.99) <= network.delay + 5.1e-3


def test_through_a_blackout_the_arms_are_free_and_afterwards_coupled_again() -> None:
    blackout = 2.0, 3.0
    found = trial(ChannelParameters(delay=0.02), (blackout,))
    forces = np.abs(found.arms[topics.SLAVE.arm_force.name]).max(axis=1)
    free = (found.time > blackout[0] + 0.021 + RELEASED) & (found.time < blackout[1])
    assert forces[found.time < blackout[0]].max() > 0.1
    assert forces[free].max() == 0.0
    assert forces[found.time > blackout[1] + 0.2].max() > 0.1
    felt = np.abs(np.diff(crossing(found).played[free]))
    assert felt.max() == 0.0
    assert given(found) <= 2 * PassiveParameters().energy


def test_the_slave_moves_in_its_own_scale() -> None:
    rig = RigParameters(coupling=CouplingParameters(scale=2.0))
    found = run_trial("none", rig, duration=1.0, channel=ChannelParameters(delay=0.005))
    master, slave = (
        np.ptp(found.arms[arm.position.name][:, 0]) for arm in (topics.MASTER, topics.SLAVE)
    )
    assert slave == pytest.approx(2.0 * master, rel=0.3)  # the tool lags on its spring


RATE, SCALE, STIFFNESS = 1000.0, 2.0, 250.0
BEGIN = 1_800_000_000_000_000_000
MASTER, SLAVE = (0.3, 0.0, 0.1), (-0.2, 0.05, 0.0)
"""Places where the arms engage, m."""


def coupled(*moved: Vector, free: bool = False) -> tuple[list[ArmEndpoint], list[Vector]]:
    """Return both ends and their forces after half a second at places from where they engaged."""
    law = PassiveParameters(law="spring", stiffness=STIFFNESS, scale=SCALE, max_force=50.0)
    ends = [
        ArmEndpoint(side, law, RATE, 1, number) for number, side in ((1, "master"), (2, "slave"))
    ]
    starts = MASTER, SLAVE
    for end, start in zip(ends, starts, strict=True):
        if not free:
            end.engage(start)
    places = [tuple(map(sum, zip(*pair, strict=True))) for pair in zip(starts, moved, strict=True)]
    forces = [ZERO, ZERO]
    for tick in range(500):
        now, system = tick / RATE, BEGIN + tick * 1_000_000
        state = State(ready=True, engaged=not free, engagement=1)
        sent = [
            end.outgoing(state, Motion(system, place, ZERO), now, system)
            for end, place in zip(ends, places, strict=True)
        ]
        for end, data in zip(ends, reversed(sent), strict=True):
            if data:
                end.incoming(data, now, system)
        forces = [end.force(place, ZERO, now) for end, place in zip(ends, places, strict=True)]
    return ends, forces


def test_positions_cross_from_where_each_arm_engaged_in_the_masters_scale() -> None:
    (master, slave), _ = coupled((0.001, 0.0, 0.0), (0.0, 0.004, 0.0))
    assert master.set_point[0] == pytest.approx((0.0, 0.004 / SCALE, 0.0))
    assert slave.set_point[0] == pytest.approx((0.001, 0.0, 0.0))


def test_both_arms_are_pulled_to_each_other_and_the_slave_by_its_scale_more() -> None:
    _, (on_master, on_slave) = coupled((0.001, 0.0, 0.0), ZERO)
    assert on_master == pytest.approx((-STIFFNESS * 0.001, 0.0, 0.0))
    assert on_slave == pytest.approx((SCALE * STIFFNESS * 0.001, 0.0, 0.0), rel=1e-3)


def test_a_slave_that_followed_by_the_scale_pulls_nobody() -> None:
    _, forces = coupled((0.001, 0.0, 0.0), (0.001 * SCALE, 0.0, 0.0))
    assert forces[0] == pytest.approx(ZERO, abs=1e-9)
    assert forces[1] == pytest.approx(ZERO, abs=1e-3)


def test_a_free_arm_is_said_to_be_at_rest_and_is_not_pulled() -> None:
    (master, slave), forces = coupled((0.001, 0.0, 0.0), (0.0, 0.004, 0.0), free=True)
    assert master.set_point == slave.set_point == (ZERO, ZERO)
    assert forces == [ZERO, ZERO]


def resumed(apart: Vector, seconds: float) -> tuple[ArmEndpoint, list[float]]:
    """Return a master's end, and its force's size in each sample after it resumes.

    The arm has moved since it was released; the slave has not moved.
    """
    law = PassiveParameters(law="damped", stiffness=STIFFNESS)
    master, slave = (
        ArmEndpoint(side, law, RATE, 1, number) for number, side in ((1, "master"), (2, "slave"))
    )
    x, y, z = map(sum, zip(MASTER, apart, strict=True))
    master.engage(MASTER)
    master.half.disengage()
    master.engage((x, y, z), resume=True)
    slave.engage(SLAVE)
    sizes = []
    for tick in range(round(seconds * RATE)):
        now, system = tick / RATE, BEGIN + tick * 1_000_000
        for end, other, place in ((slave, master, SLAVE), (master, slave, (x, y, z))):
            state = State(ready=True, engaged=True, engagement=2)
            if data := end.outgoing(state, Motion(system, place, ZERO), now, system):
                other.incoming(data, now, system)
        sizes.append(math.hypot(*master.force((x, y, z), ZERO, now)))
    return master, sizes


def test_an_arm_that_resumes_approaches_its_reference_position_slowly_from_where_it_is() -> None:
    master, sizes = resumed((0.006, 0.0, -0.008), seconds=0.5)
    assert max(sizes[:3]) < 0.01
    steps = [abs(after - before) for before, after in itertools.pairwise(sizes)]
    # The set-point moves at CATCH_UP; the stiffness, too, rises slowly.
    assert max(steps) < 2 * STIFFNESS * CATCH_UP / RATE
    assert sizes[-1] == pytest.approx(master.half.stiffness * 0.01, rel=1e-3)
    assert sizes[50] < 0.25 * sizes[-1]


def test_an_account_of_energy_that_is_wrong_once_lets_energy_cross_again() -> None:
    ends = [ArmEndpoint(side, PassiveParameters(), RATE, 1, 7) for side in ("master", "slave")]
    master, slave = ends
    tick = 0

    def run(seconds: float) -> None:
        nonlocal tick
        for _ in range(round(seconds * RATE)):
            tick += 1
            now, system = tick / RATE, BEGIN + tick * 1_000_000
            for end, other in ((master, slave), (slave, master)):
                state = State(ready=True, engaged=end.engaged)
                if data := end.outgoing(state, Motion(system), now, system):
                    other.incoming(data, now, system)
                if not end.engaged:
                    end.engage(ZERO)
                end.force(ZERO, ZERO, now)

    run(1.0)
    packet = master.endpoint.peer
    assert packet
    wrong = packet._replace(sequence=packet.sequence + 1, shipped=1e300)
    master.incoming(wrong.pack(), tick / RATE, BEGIN)
    run(3.0)
    before = master.half.energy
    slave.half.energy += 0.01  # as if its arm had taken it
    run(0.1)
    assert before < master.half.energy < before + 0.01
