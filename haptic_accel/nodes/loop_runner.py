# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loop of one host, paced by the machine's clock, whose results the nodes publish."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from haptic_accel.core.tick import HostLoop
from haptic_accel.core.topics import ARMS
from haptic_accel.devices.interface import DeviceError
from haptic_accel.nodes import timing
from haptic_accel.nodes.timing import FORCES_TIME, RECEIVING_TIME, ArrivalKeeper, RateKeeper

if TYPE_CHECKING:  # a single device needs no import of a compensator
    from haptic_accel.nodes.compensator import Compensator
    from haptic_accel.nodes.coupler import CouplingNode
    from haptic_accel.nodes.device_node import DeviceNode

FAILURES = DeviceError, OSError
"""Errors that close a device, but end no node."""


def join(nodes: Sequence[Any]) -> LoopRunner:
    """Return the loop of a process's nodes: devices in sampling order, then others."""
    devices = [node for node in nodes if hasattr(node, "side")]
    coupler = next((node for node in nodes if hasattr(node, "sides")), None)
    others = (node for node in nodes if node not in devices and node is not coupler)
    return LoopRunner(devices, coupler, next(others, None))


class LoopRunner:
    """Runner that steps a `HostLoop` on the sampling grid, then lets the nodes publish.

    In one process the loop contains all nodes; in separate processes, one device.

    Parameters
    ----------
    devices : sequence of DeviceNode
        Devices in sampling order.
    coupler : CouplingNode, optional
    compensator : Compensator, optional
    """

    follows_stop = True

    def __init__(
        self,
        devices: Sequence[DeviceNode],
        coupler: CouplingNode | None = None,
        compensator: Compensator | None = None,
    ) -> None:
        self._devices = {device.arm: device for device in devices}
        self._coupler, self._compensator = coupler, compensator
        self._rate, self._frame = devices[0].side.rate, devices[0].parameters.frame
        self._loop = HostLoop(
            {arm: device.side for arm, device in self._devices.items()},
            coupler.part if coupler else None,
            compensator.part if compensator else None,
            decide=self._decide,
            failures=FAILURES,
            failed=lambda arm, error: self._devices[arm].fail(error),
        )
        if coupler:
            coupler.sides = self._loop.sides
        self._offset = 0

    def begin(self) -> None:
        """Start at the next tick; earlier ticks do not count as missed."""
        times = [FORCES_TIME + RECEIVING_TIME * each.received for each in self._devices.values()]
        lead = timing.wake_time() + sum(times)
        self._keeper = RateKeeper(self._rate, lead=lead, frame=self._frame)
        self._arrivals = {arm: ArrivalKeeper(self._rate / self._frame) for arm in self._devices}
        self._idle = False
        framed = [each.device.description.framed for each in self._devices.values()]
        self._keeper.framed = self._coupler is not None and all(framed)
        for device in self._devices.values():
            device.rate_keeper = self._keeper

    def work(self) -> float:
        """Serve a due tick; return the steady time of the next call, s."""
        if self._rests():
            self._idle = True
            return math.inf
        if self._idle:
            self.begin()
        return self._serve_due()

    def _rests(self) -> bool:
        """Return whether nothing happens at a tick."""
        sampling = [device.side.sampling for device in self._devices.values()]
        return self._coupler is None and not any(sampling)

    def _serve_due(self) -> float:
        """Serve due work; return the steady time of the next work, s."""
        tick = self._keeper.due()
        if tick is not None:
            self._serve(tick)
        elif not self._loop.complete or any([each.received for each in self._devices.values()]):
            self._loop.go_on()
            self._finish()
        wake = self._keeper.next
        for arm, arrivals in self._arrivals.items():
            side = self._loop.sides[arm]
            complete = side.complete or not side.sampling
            if not complete or tick is None:
                poll = arrivals.polled(found=complete)
                if not complete:
                    wake = min(wake, poll)
        return wake

    def _serve(self, tick: int) -> None:
        moment = self._keeper.time(tick)
        self._offset = timing.system_time(moment) - moment
        for device in self._devices.values():
            device.offset = self._offset
        if self._coupler:
            self._coupler.receive(self._offset)
        first = tick - self._frame + 1
        for each in range(first, tick + 1):
            self._loop.step(each, each == first)
        self._finish()
        self._keeper.done()

    def _finish(self) -> None:
        """Send and publish the results of the last steps, after all due forces."""
        loop = self._loop
        if self._coupler:
            self._coupler.reply()
        if self._compensator:
            self._compensator.publish(loop.compensated, self._offset)
        for sample in loop.samples:
            device = self._devices[ARMS[sample.arm]]
            try:
                device.publish(sample)
            except FAILURES as error:  # the driver may fail to return further values
                device.fail(error)
        if self._coupler:
            self._coupler.publish(loop.tools, loop.commands, self._offset)
        for device in self._devices.values():
            device.end_with_device()

    def follow_stop(self) -> None:
        """Follow the emergency stop; mute signals that other nodes publish as well."""
        for device in self._devices.values():
            device.follow_stop()
        if self._coupler:
            self._coupler.follow_stop()
        if self._compensator:
            self._compensator.follow_stop()
        followers = [each for each in (self._coupler, self._compensator) if each]
        self._loop.mute(set().union(*(each.contested for each in followers)))
        for each in followers:
            each.contested_in_loop = self._loop.contested

    def _decide(self, now: float) -> None:
        assert self._coupler
        if (node := self._compensator) and node.knows_device and node.part.samples:
            self._coupler.engagement.compensated = True
        self._coupler.step()
