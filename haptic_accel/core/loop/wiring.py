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

"""Wiring of the loop on one host: connections between the parts, and their order in a tick."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

from haptic_accel.core import topics
from haptic_accel.core.coupling.engagement import Decision, Engagement
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.loop.compensation import CompensatedSample, CompensationPart
from haptic_accel.core.loop.device_side import ACTUATOR, ARM, DeviceSide, TickSample
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ARMS

MASTER, SLAVE = ARMS

_MOTIONS = {
    arm: {each.position.name, each.velocity.name, each.work.name}
    for arm, each in zip(ARMS, (topics.MASTER, topics.SLAVE), strict=True)
}
_HANDLE, _TOOL = topics.HANDLE_ACCELERATION.name, topics.TOOL_ACCELERATION.name


class ArmCommand(NamedTuple):
    """Force on an arm, N, and the stamp of the sample that caused it, ns."""

    arm: str
    stamp: int
    force: Vector


class Tool(NamedTuple):
    """Sample of the tool's acceleration, m/s^2, and its stamp, ns."""

    stamp: int
    acceleration: Vector


class Coupling(Protocol):
    """Interface of `CouplingPart` and `HalfCouplingPart`, which couple the arms of one host."""

    count_force: Vector
    """Part of the newest force on the master that the encoders' rounding causes, N."""

    @property
    def engagement(self) -> Engagement:
        """Engagement of this host's arms."""

    def begin(self, now: float, stamp: int) -> None:
        """Begin a tick with a time in s and a stamp in ns."""

    def put(self, arm: str, motion: Motion, now: float) -> None:
        """Add a sample of an arm at a time in s."""

    def put_tool(self, tool: Tool) -> None:
        """Add a sample of this host's tool."""

    def tools(self) -> Iterable[Tool]:
        """Return the next samples of the tool for the compensation."""

    def poll(self, now: float, listeners: int) -> Decision:
        """Engage or release the arms if due; arguments as for `Engagement.missing`."""

    def commands(self) -> Iterable[ArmCommand]:
        """Return the forces caused by the samples."""


class Results(NamedTuple):
    """Results of a step of the loop.

    Attributes
    ----------
    samples : list of (str, TickSample)
        Samples read in the step, by arm.
    tools : list of Tool
        Samples of the tool passed to the compensation.
    commands : list of ArmCommand
        Forces on arms caused by these samples.
    compensated : list of CompensatedSample
        Actuator forces caused by these samples.
    """

    samples: list[tuple[str, TickSample]]
    tools: list[Tool]
    commands: list[ArmCommand]
    compensated: list[CompensatedSample]


class HostLoop:
    """Parts of one host, and their order in a tick.

    A tick samples the devices, applies the forces that are due, and computes the forces of later
    ticks, or of the same tick without latency. A clock provides the ticks live, a counter in
    lockstep; the code is the same.

    Parameters
    ----------
    sides : mapping of str to DeviceSide
        Devices by arm, in sampling order; all with the same rate and latency.
    coupling : Coupling, optional
        None if forces come from elsewhere.
    compensation : CompensationPart, optional
        None without a handle.
    decide : callable, optional
        Called with the time in s when due, to call `Coupling.poll`. The default assumes that all
        subscribers exist, as in lockstep.
    failures : tuple of type
        Errors of a device that affect its arm only.
    failed : callable
        Called with an arm and such an error, to stop the arm's sampling.

    Attributes
    ----------
    results : Results
        Results of the last step.
    muted : set of str
        Topics of signals that are not passed on, as they have other publishers too.
    contested : int
        Number of samples that were not passed on.
    """

    def __init__(
        self,
        sides: Mapping[str, DeviceSide],
        coupling: Coupling | None = None,
        compensation: CompensationPart | None = None,
        *,
        decide: Callable[[float], None] | None = None,
        failures: tuple[type[Exception], ...] = (),
        failed: Callable[[str, Exception], None] = lambda arm, error: None,
    ) -> None:
        self.sides, self.coupling, self.compensation = dict(sides), coupling, compensation
        self._decide = decide or self._look
        self._failures, self._failed = failures, failed
        one = next(iter(self.sides.values()))
        self._clock, self._rate = one.clock, one.rate
        self._at_once = one.latency == 0
        self.muted: set[str] = set()
        self.contested = 0
        self._forget()

    @property
    def complete(self) -> bool:
        """True if no sample or force of a device is outstanding."""
        return all([side.complete for side in self.sides.values() if side.sampling])

    def stamp(self, tick: int) -> int:
        """Return the stamp of a tick's samples, ns."""
        return round(tick * NANOSECONDS / self._rate)

    def step(self, tick: int) -> None:
        """Process a tick."""
        self._forget()
        if self.coupling:
            self.coupling.begin(tick / self._rate, self.stamp(tick))
        self._at_each(lambda arm, side: self._begin(arm, side, tick))
        self._cause()
        self._at_each(self._end)

    def go_on(self) -> None:
        """Process samples and forces that arrived after their tick."""
        self._forget()
        self._at_each(self._read)
        self._cause()
        self._at_each(lambda arm, side: side.apply_late())

    def _at_each(self, act: Callable[[str, DeviceSide], None]) -> None:
        """Call a function for each open device; an error affects its arm only."""
        for arm, side in self.sides.items():
            if side.sampling:
                try:
                    act(arm, side)
                except self._failures as error:
                    self._failed(arm, error)

    def _begin(self, arm: str, side: DeviceSide, tick: int) -> None:
        side.begin(tick)
        self._read(arm, side)
        if not self._at_once:
            side.apply()

    def _end(self, arm: str, side: DeviceSide) -> None:
        if self._at_once:
            side.apply()
        side.watch()

    def _forget(self) -> None:
        self.results = Results([], [], [], [])

    def _read(self, arm: str, side: DeviceSide) -> None:
        for taken in side.read():
            self.results.samples.append((arm, taken))
        side.receive()

    def _cause(self) -> None:
        """Pass the samples to coupling and compensation, and the forces to the devices."""
        coupling, compensation, results = self.coupling, self.compensation, self.results
        if coupling is None:
            return
        now = self._clock()
        for arm, (tick, sample, work, _) in results.samples:
            stamp = self.stamp(tick)
            motion = Motion(stamp, sample.position, sample.velocity, sum(work))
            if self._passes(*_MOTIONS[arm]):
                coupling.put(arm, motion, now)
            if arm == SLAVE:
                if self._passes(_TOOL):
                    coupling.put_tool(Tool(stamp, sample.acceleration))
            elif compensation:
                compensation.orientation = sample.orientation
                handle = sample.acceleration if self._passes(_HANDLE) else None
                compensation.put_handle(stamp, handle)
        if coupling.engagement.due(now):
            self._decide(now)
        for command in coupling.commands():
            results.commands.append(command)
            self._command(command.arm, ARM, command.stamp, command.force)
        if compensation:
            compensation.put_count_force(coupling.count_force)
            for tool in coupling.tools():
                results.tools.append(tool)
                if self._passes(_TOOL):
                    compensation.put_tool(*tool)
            for caused in compensation.forces(round(now * NANOSECONDS)):
                results.compensated.append(caused)
                self._command(MASTER, ACTUATOR, caused.stamp, caused.actuator_force)

    def _passes(self, *names: str) -> bool:
        """Return whether to pass on a sample of signals; count rejected samples."""
        if not self.muted or self.muted.isdisjoint(names):
            return True
        self.contested += 1
        return False

    def _command(self, arm: str, kind: str, stamp: int, force: Vector) -> None:
        side = self.sides[arm]
        if side.sampling:
            try:
                side.command(kind, stamp, force)
            except self._failures as error:  # the device accepts forces in advance
                self._failed(arm, error)

    def _look(self, now: float) -> None:
        assert self.coupling
        if self.coupling.poll(now, listeners=1).release:
            self.results.commands.extend(release(self.sides, now))


def release(sides: Mapping[str, DeviceSide], now: float) -> list[ArmCommand]:
    """Apply a zero force to each arm, as if computed from the sample of a time, s."""
    commands = [ArmCommand(arm, round(now * NANOSECONDS), ZERO) for arm in sides]
    for arm, stamp, force in commands:
        if sides[arm].sampling:
            sides[arm].command(ARM, stamp, force)
    return commands
