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

"""``haptic-accel calibrate audio``: scale, polarity and noise of a sound card's input."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.output import check_writable, next_command
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.devices.audio import AUDIO, AudioParameters, recorded
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.serial.calibration import CalibrationError
from haptic_accel.devices.sound_bench import NO_ARM
from haptic_accel.devices.sound_calibration import (
    InputCalibration,
    by_force,
    by_gravity,
    by_reference,
    digital_scales,
    relative,
)
from haptic_accel.setup.rig_file import check_updatable, update_parameter_file

MASTER, SLAVE = "master", "slave"

GRAVITY, REFERENCE, FORCE, NAME, RELATIVE = "gravity", "reference", "force", "name", "relative"

PARTS = {MASTER: "handle", SLAVE: "tool"}

AMPLITUDE = 0.5
"""Strongest force, relative to full scale; the second half of the noise has a quarter of it."""

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
    """Measure, print, and write the scale of an input into a parameter file.

    Raises
    ------
    ParameterError
        An argument does not go with the others.
    StoppedError
        The card cannot be used, the measurement gives no scale, or the input ended.
    """
    _check(arguments)
    path = Path(arguments.file)
    check_writable(path, "file")
    check_updatable(path)
    try:
        found = _MEASURED[arguments.by](arguments)
    except (DeviceError, CalibrationError) as error:
        raise StoppedError(str(error)) from None
    except EOFError:
        raise StoppedError("the input ended before all was measured: nothing written") from None
    part = PARTS[arguments.side]
    print(f"{part}, input {arguments.input}: {found.text}")
    own: dict[str, Any] = {"inputs": f"{arguments.input}", "scales": f"{found.scale:.6g}"}
    if arguments.device:
        own["device"] = arguments.device
    node = f"{arguments.side}_device"
    update_parameter_file(path, {node: {"accelerometer_device": AUDIO, AUDIO: own}})
    print(f"parameters: {path}, for params_file:={path}")
    if arguments.side == MASTER:
        words = ["calibrate", AUDIO, f"device:={arguments.device}", f"side:={SLAVE}"]
        print(next_command(*words, f"input:={arguments.input + 1}", f"file:={path}"))
    else:
        words = ["identify", f"params_file:={path}", "--update", str(path), "actuator:=audio"]
        print(next_command(*words, f"master:={NO_ARM}"))


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
    """Return all inputs while a person does something, shape (n, channels)."""
    input(f"{request}, then press Enter\n")
    return _now(arguments)[0]


def _now(
    arguments: AudioInputArguments, played: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Return the inputs from now on, and their rate; a coil may play meanwhile."""
    a = arguments
    last = max(a.input, a.reference if a.by == REFERENCE else 1)
    if played is not None:
        played = np.pad(played[:, np.newaxis], ((0, 0), (a.output - 1, 0))).astype(np.float32)
    return recorded(a.device, a.seconds, last, played)


def _gravity(arguments: AudioInputArguments) -> InputCalibration:
    held = f"hold the {PARTS[arguments.side]} still, with the sensor's axis"
    up, down = (_still(arguments, f"{held} {way}") for way in ("up", "down"))
    channel = arguments.input - 1
    return by_gravity(up[:, channel], down[:, channel], _name(arguments))


def _reference(arguments: AudioInputArguments) -> InputCalibration:
    a = arguments
    quiet = _still(a, "let both sensors rest")
    input("shake both sensors together along their axis, fast, and press Enter meanwhile\n")
    shaken, rate = _now(a)
    known = shaken[:, a.reference - 1] * a.reference_scale
    return by_reference(shaken[:, a.input - 1], quiet[:, a.input - 1], known, rate, _name(a))


def _force(arguments: AudioInputArguments) -> InputCalibration:
    a = arguments
    quiet = _still(a, "lay the handle on soft foam, and take your hands off")
    rate = len(quiet) / a.seconds
    noise = shaking(round(a.seconds * rate), rate)
    shaken, _ = _now(a, noise)
    return by_force(
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


def _stated(arguments: AudioInputArguments) -> InputCalibration:
    """Return the scale that a sensor states, with the noise that it has at rest."""
    scales = digital_scales(arguments.device)
    if scales is None:
        raise ParameterError(
            f"device = {arguments.device!r}: states no scale; give the whole name of a 333D sensor"
            " as `haptic-accel doctor audio` lists it, or use its sheet with by:=reference"
        )
    scale = scales[min(arguments.input, 2) - 1]
    quiet = _still(arguments, "let the sensor rest")[:, arguments.input - 1]
    return InputCalibration(scale, 0.0, float(scale * quiet.std()))


def _relative(arguments: AudioInputArguments) -> InputCalibration:
    quiet = _still(arguments, "let the gripper rest")[:, arguments.input - 1]
    input("stroke a surface as in use, and press Enter meanwhile\n")
    stroked = _now(arguments)[0][:, arguments.input - 1]
    return relative(stroked, quiet, _name(arguments))


_MEASURED = {
    GRAVITY: _gravity,
    REFERENCE: _reference,
    FORCE: _force,
    NAME: _stated,
    RELATIVE: _relative,
}


def _name(arguments: AudioInputArguments) -> str:
    return f"input {arguments.input}"
