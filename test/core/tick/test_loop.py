# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop of one host with devices that keep what was asked of them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from haptic_accel.core.actuator import ActuatorParameters, MasterSafetyParameters, SafetyParameters
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.coupling.engagement import STEP_PERIOD, Engagement, EngagementParameters
from haptic_accel.core.coupling.passive import CouplingParameters
from haptic_accel.core.model import LATER, ZERO, Reading, Sample, Vector
from haptic_accel.core.sampling import RELEASED
from haptic_accel.core.tick import (
    ACTUATOR,
    ARM,
    MASTER,
    SLAVE,
    ArmSample,
    CompensationPart,
    CouplingPart,
    DeviceSide,
    HostLoop,
    PositionPositionCoupling,
    SafetyLayer,
)

RATE = 1000.0
K_M, K_SL = 100.0, 50.0
Clock = Callable[[], float]
TRAVEL = 1e-4
"""Way of the slave from tick to tick, m."""


class BrokenError(Exception):
    """A device fails."""


class Device:
    """An arm that goes up by `travel` a tick, and keeps what was written to it with the tick."""

    late = 0

    def __init__(self, travel: float = 0.0) -> None:
        self._travel = travel
        self.speed = 0.0
        self.arm: list[tuple[int, Vector]] = []
        self.actuator: list[tuple[int, float]] = []
        self.there = True
        self.broken = False

    contact_force = None

    def read(self, time: float) -> Reading:
        if self.broken:
            raise BrokenError
        tick = round(time * RATE)
        height = self._travel * tick
        moving = 0.0, 0.0, self.speed
        sample = Sample((0.0, 0.0, height), moving, along_actuator(float(tick)))
        return sample if self.there else LATER

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        tick = round(time * RATE)
        if arm_force is not None:
            self.arm.append((tick, arm_force))
        if actuator_force is not None:
            self.actuator.append((tick, actuator_force[ACTUATOR_AXIS]))


class Rig:
    """Both devices in a loop."""

    def __init__(
        self,
        latency: int = 1,
        clock: Clock | None = None,
        part: type[CouplingPart] = CouplingPart,
    ) -> None:
        self.master, self.slave = Device(), Device(TRAVEL)
        self.failed: list[tuple[str, type[Exception]]] = []
        limits = MasterSafetyParameters(hardware=ActuatorParameters())
        sides = {
            MASTER: self._side(self.master, limits, latency, (ARM, ACTUATOR), clock),
            SLAVE: self._side(self.slave, SafetyParameters(), latency, (ARM,), clock),
        }
        engagement = Engagement(EngagementParameters(), now=0.0)
        for arm in sides:
            engagement.arm_stopped(arm, False)
        coupling = PositionPositionCoupling(
            CouplingParameters(k_m=K_M, k_sl=K_SL, scale=1.0, damping=0.0)
        )
        compensation = Compensation(CompensationParameters(controller="constant"), RATE)
        self.part = part(coupling, engagement, RATE, longest=10)
        self.compensation = CompensationPart(compensation, RATE, latency, longest=10)
        self.loop = HostLoop(
            sides, self.part, self.compensation, failures=(BrokenError,), failed=self._fail
        )

    def steps(self, ticks: range) -> None:
        for tick in ticks:
            self.loop.step(tick)

    def _fail(self, arm: str, error: Exception) -> None:
        self.failed.append((arm, type(error)))
        self.loop.sides[arm].sampling = False

    @staticmethod
    def _side(
        device: Device,
        limits: SafetyParameters,
        latency: int,
        kinds: tuple[str, ...],
        clock: Clock | None,
    ) -> DeviceSide:
        safety = SafetyLayer(limits, RATE)
        safety.enable(0.0, True)
        return DeviceSide(device, safety, RATE, latency, kinds=kinds, clock=clock)


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_force_takes_effect_so_many_ticks_after_its_sample(latency: int) -> None:
    rig = Rig(latency)
    rig.steps(range(10))
    # Both engage at tick 0; at tick k the slave is k times its travel away from there.
    expected = [(k + latency, (0.0, 0.0, K_M * TRAVEL * k)) for k in range(10 - latency)]
    assert [tick for tick, _ in rig.master.arm] == [tick for tick, _ in expected]
    for (_, force), (_, wanted) in zip(rig.master.arm, expected, strict=True):
        assert force == pytest.approx(wanted)
    last_tick, last_pull = rig.slave.arm[-1]
    assert last_tick == 9
    assert last_pull == pytest.approx((0.0, 0.0, -K_SL * TRAVEL * (9 - latency)))
    assert [tick for tick, _ in rig.master.actuator] == list(range(latency, 10))


def test_the_compensation_knows_the_rounding_of_the_ticks_own_force() -> None:
    rig = Rig()
    rig.slave.speed = 0.9 * TRAVEL * RATE  # the velocity explains most of the way of a tick
    known = []
    for tick in range(5):
        rig.loop.step(tick)
        each = rig.compensation.compensation
        known.append((each.count_x, each.count_y, each.count_z))
        assert known[-1] == (rig.part.count_x, rig.part.count_y, rig.part.count_z)
    # The slave is ahead by a tenth of its travel at the first tick with a motion before it.
    assert known[1] == pytest.approx((0.0, 0.0, K_M * 0.1 * TRAVEL), rel=0.06)


def test_what_a_tick_did_can_be_seen_until_the_next() -> None:
    rig = Rig()
    rig.steps(range(3))
    loop = rig.loop
    assert [(sample.arm, sample.tick) for sample in loop.samples] == [(0, 2), (1, 2)]
    ((on_master, on_slave),) = (caused.each for caused in loop.commands)
    assert (on_master[:2], on_slave[:2]) == ((0, 2_000_000), (1, 2_000_000))
    assert [tool.acceleration for tool in loop.tools] == [along_actuator(2.0)]
    assert [sample.stamp for sample in loop.compensated] == [2_000_000]
    loop.go_on()
    assert not any((loop.samples, loop.commands, loop.tools, loop.compensated))


def test_a_sample_that_comes_later_causes_its_forces_then() -> None:
    rig = Rig()
    rig.steps(range(5))
    rig.slave.there = False
    rig.loop.step(5)
    assert not rig.loop.complete
    assert [sample.arm for sample in rig.loop.samples] == [0]
    assert not any((rig.loop.commands, rig.loop.compensated))
    rig.slave.there = True
    rig.loop.go_on()
    assert rig.loop.complete
    assert {stamp for _, stamp, _ in rig.loop.commands[0].each} == {5_000_000}
    rig.loop.step(6)
    assert rig.master.arm[-1] == (6, pytest.approx((0.0, 0.0, K_M * TRAVEL * 5)))
    assert rig.compensation.without == 0


def test_without_latency_a_late_sample_acts_at_the_time_by_the_clock() -> None:
    now = 0.0
    rig = Rig(latency=0, clock=lambda: now)
    rig.steps(range(5))
    rig.slave.there = False
    now = 5 / RATE
    rig.loop.step(5)
    rig.slave.there = True
    now = 7 / RATE
    rig.loop.go_on()
    assert rig.master.arm[-1] == (7, pytest.approx((0.0, 0.0, K_M * TRAVEL * 5)))


def test_a_device_that_fails_ends_nothing_but_its_own_forces() -> None:
    rig = Rig()
    rig.steps(range(5))
    rig.slave.broken = True
    rig.steps(range(5, 10))
    assert rig.failed == [(SLAVE, BrokenError)]
    assert [(sample.arm, sample.tick) for sample in rig.loop.samples] == [(0, 9)]
    assert rig.slave.arm[-1][0] == 4
    # The master is held by nobody, and let go.
    rig.steps(range(10, 10 + round((RELEASED + STEP_PERIOD) * RATE) + 2))
    assert not rig.part.engaged
    assert rig.master.arm[-1][1] == ZERO


@pytest.mark.parametrize("name", ["master/measured_cp", "slave/work"])
def test_without_an_arms_motion_both_are_let_go(name: str) -> None:
    rig = Rig()
    rig.steps(range(5))
    rig.loop.mute({name})
    muted = range(5, 5 + round((RELEASED + STEP_PERIOD) * RATE) + 2)
    rig.steps(muted)
    assert not rig.part.engaged
    assert rig.master.arm[-1][1] == ZERO
    assert rig.loop.contested == len(muted)
    for side in rig.loop.sides.values():
        assert side.safety.diagnostics()["arm force outdated"] == "0"
    assert rig.loop.compensated, "the vibration does not depend on it"


def test_without_the_tools_acceleration_no_force_is_felt() -> None:
    rig = Rig()
    rig.steps(range(5))
    rig.loop.mute({"slave/tool/acceleration"})
    rig.steps(range(5, 20))
    assert rig.loop.contested == 15
    assert not rig.loop.compensated
    assert len(rig.loop.commands) == 1
    assert rig.master.actuator[-1][1] == 0.0


def test_without_the_handles_acceleration_forces_are_in_time_all_the_same() -> None:
    rig = Rig()
    rig.steps(range(5))
    rig.loop.mute({"master/handle/acceleration"})
    rig.steps(range(5, 20))
    assert [tick for tick, _ in rig.master.actuator] == list(range(1, 20))
    assert rig.compensation.without == 15


class PlayingPart(CouplingPart):
    """A coupling that plays what another host's tool measured: the number of the tick."""

    def begin(self, now: float, stamp: int) -> ArmSample:
        return ArmSample(stamp, acceleration=along_actuator(now * RATE))


def test_what_another_hosts_tool_measured_is_reproduced_at_its_tick() -> None:
    rig = Rig(part=PlayingPart)
    rig.part.passes_tools = False
    loop = HostLoop({MASTER: rig.loop.sides[MASTER]}, rig.part, rig.compensation)
    first = 2_000_000  # after half an hour
    for tick, is_first in ((first, True), (first + 1, False), (first + 2, True)):
        loop.step(tick, is_first)
        ticks = [tick] if is_first else [first, tick]
        assert [each.stamp for each in loop.tools] == [each * 1_000_000 for each in ticks]
        assert [each.a_z for each in loop.tools] == pytest.approx(ticks)
        assert [each.stamp for each in loop.compensated] == [each * 1_000_000 for each in ticks]
        assert [each.tick for each in loop.samples] == ticks
    assert [tick for tick, _ in rig.master.actuator] == [first + 1, first + 2]
    loop.mute({"slave/tool/acceleration"})
    loop.step(first + 3)
    assert (len(loop.tools), loop.compensated, loop.contested) == (1, [], 1)
