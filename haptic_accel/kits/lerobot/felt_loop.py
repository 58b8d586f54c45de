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

"""Process of the fast path: accelerometers, compensation, safety layer and coil; no ROS.

It is started with the ring's file, the process whose end ends it, and words ``key:=value``. Its
standard output has one JSON object a line: remarks once it runs, or the error that ended it. Its
standard input has letters, `FEEL` and `MUTE`; its end ends the process.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack

from haptic_accel.core.actuator.safety import SafetyLayer
from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.coupling.engagement import Engagement, EngagementParameters
from haptic_accel.core.loop.compensation import CompensationPart
from haptic_accel.core.loop.coupling import CouplingPart
from haptic_accel.core.loop.device_side import ACTUATOR, ARM, DeviceSide
from haptic_accel.core.loop.wiring import MASTER, SLAVE, HostLoop
from haptic_accel.core.parameters import ParameterError, one_line
from haptic_accel.core.process import DONE, ENDING, FAILED
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import Device, DeviceError
from haptic_accel.kits.lerobot.exchange import FEEL, Ring
from haptic_accel.nodes.priority import ask_for_realtime, scheduling_class, sharpen_timers
from haptic_accel.nodes.timing import CATCH_UP, ArrivalKeeper, RateKeeper, wake_time
from haptic_accel.setup.arguments import GraphArguments, parse_arguments
from haptic_accel.setup.node_parameters import SAFETY, build_device
from haptic_accel.setup.setup import Setup

REST = 20e-6
"""Shortest sleep between two looks at the clock, s. A real-time process that never sleeps is ended
by the kernel, and starves the others before."""

FIRST_SAMPLE = 2.0
"""Longest time from opening to the first sample of the gripper, s: a card has filled its buffers
by then many times over."""


class FeltLoop:
    """Loop of one leader and one follower on the machine's sampling grid.

    It is the loop of a graph in one process, without its messages. Arms that LeRobot moves have no
    position here; those of the virtual rig are coupled.

    Parameters
    ----------
    arguments : GraphArguments
    ring : Ring
        Where the gripper's samples go.

    Raises
    ------
    ParameterError, DeviceError
        A value is not allowed, or a library is missing.
    """

    def __init__(self, arguments: GraphArguments, ring: Ring) -> None:
        setup = Setup.of(arguments)
        self._rate, latency, self._frame = arguments.rate, arguments.latency, arguments.frame
        self._ring = ring
        longest = round(CATCH_UP * self._rate)
        around, options = setup.node("compensator")
        self._compensation = Compensation(around, self._rate, options, latency=latency)
        self._devices = {arm: _device(setup, arm) for arm in ARMS}
        self._sides = {arm: _side(setup, arm, device) for arm, device in self._devices.items()}
        engagement = Engagement(EngagementParameters(), time.monotonic())
        for arm in ARMS:
            engagement.arm_stopped(arm, False)
        coupled = setup.rig().coupled(self._rate, latency)
        self._loop = HostLoop(
            self._sides,
            CouplingPart(coupled, engagement, self._rate, longest),
            CompensationPart(self._compensation, self._rate, latency, longest),
        )

    def open(self) -> list[str]:
        """Open the devices, with a silent coil; return their remarks."""
        for device in self._devices.values():
            device.open()
        self._sides[SLAVE].safety.enable(time.monotonic(), True)
        self.feel(False)
        return [device.remark for device in self._devices.values() if device.remark]

    def close(self) -> None:
        """Silence the coil at once, and close all devices."""
        with ExitStack() as closing:
            for device in self._devices.values():
                closing.callback(device.close)

    def feel(self, felt: bool) -> None:
        """Let the coil move, or silence it."""
        master = self._sides[MASTER]
        master.safety.enable(time.monotonic(), felt)
        self._compensation.mute(not felt)
        if not felt:
            master.take_off()

    def begin(self) -> None:
        """Start at the next tick."""
        self._keeper = RateKeeper(self._rate, lead=wake_time(), frame=self._frame)
        self._arrivals = {arm: ArrivalKeeper(self._rate / self._frame) for arm in self._sides}

    def work(self) -> float:
        """Do the work that is due; return the steady time of the next, s."""
        tick = self._keeper.due()
        if tick is not None:
            for each in range(tick - self._frame + 1, tick + 1):
                self._loop.step(each)
                self._pass_on()
            self._ring.count(self._keeper.ticks, self._keeper.late)
        elif not self._loop.complete:
            self._loop.go_on()
            self._pass_on()
        wake = self._keeper.next
        for arm, side in self._sides.items():
            if not side.complete or tick is None:
                look = self._arrivals[arm].polled(found=side.complete)
                wake = wake if side.complete else min(wake, look)
        return wake

    def _pass_on(self) -> None:
        for arm, taken in self._loop.results.samples:
            if arm == SLAVE:
                self._ring.put(taken.tick, taken.sample.acceleration)


def _device(setup: Setup[GraphArguments], arm: str) -> Device:
    own, options = setup.node(f"{arm}_device")
    return build_device(f"{arm}_device", own, options)


def _side(setup: Setup[GraphArguments], arm: str, device: Device) -> DeviceSide:
    """Return an arm's device behind its safety layer."""
    own, options = setup.node(f"{arm}_device")
    return DeviceSide(
        device,
        SafetyLayer(options[SAFETY], own.rate, device.axes),
        own.rate,
        own.latency,
        time.monotonic,
        kinds=(ARM, ACTUATOR) if arm == MASTER else (ARM,),
        ahead=(ACTUATOR,) if device.description.ahead else (),
        framed=own.frame > 1,
    )


def run(loop: FeltLoop, ring: Ring, parent: int) -> None:
    """Run an open loop until the parent, its pipe or a signal ends it.

    Raises
    ------
    DeviceError, OSError
        A device failed, or there is no first sample.
    """
    ends: list[int] = []
    for number in ENDING:
        signal.signal(number, lambda number, _: ends.append(number))
    os.set_blocking(sys.stdin.fileno(), False)
    remarks = loop.open()
    # A collection would find no garbage, and delay a tick by milliseconds.
    gc.collect()
    gc.freeze()
    gc.disable()
    sharpen_timers()
    ask_for_realtime()
    loop.begin()
    told, latest = False, time.monotonic() + FIRST_SAMPLE
    # A copy of the pipe may live on in a process that the parent has forked.
    while not ends and os.getppid() == parent:
        wake = loop.work()
        if not told and ring.written:
            told = True
            _tell(remarks=[*remarks, scheduling_class()])
        if not told and time.monotonic() > latest:
            raise DeviceError(f"no sample of the gripper's accelerometer in {FIRST_SAMPLE:g} s")
        if (letter := _letter()) == b"":
            return
        if letter:
            loop.feel(letter == FEEL)
        time.sleep(max(REST, wake - time.monotonic()))


def _letter() -> bytes | None:
    """Return a letter of the parent; None if none has come, an empty one at the pipe's end."""
    try:
        return os.read(sys.stdin.fileno(), 1)
    except BlockingIOError:
        return None


def _tell(**values: object) -> None:
    print(json.dumps(values), flush=True)


def main(words: Sequence[str]) -> int:
    """Run the process; return its exit status."""
    descriptor, parent, *given = words
    try:
        with ExitStack() as opened:
            ring = Ring(int(descriptor))
            loop = FeltLoop(parse_arguments(given), ring)
            opened.callback(loop.close)
            run(loop, ring, int(parent))
    except (ParameterError, DeviceError, OSError) as error:
        _tell(error=one_line(error))
        return FAILED
    return DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
