# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel calibrate``: gain, offset and mounting of an accelerometer; a card's input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_accel.cli.options import update_option, verb, words
from haptic_accel.cli.output import StoppedError, check_writable, next_command
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import NAMES
from haptic_accel.core.files import located
from haptic_accel.core.model import ACTUATOR, FloatArray
from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.devices import calibration
from haptic_accel.devices.audio import AUDIO, AudioParameters, recorded
from haptic_accel.devices.calibration import AxesCalibration, Calibration, CalibrationError
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.serial.device import HIGHEST_BOARD_RATE, PortParameters
from haptic_accel.devices.sound_bench import NO_ARM
from haptic_accel.setup import files
from haptic_accel.setup.words import described, parse_assignments

if TYPE_CHECKING:
    from haptic_accel.devices.serial.board_samples import BoardSamples
    from haptic_accel.devices.serial.protocol import Identity

MASTER, SLAVE = "master", "slave"

HELD = {MASTER: "handle", SLAVE: "tool"}
"""Part that carries the sensor of each side."""

GRAVITY, REFERENCE, FORCE, NAME, RELATIVE = "gravity", "reference", "force", "name", "relative"

AMPLITUDE = 0.5
"""Largest amplitude of the played noise, relative to full scale."""

WEAK = 0.25
"""Strength of the second half of the noise, relative to the first."""


@dataclass(frozen=True)
class AudioInputArguments(Checked):
    """Input of a sound card to calibrate: ``calibrate audio`` only."""

    device: str = parameter(
        "", "name of the sound card, or a part of it, as `haptic-accel doctor audio` lists it"
    )
    side: str = parameter(MASTER, "side of the sensor", choices=(MASTER, SLAVE))
    input: int = parameter(1, "input channel of the sensor, from 1", low=1, high=999)
    by: str = parameter(
        GRAVITY,
        "known acceleration: gravity, for inputs that pass constant voltages; a calibrated sensor"
        " (reference) on the same mass; the coil's force on a known mass; the scale that a USB"
        " sensor states in its name; relative for a contact microphone, without a unit",
        choices=(GRAVITY, REFERENCE, FORCE, NAME, RELATIVE),
    )
    seconds: float = parameter(4.0, "time to measure in each position", "s", 1.0, 60.0)
    reference: int = parameter(2, "input channel of the calibrated sensor", low=1, high=999)
    reference_scale: float = parameter(
        0.0, "acceleration of the calibrated sensor at full scale", "m/s^2", -1e6, 1e6
    )
    mass: float = parameter(
        0.0,
        "handle with all that is fixed to it, without a hand and the coil's moving part",
        "kg",
        0.0,
        100.0,
    )
    full_scale: float = like(AudioParameters, "full_scale")
    output: int = parameter(1, "output channel of the coil, from 1", low=1, high=999)
    file: str = parameter("audio.yaml", "parameter file to write, new or existing")


def calibrate_input(arguments: AudioInputArguments) -> None:
    """Measure and print the scale of an input, and write it to a parameter file.

    Raises
    ------
    ParameterError
        An argument contradicts the others.
    StoppedError
        The card is unusable, the measurement gives no scale, or the input ended.
    """
    _check(arguments)
    path = Path(arguments.file)
    check_writable(path, "file")
    files.check_updatable(path)
    try:
        found = _MEASURED[arguments.by](arguments)
    except (DeviceError, CalibrationError) as error:
        raise StoppedError(str(error)) from None
    except EOFError:
        raise StoppedError("the input ended before all was measured: nothing written") from None
    part = HELD[arguments.side]
    print(f"{part}, input {arguments.input}: {found.text}")
    own: dict[str, Any] = {"inputs": f"{arguments.input}", "scales": f"{found.scale:.6g}"}
    if arguments.device:
        own["device"] = arguments.device
    node = f"{arguments.side}_device"
    files.update_parameter_file(path, {node: {"accelerometer_device": AUDIO, AUDIO: own}})
    print(f"parameters: {path}, for params_file:={path}")
    if arguments.side == MASTER:
        command = ["calibrate", AUDIO, f"device:={arguments.device}", f"side:={SLAVE}"]
        print(next_command(*command, f"input:={arguments.input + 1}", f"file:={path}"))
    else:
        command = ["identify", f"params_file:={path}", "--update", str(path), "actuator:=audio"]
        print(next_command(*command, f"master:={NO_ARM}"))


def _check(arguments: AudioInputArguments) -> None:
    a = arguments
    needed = {
        REFERENCE: {"reference_scale": a.reference_scale},
        FORCE: {"mass": a.mass, "full_scale": a.full_scale},
    }
    for name, value in needed.get(a.by, {}).items():
        if not value:
            raise ParameterError(f"{name} = 0: must be given with by:={a.by}")
    if a.by == REFERENCE and a.reference == a.input:
        raise ParameterError(f"reference = {a.reference}: must be another channel than input")


def _still(arguments: AudioInputArguments, request: str) -> FloatArray:
    """Request an action of the user; return all inputs during it, shape (n, channels)."""
    input(f"{request}, then press Enter\n")
    return _now(arguments)[0]


def _now(
    arguments: AudioInputArguments, played: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Record the inputs from now on, while a coil may play; return them and their rate."""
    a = arguments
    last = max(a.input, a.reference if a.by == REFERENCE else 1)
    if played is not None:
        played = np.pad(played[:, np.newaxis], ((0, 0), (a.output - 1, 0))).astype(np.float32)
    return recorded(a.device, a.seconds, last, played)


def _gravity(arguments: AudioInputArguments) -> calibration.InputCalibration:
    held = f"hold the {HELD[arguments.side]} still, with the sensor's axis"
    up, down = (_still(arguments, f"{held} {way}") for way in ("up", "down"))
    channel = arguments.input - 1
    return calibration.by_gravity(up[:, channel], down[:, channel], _name(arguments))


def _reference(arguments: AudioInputArguments) -> calibration.InputCalibration:
    a = arguments
    quiet = _still(a, "let both sensors rest")
    input("shake both sensors together along their axis, fast, and press Enter meanwhile\n")
    shaken, rate = _now(a)
    known = shaken[:, a.reference - 1] * a.reference_scale
    return calibration.by_reference(
        shaken[:, a.input - 1], quiet[:, a.input - 1], known, rate, _name(a)
    )


def _force(arguments: AudioInputArguments) -> calibration.InputCalibration:
    a = arguments
    quiet = _still(a, "lay the handle on soft foam, and take your hands off")
    rate = len(quiet) / a.seconds
    noise = shaking(round(a.seconds * rate), rate)
    shaken, _ = _now(a, noise)
    return calibration.by_force(
        noise * a.full_scale, shaken[:, a.input - 1], quiet[:, a.input - 1], rate, a.mass, _name(a)
    )


def shaking(count: int, rate: float) -> FloatArray:
    """Return noise between 20 and 500 Hz for a coil, full scale 1; its second half is weaker."""
    from scipy import signal

    sections = signal.butter(2, (20.0, 500.0), "bandpass", fs=rate, output="sos")
    noise = signal.sosfilt(sections, np.random.default_rng(0).normal(size=count))
    noise *= AMPLITUDE / np.abs(noise).max()
    noise[count // 2 :] *= WEAK
    return np.asarray(noise)


def _stated(arguments: AudioInputArguments) -> calibration.InputCalibration:
    """Return the sensor's specified scale, with the measured noise at rest."""
    scales = calibration.digital_scales(arguments.device)
    if scales is None:
        raise ParameterError(
            f"device = {arguments.device!r}: states no scale; give the whole name of a 333D sensor"
            " as `haptic-accel doctor audio` lists it, or use its sheet with by:=reference"
        )
    scale = scales[min(arguments.input, 2) - 1]
    quiet = _still(arguments, "let the sensor rest")[:, arguments.input - 1]
    return calibration.InputCalibration(scale, 0.0, float(scale * quiet.std()))


def _relative(arguments: AudioInputArguments) -> calibration.InputCalibration:
    quiet = _still(arguments, "let the gripper rest")[:, arguments.input - 1]
    input("stroke a surface as in use, and press Enter meanwhile\n")
    stroked = _now(arguments)[0][:, arguments.input - 1]
    return calibration.relative(stroked, quiet, _name(arguments))


_MEASURED = {
    GRAVITY: _gravity,
    REFERENCE: _reference,
    FORCE: _force,
    NAME: _stated,
    RELATIVE: _relative,
}


def _name(arguments: AudioInputArguments) -> str:
    return f"input {arguments.input}"


ALL = "".join(NAMES)
"""All axes of an accelerometer, which are calibrated with its mounting."""

SKIP = "s"
"""Answer that skips a pose."""

SERIAL = "serial"
"""Name of devices with a serial board."""


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
    rate: int = parameter(1000, "samples per second", unit="Hz", low=100, high=HIGHEST_BOARD_RATE)
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
        assignments = [word for word in words if word != AUDIO]
        calibrate_input(parse_assignments(assignments, AudioInputArguments))
        return
    _calibrate_board(parse_assignments(words, CalibrateArguments), update)


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
        files.update_parameter_file(update, _parameters(arguments, identity, found))
    else:
        with located(f"file = '{path}'", unreadable=""):
            path.write_text(parameter_file(arguments, identity, found), encoding="utf-8")
    print(f"board {identity.serial_number}, axis {arguments.axis}: {found.text}")
    print(f"parameters: {path}, for params_file:={path}")
    if arguments.side == MASTER:
        command = ["identify", f"params_file:={path}", "--update", str(path)]
    else:
        command = files.teleop_command("", path)
    device = [] if update else [f"{arguments.side}:=serial"]
    print(next_command(*command, *device))


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
    """Calibrate one axis, held up and then down."""
    rests = []
    for way in ("up", "down"):
        input(f"hold the {arguments.axis} axis {way}, firm and still, then press Enter\n")
        rests += _rests(arguments, board)
    up, down = rests
    return calibration.calibrate(up, down, board.identity.nominal_gain)


def _all_axes(arguments: CalibrateArguments, board: BoardSamples) -> AxesCalibration:
    """Calibrate all axes with handle or tool in all poses that the user does not skip."""
    poses = {}
    for name in calibration.POSES:
        held = f"hold the {HELD[arguments.side]} with its {name}, firm and still, then press Enter"
        if input(f"{held}; or type {SKIP} to skip\n").strip() != SKIP:
            poses[name] = _rests(arguments, board)
    return calibration.calibrate_axes(poses, board.identity.nominal_gain)


def _rests(arguments: CalibrateArguments, board: BoardSamples) -> list[calibration.Rest]:
    """Measure each sampled axis at rest from now on."""
    counts = board.collect(arguments.seconds)
    return [calibration.rest(axis, board.identity.nominal_gain) for axis in counts.T]


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
        nodes[files.EVERY_NODE] = {ACTUATOR: {"force_constant": arguments.force_constant}}
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
    return comment + files.parameter_text(port_parameters(arguments, identity, found))
