# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bring-up of a rig's sensors, on boards or a sound card: side, signal and gain of each.

The module also checks the safety of the handle: force, polarity, silence after a stop, and a
pulled plug.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel import FloatArray, devices, setup
from haptic_accel.core import ACTUATOR
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import serial
from haptic_accel.kits.bringup import bench as benches
from haptic_accel.kits.bringup import signal_checks as checks
from haptic_accel.kits.bringup.signal_checks import Check

ARM = "can"
"""Prefix of the names of devices with an arm whose joints this computer drives."""

AXES = "xyz"
"""Axes of a board's accelerometer."""

REST = 1.0
"""Duration of a measurement at rest, s."""

POSE = 2.0
"""Duration of a measurement in each position, s."""

TAP = 10.0
"""Peak of a tap, relative to the noise of a card's input at rest."""

CARD_TIME = 0.012
"""Latency with a sound card's inputs, s: a round trip of four blocks of 64 samples at 48 kHz. A
card that needs more reports it; the value of a specified file is kept."""


def connect(bench: benches.Bench) -> None:
    """Find the boards, write the rig's file, and check the signals."""
    _take_over(bench)
    a = bench.arguments
    nodes: dict[str, dict[str, Any]] = {
        setup.EVERY_NODE: {"rate": a.rate, ACTUATOR: {"force_constant": a.force_constant}},
        "master_device": {"device": a.master, "actuator_device": a.actuator},
        "slave_device": {"device": a.slave},
    }
    if a.accelerometers == devices.AUDIO:
        given = bench.parameters(benches.MASTER)[0].latency if bench.path.exists() else 0
        nodes[setup.EVERY_NODE]["latency"] = max(given, round(CARD_TIME * a.rate))
        for side in ARMS:
            nodes[f"{side}_device"]["accelerometer_device"] = devices.AUDIO
    boards = [side for side in ARMS if getattr(a, side).endswith(benches.SERIAL)]
    if boards:
        for side, port in _found(bench, boards).items():
            nodes[f"{side}_device"][benches.SERIAL] = port
    setup.update_parameter_file(bench.path, nodes)
    for side in ARMS:
        _look_at(bench, side)


def calibrate_boards(bench: benches.Bench) -> None:
    """Measure axis, gain and offset of each accelerometer."""
    for side in ARMS:
        if bench.is_on_card(side):
            bench.settle(lambda side=side: _scaled(bench, side))  # type: ignore[misc]
        elif bench.device_name(side).endswith(benches.SERIAL):
            bench.settle(lambda side=side: _turned_over(bench, side))  # type: ignore[misc]


def _take_over(bench: benches.Bench) -> None:
    """Copy the values of the specified parameter files to the rig's file."""
    for path in setup.parameter_paths(bench.arguments.params_file):
        values = setup.read_parameter_file(path)
        setup.update_parameter_file(bench.path, {node: own for node, own in values.items() if own})


def _found(bench: benches.Bench, sides: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return the port of each side's board; the board with an actuator is the handle's."""
    found: dict[str, dict[str, str]] = {}

    def look() -> list[Check]:
        from haptic_accel.devices.serial import BoardSamples

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
            except devices.DeviceError as error:
                results.append(Check(False, str(error), "flash the board: firmware/README.md"))
                continue
            side = benches.MASTER if identity.coils else benches.SLAVE
            key = "port" if port.port else "usb_serial"
            found.setdefault(side, {key: getattr(port, key)})
            text = f"{name}: board {identity.serial_number} of the {benches.HELD[side]}"
            results.append(Check(True, text))
        missing = [benches.HELD[side] for side in sides if side not in found]
        if missing:
            advice = "plug it in; the board with an actuator's amplifier is the handle's"
            results.append(Check(False, f"no board of the {' and '.join(missing)}", advice))
        return results

    bench.settle(look, can_skip=False)
    return {side: found[side] for side in sides}


def _ports(bench: benches.Bench) -> dict[str, serial.PortParameters]:
    """Return the specified ports, or all ports of this machine, by name."""
    given = [port for port in bench.arguments.ports.split(",") if port]
    if given:
        return {port: serial.PortParameters(port=str(Path(port).absolute())) for port in given}
    from serial.tools import list_ports

    return {
        port.device: serial.PortParameters(usb_serial=port.serial_number)
        for port in list_ports.comports()
        if port.serial_number
    }


def _look_at(bench: benches.Bench, side: str) -> None:
    """Check a side's signal at rest, and that the sensor belongs to this side."""
    held = benches.HELD[side]
    if bench.is_on_card(side):
        bench.goes_on(f"let go of the {held}, so that it lies still, then press Enter")
        bench.settle(lambda: _heard(bench, side))
        return
    is_simulated = bench.is_simulated(side)
    if is_simulated:
        bench.settle(lambda: [Check(True, f"{held}: simulated")])
        if side == benches.SLAVE or not bench.has_actuator():
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
        if bench.device_name(side) in benches.ARMS_ALONE:
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


def _heard(bench: benches.Bench, side: str) -> list[Check]:
    """Check the level of a card's input, and that it shows taps on this side."""
    quiet = _recorded(bench, side, REST)
    try:
        devices.check_level(quiet, f"{benches.HELD[side]}: input")
    except serial.CalibrationError as error:
        return [Check(False, str(error), "check sensor, cable, input and its gain")]
    noise = float(quiet.std())

    def is_tapped() -> bool:
        return float(np.abs(_recorded(bench, side, REST) - quiet.mean()).max()) > TAP * noise

    return [
        Check(
            bench.awaits(f"tap the {benches.HELD[side]} a few times", is_tapped),
            f"taps on the {benches.HELD[side]} are in its input, noise {noise:.2g} of full scale",
            "is this the other sensor's input? Correct audio.inputs; is the sensor fixed to it?",
        )
    ]


def _recorded(bench: benches.Bench, side: str, seconds: float) -> FloatArray:
    """Record a side's first input of the card from now on, full scale 1."""
    _, options = bench.parameters(side)
    own = options[devices.AUDIO]
    channel = devices.read_channels("audio.inputs", own.inputs)[0]
    return devices.recorded(own.device, seconds, channel)[0][:, channel - 1]


def _scaled(bench: benches.Bench, side: str) -> list[Check]:
    """Measure the scale of a card's input by gravity, unless the scale is known."""
    held = benches.HELD[side]
    _, options = bench.parameters(side)
    if known := options[devices.AUDIO].scales:
        return [Check(True, f"{held}: full scale {known} m/s^2, as in {bench.path.name}")]
    poses = []
    for pose in ("upwards", "downwards"):
        bench.goes_on(f"hold the {held} with the sensor's axis {pose}, still, then press Enter")
        poses.append(_recorded(bench, side, POSE))
    try:
        up, down = poses
        found = devices.by_gravity(up, down, f"{held}: input")
    except serial.CalibrationError as error:
        words = f"haptic-accel calibrate audio side:={side} file:={bench.path}"
        return [Check(False, str(error), f"in another terminal: {words}, and by:=...")]
    scales = {devices.AUDIO: {"scales": f"{found.scale:.6g}"}}
    setup.update_parameter_file(bench.path, {f"{side}_device": scales})
    return [Check(True, f"{held}: {found.text}")]


def _turned_over(bench: benches.Bench, side: str) -> list[Check]:
    from haptic_accel.devices.serial import BoardSamples

    own, options = bench.parameters(side)
    poses = []
    with BoardSamples(options[benches.SERIAL], round(own.rate), AXES) as board:
        bench.person.show(board)
        gain = board.identity.nominal_gain
        for pose in ("upwards", "downwards"):
            pose_text = f"with the coil's axis {pose}, firm and still"
            bench.goes_on(f"hold the {benches.HELD[side]} {pose_text}, then press Enter")
            poses.append(board.collect(POSE))
        number = board.identity.serial_number
    axis = serial.vertical(*poses)
    try:
        up, down = (serial.rest(pose[:, axis], gain) for pose in poses)
        found = serial.calibrate(up, down, gain)
    except serial.CalibrationError as error:
        return [Check(False, str(error), "hold it again, the other way up the second time")]
    calibration = found.parameters(AXES[axis], number)
    nodes = {f"{side}_device": {benches.SERIAL: {"calibration": calibration}}}
    setup.update_parameter_file(bench.path, nodes)
    within = f"{found.gain_error / abs(found.gain):.2%}"
    return [
        Check(
            True,
            f"{benches.HELD[side]}: axis {AXES[axis]}, gain {found.gain:.5g} m/s^2 per count"
            f" within {within}, noise {found.noise:.3f} m/s^2",
        )
    ]


PROBE = 1.0
"""Duration of a probing force, s."""

METER_CURRENT = 0.1
"""Current through the resistor in the coil's place, A: a volt at ten ohms."""


def make_safe(bench: benches.Bench) -> None:
    """Check force and polarity of the actuator, and its silence after each kind of end."""
    if not bench.has_actuator():
        return
    if bench.device_name(benches.MASTER).endswith(benches.SERIAL):
        _measure_current(bench)
    bench.goes_on("hold the handle as in use, with the coil connected, then press Enter")
    bench.settle(lambda: _probed(bench))
    if bench.device_name(benches.SLAVE) not in benches.ARMS_ALONE:
        bench.settle(lambda: _heard_apart(bench))
    bench.settle(lambda: _stopped(bench))
    if bench.device_name(benches.MASTER).endswith(benches.SERIAL):
        bench.settle(lambda: _unplugged(bench))


def _measure_current(bench: benches.Bench) -> None:
    """Compare the amplifier's current through a resistor with the commanded current."""
    if not bench.goes_on(
        "disconnect the coil; put a resistor of 4 to 10 ohms and a meter for current in its"
        " place, then press Enter",
        skip="skip",
    ):
        bench.notes.append(f"{benches.SKIPPED}current not measured")
        bench.person.tell(bench.notes[-1])
        return
    _, options = bench.parameters(benches.MASTER)
    constant = options[benches.SERIAL].actuator.force_constant

    def measure() -> list[Check]:
        with bench.observed(benches.MASTER) as device:
            bench.person.show(device)
            device.drive(lambda _: METER_CURRENT * constant)
            time.sleep(benches.RESPONSE_SETTLING)
            driven = bench.number("type the current that the meter shows now, A")
            device.drive(None)
            time.sleep(benches.RESPONSE_SETTLING)
            silent = bench.number("the commands have ended: type the current now, A")
        zero = Check(
            abs(silent) < checks.CURRENT_ERROR * METER_CURRENT,
            f"current {silent:g} A without commands (0)",
            "switch the amplifier off: it does not follow the board",
        )
        return [checks.current_check(driven, METER_CURRENT), zero]

    bench.settle(measure)


def _probed(bench: benches.Bench) -> list[Check]:
    """Check the response to forces; correct the polarity."""
    with bench.observed(benches.MASTER) as device:
        bench.person.show(device)
        at_rest = device.observe(REST).acceleration
        noise = float(np.nanstd(at_rest)) * math.sqrt(2 / len(at_rest))
        responses = []
        for amplitude in checks.PROBE_FORCES:
            device.drive(_probe(amplitude))
            time.sleep(benches.RESPONSE_SETTLING)
            seen = device.observe(PROBE)
            responses.append(checks.response(seen.force, seen.acceleration, seen.rate))
        device.drive(None)
    small, large = responses
    found = checks.probe_checks(small, large, noise)
    if len(found) > 1 and not found[1].passed:
        _, options = bench.parameters(benches.MASTER)
        turned = -options[setup.SAFETY].hardware.force_constant
        setup.update_parameter_file(
            bench.path, {setup.EVERY_NODE: {ACTUATOR: {"force_constant": turned}}}
        )
        found[1] = Check(True, f"the coil pushes backwards: force constant made {turned:g} N/A")
    return found


def _heard_apart(bench: benches.Bench) -> list[Check]:
    """Check that the tool's accelerometer does not measure the handle's vibration."""
    with bench.observed(benches.MASTER) as device, bench.observed(benches.SLAVE) as tool:
        device.drive(_probe(checks.PROBE_FORCES[1]))
        time.sleep(benches.RESPONSE_SETTLING)
        both = device.observe(PROBE), tool.last(PROBE)
        device.drive(None)
    # Samples of two devices do not start together, but the force has a single frequency.
    count = min(len(each.acceleration) for each in both)
    force, rate = both[0].force[:count], both[0].rate
    handle, heard = (abs(checks.response(force, each.acceleration[:count], rate)) for each in both)
    return [checks.apart_check(heard, handle)]


def _stopped(bench: benches.Bench) -> list[Check]:
    """Check that the handle is quiet after an emergency stop, and after the last command."""
    found = []
    with bench.observed(benches.MASTER) as device:
        bench.person.show(device)
        noise = float(np.nanstd(device.observe(REST).acceleration))
        for name, end in (
            ("emergency stop", device.stop),
            ("end of the commands", lambda: device.drive(None)),
        ):
            device.arm()
            device.drive(_probe(checks.PROBE_FORCES[1]))
            time.sleep(benches.RESPONSE_SETTLING)
            end()
            time.sleep(benches.RESPONSE_SETTLING)
            seen = device.last(benches.RESPONSE_SETTLING + REST)
            last = int(np.flatnonzero(seen.force)[-1])
            taken = checks.quiet_after(
                seen.acceleration - np.nanmean(seen.acceleration), seen.rate, last, noise
            )
            found.append(
                Check(
                    taken <= checks.QUIET_TIME,
                    f"quiet {1e3 * taken:.0f} ms after the {name} (at most"
                    f" {1e3 * checks.QUIET_TIME:.0f})",
                    "do not hold the handle: switch the amplifier off, and check its input",
                )
            )
    return found


def _unplugged(bench: benches.Bench) -> list[Check]:
    """Check that a pulled plug is reported, and that no force returns by itself."""
    with bench.observed(benches.MASTER) as device:
        bench.person.show(device)
        noise = float(np.nanstd(device.observe(REST).acceleration))
        device.drive(_probe(checks.PROBE_FORCES[1]))
        named = bench.awaits("pull the USB plug of the handle", lambda: bool(device.problem))
        lost = device.silent_for
        if not named:
            return [Check(False, "the plug was not pulled", "pull the USB plug while it hums")]
        gone = Check(
            lost <= checks.GONE_TIME,
            f"the loss was named after {lost:.2f} s (at most {checks.GONE_TIME:g})",
            "is the board on a hub that hides the loss? Use a port of this machine",
        )

        def is_gone() -> bool:
            return bool(np.isnan(device.last(benches.RESPONSE_SETTLING).acceleration).all())

        def is_back() -> bool:
            return bool(np.isfinite(device.last(REST).acceleration).all())

        request = "plug it in again"
        if not (bench.awaits(request, is_gone) and bench.awaits("", is_back)):
            return [gone, Check(False, "the board did not come back", "reset the board")]
        level = float(np.nanstd(device.last(REST).acceleration))
    quiet = Check(
        level <= 2 * noise + serial.STILL,
        f"no force by itself once it is back ({level:.2f} m/s^2)",
        "flash the board: its firmware must wait to be armed",
    )
    return [gone, quiet]


def _probe(amplitude: float) -> devices.ForceOverTime:
    """Return the probing force of an amplitude in N."""
    omega = 2 * math.pi * checks.PROBE_FREQUENCY
    return lambda time: amplitude * math.cos(omega * time)
