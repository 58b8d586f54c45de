# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The real driver through real interfaces of python-can, with emulated drives at the other end."""

from __future__ import annotations

import itertools
import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import from_flat
from haptic_accel.devices.can.device import CanSlave, bus_configuration, message_of, open_bus
from haptic_accel.devices.can.parameters import CanParameters
from haptic_accel.devices.can.protocol import AxisState, Estimates, Heartbeat
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.simulated import SimulatedSlave, SimulatedSlaveParameters
from haptic_accel.kits.emulators.can_line import BusPort, CanLine, CanPort, EmulatedArm, SlcanPort
from haptic_accel.kits.emulators.ports import CAN_FAULTS, Faults, run
from running import on_thread, wait_until

RATE = 200.0  # Hz

WATCHDOG = 0.4
"""Time-out of the drives' watchdogs while a device opens, s: a test's machine may stall."""

PATIENT = {"heartbeat_timeout": 2.0, "estimates_timeout": 1.0, "start_timeout": 10.0}

CHANNELS = itertools.count()


class Plugged:
    """A device, and the arm at the other end in a thread of its own."""

    def __init__(self, port: CanPort, values: dict[str, Any], faults: str, seconds: float) -> None:
        self.values = {**PATIENT, **values}
        self.parameters = from_flat(CanSlave.Parameters, self.values)
        slave = SimulatedSlave(SimulatedSlaveParameters(), RATE, 0)
        self.arm = EmulatedArm(self.parameters, slave, rate=RATE, watchdog=WATCHDOG)
        self.line = CanLine(port, [self.arm], RATE, Faults(faults, CAN_FAULTS, seconds))
        self.device = CanSlave(self.parameters, RATE, 0)
        self._stack = ExitStack()
        self._stack.callback(self.line.close)
        self._stack.enter_context(on_thread(partial(run, [self.line])))
        self._stack.callback(self.device.close)

    def push(self) -> None:
        """Do what a device node does at a tick."""
        self.device.read(time.monotonic())
        self.device.write(time.monotonic(), arm_force=(0.2, 0.0, 0.1))

    def pushed_until(self, condition: Callable[[], bool], what: str) -> None:
        """Push over and over until something is so."""

        def pushed() -> bool:
            self.push()
            return condition()

        wait_until(pushed, what)

    def open(self) -> None:
        """Open the device, which tests the watchdogs; from then on they bear a stall."""
        self.device.open()
        for axis in self.arm.axes:
            axis.watchdog = 2.0

    @property
    def exerted(self) -> bool:
        """Return True where any motor has a torque."""
        return any(axis.torque for axis in self.arm.axes)

    def close(self) -> None:
        self._stack.close()


Plug = Callable[..., Plugged]


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    """Give a test devices, opened unless told otherwise, and close them."""
    made: list[Plugged] = []

    def plugged(
        interface: str = "slcan",
        *,
        faults: str = "",
        seconds: float = 1.0,
        opened: bool = True,
        **values: Any,
    ) -> Plugged:
        values["interface"] = interface
        if interface == "slcan":
            path = tmp_path / f"adapter{len(made)}"
            values |= {"channel": str(path), "options": '{"sleep_after_open": 0}'}
            port: CanPort = SlcanPort(path)
        else:
            values["channel"] = f"test{next(CHANNELS)}"
            configuration = bus_configuration(from_flat(CanParameters, values))
            port = BusPort(lambda: open_bus(configuration, []))
        made.append(Plugged(port, values, faults, seconds))
        if opened:
            made[-1].open()
        return made[-1]

    yield plugged
    for each in made:
        each.close()


@pytest.mark.parametrize("interface", ["virtual", "slcan"])
@pytest.mark.parametrize("estimates", ["streamed", "requested"])
def test_a_force_moves_the_tip_and_closing_takes_it_off(
    plug: Plug, interface: str, estimates: str
) -> None:
    plugged = plug(interface, estimates=estimates)
    device = plugged.device
    assert device.counters()["armed"]
    assert device.problem == ""
    assert "bus load up to" in device.remark
    start = device.read(0.0)
    # In the middle of the workspace, and the rig's tip 10 mm above its surface.
    assert start.position == pytest.approx((0.135, 0.0, -0.125), abs=1e-3)
    assert start.acceleration == ZERO
    beyond = start.position[0] + 0.005
    plugged.pushed_until(lambda: device.read(0.0).position[0] > beyond, "pushed away")
    assert device.read(0.0).velocity[0] > 0
    device.close()
    wait_until(lambda: not any(axis.armed for axis in plugged.arm.axes), "idle")
    assert not plugged.exerted
    status = device.counters()
    assert status["connected"] == status["armed"] == 0
    assert status["frames_received"] > 0
    assert status["bus_losses"] == status["frames_garbled"] == 0


@contextmanager
def another_drive(plugged: Plugged) -> Iterator[None]:
    """Let a drive half a turn away report with the id of the arm's first, as from the factory."""
    bus = open_bus(bus_configuration(plugged.parameters), [])
    over = threading.Event()

    def report() -> None:
        while not over.wait(1 / RATE):
            for frame in (Estimates(0, 0.5, 0.0), Heartbeat(0, 0, AxisState.CLOSED_LOOP_CONTROL)):
                bus.send(message_of(frame.frame()))

    thread = threading.Thread(target=report)
    thread.start()
    yield
    over.set()
    thread.join()
    bus.shutdown()


TWO_DRIVES = r"joint1 \(node 0\): jumped by .* turns .*: do two drives have this node id\?"


def test_a_second_drive_with_the_id_of_an_axis_ends_all_torques(plug: Plug) -> None:
    plugged = plug("virtual")
    device = plugged.device
    with another_drive(plugged):
        plugged.pushed_until(lambda: not device.counters()["armed"], "let go")
        assert re.fullmatch(TWO_DRIVES, device.problem)
        assert device.counters()["position_jumps"] > 0
        assert device.read(0.0) is None
        plugged.pushed_until(lambda: not plugged.exerted, "no torque")
        assert device.arm() is None
        plugged.pushed_until(lambda: device.counters()["disarmed"] > 1, "refused again")
        assert device.read(0.0) is None
    wait_until(lambda: device.read(0.0) is not None, "one drive is left")


def test_an_arm_with_a_second_drive_of_an_id_cannot_be_opened(plug: Plug) -> None:
    plugged = plug("virtual", opened=False)
    with another_drive(plugged), pytest.raises(DeviceError, match=TWO_DRIVES):
        plugged.open()
    assert not plugged.exerted


def test_an_axis_error_takes_all_torques_off_until_it_is_armed_again(plug: Plug) -> None:
    plugged = plug("virtual", rearm="auto", faults="error@0.2")
    device = plugged.device
    plugged.pushed_until(lambda: not device.counters()["armed"], "let go")
    assert device.problem == "joint1 (node 0): DRV_FAULT"
    plugged.pushed_until(lambda: not any(axis.armed for axis in plugged.arm.axes), "all idle")
    assert not plugged.exerted
    assert device.counters()["disarmed"] == 1
    assert device.arm() is None
    plugged.pushed_until(lambda: plugged.exerted, "torques again")
    assert device.problem == ""


@pytest.mark.parametrize("fault", ["heartbeat@0.1", "estimates@0.1", "bus_off@0.1"])
def test_what_is_not_heard_takes_all_torques_off(plug: Plug, fault: str) -> None:
    patience = {"heartbeat_timeout": 0.5, "estimates_timeout": 0.5}
    plugged = plug("virtual", faults=fault, seconds=1e6, **patience)
    plugged.pushed_until(lambda: not plugged.device.counters()["armed"], "let go")
    assert "joint1 (node 0): no " in plugged.device.problem
    wait_until(lambda: not plugged.exerted, "no torque, by command or by the drives' watchdogs")


@pytest.mark.parametrize("rearm", ["manual", "auto"])
def test_an_adapter_may_be_unplugged_and_plugged_in_again(plug: Plug, rearm: str) -> None:
    plugged = plug("slcan", rearm=rearm, faults="unplug@0.1", seconds=0.5)
    device = plugged.device
    plugged.pushed_until(lambda: not device.counters()["armed"], "gone")
    assert device.problem == "the bus has gone"
    wait_until(lambda: device.read(0.0) is None, "no sample")
    plugged.pushed_until(lambda: bool(device.counters()["connected"]), "back")
    assert device.counters()["bus_losses"] == 1
    if rearm == "manual":
        more = device.counters()["frames_received"] + 100
        plugged.pushed_until(lambda: device.counters()["frames_received"] > more, "well heard")
        assert not device.counters()["armed"]
        assert not plugged.exerted
        assert device.arm() is None
    plugged.pushed_until(lambda: plugged.exerted, "torques again")


def test_garbage_and_lost_frames_are_counted_and_borne(plug: Plug) -> None:
    plugged = plug("slcan", faults="garbage,drop")
    device = plugged.device
    plugged.pushed_until(lambda: device.counters()["frames_garbled"] > 3, "garbage")
    plugged.pushed_until(lambda: plugged.exerted, "torques")
    assert device.counters()["bus_losses"] == 0


def test_a_bus_without_the_drives_is_said(plug: Plug) -> None:
    plugged = plug("virtual", faults="bus_off", opened=False, start_timeout=0.2)
    with pytest.raises(DeviceError, match="no heartbeat of joint1 .node 0., joint2 .* powered"):
        plugged.device.open()
    assert plugged.device.counters()["connected"] == 0


@pytest.mark.parametrize("estimates", ["streamed", "requested"])
def test_a_drive_without_a_watchdog_is_refused(plug: Plug, estimates: str) -> None:
    plugged = plug("virtual", opened=False, estimates=estimates)
    plugged.arm.axes[1].watchdog = 0.0
    with pytest.raises(DeviceError) as refused:
        plugged.device.open()
    channel = plugged.parameters.channel
    assert str(refused.value) == (
        f"can: virtual {channel}: joint2 (node 1): goes on without commands: set"
        " axis0.config.enable_watchdog = True and axis0.config.watchdog_timeout = 0.02, then"
        " save_configuration()"
    )
    wait_until(lambda: not any(axis.armed for axis in plugged.arm.axes), "idle")
    plugged.arm.axes[1].watchdog = 0.1
    plugged.open()
    assert "without commands no torque in 0." in plugged.device.remark
    plugged.pushed_until(lambda: plugged.exerted, "torques")


DRIVER = """
import json, sys, time
from haptic_accel.core.parameters import from_flat
from haptic_accel.devices.can.device import CanSlave
device = CanSlave(from_flat(CanSlave.Parameters, json.loads(sys.argv[1])), 200.0, 0)
device.open()
while True:
    device.read(time.monotonic())
    device.write(time.monotonic(), arm_force=(0.2, 0.0, 0.1))
    time.sleep(0.005)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_killed_or_frozen_driver_leaves_no_torque(plug: Plug, number: signal.Signals) -> None:
    plugged = plug("slcan", opened=False)
    for axis in plugged.arm.axes:
        axis.watchdog = 0.5
    with subprocess.Popen([sys.executable, "-c", DRIVER, json.dumps(plugged.values)]) as driver:
        wait_until(lambda: plugged.exerted, "torques")
        driver.send_signal(number)
        wait_until(lambda: not plugged.exerted, "no torque")
        assert not any(axis.armed for axis in plugged.arm.axes)
        driver.kill()


def test_a_force_that_nobody_repeats_is_taken_off_by_the_drives(plug: Plug) -> None:
    plugged = plug("virtual", estimates="requested")
    plugged.pushed_until(lambda: plugged.exerted, "torques")
    for axis in plugged.arm.axes:
        axis.watchdog = 0.1
    # The thread that moves the arm hangs here, while the bus is read.
    wait_until(lambda: not plugged.exerted, "no torque")


def test_a_device_can_be_opened_again(plug: Plug) -> None:
    plugged = plug("virtual")
    plugged.device.close()
    plugged.device.close()
    for axis in plugged.arm.axes:
        axis.watchdog = 0.1
    plugged.open()
    plugged.pushed_until(lambda: plugged.exerted, "torques again")
