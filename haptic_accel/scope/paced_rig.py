# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Virtual rig in real time, whose hand a page leads, without ROS."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from haptic_accel.core.axes import ACTUATOR_AXIS, NAMES
from haptic_accel.core.control.controllers import granted_delay
from haptic_accel.core.model import ACTUATOR, ZERO, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.simulated_rig import build_loop, build_parts
from haptic_accel.core.tick import MASTER, SLAVE
from haptic_accel.devices.simulated import PointerMaster, SimulatedSlave, SimulatedSlaveParameters
from haptic_accel.scope.server import CommandError, check_choice
from haptic_accel.scope.state import NodeReport, NodeReports, choices, drawing, state_of
from haptic_accel.scope.windows import GraphSettings, Windows
from haptic_accel.setup.arguments import POINTER, SIMULATED, GraphArguments
from haptic_accel.setup.files import POSTURE, SURFACE
from haptic_accel.setup.setup import Parameters, Setup

PAUSE = 4e-3
"""Pause between two groups of ticks, s: a quarter of a display frame, so that waking costs
little."""

LONGEST_BEHIND = 0.1
"""Longest gap whose missed ticks are computed afterwards, s; longer gaps are skipped, so that a
slow or suspended machine shows the present."""

REPORT_PERIOD = 1.0
"""Interval between two reports of the parts, s, as nodes send them."""

STROKE, STROKE_RATE, STROKE_HEIGHT = 0.05, 0.4, -0.004
"""Amplitude, m, rate, Hz, and height, m, of the hand's strokes until a page leads the hand. The
strokes are below the surface, so that the tool presses on it."""


class _Request(NamedTuple):
    """Action to be executed between two ticks, and the receiver of its result or refusal."""

    action: str
    value: str
    answer: Future[str]


class PacedRig:
    """Both sides of the virtual rig with coupling and compensation, in real time.

    The lockstep loop runs here in groups of ticks that follow the clock. The simulation waits for
    the loop, so that no force is late. Signals go to `windows`; the server's thread requests the
    rest.

    Parameters
    ----------
    surface : str
        Surface under the tool: a name, or a path ending in ``.yaml``.
    rig : str
        Name or file of the rig's parameters.

    Attributes
    ----------
    windows : Windows
        Signals that a page shows.

    Raises
    ------
    ParameterError
        The surface or the rig is unknown, or its file is wrong.
    """

    def __init__(self, surface: str, rig: str) -> None:
        self._arguments = GraphArguments.from_specified(surface=surface, rig=rig, master=POINTER)
        self.windows = Windows()
        self._choices = choices()
        self._requests: SimpleQueue[_Request] = SimpleQueue()
        self._point: tuple[float, float] | None = None
        self._is_led = False
        self._reports = NodeReports()
        self._reported = -math.inf
        self._left_out = 0
        self._build()

    def _build(self) -> None:
        arguments = self._arguments
        self._rate, latency = arguments.rate, arguments.latency
        setup = Setup.of(arguments)
        rig = setup.rig()
        compensation, self._controllers = setup.node("compensator")
        self._master_parameters = rig.master
        self._values = {
            "compensator": dict(setup.values["compensator"]),
            "master_device": {"device": POINTER, POSTURE: rig.master.grip.posture},
            "slave_device": {"device": SIMULATED, f"{SURFACE}name": arguments.surface},
        }
        self._master = PointerMaster(rig.master, self._rate, arguments.seed)
        self._slave = SimulatedSlave(_slave(setup), self._rate, arguments.seed)
        devices = {MASTER: self._master, SLAVE: self._slave}
        for device in devices.values():
            device.open()
        own = compensation, self._controllers
        sides, part = build_parts(rig, devices, *own, self._rate, latency, time.monotonic)
        sides[SLAVE].wants_contact = True
        self._loop, self._compensation = build_loop(rig, sides, part), part.slow
        self.windows.show_axes(self._master.axes)
        axes = self.windows.by_axis.items()
        self._axes = [(NAMES.index(axis), windows) for axis, windows in axes]
        settings = GraphSettings(
            *(compensation.high_pass_frequency, self._controllers[ACTUATOR], latency),
            self._granted(compensation.controller),
            noise=rig.master.accelerometer.noise,
            assumed=False,
        )
        for _, windows in self._axes:
            windows.settings = settings
        self._rig = rig
        self._show_plant()
        self._tick = 0

    def _show_plant(self) -> None:
        """Set the plant of a window with one axis to the handle in its present grip."""
        (_, windows), *others = self._axes
        if others:
            return
        handle = held(self._rig.master.handle, self._master_parameters.grip, self._arguments.seed)
        windows.settings = replace(windows.settings, plant=self._rig.plant(handle))

    # What a page shows

    def choices(self) -> dict[str, list[str]]:
        """Return the choices of the page."""
        return self._choices

    def scene(self) -> dict[str, Any]:
        """Return the scene's drawing."""
        return drawing(self._values["slave_device"])

    def state(self) -> dict[str, Any]:
        """Return the state for a page; called on the server's thread."""
        return state_of(self._reports, (), self._values, self.windows.settings, led=True, stop={})

    def lead(self, x: float, z: float) -> str:
        """Lead the hand to a point, m; called on the server's thread."""
        self._point = x, z
        self._is_led = True
        return ""

    async def act(self, action: str, value: Any) -> str:
        """Execute a command of a page between two ticks; return one line.

        Raises
        ------
        CommandError
            The action or its value is not one of the choices, or is refused.
        """
        check_choice("action", action, self._choices)
        check_choice(action, value, self._choices[action])
        request = _Request(action, value, Future())
        self._requests.put(request)
        try:
            return await asyncio.wrap_future(request.answer)
        except ParameterError as error:
            raise CommandError(str(error)) from None

    # The loop

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run in real time until `stopped` returns true."""
        start = time.monotonic()
        origin = time.time_ns()
        while not stopped():
            self._carry_out()
            now = time.monotonic()
            due = math.floor((now - start) * self._rate)
            left_out = due - self._tick - round(LONGEST_BEHIND * self._rate)
            if left_out > 0:
                self._left_out += left_out
                start += left_out / self._rate
                origin += (missing := round(left_out * NANOSECONDS / self._rate))
                for _, windows in self._axes:
                    windows.leave_out(missing)
                due -= left_out
            self._follow_hand()
            for _ in range(due - self._tick):
                self._step(origin)
            self._report(now)
            time.sleep(PAUSE)

    def _follow_hand(self) -> None:
        """Lead the hand to the latest point of a page or, before any, along the strokes."""
        if not self._is_led:
            phase = 2 * math.pi * STROKE_RATE * self._tick / self._rate
            self._master.point((STROKE * math.sin(phase), 0.0, STROKE_HEIGHT))
            return
        point, self._point = self._point, None
        if point:
            self._master.point((point[0], 0.0, point[1]))

    def _step(self, origin: int) -> None:
        """Process a tick, and store its signals with stamps after an origin, ns."""
        loop, windows = self._loop, self.windows
        loop.step(self._tick)
        self._tick += 1
        for sample in loop.samples:
            stamp = origin + sample.stamp
            if not sample.arm:
                for index, each in self._axes:
                    each.handle.put(stamp, sample.acceleration[index])
                windows.vectors["handle"] = sample.position
            else:
                windows.position.put(stamp, sample.position[ACTUATOR_AXIS])
                windows.vectors["tool"] = sample.position
                windows.vectors["tool_velocity"] = sample.velocity
                windows.vectors["contact_force"] = sample.contact or ZERO
        for command in loop.commands:
            windows.arm_force.put(origin + command.s_stamp, command.s_z)
        for sent in loop.compensated:
            for index, each in self._axes:
                each.desired.put(origin + sent.stamp, sent.desired_acceleration[index])
                each.force.put(origin + sent.stamp, sent.actuator_force[index])

    def _carry_out(self) -> None:
        """Execute the actions that pages have requested."""
        while True:
            try:
                action, value, answer = self._requests.get_nowait()
            except Empty:
                return
            try:
                getattr(self, f"_set_{action}")(value)
            except ParameterError as error:
                answer.set_exception(error)
            else:
                for _, windows in self._axes:
                    windows.restart_comparison()
                answer.set_result(f"{action}: {value}")

    def _set_controller(self, name: str) -> None:
        self._compensation.select(name)
        self._values["compensator"]["controller"] = name
        for _, windows in self._axes:
            windows.settings = replace(windows.settings, granted_delay=self._granted(name))

    def _granted(self, controller: str) -> int:
        """Return a controller's granted delay, in samples."""
        return granted_delay(controller, self._controllers, self._rate)

    def _set_surface(self, name: str) -> None:
        self._slave.change(_slave(Setup.of(replace(self._arguments, surface=name))))
        self._values["slave_device"][f"{SURFACE}name"] = name

    def _set_grip(self, posture: str) -> None:
        parameters = self._master_parameters
        grip = replace(parameters.grip, posture=posture)
        self._master_parameters = replace(parameters, grip=grip)
        self._master.change(self._master_parameters)
        self._show_plant()
        self._values["master_device"][POSTURE] = posture

    def _report(self, now: float) -> None:
        """Report diagnostics as the nodes of a graph do."""
        if now < self._reported + REPORT_PERIOD:
            return
        self._reported = now
        if (name := self._compensation.controller) != self._values["compensator"]["controller"]:
            self._set_controller(name)  # the controller has failed
        engaged = self._loop.coupling is not None and self._loop.coupling.engagement.engaged
        coupler = {"engaged": str(bool(engaged)).lower()}
        warning, values = self._compensation.diagnostics()
        left_out, self._left_out = self._left_out / self._rate, 0
        slow = f"{left_out:.2f} s left out: this machine is too slow now" if left_out else ""
        for part, warned, report in (
            ("loop", slow, {}),
            ("coupler", "", coupler),
            ("compensator", warning, values),
        ):
            level = int(bool(warned))
            self._reports.receive(part, NodeReport(level, warned or "OK", report, now))


def _slave(setup: Parameters) -> SimulatedSlaveParameters:
    """Return the simulated slave's parameters of a graph."""
    _, devices = setup.node("slave_device")
    found: SimulatedSlaveParameters = devices[SIMULATED]
    return found
