# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rig on the bench: its parameter file, its devices, and the user who brings it up."""

from __future__ import annotations

import itertools
import math
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from haptic_accel import Checked, GraphArguments, Setup, parameter
from haptic_accel.core import ActuatorParameters
from haptic_accel.core.parameters import like, shown
from haptic_accel.core.process import PROGRESS, SUPERVISOR, module_command, read_event
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import AUDIO, MASTERS, SLAVES, DeviceError, Observation, ObservedDevice
from haptic_accel.graph import hurry
from haptic_accel.kits.bringup.signal_checks import Check
from haptic_accel.setup import SAFETY, build_device, parameter_paths, read_parameter_file
from haptic_accel.setup.arguments import POINTER, SIMULATED, VIRTUAL

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
"""Part of each arm that is held in the hand or touches the surface."""

ARMS_ALONE = "can", "crtk"
"""Devices that have neither an accelerometer nor an actuator in the handle."""

SERIAL = "serial"
"""Suffix of the names of devices with a board on USB serial."""

COMMAND = module_command("haptic_accel.cli.main")
"""Command line of this program."""

RESPONSE_SETTLING = 0.4
"""Time until a probing force's response is steady, or has died away, s."""

PATIENCE = 60.0
"""Time-out for an action requested from the user, s."""

ACTION_POLL_PERIOD = 0.02
"""Interval between checks for a requested action, s."""

SKIP = "s"
"""Answer that skips a request."""

PASSED, NOT_PASSED, SKIPPED = "ok: ", "NOT PASSED: ", "SKIPPED: "
"""Prefixes of the lines with a check's result."""


@dataclass(frozen=True)
class BringUpArguments(Checked):
    """Rig to bring up."""

    file: str = parameter("rig.yaml", "file of the rig, to write and to go on from")
    master: str = parameter(SERIAL, "master device", choices=tuple(MASTERS))
    actuator: str = like(GraphArguments, "actuator")
    accelerometers: str = like(GraphArguments, "accelerometers")
    slave: str = parameter(SERIAL, "slave device", choices=tuple(SLAVES))
    ports: str = parameter(
        "", "serial ports of the boards, separated by commas; empty for those of this machine"
    )
    params_file: str = parameter(
        "", "ROS parameter files to take over into a new file, such as an arm's kinematics"
    )
    rate: float = parameter(GraphArguments.rate, "sampling rate", unit="Hz", low=100.0, high=10e3)
    force_constant: float = parameter(
        ActuatorParameters.force_constant,
        "force constant of the handle's actuator, from its data sheet",
        unit="N/A",
        low=-1000.0,
        high=1000.0,
    )
    redo: str = parameter("", "step to begin with again; empty to go on", choices=("", *STEPS))


class Watched(Protocol):
    """Interface of a source of a live signal."""

    def last(self, seconds: float) -> Observation:
        """Return the samples of the last seconds."""


class Person(Protocol):
    """Interface of the person who brings up the rig, at a terminal or a page."""

    def begin(self, number: int, step: str, purpose: str) -> None:
        """Show that a step begins."""

    def tell(self, line: str) -> None:
        """Show a line."""

    def show(self, watched: Watched | None) -> None:
        """Show a live signal from now on; None for none."""

    def ask(self, request: str, skip: str = "") -> str:
        """Return the answer to a request, empty to continue; raise EOFError without an answer.

        Parameters
        ----------
        request : str
        skip : str
            Effect of the answer `SKIP`, for a button; empty if it is not offered.
        """

    def request(self, line: str) -> None:
        """Request an action that is detected automatically."""


class Outcome(NamedTuple):
    """Outcome of a command: exit status, last non-empty line, and events by name."""

    status: int
    last: str
    events: Mapping[str, Mapping[str, Any]]


class BringUpError(RuntimeError):
    """Error: the bring-up cannot continue; the message is one line."""


class Bench:
    """Rig during its bring-up.

    Parameters
    ----------
    arguments : BringUpArguments
    person : Person

    Attributes
    ----------
    path : Path
        Parameter file of the rig.
    notes : list of str
        Results of the present step, for the file.

    Raises
    ------
    ParameterError
        A file cannot be read.
    """

    def __init__(self, arguments: BringUpArguments, person: Person) -> None:
        self.arguments, self.person = arguments, person
        self.path = Path(arguments.file)
        self.notes: list[str] = []
        for path in parameter_paths(arguments.params_file):
            read_parameter_file(path)
        if self.path.exists():
            read_parameter_file(self.path)

    def settle(self, measure: Callable[[], list[Check]], *, can_skip: bool = True) -> None:
        """Measure until all checks pass or the user skips them; note the last results."""
        while True:
            try:
                found = measure()
            except DeviceError as error:
                found = [Check(False, str(error), "check the cable and the device's supply")]
            for check in found:
                self.person.tell((PASSED if check.passed else NOT_PASSED) + check.text)
                if not check.passed:
                    self.person.tell(f"  {check.advice}")
            passed = all(check.passed for check in found)
            skip = "go on all the same" if can_skip else ""
            if passed or not self.goes_on("press Enter to try again", skip):
                self.notes += [("" if each.passed else NOT_PASSED) + each.text for each in found]
                return

    def goes_on(self, request: str, skip: str = "") -> bool:
        """Ask until the answer is empty, or `SKIP` where offered; return whether it is empty.

        Parameters
        ----------
        request : str
        skip : str
            Effect of the answer `SKIP`; empty if it is not offered.
        """
        allowed = {"": "Enter"}
        if skip:
            allowed[SKIP] = f"{SKIP} and Enter"
            request = f"{request}, or type {SKIP} to {skip}"
        while (answer := self.person.ask(request, skip).strip().lower()) not in allowed:
            self.person.tell(f"{shown(answer)}: must be {' or '.join(allowed.values())}")
        return not answer

    def number(self, request: str) -> float:
        """Ask until the answer is a finite number; return it."""
        while True:
            with suppress(ValueError):
                if math.isfinite(number := float(self.person.ask(request))):
                    return number
            self.person.tell("must be a number, such as 0.1")

    def report_folder(self, step: str) -> Path:
        """Return the path of a new folder next to the rig's file."""
        beside = self.path.with_name(f"{self.path.stem}_reports")
        free = (beside / f"{step}_{n}" for n in itertools.count(1))
        return next(folder for folder in free if not folder.exists())

    def keep(self, report: Path) -> None:
        """Show and note the path of a report."""
        self.notes.append(f"report in {report}")
        self.person.tell(self.notes[-1])

    def awaits(self, request: str, happened: Callable[[], bool]) -> bool:
        """Request an action, and return whether it happens in time."""
        if request:
            self.person.request(request)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if happened():
                return True
            time.sleep(ACTION_POLL_PERIOD)
        return False

    def command(self, *words: str) -> Outcome:
        """Run a command of this program, and show its progress."""
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
                            self.person.tell(event["text"])
                    else:
                        last = line.rstrip() or last
            except BaseException:
                process.terminate()
                process.wait()
                raise
        return Outcome(process.returncode, last, events)

    def parameters(self, side: str) -> tuple[Any, dict[str, Any]]:
        """Return the parameters of a side's device, and those of its options by name."""
        arguments = GraphArguments.from_specified(params_file=str(self.path), record=False)
        return Setup.of(arguments).node(f"{side}_device")

    def device_name(self, side: str) -> str:
        """Return the driver of a side's device."""
        return str(self.parameters(side)[0].device)

    def is_on_card(self, side: str) -> bool:
        """Return whether a side's accelerometer is on a sound card."""
        return bool(self.parameters(side)[0].accelerometer_device == AUDIO)

    def is_simulated(self, side: str) -> bool:
        """Return whether a side's device is simulated."""
        without = (SIMULATED, POINTER, VIRTUAL)
        return not self.is_on_card(side) and self.device_name(side) in without

    def has_actuator(self) -> bool:
        """Return whether the handle has a real actuator."""
        own, _ = self.parameters(MASTER)
        return own.actuator_device == AUDIO or own.device not in (SIMULATED, POINTER, *ARMS_ALONE)

    @contextmanager
    def observed(self, side: str) -> Iterator[ObservedDevice]:
        """Open a side's device while the context is entered; close it without force."""
        own, options = self.parameters(side)
        device = build_device(f"{side}_device", own, options)
        with ObservedDevice(device, options[SAFETY], own.rate, own.latency, hurry) as observed:
            time.sleep(RESPONSE_SETTLING)
            try:
                yield observed
            finally:
                self.person.show(None)
