# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Another voice coil, described once in one file, is what every part of the graph uses."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest
import yaml

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import along_actuator
from haptic_accel.core.control.compensation import PLANT
from haptic_accel.core.model import ACTUATOR, Vector
from haptic_accel.core.tick import ActuatorGuard, SafetyLayer
from haptic_accel.devices.serial.device import SerialMaster
from haptic_accel.devices.simulated import SimulatedMaster
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments
from haptic_accel.setup.node_parameters import SAFETY, build_parameters
from haptic_accel.setup.setup import Setup
from one_coil import OneCoil

MOTION = {"m_a": 0.031, "k_s": 410.0, "b_s": 1.3, "travel": 2.5e-3}
HEAT = {"peak_force": 4.0, "continuous_force": 1.5, "thermal_time": 7.0}
COIL = ActuatorParameters(**MOTION, **HEAT, force_constant=-3.1)
RATE = 1000.0


class Wire:
    """A serial link that keeps the set-points of the current."""

    def __init__(self) -> None:
        self.currents: list[Vector] = []

    def set_currents(self, currents: Vector, due: float) -> None:
        """Keep a set-point."""
        self.currents.append(currents)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a parameter file that describes the coil, and the port of its board."""
    serial = {"serial": {"port": "/dev/coil"}}
    content = {"/**": {ACTUATOR: asdict(COIL)}, "master_device": serial}
    content = {key: {"ros__parameters": values} for key, values in content.items()}
    path = tmp_path / "coil.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_every_number_of_the_coil_differs_from_the_papers() -> None:
    paper = asdict(ActuatorParameters())
    assert all(value != paper[name] for name, value in asdict(COIL).items())


@pytest.mark.parametrize("rig", ["ideal", "paper"])
def test_one_block_describes_the_actuator_to_every_node(file: Path, rig: str) -> None:
    values = Setup.of(GraphArguments(params_file=str(file), rig=rig)).values
    suspension = (COIL.m_a, COIL.k_s, COIL.b_s)
    _, master = build_parameters("master_device", values["master_device"])
    _, compensator = build_parameters("compensator", values["compensator"])
    assert master[SAFETY].hardware == compensator[ACTUATOR] == COIL
    assert master["simulated"].actuator == master["serial"].actuator == COIL
    for handle in (compensator[PLANT].handle, master["simulated"].handle):
        assert (handle.m_a, handle.k_s, handle.b_s) == suspension
    own = Setup.of(IdentifyArguments(params_file=str(file))).values["identifier"]
    _, identifier = build_parameters("identifier", own)
    assert identifier[ACTUATOR] == COIL


def test_all_that_drives_or_limits_the_coil_uses_it(file: Path) -> None:
    values = Setup.of(GraphArguments(params_file=str(file), controller="constant")).values
    _, master = build_parameters("master_device", values["master_device"])
    own, options = build_parameters("compensator", values["compensator"])

    layer = SafetyLayer(master[SAFETY], RATE)
    layer.enable(0.0, True)
    peak = along_actuator(COIL.peak_force)
    assert layer.actuator_limit
    assert layer.actuator_limit.command(0.0, 0.0, 0.0, 0.0, 50.0)
    assert layer.actuator_limit.z == COIL.peak_force

    compensation = OneCoil(own, RATE, options)
    compensation.sample(0.0, 0.0)  # at rest
    assert compensation.sample(1000.0, 0.0)[1] == COIL.peak_force
    expected = ActuatorGuard(COIL, RATE)
    expected.advance(expected.within(50.0, 0.0), 0.0)
    assert (compensation.guard.heat, compensation.guard.travel) == (expected.heat, expected.travel)

    simulated = SimulatedMaster(master["simulated"], RATE, 0)
    simulated.open()
    simulated.read(0.0)
    simulated.write(0.0, actuator_force=along_actuator(50.0))
    assert simulated.counters()["actuator_saturated"] == 1
    simulated.write(0.0, actuator_force=peak)
    assert simulated.counters()["actuator_saturated"] == 1

    driver, wire = SerialMaster(master["serial"], RATE, 0), Wire()
    driver._link = wire  # type: ignore[assignment]
    driver.write(0.0, actuator_force=along_actuator(1.0))
    assert wire.currents == [along_actuator(1.0 / COIL.force_constant)]


def test_one_node_may_believe_in_another_actuator(file: Path, tmp_path: Path) -> None:
    content = yaml.safe_load(file.read_text())
    content["compensator"] = {"ros__parameters": {ACTUATOR: {"m_a": 0.04}}}
    mine = tmp_path / "mine.yaml"
    mine.write_text(yaml.safe_dump(content))
    setup = Setup.of(GraphArguments(params_file=str(mine)))
    values = setup.values
    _, options = build_parameters("compensator", values["compensator"])
    assert options[PLANT].handle.m_a == options[ACTUATOR].m_a == 0.04
    assert setup.rig().master.handle.m_a == COIL.m_a
