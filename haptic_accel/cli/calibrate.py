# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``haptic-accel calibrate``: gain, offset and mounting of an accelerometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptic_accel.cli.calibrate_audio import AudioInputArguments, calibrate_input
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import update_option, verb, words
from haptic_accel.cli.output import next_command
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import NAMES
from haptic_accel.core.bounded_files import located
from haptic_accel.core.model import ACTUATOR
from haptic_accel.core.parameters import ParameterError, parameter
from haptic_accel.devices import DeviceError
from haptic_accel.devices.audio import AUDIO
from haptic_accel.devices.serial.calibration import (
    POSES,
    AxesCalibration,
    Calibration,
    CalibrationError,
    Rest,
    calibrate,
    calibrate_axes,
    rest,
)
from haptic_accel.devices.serial.device import HIGHEST_RATE, PortParameters
from haptic_accel.setup.files import EVERY_NODE, parameter_text
from haptic_accel.setup.rig_file import teleoperation_words, update_parameter_file
from haptic_accel.setup.words import described, parse_words

if TYPE_CHECKING:
    from haptic_accel.devices.serial.board_samples import BoardSamples
    from haptic_accel.devices.serial.protocol import Identity

MASTER, SLAVE = "master", "slave"

HELD = {MASTER: "handle", SLAVE: "tool"}

ALL = "".join(NAMES)
"""All axes of an accelerometer, which are calibrated with its mounting."""

SKIP = "s"
"""Answer that leaves out a pose."""

SERIAL = "serial"
"""Name of the devices behind a serial board."""


@dataclass(frozen=True)
class CalibrateArguments(PortParameters):
    """Arguments of a calibration."""

    side: str = parameter(MASTER, "side of the board", choices=(MASTER, SLAVE))
    axis: str = parameter(
        "z",
        "axis of the accelerometer along the actuator, to turn over; xyz for all axes and the"
        " rotation from sensor to handle or tool, from six poses",
        choices=(*NAMES, ALL),
    )
    seconds: float = parameter(
        2.0, "time to measure in each position", unit="s", low=0.1, high=600.0
    )
    rate: int = parameter(1000, "samples per second", unit="Hz", low=100, high=HIGHEST_RATE)
    force_constant: float = parameter(
        ActuatorParameters.force_constant,
        "force constant of the master's actuator, from its data sheet (H2W NCM02-05-005-4JB: 2.4)",
        unit="N/A",
        low=-1000.0,
        high=1000.0,
    )
    file: str = parameter("", "file to write; empty for calibration_<side>.yaml")


def _described() -> list[tuple[str, str, str]]:
    """Return name, default and text of every argument, once."""
    kinds = (AudioInputArguments, CalibrateArguments)
    lines = {line[0]: line for kind in kinds for line in described(kind)}
    return list(lines.values())


@verb(
    "haptic-accel calibrate port:=/dev/ttyACM0 side:=slave",
    "haptic-accel calibrate usb_serial:=NUMBER axis:=xyz --update rig.yaml",
    "haptic-accel calibrate audio device:=USB input:=1 by:=force mass:=0.2 full_scale:=5",
    name="calibrate",
)
@words(
    CalibrateArguments,
    AudioInputArguments,
    describe=_described,
    metavar=f"[{AUDIO}] [key:=value ...]",
)
@update_option("device, port and calibration")
def calibrate_any(words: Sequence[str], update: Path | None) -> None:
    """Measure an accelerometer behind a serial board, or on an input of a sound card.

    A board's accelerometer is held with one axis up, then down.

    Writes its gain and offset as a parameter file for params_file:=FILE. With axis:=xyz, hold
    handle or tool with each of its axes up, then down: that also gives the rotation from the
    sensor. Three poses that are not in one plane give the rotation alone.

    With audio, an input's scale comes from by:=gravity, a reference beside it, or the coil's force
    on a known mass; the file is file:=FILE.
    """
    if AUDIO in words:
        if update:
            raise ParameterError(f"--update {update}: use file:={update} with {AUDIO}")
        given = [word for word in words if word != AUDIO]
        calibrate_input(parse_words(given, AudioInputArguments))
        return
    _calibrate_board(parse_words(words, CalibrateArguments), update)


def _calibrate_board(arguments: CalibrateArguments, update: Path | None) -> None:
    if bool(arguments.port) == bool(arguments.usb_serial):
        raise ParameterError("port = '': must be given, or usb_serial, and not both")
    if update and arguments.file:
        raise ParameterError(f"file = '{arguments.file}': must be empty with --update")
    path = update or Path(arguments.file or f"calibration_{arguments.side}.yaml")
    if not path.absolute().parent.is_dir() or path.is_dir():
        raise ParameterError(f"file = '{path}': must be a file in an existing folder")
    try:
        identity, found = _measured(arguments)
    except (DeviceError, CalibrationError) as error:
        raise StoppedError(str(error)) from None
    except EOFError:
        raise StoppedError("the input ended before all positions were measured") from None
    if update:
        update_parameter_file(update, _parameters(arguments, identity, found))
    else:
        with located(f"file = '{path}'", unreadable=""):
            path.write_text(parameter_file(arguments, identity, found), encoding="utf-8")
    print(f"board {identity.serial_number}, axis {arguments.axis}: {found.text}")
    print(f"parameters: {path}, for params_file:={path}")
    if arguments.side == MASTER:
        words = ["identify", f"params_file:={path}", "--update", str(path)]
    else:
        words = teleoperation_words("", path)
    device = [] if update else [f"{arguments.side}:=serial"]
    print(next_command(*words, *device))


def _measured(arguments: CalibrateArguments) -> tuple[Identity, Calibration | AxesCalibration]:
    """Measure in all positions; the actuator is not armed."""
    from haptic_accel.devices.serial.board_samples import BoardSamples

    with BoardSamples(arguments, arguments.rate, arguments.axis) as board:
        coils = "".join(board.identity.coils)
        if arguments.axis == ALL and arguments.side == MASTER and coils != ALL:
            raise CalibrationError(
                f"axis = {ALL}: the board drives coils along {coils or 'no axis'}, must"
                " be all three: a handle with one coil uses one axis of its sensor"
            )
        measure = _all_axes if arguments.axis == ALL else _one_axis
        return board.identity, measure(arguments, board)


def _one_axis(arguments: CalibrateArguments, board: BoardSamples) -> Calibration:
    """Turn one axis of the sensor over."""
    rests = []
    for way in ("up", "down"):
        input(f"hold the {arguments.axis} axis {way}, firm and still, then press Enter\n")
        rests += _rests(arguments, board)
    up, down = rests
    return calibrate(up, down, board.identity.nominal_gain)


def _all_axes(arguments: CalibrateArguments, board: BoardSamples) -> AxesCalibration:
    """Hold handle or tool in all poses, except those that a person leaves out."""
    poses = {}
    for name in POSES:
        held = f"hold the {HELD[arguments.side]} with its {name}, firm and still, then press Enter"
        if input(f"{held}; or type {SKIP} to skip\n").strip() != SKIP:
            poses[name] = _rests(arguments, board)
    return calibrate_axes(poses, board.identity.nominal_gain)


def _rests(arguments: CalibrateArguments, board: BoardSamples) -> list[Rest]:
    """Return the rest of each sampled axis from now on."""
    counts = board.collect(arguments.seconds)
    return [rest(axis, board.identity.nominal_gain) for axis in counts.T]


def _parameters(
    arguments: CalibrateArguments, identity: Identity, found: Calibration | AxesCalibration
) -> dict[str, dict[str, Any]]:
    """Return the parameters of the rig's file: device, port and calibration."""
    nodes = port_parameters(arguments, identity, found)
    nodes[f"{arguments.side}_device"]["device"] = SERIAL
    return nodes


def port_parameters(
    arguments: CalibrateArguments, identity: Identity, found: Calibration | AxesCalibration
) -> dict[str, dict[str, Any]]:
    """Return the parameters of each node: port, calibration and the actuator's force constant."""
    port = "port" if arguments.port else "usb_serial"
    number = identity.serial_number
    values: dict[str, Any] = {port: getattr(arguments, port)}
    if isinstance(found, AxesCalibration):
        values |= {"axes": ", ".join(NAMES), "calibration": found.parameters(number)}
    else:
        values["calibration"] = found.parameters(arguments.axis, number)
    nodes: dict[str, dict[str, Any]] = {f"{arguments.side}_device": {SERIAL: values}}
    if arguments.side == MASTER:
        nodes[EVERY_NODE] = {ACTUATOR: {"force_constant": arguments.force_constant}}
    return nodes


def parameter_file(
    arguments: CalibrateArguments, identity: Identity, found: Calibration | AxesCalibration
) -> str:
    """Return a ROS parameter file for ``params_file:=FILE``; see `port_parameters`."""
    head = [
        f"Board {identity.serial_number}, {datetime.now():%Y-%m-%d %H:%M}, by gravity"
        f" (haptic-accel calibrate), {arguments.seconds:g} s in each position.",
        f"{found.text[0].upper()}{found.text[1:]}.",
    ]
    if arguments.side == MASTER:
        head.append("The force constant is the data sheet's.")
    comment = "".join(f"# {line}\n" for line in head)
    return comment + parameter_text(port_parameters(arguments, identity, found))
