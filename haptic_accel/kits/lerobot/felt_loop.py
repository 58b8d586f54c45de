# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Process of the fast path: accelerometers, compensation, safety layer and coil; no ROS.

The process is started with the file of its `Ring`, the id of the parent with which it ends, and
arguments ``key:=value``. It prints one line with the prefix `RUNNING` once it runs, and one if an
error ends it.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack

from haptic_accel import GraphArguments, ParameterError, Setup
from haptic_accel.commands import DONE, FAILED
from haptic_accel.core import Compensation, build_loop
from haptic_accel.core import tick as ticks
from haptic_accel.core.parameters import one_line
from haptic_accel.core.process import ENDING
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import Device, DeviceError
from haptic_accel.graph import PendingStop, own_domain
from haptic_accel.kits.lerobot.fast_path import FELT, LATE, RUNNING, TICKS, WRITTEN, Ring
from haptic_accel.nodes import timing
from haptic_accel.setup import SAFETY, build_device
from haptic_accel.setup.arguments import parse_arguments

FELT_TIME, LOOKING_PERIOD = 500_000_000, 100_000_000
"""Time for which a request lets the coil move, ns: much longer than a frame of LeRobot, and short
if LeRobot hangs. Interval between checks for a pending emergency stop, ns: as for the nodes."""

REST = 20e-6
"""Minimum sleep between two readings of the clock, s. The kernel ends a real-time process that
never sleeps, which before that starves other processes."""


class FeltLoop:
    """Loop of one leader and one follower on the machine's sampling grid.

    The loop equals that of a graph in one process, without messages. Arms that LeRobot moves have
    no position in this loop; those of the virtual rig are coupled.

    Parameters
    ----------
    arguments : GraphArguments
    ring : Ring
        Receives the gripper's samples, and contains the requests to let the coil move.

    Raises
    ------
    ParameterError, DeviceError
        A value is not allowed, or a library is missing.
    """

    def __init__(self, arguments: GraphArguments, ring: Ring) -> None:
        setup = Setup.of(arguments)
        self._rate, self._frame, self._ring = arguments.rate, arguments.frame, ring
        latency, longest = arguments.latency, round(timing.CATCH_UP * self._rate)
        around, options = setup.node("compensator")
        self._compensation = Compensation(around, self._rate, options, latency=latency)
        part = ticks.CompensationPart(self._compensation, self._rate, latency, longest)
        built = {arm: _built(setup, arm) for arm in ARMS}
        self._devices = [device for device, _ in built.values()]
        self._sides = {arm: side for arm, (_, side) in built.items()}
        self._loop = build_loop(setup.rig(), self._sides, part, longest=longest)
        self._pending, self._looked, self._stopped = PendingStop(own_domain(), ""), 0, True

    def open(self) -> str:
        """Open the devices, with a silent coil; return their remarks."""
        for device in self._devices:
            device.open()
        self._sides[ticks.SLAVE].safety.enable(time.monotonic(), True)
        self._feel(False)
        return "; ".join(device.remark for device in self._devices if device.remark)

    def close(self) -> None:
        """Silence the coil at once, and close all devices."""
        with ExitStack() as closing:
            for device in self._devices:
                closing.callback(device.close)

    def begin(self) -> None:
        """Start at the next tick."""
        self._keeper = timing.RateKeeper(self._rate, lead=timing.wake_time(), frame=self._frame)
        self._arrivals = {arm: timing.ArrivalKeeper(self._rate / self._frame) for arm in ARMS}

    def work(self) -> float:
        """Do the work that is due; return the steady time of the next work, s."""
        if self._may_feel(time.monotonic_ns()) != self._felt:
            self._feel(not self._felt)
        tick = self._keeper.due()
        if tick is not None:
            for each in range(tick - self._frame + 1, tick + 1):
                self._loop.step(each)
                self._pass_on()
            self._ring.counts[[TICKS, LATE]] = self._keeper.ticks, self._keeper.late
        elif not self._loop.complete:
            self._loop.go_on()
            self._pass_on()
        wake = self._keeper.next
        for arm, side in self._sides.items():
            if not side.complete or tick is None:
                look = self._arrivals[arm].polled(found=side.complete)
                wake = wake if side.complete else min(wake, look)
        return wake

    def _may_feel(self, now: int) -> bool:
        """Return whether coil motion is requested and no emergency stop is pending."""
        if now - self._looked >= LOOKING_PERIOD:
            self._looked, self._stopped = now, self._pending.holds()
        return not self._stopped and bool(now - self._ring.counts[FELT] < FELT_TIME)

    def _feel(self, felt: bool) -> None:
        """Let the coil move, or silence it."""
        self._felt = felt
        self._sides[ticks.MASTER].safety.enable(time.monotonic(), felt)
        self._compensation.mute(not felt)
        if not felt:
            self._sides[ticks.MASTER].take_off()

    def _pass_on(self) -> None:
        for sample in self._loop.samples:
            if sample.arm == ARMS.index(ticks.SLAVE):
                self._ring.put(sample.tick, sample.acceleration)


def _built(setup: Setup[GraphArguments], arm: str) -> tuple[Device, ticks.DeviceSide]:
    """Return an arm's device, and its `DeviceSide` with the safety layer."""
    own, options = setup.node(f"{arm}_device")
    device = build_device(f"{arm}_device", own, options)
    safety = ticks.SafetyLayer(options[SAFETY], own.rate, device.axes)
    kinds = (ticks.ARM, ticks.ACTUATOR) if arm == ticks.MASTER else (ticks.ARM,)
    ahead = (ticks.ACTUATOR,) if device.description.ahead else ()
    given = {"kinds": kinds, "ahead": ahead, "framed": own.frame > 1}
    return device, ticks.DeviceSide(device, safety, own.rate, own.latency, time.monotonic, **given)


def run(loop: FeltLoop, ring: Ring, parent: int) -> None:
    """Run an open loop until a signal or the end of its parent.

    Raises
    ------
    DeviceError, OSError
        A device failed.
    """
    ends: list[int] = []
    for number in ENDING:
        signal.signal(number, lambda number, _: ends.append(number))
    remarks = loop.open()
    # A collection would find no garbage, and delay a tick by milliseconds.
    gc.collect()
    gc.freeze()
    gc.disable()
    timing.sharpen_timers()
    timing.ask_for_realtime()
    loop.begin()
    is_told = False
    # A pipe is no alternative: another child of the parent would keep its other end open.
    while not ends and os.getppid() == parent:
        wake = loop.work()
        if ring.counts[WRITTEN] and not is_told:
            told = "; ".join(filter(None, (remarks, timing.scheduling_class())))
            print(RUNNING, told, flush=True)
            is_told = True
        time.sleep(max(REST, wake - time.monotonic()))


def main(words: Sequence[str]) -> int:
    """Run the process; return its exit status."""
    descriptor, parent, *given = words
    # Libraries may print, too; redirect their lines to the terminal.
    sys.stdout = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), 1)
    with ExitStack() as opened:
        try:
            ring = Ring(int(descriptor))
            loop = FeltLoop(parse_arguments(given), ring)
            opened.callback(loop.close)
            run(loop, ring, int(parent))
        except (ParameterError, DeviceError, OSError) as error:
            print(one_line(error), flush=True)
            return FAILED
    return DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
