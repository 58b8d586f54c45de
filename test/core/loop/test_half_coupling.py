# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One arm that is coupled with a peer's: when it has forces, and what it plays."""

from __future__ import annotations

import math

from haptic_accel.core.coupling.engagement import FREE_TIME, STEP_PERIOD
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network.channel import ChannelParameters
from haptic_accel.core.network.playout import TRUE, WAITING
from haptic_accel.core.sampling import RELEASED
from haptic_accel.core.two_hosts import Crossed, TwoHosts

RATE = 1000.0
DELAY = 0.01
WAY = DELAY + STEP_PERIOD
"""Time in which what one host knows has an effect on the other, s."""


class Run:
    """Two halves, whose arms are where a test says."""

    def __init__(self) -> None:
        self.hosts = TwoHosts(PassiveParameters(), ChannelParameters(delay=DELAY), RATE)
        self.master, self.slave = self.hosts.halves
        self.at: Vector = ZERO
        self.tick = 0

    def run(self, seconds: float) -> list[Crossed]:
        """Return what came of the samples of a time."""
        found = []
        for _ in range(round(seconds * RATE)):
            arm = Motion(0, self.at, ZERO)
            found.append(self.hosts.sample(self.tick / RATE, arm, arm, acceleration=1.0))
            self.tick += 1
        return found

    @property
    def engaged(self) -> tuple[bool, bool]:
        return self.master.end.engaged, self.slave.end.engaged


def engaged_run() -> Run:
    run = Run()
    free = run.run(0.01)
    assert all((each.on_master, each.on_slave) == (None, None) for each in free)
    run.run(0.2)
    assert run.engaged == (True, True)
    return run


def test_an_emergency_stop_on_one_host_frees_both_until_each_is_released() -> None:
    run = engaged_run()
    run.slave.engagement.stop.stop()
    found = run.run(2 * WAY)
    assert run.engaged == (False, False)
    assert found[-1].on_master is found[-1].on_slave is None
    for half in (run.slave, run.master):
        run.run(1.0)
        assert run.engaged == (False, False)
        assert half.engagement.stop.release(run.tick / RATE, []) == ""
    run.run(2 * WAY)
    assert run.engaged == (True, True)


def test_an_arm_that_is_released_is_told_so_once() -> None:
    run = engaged_run()
    run.master.engagement.request(False)
    forces = [each.on_master for each in run.run(2 * WAY)]
    assert forces.count(ZERO) >= 1
    free = forces.index(None)
    assert forces[free - 1] == ZERO
    assert set(forces[free:]) == {None}


def test_a_sample_that_is_not_finite_counts_as_missing() -> None:
    run = engaged_run()
    run.at = (math.nan, 0.0, 0.0)
    assert {each.on_master for each in run.run(RELEASED / 2)} == {None}
    assert run.engaged == (True, True)
    run.run(RELEASED)
    assert run.engaged == (False, False)


def test_after_a_silence_playout_begins_anew_and_arms_engage_after_resting() -> None:
    run = engaged_run()
    for channel in run.hosts.channels:
        channel.parameters = ChannelParameters(loss=1.0)
    kinds = [each.played.kind for each in run.run(2 * RELEASED)]
    assert kinds[0] == TRUE
    assert kinds[-1] == WAITING
    for channel in run.hosts.channels:
        channel.parameters = ChannelParameters(delay=DELAY)
    assert run.run(DELAY + 2 / RATE)[-1].played.kind == TRUE
    assert run.engaged == (False, False)
    run.run(FREE_TIME + 2 * WAY)
    assert run.engaged == (True, True)


def test_a_half_that_starts_again_is_engaged_with_anew() -> None:
    run = engaged_run()
    run.hosts.restart(1, run.tick / RATE)
    _, run.slave = run.hosts.halves
    run.run(RELEASED + 2 * WAY)
    assert run.engaged == (False, False)
    run.run(2 * FREE_TIME + 4 * WAY)
    assert run.engaged == (True, True)
    assert (run.master.engagement.count, run.slave.engagement.count) == (2, 1)
