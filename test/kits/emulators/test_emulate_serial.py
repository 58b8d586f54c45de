# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The whole experiment through pyserial, with boards that are not there."""

from __future__ import annotations

import itertools
import math
import shlex
import signal
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from haptic_accel.analysis.metrics import actual_acceleration
from haptic_accel.analysis.segments import read_segment
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.axes import ALL_AXES, Axes, read_numbers
from haptic_accel.core.parameters import from_flat
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.topics import ACTUATOR_FORCE
from haptic_accel.devices.interface import LATER, Sample
from haptic_accel.devices.serial.device import SerialMaster, SerialMasterParameters
from haptic_accel.devices.serial.protocol import FULL_SCALE
from haptic_accel.setup.files import read_parameter_file
from observing import Observer
from running import PATIENCE, Start
from verbs import status_of

RATE = 1000.0
FREQUENCY = 100.0
"""Frequency of a force, Hz."""


@pytest.mark.parametrize("frame", [(), ("frame:=2", "latency:=5ms")], ids=["samples", "frames"])
def test_the_graph_runs_through_serial_ports(
    haptic_accel: Start, observer: Observer, tmp_path: Path, frame: tuple[str, ...]
) -> None:
    faults = ("faults:=garbage,drop,stall@1", "fault_seconds:=0.05")
    boards = haptic_accel("emulate", "serial", "folder:=my boards", "surface:=text", *faults)
    line = boards.wait_for("teleop master:=serial")
    # A machine that holds the boards up for a second must not end the test.
    config = tmp_path / "my boards" / "serial.yaml"
    values = yaml.safe_load(config.read_text())
    values["/**/master_device"]["ros__parameters"]["serial"]["rearm"] = "auto"
    config.write_text(yaml.safe_dump(values))
    # What a user is told to type, and a little more.
    words = [word for word in shlex.split(line) if ":=" in word]
    graph = haptic_accel("teleop", *words, *frame, "bag:=bag", "controller:=constant")
    graph.wait_for("board emulated-master")
    boards.wait_for("the hand begins")
    # One frame in ten is damaged in both directions of the first line, and of no other: these
    # are some two seconds of forces.
    counts = {"frames_damaged": 1, "board_damaged": 200, "frames_received": 1000}
    handle = observer.status("master_device", least=counts)
    tool = observer.status("slave_device", least={"frames_received": 1000})
    assert tool["frames_damaged"] == "0", (handle, tool)
    assert graph.end(signal.SIGINT) == 0, graph.text

    bag = read_bag(tmp_path / "bag")
    assert np.std(bag.signals["slave/tool/acceleration"].values[:, 2]) > 0.1
    segment = read_segment(tmp_path / "bag")
    actual = actual_acceleration(segment)
    assert actual is not None
    # What is commanded is felt: the handle moves, and not by itself.
    assert np.std(segment.signals[ACTUATOR_FORCE.name]) > 0.01
    assert np.std(actual) > 0.1

    assert boards.end(signal.SIGINT) == 0, boards.text


def test_no_force_is_called_held_while_a_board_is_disarmed(
    haptic_accel: Start, observer: Observer
) -> None:
    faults = ("faults:=unplug@1", "fault_seconds:=0.5")
    boards = haptic_accel("emulate", "serial", "folder:=boards", "surface:=text", *faults)
    line = boards.wait_for("teleop master:=serial")
    words = [word for word in shlex.split(line) if ":=" in word]
    graph = haptic_accel("teleop", *words, "controller:=constant")
    # A board that comes back is not armed until somebody arms it; the commands go on.
    found = observer.status("master_device", "not armed", **{"forces allowed": "false"})
    assert "actuator force last given (N)" in found
    assert not any("held (N)" in key for key in found)
    assert graph.end(signal.SIGINT) == 0, graph.text
    assert boards.end(signal.SIGINT) == 0, boards.text


RIGS = [("paper", "z", "ud"), ("three_axis", "xyz", "123456")]


@pytest.mark.quiet
@pytest.mark.parametrize(("rig", "axis", "keys"), RIGS)
def test_keys_turn_the_boards_over_for_a_calibration(
    terminals: Any, here: Path, monkeypatch: pytest.MonkeyPatch, rig: str, axis: str, keys: str
) -> None:
    emulate = ("-m", "haptic_accel.cli.main", "emulate", "serial", "folder:=boards")
    boards = terminals(*emulate, f"rig:={rig}")
    boards.wait_for("keys: u, d")
    (here / "rig.yaml").write_text("/**: {ros__parameters: {rate: 1000.0}}\n")
    poses = zip(keys, itertools.cycle(("up", "down")), strict=False)

    def turn_over(question: str) -> str:
        key, way = next(poses)
        assert f"axis {way}" in question
        boards.press(key.encode())
        time.sleep(0.3)  # samples of before have arrived
        return ""

    monkeypatch.setattr("builtins.input", turn_over)
    words = f"calibrate port:=boards/master axis:={axis} seconds:=0.2 --update rig.yaml"
    assert status_of(*words.split()) == 0
    assert not [*poses]
    found = read_parameter_file(here / "rig.yaml")["master_device"]
    # The emulated sensor is exact.
    nominal = RigParameters().master.accelerometer.range / FULL_SCALE
    several = "s" if len(axis) > 1 else ""
    gains = read_numbers("gains", str(found[f"serial.calibration.gain{several}"]), len(axis))
    offsets = read_numbers("offsets", str(found[f"serial.calibration.offset{several}"]), len(axis))
    assert gains == pytest.approx([nominal] * len(axis), rel=5e-3)
    assert offsets == pytest.approx([0.0] * len(axis), abs=0.01 * FULL_SCALE)
    if several:
        mounting = read_numbers("mounting", found["serial.calibration.mounting"], 9)
        assert np.reshape(mounting, (3, 3)) == pytest.approx(np.eye(3), abs=0.01)
    boards.press(b"\x03")
    assert boards.process.wait(PATIENCE) == 0


@pytest.mark.quiet
def test_boards_of_a_handle_with_three_coils_are_driven_along_each(
    haptic_accel: Start, tmp_path: Path
) -> None:
    boards = haptic_accel("emulate", "serial", "rig:=three_axis", "folder:=boards")
    assert "slave:=serial rig:=three_axis params_file:=" in boards.wait_for("teleop")
    nodes = read_parameter_file(tmp_path / "boards" / "serial.yaml")
    own = [each for each in nodes["master_device"].items() if each[0].startswith("serial.")]
    values = {name.removeprefix("serial."): value for name, value in own}
    handle = SerialMaster(from_flat(SerialMasterParameters, values), RATE, 0)
    with closing(handle):
        handle.open()
        assert handle.axes == ALL_AXES
        loudest = [np.argmax(vibration(handle, axis)) for axis in ALL_AXES.names]
        assert loudest == list(ALL_AXES.indices)
    assert boards.end(signal.SIGINT) == 0, boards.text


def vibration(handle: SerialMaster, axis: str) -> np.ndarray:
    """Drive one coil; return the amplitude of the acceleration at its frequency, by axis."""
    start, samples = math.ceil(time.monotonic() * RATE), []
    for tick in range(start, start + 400):
        while (sample := handle.read(tick / RATE)) is LATER:
            time.sleep(1e-4)
        if isinstance(sample, Sample):
            wave = np.exp(2j * np.pi * FREQUENCY * tick / RATE)
            samples.append(wave * np.array(sample.acceleration))
        force = math.sin(2 * math.pi * FREQUENCY * tick / RATE)
        handle.write((tick + 5) / RATE, actuator_force=Axes((axis,)).vector([force]))
    return np.abs(np.mean(samples, axis=0))


@pytest.mark.quiet
def test_a_node_without_its_board_says_so(start: Start) -> None:
    given = ("-p", "device:=serial", "-p", "serial.port:=/dev/none")
    node = start("-m", "haptic_accel.nodes.slave_device", "--ros-args", *given)
    assert node.end() == 1
    assert node.lines == ["slave_device: /dev/none: there is no such port; is it plugged in?"]
