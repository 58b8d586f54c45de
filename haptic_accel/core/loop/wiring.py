# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Wiring of the loop on one host: which part feeds which, in the order of a tick."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

from haptic_accel.core import topics
from haptic_accel.core.coupling.engagement import Decision, Engagement
from haptic_accel.core.coupling.pairing import Motion
from haptic_accel.core.loop.compensation import Caused, CompensationPart
from haptic_accel.core.loop.device_side import ACTUATOR, ARM, DeviceSide, Taken
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ARMS, along_actuator

MASTER, SLAVE = ARMS

_MOTIONS = {
    arm: {each.position.name, each.velocity.name, each.work.name}
    for arm, each in zip(ARMS, (topics.MASTER, topics.SLAVE), strict=True)
}
_HANDLE, _TOOL = topics.HANDLE_ACCELERATION.name, topics.TOOL_ACCELERATION.name


class Pull(NamedTuple):
    """Force on an arm, N, and the stamp of the sample that caused it, ns."""

    arm: str
    stamp: int
    force: Vector


class Tool(NamedTuple):
    """Sample of the tool's acceleration, m/s^2, and its stamp, ns."""

    stamp: int
    acceleration: float


class Coupling(Protocol):
    """A part that couples the arms of one host: `CouplingPart` or `HalfCouplingPart`."""

    @property
    def engagement(self) -> Engagement:
        """Decision when the arms of this host are coupled."""

    def begin(self, now: float, stamp: int) -> None:
        """Begin a tick, whose grid point is at a time in s and has a stamp in ns."""

    def put(self, arm: str, motion: Motion, now: float) -> None:
        """Take a sample of an arm at a time in s."""

    def put_tool(self, tool: Tool) -> None:
        """Take a sample of the tool of this host."""

    def tools(self) -> Iterable[Tool]:
        """Return the samples of the tool that the compensation needs next."""

    def look(self, now: float, listeners: int) -> Decision:
        """Engage or release as things are; arguments as for `Engagement.missing`."""

    def pulls(self) -> Iterable[Pull]:
        """Return the forces that the samples cause."""


class HostLoop:
    """The parts of one host, and the order in which a tick takes them.

    Devices are sampled, forces that are due take effect, and the samples cause those of the next
    ticks: without latency, of this one. It is the same live, where a clock gives the ticks, and in
    lockstep, where a counter does.

    Parameters
    ----------
    sides : mapping of str to DeviceSide
        Devices by arm, in the order in which they are sampled; all of one rate and latency.
    coupling : Coupling, optional
        None where forces come from elsewhere.
    compensation : CompensationPart, optional
        None where there is no handle.
    decide : callable, optional
        Called with the time in s when `Coupling.look` is due, and looks; default: looks with all
        subscribers there, as in lockstep.
    failures : tuple of type
        Errors of devices that concern their arm only.
    failed : callable
        Called with an arm and such an error; to stop its sampling.

    Attributes
    ----------
    samples : list of (str, Taken)
        Samples that the last step read, by arm.
    tools : list of Tool
        Samples of the tool that the compensation got.
    pulls : list of Pull
        Forces on arms that they caused.
    felt : list of Caused
        Forces of the actuator that they caused.
    muted : set of str
        Names of the topics of signals that are not to be passed on, as others publish them, too.
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
        """True if no device still owes a sample, nor is owed a force."""
        return all([side.complete for side in self.sides.values() if side.sampling])

    def stamp(self, tick: int) -> int:
        """Return the stamp of a tick's samples, ns."""
        return round(tick * NANOSECONDS / self._rate)

    def step(self, tick: int) -> None:
        """Serve a tick."""
        self._forget()
        if self.coupling:
            self.coupling.begin(tick / self._rate, self.stamp(tick))
        self._at_each(lambda arm, side: self._begin(arm, side, tick))
        self._cause()
        self._at_each(self._end)

    def go_on(self) -> None:
        """Take samples and forces that were not there at their tick."""
        self._forget()
        self._at_each(self._read)
        self._cause()
        self._at_each(lambda arm, side: side.apply_late())

    def _at_each(self, act: Callable[[str, DeviceSide], None]) -> None:
        """Act on each device that is open; what fails concerns its arm only."""
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
        self.samples: list[tuple[str, Taken]] = []
        self.tools: list[Tool] = []
        self.pulls: list[Pull] = []
        self.felt: list[Caused] = []

    def _read(self, arm: str, side: DeviceSide) -> None:
        for taken in side.read():
            self.samples.append((arm, taken))
        side.receive()

    def _cause(self) -> None:
        """Pass the samples to coupling and compensation, and their forces to the devices."""
        coupling, compensation = self.coupling, self.compensation
        if coupling is None:
            return
        now = self._clock()
        for arm, (tick, sample, work) in self.samples:
            stamp = self.stamp(tick)
            motion = Motion(stamp, sample.position, sample.velocity, sum(work))
            if self._passes(*_MOTIONS[arm]):
                coupling.put(arm, motion, now)
            if arm == SLAVE:
                if self._passes(_TOOL):
                    coupling.put_tool(Tool(stamp, sample.acceleration))
            elif compensation:
                handle = sample.acceleration if self._passes(_HANDLE) else None
                compensation.put_handle(stamp, handle)
        if compensation:
            for tool in coupling.tools():
                self.tools.append(tool)
                if self._passes(_TOOL):
                    compensation.put_tool(*tool)
            for caused in compensation.forces(round(now * NANOSECONDS)):
                self.felt.append(caused)
                force = along_actuator(caused.actuator_force)
                self._command(MASTER, ACTUATOR, caused.stamp, force)
        if coupling.engagement.due(now):
            self._decide(now)
        for pull in coupling.pulls():
            self.pulls.append(pull)
            self._command(pull.arm, ARM, pull.stamp, pull.force)

    def _passes(self, *names: str) -> bool:
        """Return whether a sample of signals is passed on; count one that is not."""
        if not self.muted or self.muted.isdisjoint(names):
            return True
        self.contested += 1
        return False

    def _command(self, arm: str, kind: str, stamp: int, force: Vector) -> None:
        side = self.sides[arm]
        if side.sampling:
            try:
                side.command(kind, stamp, force)
            except self._failures as error:  # of a device that takes forces ahead
                self._failed(arm, error)

    def _look(self, now: float) -> None:
        assert self.coupling
        if self.coupling.look(now, listeners=1).release:
            self.pulls += release(self.sides, now)


def release(sides: Mapping[str, DeviceSide], now: float) -> list[Pull]:
    """Apply a zero force to each arm, as if computed from the sample of a time, s."""
    pulls = [Pull(arm, round(now * NANOSECONDS), ZERO) for arm in sides]
    for arm, stamp, force in pulls:
        if sides[arm].sampling:
            sides[arm].command(ARM, stamp, force)
    return pulls
