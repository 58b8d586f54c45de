# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One arm that is coupled with a peer's: when it has forces, and what it plays."""

from __future__ import annotations

import math
from typing import NamedTuple

import pytest

from haptic_accel.core.actuator import SafetyParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes, along_actuator
from haptic_accel.core.coupling.engagement import FREE_TIME, STEP_PERIOD
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.model import ZERO, Sample, Vector
from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.sampling import LATENCY, RELEASED
from haptic_accel.core.simulated_rig import rig_side
from haptic_accel.core.tick import ARM, MASTER, SLAVE
from haptic_accel.kits.link.playout import TRUE, WAITING
from haptic_accel.kits.link.two_hosts import TwoHosts

RATE = 1000.0
DELAY = 0.01
WAY = DELAY + STEP_PERIOD
"""Time in which what one host knows has an effect on the other, s."""


class Puppet:
    """A rig whose arm is where a test says, whatever pushes it."""

    at: Vector = ZERO
    acceleration: Vector = along_actuator(1.0)

    late = 0
    contact_force = None

    def read(self, time: float) -> Sample:
        """Return where it is, at rest."""
        return Sample(self.at, ZERO, self.acceleration)

    def write(self, time: float, **forces: Vector) -> None:
        """Stay."""


class PlayedSample(NamedTuple):
    """Forces that a tick caused, None for an arm without a command, and what it played."""

    on_master: Vector | None
    on_slave: Vector | None
    kind: str


class Run:
    """Two hosts, whose arms are where a test says."""

    def __init__(self, axes: Axes = ACTUATOR_AXES) -> None:
        self.rigs = {arm: Puppet() for arm in (MASTER, SLAVE)}
        sides = {
            arm: rig_side(rig, SafetyParameters(), RATE, LATENCY, [ARM])
            for arm, rig in self.rigs.items()
        }
        network = ChannelParameters(delay=DELAY)
        self.hosts = TwoHosts(PassiveParameters(), network, sides, axes=axes)
        self.master, self.slave = self.hosts.couplings.values()
        self.tick = 0

    def place(self, at: Vector) -> None:
        for rig in self.rigs.values():
            rig.at = at

    def run(self, seconds: float) -> list[PlayedSample]:
        """Return what came of the samples of a time."""
        found = []
        for _ in range(round(seconds * RATE)):
            self.hosts.step(self.tick)
            forces = {
                arm: force
                for loop in self.hosts.loops.values()
                for caused in loop.commands
                for arm, _, force in caused.each
            }
            played = self.hosts.couplings[MASTER].played
            found.append(PlayedSample(forces.get(0), forces.get(1), played.kind))
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
    run.place((math.nan, 0.0, 0.0))
    assert {each.on_master for each in run.run(RELEASED / 2)} == {None}
    assert run.engaged == (True, True)
    run.run(RELEASED)
    assert run.engaged == (False, False)


def test_after_a_silence_playout_begins_anew_and_arms_engage_after_resting() -> None:
    run = engaged_run()
    for channel in run.hosts.channels:
        channel.parameters = ChannelParameters(loss=1.0)
    kinds = [each.kind for each in run.run(2 * RELEASED)]
    assert kinds[0] == TRUE
    assert kinds[-1] == WAITING
    for channel in run.hosts.channels:
        channel.parameters = ChannelParameters(delay=DELAY)
    assert run.run(DELAY + 2 / RATE)[-1].kind == TRUE
    assert run.engaged == (False, False)
    run.run(FREE_TIME + 2 * WAY)
    assert run.engaged == (True, True)


def test_a_half_that_starts_again_is_engaged_with_anew() -> None:
    run = engaged_run()
    run.hosts.restart(SLAVE, run.tick / RATE)
    run.slave = run.hosts.couplings[SLAVE]
    run.run(RELEASED + 2 * WAY)
    assert run.engaged == (False, False)
    run.run(2 * FREE_TIME + 4 * WAY)
    assert run.engaged == (True, True)
    assert (run.master.engagement.count, run.slave.engagement.count) == (2, 1)


@pytest.mark.parametrize(
    ("axes", "felt"), [(ALL_AXES, (1.0, -2.0, 3.0)), (ACTUATOR_AXES, (0.0, 0.0, 3.0))]
)
def test_a_tool_is_felt_along_the_axes_that_it_has(axes: Axes, felt: Vector) -> None:
    run = Run(axes)
    run.rigs[SLAVE].acceleration = (1.0, -2.0, 3.0)
    run.run(3 * WAY)
    assert run.master.played == (felt, TRUE)
