# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop in frames, whose forces are given ahead, against the loop sample by sample."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_accel.core.model import Sample, Vector
from haptic_accel.core.rig.master_rig import axes_of
from haptic_accel.core.simulated_rig import build_loop, build_parts, rig_side
from haptic_accel.core.tick import ACTUATOR, ARM, DeviceSide, HostLoop, SafetyLayer
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import Device
from haptic_accel.devices.simulated import SimulatedMaster, SimulatedSlave
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup

RATE, LATENCY, SECONDS = 2000.0, 6, 1.0

Signals = list[tuple[Vector, ...]]


class FrameClock:
    """Time at which the samples of a frame are processed, s."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def loop_with(clock: FrameClock, frame: int) -> HostLoop:
    """Return the loop of both simulated arms by a clock, in frames or sample by sample."""
    setup = Setup.of(GraphArguments(rig="paper", controller="adaptive", rate=RATE))
    rig = setup.rig()
    around, controllers = setup.node("compensator")
    slave_parameters = setup.node("slave_device")[1]["simulated"]
    devices: dict[str, Device] = {
        ARMS[0]: SimulatedMaster(rig.master, RATE, 0),
        ARMS[1]: SimulatedSlave(slave_parameters, RATE, 0),
    }
    sides = {}
    axes = axes_of(rig.master)
    for (arm, device), limits in zip(devices.items(), rig.safety, strict=True):
        device.open()
        safety = SafetyLayer(limits, RATE, axes)
        safety.enable(0.0, True)
        kinds = (ARM, ACTUATOR) if arm == ARMS[0] else (ARM,)
        sides[arm] = DeviceSide(
            device, safety, RATE, LATENCY, clock, kinds=kinds, framed=frame > 1
        )
    parts = build_parts(rig, devices, around, controllers, RATE, LATENCY)  # type: ignore[arg-type]
    return build_loop(rig, sides, parts[1])


def signals(frame: int, late: float = 0.0) -> tuple[Signals, dict[str, tuple[int, int]]]:
    """Return all samples and forces of a trial, and the deadlines of each side.

    Frames are processed `late` after their last sample, s.
    """
    clock = FrameClock()
    loop = loop_with(clock, frame)
    recorded = np.full((round(SECONDS * RATE), 10, 3), math.nan)
    loop.record(recorded)
    found: Signals = []
    for last in range(frame - 1, round(SECONDS * RATE), frame):
        clock.now = last / RATE + late
        for tick in range(last - frame + 1, last + 1):
            loop.step(tick)
            if loop.commands and loop.compensated:
                row = [(each.acceleration, each.position, each.velocity) for each in loop.samples]
                forces = [force for _, _, force in loop.commands[0].each]
                felt = loop.compensated[0]
                last_row = felt.desired_acceleration, felt.actuator_force
                expected = (*row[0], forces[0], *row[1], forces[1], *last_row)
                assert recorded[tick].tolist() == [*map(list, expected)]
            found.append(
                (
                    *(each.acceleration for each in loop.samples),
                    *(each.position for each in loop.samples),
                    *(each.work for each in loop.samples),
                    *(force for each in loop.commands for _, _, force in each.each),
                    *(each.actuator_force for each in loop.compensated),
                )
            )
    return found, {arm: side.deadlines for arm, side in loop.sides.items()}


@pytest.mark.parametrize("frame", [2, 4, 5])
def test_frames_give_the_signals_of_single_samples_bit_for_bit(frame: int) -> None:
    expected, _ = signals(1)
    found, deadlines = signals(frame)
    assert len(found) == len(expected)
    assert found == expected
    assert any(any(force) for row in found for force in row[6:])
    for due, missed in deadlines.values():
        assert due > 0.9 * SECONDS * RATE
        assert missed == 0


@pytest.mark.parametrize(("late", "in_time"), [(1.4e-3, True), (1.8e-3, False)])
def test_an_overdue_force_acts_when_it_is_given(late: float, in_time: bool) -> None:
    # The first force of four is due three samples, 1.5 ms, after the last of its frame.
    expected, _ = signals(1)
    found, deadlines = signals(4, late)
    assert (found == expected) == in_time
    for due, missed in deadlines.values():
        assert missed == (0 if in_time else pytest.approx(due / 4, rel=0.02))


class ByTuples(SimulatedMaster):
    """A simulated device that is read and written like any other."""

    def read(self, time: float) -> Sample:
        return super().read(time)


def test_a_simulated_device_is_driven_like_any_other() -> None:
    rig = Setup.of(GraphArguments(rig="three_axis", controller="constant", rate=RATE)).rig()
    sides = [
        rig_side(device(rig.master, RATE, 0), rig.safety[0], RATE, 1, axes=axes_of(rig.master))
        for device in (SimulatedMaster, ByTuples)
    ]
    assert [side.motion is None for side in sides] == [False, True]
    for tick in range(200):
        read = []
        for side in sides:
            side.begin(tick)
            side.read()
            read.append([(each.sample, each.work) for each in side.samples])
            for kind, size in ((ARM, 0.5), (ACTUATOR, 0.2)):
                side.command(kind, tick * 1e9 / RATE, size, -size, 0.5 * size)
            side.apply()
            side.watch()
        assert read[0] == read[1]
