# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated rigs whose accelerometers are connected wrongly, or broken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from haptic_accel.core.model import FloatArray, Sample, Vector
from haptic_accel.core.rig import Rig
from haptic_accel.core.rig.master_rig import simulated_master
from haptic_accel.core.rig.slave_rig import SlaveRig
from haptic_accel.core.simulated_rig import build_loop, build_parts
from haptic_accel.core.tick import MASTER, SLAVE, CompensationPart
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.setup import Setup

Sensor = Callable[[Vector, Vector], Vector]
"""What an accelerometer measures of the accelerations of handle and tool, m/s^2."""


@dataclass(frozen=True)
class Mixture:
    """Accelerometer that measures parts of the accelerations of handle and tool."""

    parts: tuple[float, float]

    def __call__(self, handle: Vector, tool: Vector) -> Vector:
        x, y, z = np.array(self.parts) @ np.array([handle, tool])
        return float(x), float(y), float(z)


class Sensed(Rig):
    """Rig with another accelerometer."""

    def __init__(self, own: Rig, both: Sequence[Rig], sensor: Sensor) -> None:
        super().__init__(own.motion)
        self._own, self._both, self._sensor = own, both, sensor

    def read(self, time: float) -> Sample:
        handle, tool = [each.read(time).acceleration for each in self._both]
        return self._own.read(time)._replace(acceleration=self._sensor(handle, tool))


class Result(NamedTuple):
    """Force after silence, N, and the last failure; parts for further calls."""

    force: FloatArray
    failure: str
    part: CompensationPart


def run_sensed(
    controller: str,
    rig_name: str,
    sensors: Mapping[str, Sensor],
    tool: FloatArray,
    rate: float = 1000.0,
) -> Result:
    """Run a rig with other accelerometers of master, slave or both."""
    setup = Setup.of(parse_arguments([f"controller:={controller}", f"rig:={rig_name}"]))
    rig = setup.rig()
    around, controllers = setup.node("compensator")
    rigs = simulated_master(rig.master, rate), SlaveRig(rig.slave, rate, 0, tool)
    own = dict(zip((MASTER, SLAVE), rigs, strict=True))
    devices = own | {arm: Sensed(own[arm], rigs, each) for arm, each in sensors.items()}
    around = replace(around, controller=controller)
    sides, part = build_parts(rig, devices, around, controllers, rate, 1)
    loop = build_loop(rig, sides, part)
    rows = np.zeros((len(tool), 10, 3))
    loop.record(rows)
    for tick in range(len(tool)):
        loop.step(tick)
    return Result(rows[:, 9, 2], part.slow.failure, part)
