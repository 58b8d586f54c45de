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

"""Sensors of a rig, on boards or a sound card: which is whose, what they show, and their gain."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.core import signal_checks as checks
from haptic_accel.core.model import ACTUATOR, FloatArray
from haptic_accel.core.signal_checks import Check
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import DeviceError
from haptic_accel.devices.audio import AUDIO, read_channels, recorded
from haptic_accel.devices.serial.calibration import CalibrationError, calibrate, rest, vertical
from haptic_accel.devices.serial.device import PortParameters
from haptic_accel.devices.sound_calibration import by_gravity, check_level
from haptic_accel.kits.bringup.bench import ARMS_ALONE, HELD, MASTER, SERIAL, SLAVE, Bench
from haptic_accel.setup.files import EVERY_NODE, SEPARATOR, parameter_paths, read_parameter_file
from haptic_accel.setup.rig_file import update_parameter_file

ARM = "can"
"""Begin of the names of devices with an arm whose joints this computer drives."""

AXES = "xyz"
"""Axes of a board's accelerometer."""

REST = 1.0
"""Time to look at a signal at rest, s."""

POSE = 2.0
"""Time to measure in each position, s."""

TAP = 10.0
"""Peak of a tap, relative to the noise of a card's input at rest."""

CARD_TIME = 0.012
"""Latency with a sound card's inputs, s: 48 kHz, 64 samples a block, and a round trip of four; a
card that needs more says so."""


def connect(bench: Bench) -> None:
    """Find the boards, write the rig's file, and look at the signals."""
    _take_over(bench)
    a = bench.arguments
    nodes: dict[str, dict[str, Any]] = {
        EVERY_NODE: {"rate": a.rate, ACTUATOR: {"force_constant": a.force_constant}},
        "master_device": {"device": a.master, "actuator_device": a.actuator},
        "slave_device": {"device": a.slave},
    }
    if a.accelerometers == AUDIO:
        nodes[EVERY_NODE]["latency"] = round(CARD_TIME * a.rate)
        for side in ARMS:
            nodes[f"{side}_device"]["accelerometer_device"] = AUDIO
    boards = [side for side in ARMS if getattr(a, side).endswith(SERIAL)]
    if boards:
        for side, port in _found(bench, boards).items():
            nodes[f"{side}_device"][SERIAL] = port
    update_parameter_file(bench.path, nodes)
    for side in ARMS:
        _look_at(bench, side)


def calibrate_boards(bench: Bench) -> None:
    """Measure axis, gain and offset of each accelerometer."""
    for side in ARMS:
        if bench.is_on_card(side):
            bench.settle(lambda side=side: _scaled(bench, side))  # type: ignore[misc]
        elif bench.device_name(side).endswith(SERIAL):
            bench.settle(lambda side=side: _turned_over(bench, side))  # type: ignore[misc]


def _take_over(bench: Bench) -> None:
    """Copy the values of the given parameter files into the rig's."""
    for path in parameter_paths(bench.arguments.params_file):
        values = read_parameter_file(path)
        update_parameter_file(bench.path, {node: own for node, own in values.items() if own})


def _found(bench: Bench, sides: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return the port of each side's board: the one with an actuator is the handle's."""
    found: dict[str, dict[str, str]] = {}

    def look() -> list[Check]:
        from haptic_accel.devices.serial.board_samples import BoardSamples

        found.clear()
        ports = _ports(bench)
        if not ports:
            advice = "plug in the board's cable, one for data, and join the group dialout"
            return [Check(False, "no serial port", advice)]
        results = []
        for name, port in ports.items():
            try:
                with BoardSamples(port, round(bench.arguments.rate), AXES) as board:
                    identity = board.identity
            except DeviceError as error:
                results.append(Check(False, str(error), "flash the board: firmware/README.md"))
                continue
            side = MASTER if identity.coils else SLAVE
            key = "port" if port.port else "usb_serial"
            found.setdefault(side, {key: getattr(port, key)})
            text = f"{name}: board {identity.serial_number} of the {HELD[side]}"
            results.append(Check(True, text))
        missing = [HELD[side] for side in sides if side not in found]
        if missing:
            advice = "plug it in; the board with an actuator's amplifier is the handle's"
            results.append(Check(False, f"no board of the {' and '.join(missing)}", advice))
        return results

    bench.settle(look, can_skip=False)
    return {side: found[side] for side in sides}


def _ports(bench: Bench) -> dict[str, PortParameters]:
    """Return the given ports, or this machine's, by name."""
    given = [port for port in bench.arguments.ports.split(SEPARATOR) if port]
    if given:
        return {port: PortParameters(port=str(Path(port).absolute())) for port in given}
    from serial.tools import list_ports

    return {
        port.device: PortParameters(usb_serial=port.serial_number)
        for port in list_ports.comports()
        if port.serial_number
    }


def _look_at(bench: Bench, side: str) -> None:
    """Check a side's signal at rest, and that the sensor belongs to this side."""
    held = HELD[side]
    if bench.is_on_card(side):
        bench.goes_on(f"let go of the {held}, so that it lies still, then press Enter")
        bench.settle(lambda: _heard(bench, side))
        return
    is_simulated = bench.is_simulated(side)
    if is_simulated:
        bench.settle(lambda: [Check(True, f"{held}: simulated")])
        if side == SLAVE or not bench.has_actuator():
            return
    with bench.observed(side) as device:
        bench.person.show(device)
        if device.remark:
            bench.person.tell(f"{held}: {device.remark}")
        if is_simulated:
            return
        if bench.device_name(side).startswith(ARM):
            x, y, z = 1e3 * np.nanmean(device.observe(REST).position, axis=0)
            bench.goes_on(
                f"the {held} is at x {x:.0f}, y {y:.0f}, z {z:.0f} mm: move it away, to the"
                " left and up, where x, y and z grow; press Enter, or correct direction and"
                " offset of its joints and begin again"
            )
        if bench.device_name(side) in ARMS_ALONE:
            return
        bench.goes_on(f"let go of the {held}, so that it lies still, then press Enter")
        bench.settle(lambda: checks.rest_checks(device.observe(REST).acceleration))
        noise = float(np.nanstd(device.observe(REST).acceleration))
        bench.settle(
            lambda: [
                Check(
                    bench.awaits(
                        f"tap the {held} a few times",
                        lambda: checks.is_tapped(device.last(REST).acceleration, noise),
                    ),
                    f"taps on the {held} are in its signal",
                    "is this the other board? Swap the cables; is the sensor fixed to it?",
                )
            ]
        )


def _heard(bench: Bench, side: str) -> list[Check]:
    """Check the level of a card's input, and that taps on this side are in it."""
    quiet = _recorded(bench, side, REST)
    try:
        check_level(quiet, f"{HELD[side]}: input")
    except CalibrationError as error:
        return [Check(False, str(error), "check sensor, cable, input and its gain")]
    noise = float(quiet.std())

    def is_tapped() -> bool:
        return float(np.abs(_recorded(bench, side, REST) - quiet.mean()).max()) > TAP * noise

    return [
        Check(
            bench.awaits(f"tap the {HELD[side]} a few times", is_tapped),
            f"taps on the {HELD[side]} are in its input, noise {noise:.2g} of full scale",
            "is this the other sensor's input? Correct audio.inputs; is the sensor fixed to it?",
        )
    ]


def _recorded(bench: Bench, side: str, seconds: float) -> FloatArray:
    """Return what the card's first input of a side has from now on, full scale 1."""
    _, options = bench.parameters(side)
    own = options[AUDIO]
    channel = read_channels("audio.inputs", own.inputs)[0]
    return recorded(own.device, seconds, channel)[0][:, channel - 1]


def _scaled(bench: Bench, side: str) -> list[Check]:
    """Measure the scale of a card's input by gravity, unless it is known."""
    held = HELD[side]
    _, options = bench.parameters(side)
    if known := options[AUDIO].scales:
        return [Check(True, f"{held}: full scale {known} m/s^2, as in {bench.path.name}")]
    poses = []
    for pose in ("upwards", "downwards"):
        bench.goes_on(f"hold the {held} with the sensor's axis {pose}, still, then press Enter")
        poses.append(_recorded(bench, side, POSE))
    try:
        up, down = poses
        found = by_gravity(up, down, f"{held}: input")
    except CalibrationError as error:
        words = f"haptic-accel calibrate audio side:={side} file:={bench.path}"
        return [Check(False, str(error), f"in another terminal: {words}, and by:=...")]
    scales = {AUDIO: {"scales": f"{found.scale:.6g}"}}
    update_parameter_file(bench.path, {f"{side}_device": scales})
    return [Check(True, f"{held}: {found.text}")]


def _turned_over(bench: Bench, side: str) -> list[Check]:
    from haptic_accel.devices.serial.board_samples import BoardSamples

    own, options = bench.parameters(side)
    poses = []
    with BoardSamples(options[SERIAL], round(own.rate), AXES) as board:
        bench.person.show(board)
        gain = board.identity.nominal_gain
        for pose in ("upwards", "downwards"):
            pose_text = f"with the coil's axis {pose}, firm and still"
            bench.goes_on(f"hold the {HELD[side]} {pose_text}, then press Enter")
            poses.append(board.collect(POSE))
        number = board.identity.serial_number
    axis = vertical(*poses)
    try:
        up, down = (rest(pose[:, axis], gain) for pose in poses)
        found = calibrate(up, down, gain)
    except CalibrationError as error:
        return [Check(False, str(error), "hold it again, the other way up the second time")]
    calibration = found.parameters(AXES[axis], number)
    nodes = {f"{side}_device": {SERIAL: {"calibration": calibration}}}
    update_parameter_file(bench.path, nodes)
    within = f"{found.gain_error / abs(found.gain):.2%}"
    return [
        Check(
            True,
            f"{HELD[side]}: axis {AXES[axis]}, gain {found.gain:.5g} m/s^2 per count within"
            f" {within}, noise {found.noise:.3f} m/s^2",
        )
    ]
