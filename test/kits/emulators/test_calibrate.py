# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The flip test of an accelerometer, with a board that is turned over by the test."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from haptic_accel.core.axes import ALL_AXES, along_actuator
from haptic_accel.core.model import GRAVITY, ZERO, Vector, vector
from haptic_accel.core.parameters import from_flat
from haptic_accel.devices.calibration import POSES
from haptic_accel.devices.serial.device import CalibrationParameters, Sensor
from haptic_accel.devices.serial.protocol import FULL_SCALE, Identity
from haptic_accel.kits.emulators.ports import run
from haptic_accel.kits.emulators.serial_line import EmulatedBoard, SerialLines
from haptic_accel.setup.files import read_parameter_file
from running import on_thread, wait_until
from verbs import output_of, refusal

CALIBRATE, WORDS = ("calibrate", "port:=port"), ("seconds:=0.2", "file:=found.yaml")

PORT_SAMPLES = 300
"""Samples of one axis that a terminal of 4096 bytes holds at most: 14 bytes each."""


class Turned:
    """A board with a sensor that is off by a little, held as the test says.

    Attributes
    ----------
    felt : callable
        Acceleration at a time, m/s^2.
    """

    def __init__(self, path: Path) -> None:
        identity = Identity((1, 0, 0), 0b111, 10_000, 49.0, (0.0, 0.0, 2.75), "board-7")
        self.felt: Callable[[float], Vector] = lambda time: ZERO
        self.emulated = EmulatedBoard(identity, path, lambda time: self.felt(time))

    def hold(self, gravity: float) -> None:
        """Hold it still: 5 % too sensitive, and 0.5 m/s^2 off."""
        self._feel(along_actuator(1.05 * gravity + 0.5))

    def hold_tool(self, name: str) -> None:
        """Hold a tool still, on which the sensor is turned by a quarter about z."""
        x, y, z = POSES[name]
        felt = [1.05 * GRAVITY * each + 0.5 for each in (-y, x, z)]
        self._feel(vector(np.array(felt)))

    def _feel(self, acceleration: Vector) -> None:
        """Measure an acceleration until further notice, m/s^2."""
        sampled = itertools.count()

        def felt(time: float) -> Vector:
            self.newest = next(sampled)
            return acceleration

        self.newest = 0
        self.felt = felt
        # The port holds fewer samples than these: all of before have been read.
        wait_until(lambda: self.newest > PORT_SAMPLES, "samples of before have arrived")


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Turned]:
    board = Turned(tmp_path / "port")
    with closing(board.emulated), on_thread(partial(run, [SerialLines([board.emulated])])):
        yield board


Acts = Callable[..., list[str]]


@pytest.fixture
def person(here: Path, monkeypatch: pytest.MonkeyPatch) -> Acts:
    """Let a person act when asked: ``person(*ACTS)`` returns the questions.

    An act returns what is typed before Enter, or None; after the last one the input has ended.
    """

    def acting(*acts: Callable[[], str | None]) -> list[str]:
        left, asked = iter(acts), list[str]()

        def answer(question: str) -> str:
            asked.append(question)
            for act in left:
                return act() or ""
            raise EOFError

        monkeypatch.setattr("builtins.input", answer)
        return asked

    return acting


def test_a_board_is_calibrated_by_turning_it_over(
    board: Turned, person: Acts, tmp_path: Path
) -> None:
    turning = partial(board.hold, GRAVITY), partial(board.hold, -GRAVITY)
    # The emulated board samples along z alone: what is asked of another axis is still.
    person(turning[0], turning[0])
    told = refusal(*CALIBRATE, "axis:=y", "force_constant:=2.5", *WORDS, status=1)
    assert "should by about 19.6; was this axis held up and then down?" in told
    assert not (tmp_path / "found.yaml").exists()

    asked = person(*turning)
    assert "found.yaml" in output_of(*CALIBRATE, "force_constant:=2.5", *WORDS)
    firm = "firm and still, then press Enter\n"
    assert asked == [f"hold the z axis {way}, {firm}" for way in ("up", "down")]
    values = read_parameter_file(tmp_path / "found.yaml")["master_device"]
    assert values["serial.port"] == "port"
    assert values["serial.calibration.board"] == "board-7"
    assert values["serial.calibration.gain"] == pytest.approx(49.0 / FULL_SCALE / 1.05, rel=1e-3)
    assert values["serial.calibration.offset"] == pytest.approx(0.5 / 49.0 * FULL_SCALE, abs=1)
    assert values["actuator.force_constant"] == 2.5
    assert "Gain 0.00142" in (tmp_path / "found.yaml").read_text()
    assert yaml.safe_load((tmp_path / "found.yaml").read_text())


def test_a_calibration_goes_into_the_file_of_the_rig(
    board: Turned, person: Acts, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("coupler: {ros__parameters: {k_m: 300.0}}  # soft\n")
    person(partial(board.hold, GRAVITY), partial(board.hold, -GRAVITY))
    last = output_of(*CALIBRATE, "seconds:=0.2", "--update", "rig.yaml").splitlines()[-1]
    assert last == "next: haptic-accel identify params_file:=rig.yaml --update rig.yaml"
    assert "# soft" in rig.read_text()
    values = read_parameter_file(rig, "")
    assert values["coupler"]["k_m"] == 300.0
    assert values["master_device"]["device"] == "serial"
    assert values["master_device"]["serial.calibration.board"] == "board-7"
    assert values["compensator"]["actuator.force_constant"] == 2.4


def test_six_poses_give_the_mounting_of_a_tools_sensor(
    board: Turned, person: Acts, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("/**: {ros__parameters: {rate: 1000.0}}\n")
    asked = person(*(partial(board.hold_tool, name) for name in POSES))
    words = ("side:=slave", "axis:=xyz", "seconds:=0.2", "--update", "rig.yaml")
    text = output_of(*CALIBRATE, *words)
    for question, name in zip(asked, POSES, strict=True):
        assert question.startswith(f"hold the tool with its {name}, firm and still"), question
    assert "axis xyz: sensor turned by 90.0 +- 0.0 degrees" in text
    values = read_parameter_file(rig)["slave_device"]
    assert values["serial.axes"] == "x, y, z"
    sensor = Sensor(from_flat(CalibrationParameters, values, "serial.calibration."), ALL_AXES)
    for upward in POSES.values():
        x, y, z = upward
        counts = [round((1.05 * GRAVITY * each + 0.5) / 49.0 * FULL_SCALE) for each in (-y, x, z)]
        (found,) = sensor.accelerations(counts, 1.0)
        assert found == pytest.approx([GRAVITY * each for each in upward], abs=0.02)


def test_a_pose_may_be_skipped_but_not_too_many(board: Turned, person: Acts) -> None:
    person(*[lambda: "s"] * 5, partial(board.hold_tool, "z axis up"))
    told = refusal(*CALIBRATE, "side:=slave", "axis:=xyz", *WORDS, status=1)
    assert told == "poses = 1: must be at least 3"


def test_a_board_that_moves_is_refused(board: Turned, person: Acts) -> None:
    board.felt = lambda time: along_actuator(3.0 * (time * 20 % 1))
    person(lambda: "", lambda: "")
    told = refusal(*CALIBRATE, "side:=slave", *WORDS, status=1)
    assert told.startswith("the sensor moved: standard deviation")


@pytest.mark.usefixtures("board")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["port:=none"], "none: there is no such port"),
        (["port:=port", "axis:=xyz"], "axis = xyz: the board drives coils along z, must be all"),
        (["port:=port"], "the input ended before all positions were measured"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(person: Acts, words: list[str], told: str) -> None:
    person()
    assert refusal("calibrate", *words, status=1).startswith(told)
