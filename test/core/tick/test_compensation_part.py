# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math

import pytest

from haptic_accel.core.axes import along_actuator
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.model import Vector
from haptic_accel.core.tick import ArmSample, CompensatedSample, CompensationPart

RATE = 1000.0
PERIOD = 1_000_000
"""Period in ns."""

SOON, LATE = PERIOD // 4, PERIOD
"""Times after a sample, ns: the handle's may still come; a force for the next tick is due."""


@pytest.fixture
def part() -> CompensationPart:
    compensation = Compensation(CompensationParameters(controller="constant"), RATE)
    return CompensationPart(compensation, RATE, latency=1, longest=100)


def forces(part: CompensationPart, now: int) -> list[CompensatedSample]:
    part.results.clear()
    part.compute(now)
    return [*part.results]


def stamps(part: CompensationPart, now: int) -> list[int]:
    return [caused.stamp for caused in forces(part, now)]


def test_a_force_waits_for_the_handles_sample_of_the_tick_before(part: CompensationPart) -> None:
    part.put_tool(ArmSample(5 * PERIOD, acceleration=along_actuator(1.0)))
    assert stamps(part, 5 * PERIOD + SOON) == []
    part.put_handle(ArmSample(4 * PERIOD, acceleration=along_actuator(0.5)))
    assert stamps(part, 5 * PERIOD + SOON) == [5 * PERIOD]
    assert part.without == 0


def test_a_handles_sample_that_is_lost_is_not_waited_for(part: CompensationPart) -> None:
    for tick in (5, 6):
        part.put_tool(ArmSample(tick * PERIOD, acceleration=along_actuator(1.0)))
    assert stamps(part, 6 * PERIOD + LATE) == [5 * PERIOD, 6 * PERIOD]
    assert part.without == 1  # the first has none before it
    part.put_tool(ArmSample(7 * PERIOD, acceleration=along_actuator(1.0)))
    # That of tick 6 was lost: a later one is there.
    part.put_handle(ArmSample(8 * PERIOD, acceleration=along_actuator(0.5)))
    assert stamps(part, 7 * PERIOD + SOON) == [7 * PERIOD]
    assert part.without == 2
    # That of the tick before the last does not stand for it.
    part.put_tool(ArmSample(10 * PERIOD, acceleration=along_actuator(1.0)))
    assert stamps(part, 10 * PERIOD + LATE) == [10 * PERIOD]
    assert part.without == 3


def test_lost_samples_of_the_tool_are_predicted_unless_they_are_many(
    part: CompensationPart,
) -> None:
    for tick in (1, 3, 6, 106):
        part.put_tool(ArmSample(tick * PERIOD, acceleration=along_actuator(1.0)))
    assert len(stamps(part, 106 * PERIOD + LATE)) == 4
    assert (part.samples, part.lost, part.bridged) == (4, 102, 3)


@pytest.mark.parametrize(
    ("offset", "without"),
    [(-PERIOD // 2, 0), (-PERIOD // 2 - 1, 1), (PERIOD // 2 - 1, 0), (PERIOD // 2, 1)],
)
def test_a_handles_sample_is_of_the_nearest_tick(
    part: CompensationPart, offset: int, without: int
) -> None:
    part.put_tool(ArmSample(4 * PERIOD, acceleration=along_actuator(1.0)))
    stamps(part, 4 * PERIOD + LATE)
    part.put_tool(ArmSample(5 * PERIOD, acceleration=along_actuator(1.0)))
    part.put_handle(ArmSample(4 * PERIOD + offset, acceleration=along_actuator(0.5)))
    # It is waited for until half a period before the force is due.
    assert stamps(part, 5 * PERIOD + PERIOD // 2) == [5 * PERIOD]
    assert part.without == without


@pytest.mark.parametrize(
    ("measured", "across"),
    [((0.0, 0.0, 1.0), False), ((1.0, 0.0, 0.0), True), ((0.0, 1.0, 0.0), True)],
)
def test_a_tool_that_measures_across_the_actuator_is_known(
    part: CompensationPart, measured: Vector, across: bool
) -> None:
    for acceleration in (measured, along_actuator(2.0)):
        part.put_tool(ArmSample(PERIOD, acceleration=acceleration))
        assert part.measured_across == across


def test_of_the_samples_of_two_ticks_each_finds_its_own() -> None:
    compensation = Compensation(CompensationParameters(controller="constant"), RATE)
    part = CompensationPart(compensation, RATE, latency=1)
    part.put_tool(ArmSample(4 * PERIOD, acceleration=along_actuator(1.0)))
    stamps(part, 4 * PERIOD + LATE)
    for tick in range(1, 6):
        part.put_handle(ArmSample(tick * PERIOD, acceleration=along_actuator(0.5)))
    assert len(part.handles) == 2
    for tick in (5, 6):
        part.put_tool(ArmSample(tick * PERIOD, acceleration=along_actuator(1.0)))
    assert stamps(part, 6 * PERIOD) == [5 * PERIOD, 6 * PERIOD]
    assert part.without == 0


class Passing(Compensation):
    """A compensation for three coils that passes on what it gets."""

    def __init__(self) -> None:
        super().__init__(CompensationParameters(controller="constant", axes="x, y, z"), RATE)
        self.given: list[Vector] = []
        self.handles: list[tuple[float, ...]] = []

    def compute(self, t_x: float, t_y: float, t_z: float, *handle: float) -> None:
        self.given.append((t_x, t_y, t_z))
        self.handles.append(handle)
        self.desired_x, self.desired_y, self.desired_z = t_x, t_y, t_z


def test_a_turned_handle_gets_the_tools_vibration_in_its_own_axes() -> None:
    part = CompensationPart(Passing(), RATE, latency=1)
    part.put_tool(ArmSample(PERIOD, acceleration=(1.0, 2.0, 3.0)))
    found = [caused.desired_acceleration for caused in forces(part, PERIOD + LATE)]
    part.orientation = math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)  # a quarter turn about x
    part.put_tool(ArmSample(2 * PERIOD, acceleration=(1.0, 2.0, 3.0)))
    part.put_tool(
        ArmSample(3 * PERIOD, acceleration=along_actuator(3.0))
    )  # of a sensor with one axis
    found += [caused.desired_acceleration for caused in forces(part, 3 * PERIOD + LATE)]
    part.set_count_force(0.0, 0.0, 3.0)
    each = part.compensation
    assert (each.count_x, each.count_y, each.count_z) == pytest.approx((0.0, 3.0, 0.0))
    assert found[0] == (1.0, 2.0, 3.0)
    assert found[1] == pytest.approx((1.0, 3.0, -2.0))
    assert found[2] == along_actuator(3.0)


def test_nothing_is_predicted_from_a_sample_with_an_axis_that_is_no_number() -> None:
    passing = Passing()
    part = CompensationPart(passing, RATE, latency=1)
    for tick in range(30):
        tool = (math.nan, 1000.0, 1000.0) if tick % 3 else (0.5, 0.5, 0.5)
        part.put_tool(ArmSample(tick * PERIOD, acceleration=tool))
        forces(part, tick * PERIOD + LATE)
    part.put_tool(ArmSample(40 * PERIOD, acceleration=(1.0, 1.0, 1.0)))
    forces(part, 40 * PERIOD + LATE)
    assert part.bridged == 10
    assert all(max(map(abs, tool)) <= 0.5 for tool in passing.given[30:40])


def test_what_waits_can_be_forgotten(part: CompensationPart) -> None:
    part.put_tool(ArmSample(PERIOD, acceleration=along_actuator(1.0)))
    part.clear()
    assert not part.waiting
    for tick in (2, 9):
        assert stamps(part, tick * PERIOD + LATE) == []
        part.put_tool(ArmSample(tick * PERIOD, acceleration=along_actuator(1.0)))
        assert stamps(part, tick * PERIOD + LATE) == [tick * PERIOD]
        part.clear()
    assert part.lost == 0


@pytest.mark.parametrize(("gap", "bridged"), [(1, 0), (2, 1), (3, 2), (21, 20), (22, 0)], ids=str)
def test_each_sample_of_a_gap_that_is_not_too_long_is_predicted(gap: int, bridged: int) -> None:
    passing = Passing()
    part = CompensationPart(passing, RATE, latency=1)
    for tick in (1, 1 + gap, 2 + gap):
        part.put_tool(ArmSample(tick * PERIOD, acceleration=(1.0, 2.0, 3.0)))
        forces(part, tick * PERIOD + LATE)
    assert (part.lost, part.bridged) == (gap - 1, bridged)
    assert len(passing.given) == 3 + bridged
    # Each axis is predicted from its own past, in its own direction.
    assert all(x < y < z for x, y, z in passing.given)
    assert passing.handles == [(False, 0.0, 0.0, 0.0)] * len(passing.given), "none was measured"
