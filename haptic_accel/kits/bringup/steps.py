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

"""Five steps from unknown boards to a compensated handle: each measures, judges and advises."""

from __future__ import annotations

import itertools
import json
import math
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from haptic_accel.analysis.experiment import LOST_SHARE
from haptic_accel.core import signal_checks as checks
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import ACTUATOR
from haptic_accel.core.parameters import Checked, like, parameter, shown
from haptic_accel.core.process import (
    FULL_SCALE,
    PROGRESS,
    SUPERVISOR,
    TOO_STRONG,
    module_command,
    read_event,
)
from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.core.signal_checks import Check
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import MASTERS, SLAVES, DeviceError
from haptic_accel.devices.audio import AUDIO
from haptic_accel.devices.observed import Force, Observation, ObservedDevice
from haptic_accel.devices.serial.calibration import CalibrationError, calibrate, rest, vertical
from haptic_accel.devices.serial.device import PortParameters
from haptic_accel.setup.arguments import POINTER, SIMULATED, VIRTUAL, GraphArguments
from haptic_accel.setup.files import EVERY_NODE, SEPARATOR, parameter_paths, read_parameter_file
from haptic_accel.setup.node_parameters import SAFETY, build_device
from haptic_accel.setup.rig_file import (
    note_step,
    noted_steps,
    teleoperation_words,
    update_parameter_file,
)
from haptic_accel.setup.setup import Setup

MASTER, SLAVE = ARMS

STEPS = {
    "connect": "find the boards, and look at their signals",
    "calibrate": "turn each board over, for its axis, gain and offset",
    "make_safe": "force, polarity, stop, silence and a pulled plug",
    "identify": "excite the handle, and fit its model",
    "prove": "feel the surface without and with compensation, and compare",
}
"""Names of the steps, and their purpose."""

HELD = {MASTER: "handle", SLAVE: "tool"}
"""Part in the hand or on the surface, of each arm."""

ARM = "can"
"""Begin of the names of devices with an arm whose joints this computer drives."""

ARMS_ALONE = "can", "crtk"
"""Devices with neither accelerometer nor actuator in the handle."""

SERIAL = "serial"
"""Ending of the names of devices with a board on USB serial."""

COMMAND = module_command("haptic_accel.cli.main")
"""Command line of this program."""

AXES = "xyz"
"""Axes of a board's accelerometer."""

REST = 1.0
"""Time to look at a signal at rest, s."""

POSE = 2.0
"""Time to measure in each position, s."""

PROBE = 1.0
"""Duration of a probing force, s."""

RESPONSE_SETTLING = 0.4
"""Time until a probing force's response is steady, or has died away, s."""

PATIENCE = 60.0
"""Time to wait for what the user is asked to do, s."""

ACTION_POLL_PERIOD = 0.02
"""Interval between looks for it, s."""

METER_CURRENT = 0.1
"""Current through the resistor in the coil's place, A: a volt at ten ohms."""

SMALLEST_SHARE = 0.05
"""Share of the sweep's amplitudes below which identification is not tried again."""

TRIAL = 10
"""Duration of a trial with a controller, s, as the paper's."""

TIMED = "master_device", "slave_device", "coupler", "compensator"
"""Nodes that share the latency of the graph."""

MOST_LATENCY = 4
"""Largest latency that the proof sets, samples. Each adds to the least possible error (`bound`);
beyond, the machine is not fit for the rate."""

MOST_LATE = 100.0 * LOST_SHARE
"""Share of late forces above which a graph needs more time, %, as an experiment warns."""

SKIP = "s"
"""Answer that goes on without what is asked."""

PASSED, NOT_PASSED, SKIPPED = "ok: ", "NOT PASSED: ", "SKIPPED: "
"""Beginnings of the lines that tell a check's result."""


@dataclass(frozen=True)
class BringUpArguments(Checked):
    """Rig to bring up."""

    file: str = parameter("rig.yaml", "file of the rig, to write and to go on from")
    master: str = parameter(SERIAL, "master device", choices=tuple(MASTERS))
    actuator: str = like(GraphArguments, "actuator")
    slave: str = parameter(SERIAL, "slave device", choices=tuple(SLAVES))
    ports: str = parameter(
        "", "serial ports of the boards with commas between; empty for those of this machine"
    )
    params_file: str = parameter(
        "", "ROS parameter files to take over into a new file, such as an arm's kinematics"
    )
    rate: float = parameter(DEFAULT_RATE, "sampling rate", unit="Hz", low=100.0, high=10e3)
    force_constant: float = parameter(
        ActuatorParameters.force_constant,
        "force constant of the handle's actuator, from its data sheet",
        unit="N/A",
        low=-1000.0,
        high=1000.0,
    )
    redo: str = parameter("", "step to begin with again; empty to go on", choices=("", *STEPS))


class Watched(Protocol):
    """Source of a live signal."""

    def last(self, seconds: float) -> Observation:
        """Return the samples of the last seconds."""


class Person(Protocol):
    """Person who brings up the rig, at a terminal or a page."""

    def begin(self, number: int, step: str, purpose: str) -> None:
        """Show that a step begins."""

    def tell(self, line: str) -> None:
        """Show a line."""

    def show(self, watched: Watched | None) -> None:
        """Show a live signal from now on; None for none."""

    def ask(self, request: str) -> str:
        """Return the answer to a request, empty to go on; raise EOFError where there is none."""

    def request(self, line: str) -> None:
        """Ask for an action that is noticed by itself."""


class _Ran(NamedTuple):
    """Outcome of a verb: exit status, its last non-empty line, and its events by name."""

    status: int
    last: str
    events: Mapping[str, Mapping[str, Any]]


class BringUpError(RuntimeError):
    """Error: the rig cannot be brought up further; the message is one line."""


class BringUp:
    """Bring-up of a rig.

    Parameters
    ----------
    arguments : BringUpArguments
    person : Person

    Raises
    ------
    ParameterError
        The rig's file cannot be read or written, or an argument does not go with it.
    """

    def __init__(self, arguments: BringUpArguments, person: Person) -> None:
        self._arguments, self._person = arguments, person
        self._path = Path(arguments.file)
        self._said: list[str] = []
        for path in parameter_paths(arguments.params_file):
            read_parameter_file(path)
        if self._path.exists():
            read_parameter_file(self._path)
        noted = noted_steps(self._path)
        self._done = dict[str, str]()
        for step in STEPS:
            if step not in noted or step == arguments.redo:
                break
            self._done[step] = noted[step]

    def run(self) -> list[str]:
        """Take the steps that are left; return verb and words of the next command.

        Raises
        ------
        BringUpError
            A step cannot be taken.
        EOFError
            Nobody answers; the same command goes on at the unfinished step.
        """
        for number, (step, purpose) in enumerate(STEPS.items(), start=1):
            self._person.begin(number, step.replace("_", " "), purpose)
            if step in self._done:
                self._person.tell(f"done {self._done[step]}")
                continue
            self._said.clear()
            try:
                getattr(self, f"_{step}")()
            except DeviceError as error:
                raise BringUpError(str(error)) from None
            self._person.show(None)
            text = "; ".join(self._said) or "nothing to do"
            note_step(self._path, step, f"{datetime.now():%Y-%m-%d %H:%M}: {text}")
        return teleoperation_words("", self._path, "controller:=adaptive")

    # The steps

    def _connect(self) -> None:
        self._take_over()
        a = self._arguments
        nodes: dict[str, dict[str, Any]] = {
            EVERY_NODE: {"rate": a.rate, ACTUATOR: {"force_constant": a.force_constant}},
            "master_device": {"device": a.master, "actuator_device": a.actuator},
            "slave_device": {"device": a.slave},
        }
        boards = [side for side in ARMS if getattr(a, side).endswith(SERIAL)]
        if boards:
            for side, port in self._found(boards).items():
                nodes[f"{side}_device"][SERIAL] = port
        update_parameter_file(self._path, nodes)
        for side in ARMS:
            self._look_at(side)

    def _calibrate(self) -> None:
        for side in ARMS:
            if self._device_name(side).endswith(SERIAL):
                self._settle(lambda side=side: self._turned_over(side))  # type: ignore[misc]

    def _make_safe(self) -> None:
        if not self._has_actuator():
            return
        if self._device_name(MASTER).endswith(SERIAL):
            self._measure_current()
        self._goes_on("hold the handle as in use, with the coil connected, then press Enter")
        self._settle(self._probed)
        self._settle(self._stopped)
        if self._device_name(MASTER).endswith(SERIAL):
            self._settle(self._unplugged)

    def _identify(self) -> None:
        if self._device_name(MASTER) in ARMS_ALONE:
            return
        if scale := self._identified().get(FULL_SCALE):
            mass = self._number("type the mass of all that moves with the handle, without m_a, kg")
            full_scale = {"audio": {"full_scale": float(f"{scale['value'] * mass:.4g}")}}
            update_parameter_file(self._path, {"master_device": full_scale})
            self._person.tell("the force is scaled now: again, with newtons")
            self._identified()
        self._said.append("the model is in this file")

    def _identified(self) -> Mapping[str, Mapping[str, Any]]:
        """Identify the handle, with less force where the travel is short; return the events."""
        self._goes_on("hold the handle as in use, without moving it, then press Enter")
        share = 1.0
        words = ["params_file:=" + str(self._path), "--update", str(self._path)]
        while True:
            out = self._report_folder("identify")
            ran = self._command("identify", *words, *_amplitudes(share), "--out", str(out))
            if ran.status == 0:
                self._keep(out)
                return ran.events
            share /= 2
            if TOO_STRONG not in ran.events or share < SMALLEST_SHARE:
                reason = ran.last.partition("; next: ")[0]  # this is the next command
                if not self._goes_on(f"{reason}; press Enter to try again, or type s to stop"):
                    raise BringUpError(reason)
                share = 1.0
            else:
                self._person.tell("the actuator came near its stops: again with half the force")

    def _prove(self) -> None:
        if not {self._device_name(side) for side in ARMS}.isdisjoint(ARMS_ALONE):
            self._settle(lambda: [Check(True, "no accelerometer on both arms: not compared")])
            return
        self._goes_on(
            f"take the handle, and stroke the surface once the arms engage, {TRIAL} s without"
            f" and {TRIAL} s with compensation; press Enter to begin"
        )
        self._settle(self._compared)

    # Connect

    def _take_over(self) -> None:
        """Copy the values of the given parameter files into the rig's."""
        for path in parameter_paths(self._arguments.params_file):
            values = read_parameter_file(path)
            update_parameter_file(self._path, {node: own for node, own in values.items() if own})

    def _found(self, sides: Sequence[str]) -> dict[str, dict[str, str]]:
        """Return the port of each side's board: the one with an actuator is the handle's."""
        found: dict[str, dict[str, str]] = {}

        def look() -> list[Check]:
            from haptic_accel.devices.serial.board_samples import BoardSamples

            found.clear()
            ports = self._ports()
            if not ports:
                advice = "plug in the board's cable, one for data, and join the group dialout"
                return [Check(False, "no serial port", advice)]
            results = []
            for name, port in ports.items():
                try:
                    with BoardSamples(port, round(self._arguments.rate), AXES) as board:
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

        self._settle(look, can_skip=False)
        return {side: found[side] for side in sides}

    def _ports(self) -> dict[str, PortParameters]:
        """Return the given ports, or this machine's, by name."""
        given = [port for port in self._arguments.ports.split(SEPARATOR) if port]
        if given:
            return {port: PortParameters(port=str(Path(port).absolute())) for port in given}
        from serial.tools import list_ports

        return {
            port.device: PortParameters(usb_serial=port.serial_number)
            for port in list_ports.comports()
            if port.serial_number
        }

    def _look_at(self, side: str) -> None:
        """Check a side's signal at rest, and that the sensor belongs to this side."""
        held = HELD[side]
        is_simulated = self._is_simulated(side)
        if is_simulated:
            self._settle(lambda: [Check(True, f"{held}: simulated")])
            if side == SLAVE or not self._has_actuator():
                return
        with self._observed(side) as device:
            self._person.show(device)
            if device.remark:
                self._person.tell(f"{held}: {device.remark}")
            if is_simulated:
                return
            if self._device_name(side).startswith(ARM):
                x, y, z = 1e3 * np.nanmean(device.observe(REST).position, axis=0)
                self._goes_on(
                    f"the {held} is at x {x:.0f}, y {y:.0f}, z {z:.0f} mm: move it away, to the"
                    " left and up, where x, y and z grow; press Enter, or correct direction and"
                    " offset of its joints and begin again"
                )
            if self._device_name(side) in ARMS_ALONE:
                return
            self._goes_on(f"let go of the {held}, so that it lies still, then press Enter")
            self._settle(lambda: checks.rest_checks(device.observe(REST).acceleration))
            noise = float(np.nanstd(device.observe(REST).acceleration))
            self._settle(
                lambda: [
                    Check(
                        self._awaits(
                            f"tap the {held} a few times",
                            lambda: checks.is_tapped(device.last(REST).acceleration, noise),
                        ),
                        f"taps on the {held} are in its signal",
                        "is this the other board? Swap the cables; is the sensor fixed to it?",
                    )
                ]
            )

    # Calibrate

    def _turned_over(self, side: str) -> list[Check]:
        from haptic_accel.devices.serial.board_samples import BoardSamples

        own, options = self._parameters(side)
        poses = []
        with BoardSamples(options[SERIAL], round(own.rate), AXES) as board:
            self._person.show(board)
            gain = board.identity.nominal_gain
            for pose in ("upwards", "downwards"):
                pose_text = f"with the coil's axis {pose}, firm and still"
                self._goes_on(f"hold the {HELD[side]} {pose_text}, then press Enter")
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
        update_parameter_file(self._path, nodes)
        within = f"{found.gain_error / abs(found.gain):.2%}"
        return [
            Check(
                True,
                f"{HELD[side]}: axis {AXES[axis]}, gain {found.gain:.5g} m/s^2 per count within"
                f" {within}, noise {found.noise:.3f} m/s^2",
            )
        ]

    # Make safe

    def _measure_current(self) -> None:
        """Compare the amplifier's current through a resistor with what is commanded."""
        if not self._goes_on(
            "disconnect the coil; put a resistor of 4 to 10 ohms and a meter for current in its"
            " place, then press Enter; or type s to skip"
        ):
            self._said.append(f"{SKIPPED}current not measured")
            self._person.tell(self._said[-1])
            return
        _, options = self._parameters(MASTER)
        constant = options[SERIAL].actuator.force_constant

        def measure() -> list[Check]:
            with self._observed(MASTER) as device:
                self._person.show(device)
                device.drive(lambda _: METER_CURRENT * constant)
                time.sleep(RESPONSE_SETTLING)
                driven = self._number("type the current that the meter shows now, A")
                device.drive(None)
                time.sleep(RESPONSE_SETTLING)
                silent = self._number("the commands have ended: type the current now, A")
            zero = Check(
                abs(silent) < checks.CURRENT_ERROR * METER_CURRENT,
                f"current {silent:g} A without commands (0)",
                "switch the amplifier off: it does not follow the board",
            )
            return [checks.current_check(driven, METER_CURRENT), zero]

        self._settle(measure)

    def _probed(self) -> list[Check]:
        """Check the response to forces; correct the polarity."""
        with self._observed(MASTER) as device:
            self._person.show(device)
            at_rest = device.observe(REST).acceleration
            noise = float(np.nanstd(at_rest)) * math.sqrt(2 / len(at_rest))
            responses = []
            for amplitude in checks.PROBE_FORCES:
                device.drive(_probe(amplitude))
                time.sleep(RESPONSE_SETTLING)
                seen = device.observe(PROBE)
                responses.append(checks.response(seen.force, seen.acceleration, seen.rate))
            device.drive(None)
        small, large = responses
        found = checks.probe_checks(small, large, noise)
        if len(found) > 1 and not found[1].passed:
            _, options = self._parameters(MASTER)
            turned = -options[SAFETY].hardware.force_constant
            update_parameter_file(self._path, {EVERY_NODE: {ACTUATOR: {"force_constant": turned}}})
            text = f"the coil pushes backwards: force constant made {turned:g} N/A"
            found[1] = Check(True, text)
        return found

    def _stopped(self) -> list[Check]:
        """Check that the handle is quiet after an emergency stop, and after the last command."""
        found = []
        with self._observed(MASTER) as device:
            self._person.show(device)
            noise = float(np.nanstd(device.observe(REST).acceleration))
            for name, end in (
                ("emergency stop", device.stop),
                ("end of the commands", lambda: device.drive(None)),
            ):
                device.arm()
                device.drive(_probe(checks.PROBE_FORCES[1]))
                time.sleep(RESPONSE_SETTLING)
                end()
                time.sleep(RESPONSE_SETTLING)
                seen = device.last(RESPONSE_SETTLING + REST)
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

    def _unplugged(self) -> list[Check]:
        """Check that a pulled plug is named, and that no force comes back by itself."""
        with self._observed(MASTER) as device:
            self._person.show(device)
            noise = float(np.nanstd(device.observe(REST).acceleration))
            device.drive(_probe(checks.PROBE_FORCES[1]))
            named = self._awaits("pull the USB plug of the handle", lambda: bool(device.problem))
            lost = device.silent_for
            if not named:
                return [Check(False, "the plug was not pulled", "pull the USB plug while it hums")]
            gone = Check(
                lost <= checks.GONE_TIME,
                f"the loss was named after {lost:.2f} s (at most {checks.GONE_TIME:g})",
                "is the board on a hub that hides the loss? Use a port of this machine",
            )

            def is_gone() -> bool:
                return bool(np.isnan(device.last(RESPONSE_SETTLING).acceleration).all())

            def is_back() -> bool:
                return bool(np.isfinite(device.last(REST).acceleration).all())

            request = "plug it in again"
            if not (self._awaits(request, is_gone) and self._awaits("", is_back)):
                return [gone, Check(False, "the board did not come back", "reset the board")]
            level = float(np.nanstd(device.last(REST).acceleration))
        quiet = Check(
            level <= 2 * noise + checks.STILL,
            f"no force by itself once it is back ({level:.2f} m/s^2)",
            "flash the board: its firmware must wait to be armed",
        )
        return [gone, quiet]

    # Prove

    def _compared(self) -> list[Check]:
        """Run the graph without compensation and with `adaptive`, and compare the errors."""
        out = self._report_folder("prove")
        results = out.with_suffix(".json")
        out.parent.mkdir(parents=True, exist_ok=True)
        ran = self._command(
            *("experiment", "--controllers", "none,adaptive"),
            *(f"params_file:={self._path}", "surface:=plywood", f"duration:={TRIAL}"),
            *("--out", str(out), "--json", str(results)),
        )
        if ran.status:
            return [Check(False, ran.last, "haptic-accel doctor checks the machine")]
        self._keep(out)
        conditions = json.loads(results.read_text(encoding="utf-8"))["conditions"]
        none, adaptive = sorted(conditions, key=lambda each: each["controller"], reverse=True)
        without, error = none["nrmse_percent"], adaptive["nrmse_percent"]
        if without is None or error is None:
            advice = "press the tool on the surface, and stroke along it during both trials"
            return [Check(False, "the tool touched nothing", advice)]
        least = adaptive["limited_bound_percent"]
        late = max(each["deadlines_missed_percent"] or 0.0 for each in conditions)
        if late > MOST_LATE:
            told = f"{late:.1f} % of the actuator forces took effect late"
            in_time = Check(False, told, self._more_time())
        else:
            in_time = Check(True, "forces in time")
        return [in_time, checks.proof_check(without, error, least or 0.0)]

    def _more_time(self) -> str:
        """Give the forces a sample more time, as far as that is useful; return what was done."""
        latency = self._parameters(MASTER)[0].latency + 1
        if latency > MOST_LATENCY:
            return "close other programs, and run haptic-accel doctor"
        update_parameter_file(self._path, {node: {"latency": latency} for node in TIMED})
        return f"forces have {latency} samples of time from now on; measure again"

    # Parts of all steps

    def _settle(self, measure: Callable[[], list[Check]], *, can_skip: bool = True) -> None:
        """Measure until all checks pass, or the user goes on without; note the last results."""
        while True:
            try:
                found = measure()
            except DeviceError as error:
                found = [Check(False, str(error), "check the cable and the device's supply")]
            for check in found:
                self._tell(check)
            passed = all(check.passed for check in found)
            skip = f" or type {SKIP} to go on all the same" if can_skip else ""
            if passed or not self._goes_on(f"press Enter to try again{skip}"):
                self._said += [("" if each.passed else NOT_PASSED) + each.text for each in found]
                return

    def _tell(self, check: Check) -> None:
        if check.passed:
            self._person.tell(PASSED + check.text)
        else:
            self._person.tell(NOT_PASSED + check.text)
            self._person.tell(f"  {check.advice}")

    def _goes_on(self, request: str) -> bool:
        """Ask until the answer is empty, or `SKIP` where offered; return whether it is empty."""
        allowed = {"": "Enter", SKIP: f"{SKIP} and Enter"}
        if f"type {SKIP} " not in request:
            del allowed[SKIP]
        while (answer := self._person.ask(request).strip().lower()) not in allowed:
            self._person.tell(f"{shown(answer)}: must be {' or '.join(allowed.values())}")
        return not answer

    def _number(self, request: str) -> float:
        while True:
            with suppress(ValueError):
                if math.isfinite(number := float(self._person.ask(request))):
                    return number
            self._person.tell("must be a number, such as 0.1")

    def _report_folder(self, step: str) -> Path:
        """Return the path of a new folder beside the rig's file."""
        beside = self._path.with_name(f"{self._path.stem}_reports")
        free = (beside / f"{step}_{n}" for n in itertools.count(1))
        return next(folder for folder in free if not folder.exists())

    def _keep(self, report: Path) -> None:
        """Tell and note where a report is."""
        self._said.append(f"report in {report}")
        self._person.tell(self._said[-1])

    def _awaits(self, request: str, happened: Callable[[], bool]) -> bool:
        """Ask for an action, and return whether it happens in time."""
        if request:
            self._person.request(request)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if happened():
                return True
            time.sleep(ACTION_POLL_PERIOD)
        return False

    def _command(self, *words: str) -> _Ran:
        """Run a verb of this program, and show its progress."""
        last, events = "no reason given", dict[str, Mapping[str, Any]]()
        with subprocess.Popen(
            [*COMMAND, *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, SUPERVISOR: str(os.getpid())},
        ) as process:
            assert process.stdout
            try:
                for line in process.stdout:
                    if event := read_event(line):
                        events[event["event"]] = event
                        if event["event"] == PROGRESS:
                            self._person.tell(event["text"])
                    else:
                        last = line.rstrip() or last
            except BaseException:
                process.terminate()
                process.wait()
                raise
        return _Ran(process.returncode, last, events)

    def _parameters(self, side: str) -> tuple[Any, dict[str, Any]]:
        arguments = GraphArguments.from_given(params_file=str(self._path), record=False)
        return Setup.of(arguments).node(f"{side}_device")

    def _device_name(self, side: str) -> str:
        return str(self._parameters(side)[0].device)

    def _is_simulated(self, side: str) -> bool:
        return self._device_name(side) in (SIMULATED, POINTER, VIRTUAL)

    def _has_actuator(self) -> bool:
        """Return whether the handle has an actuator that is no simulation."""
        own, _ = self._parameters(MASTER)
        return own.actuator_device == AUDIO or own.device not in (SIMULATED, POINTER, *ARMS_ALONE)

    @contextmanager
    def _observed(self, side: str) -> Iterator[ObservedDevice]:
        own, options = self._parameters(side)
        device = build_device(f"{side}_device", own, options)
        with ObservedDevice(device, options[SAFETY], own.rate, own.latency) as observed:
            time.sleep(RESPONSE_SETTLING)
            try:
                yield observed
            finally:
                self._person.show(None)


def _probe(amplitude: float) -> Force:
    """Return the probing force of an amplitude in N."""
    omega = 2 * math.pi * checks.PROBE_FREQUENCY
    return lambda time: amplitude * math.cos(omega * time)


def _amplitudes(share: float) -> list[str]:
    """Return the arguments for a fraction of the sweep's default amplitudes; none for 1."""
    sweep = SweepParameters()
    names = ("start_amplitude", "end_amplitude") if share < 1 else ()
    return [f"{name}:={share * getattr(sweep, name):.3g}" for name in names]
