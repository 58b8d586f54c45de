# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device that is sampled and driven without a graph."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from haptic_accel.core.actuator import MasterSafetyParameters
from haptic_accel.core.axes import along_actuator
from haptic_accel.core.handle.mechanics import sampled_response
from haptic_accel.core.model import ZERO, AccelerometerParameters, Vector
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.devices.interface import DeviceError, Reading
from haptic_accel.devices.observed import ObservedDevice
from haptic_accel.devices.simulated import SimulatedMaster
from running import wait_until

RATE = 1000.0
PROBE_FREQUENCY = 150.0  # Hz
AMPLITUDE = 0.3  # N


def probe(moment: float) -> float:
    return AMPLITUDE * math.cos(2 * math.pi * PROBE_FREQUENCY * moment)


def observed(device: SimulatedMaster) -> ObservedDevice:
    return ObservedDevice(device, MasterSafetyParameters(), RATE, 1, lambda: None)


def test_a_force_moves_the_handle_as_its_model_says() -> None:
    parameters = MasterRigParameters(accelerometer=AccelerometerParameters(noise_density=0.0))
    with observed(SimulatedMaster(parameters, RATE, 0)) as device:
        device.drive(probe)
        time.sleep(0.5)
        seen = device.observe(0.5)
    whole = ~np.isnan(seen.acceleration) & (seen.force != 0.0)
    if whole.mean() < 0.9:
        pytest.skip("this machine was held up")
    there = ~np.isnan(seen.acceleration)
    wave = np.exp(-2j * math.pi * PROBE_FREQUENCY / RATE * np.flatnonzero(there))
    found = (wave @ seen.acceleration[there]) / (wave @ seen.force[there])
    handle, mount = parameters.handle, parameters.mount
    driven, bandwidth = np.array([PROBE_FREQUENCY]), parameters.accelerometer.bandwidth
    expected = sampled_response(handle, driven, RATE, 0.0, bandwidth, mount)[0]
    assert abs(found) == pytest.approx(abs(expected), rel=0.1)
    assert found.real > 0


@pytest.mark.parametrize("last", [2, 3])
def test_what_was_interrupted_is_measured_again_or_refused(last: int) -> None:
    counts = iter([0, 1, 1, 2, 2, last])  # before and after each measurement

    class Interrupted(SimulatedMaster):
        interruptions = property(lambda _: next(counts))  # type: ignore[assignment]

    with observed(Interrupted(MasterRigParameters(), RATE, 0)) as device:
        if last == 2:
            assert len(device.observe(0.1).acceleration) == 100
            return
        with pytest.raises(DeviceError, match="1 times in 0.1 s, must be none; measured 3 times"):
            device.observe(0.1)


def test_a_stopped_device_gets_no_force() -> None:
    master = SimulatedMaster(MasterRigParameters(), RATE, 0)
    forces: list[Vector] = []
    write = master.write

    def noted(moment: float, **given: Vector) -> None:
        forces.append(given.get("actuator_force", ZERO))
        write(moment, **given)

    master.write = noted  # type: ignore[method-assign]
    with observed(master) as device:
        device.drive(lambda _: 1.0)
        wait_until(lambda: along_actuator(1.0) in forces, "a force")
        device.stop()
        forces.clear()
        time.sleep(0.1)
        assert set(forces) <= {ZERO}
        device.arm()
        wait_until(lambda: along_actuator(1.0) in forces, "a force")


class Broken(SimulatedMaster):
    """Device that fails after some samples."""

    left = 100

    def read(self, time: float) -> Reading:
        self.left -= 1
        if not self.left:
            raise DeviceError("the device has gone")
        return super().read(time)


def test_a_failure_is_kept_and_later_samples_are_missing() -> None:
    with observed(Broken(MasterRigParameters(), RATE, 0)) as device:
        wait_until(lambda: device.problem, "a failure")
        assert device.problem == "the device has gone"
        silent = device.silent_for
        time.sleep(0.05)
        assert device.silent_for >= silent + 0.05
