# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loop of one host: order of measuring, coupling, compensating and applying in a tick."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from haptic_accel.core.model import IDENTITY
from haptic_accel.core.tick.control import HandleCompensation
from haptic_accel.core.tick.coupling import ArmCoupling, CoupledForces
from haptic_accel.core.tick.device_side import ARM, DeviceSide
from haptic_accel.core.tick.loss_concealment import LossConcealment
from haptic_accel.core.tick.rigs import scalars
from haptic_accel.core.tick.samples import ArmSample

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from haptic_accel.core.model import FloatArray, Vector

SENDING_TIME: float = 0.5
"""Time reserved for sending a force to its device before it is due, in periods. The handle's
sample of the previous tick is awaited until then."""

LONGEST_BRIDGE: float = 0.02
"""Longest gap in the tool's samples that prediction fills, s. A longer prediction of texture is
useless, and the arms disengage soon after."""

ARMS = MASTER, SLAVE = "master", "slave"


class CompensatedSample:
    """Result for a tool sample: desired acceleration, m/s^2, and coils' forces, N.

    Attributes
    ----------
    stamp : int
        Stamp of the tool's sample, ns.
    d_x, d_y, d_z, f_x, f_y, f_z : float
        Desired acceleration and forces.
    """

    def __init__(self) -> None:
        self.stamp = 0
        self.d_x = self.d_y = self.d_z = self.f_x = self.f_y = self.f_z = 0.0

    @property
    def desired_acceleration(self) -> Vector:
        """Desired acceleration, m/s^2."""
        return self.d_x, self.d_y, self.d_z

    @property
    def actuator_force(self) -> Vector:
        """Force of each coil, N."""
        return self.f_x, self.f_y, self.f_z


class CompensationPart:
    """Compute one force for each sample of the tool, in order.

    The force of a tick depends on the tool's sample of that tick and on the handle's sample of the
    previous tick. The handle's sample of the same tick may not have arrived yet.

    Parameters
    ----------
    compensation : Compensation
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples.
    longest : int
        Maximum number of waiting samples of the handle: at least those of two successive ticks.

    Attributes
    ----------
    compensation : Compensation
    samples, lost, bridged, without : int
        Numbers of tool samples: received; lost; lost and replaced by predictions; used without the
        handle's sample.
    measured_across : bool
        True if the tool has measured an acceleration across the actuator's axis.
    orientation : tuple of float
        Newest orientation of the handle relative to its base frame; the tool's samples are rotated
        from the base's axes to the handle's.
    is_handle_muted : bool
        True if the handle's samples count as lost, as their topic has other publishers too.
    results : list of CompensatedSample
        Results that were computed since the list was cleared, when their objects are reused.
    """

    def __init__(self, compensation: Any, rate: float, latency: int, longest: int = 2) -> None:
        self.compensation: HandleCompensation = compensation
        self.slow: Any = compensation
        self.period: float = 1e9 / rate
        self.longest_wait: float = (max(1, latency) - SENDING_TIME) * self.period
        self.longest_bridge: float = LONGEST_BRIDGE * rate
        self.longest: int = longest
        self.tools: list[ArmSample] = []
        self.handles: list[ArmSample] = []
        self.has_last = self.measured_across = self.is_handle_muted = False
        self.axes: Any = compensation.axes
        self.concealments: list[LossConcealment] = [LossConcealment() for _ in self.axes.names]
        self.samples = self.lost = self.bridged = self.without = 0
        self.orientation: Any = IDENTITY
        self.results: list[CompensatedSample] = []
        self.made: list[CompensatedSample] = []

    def put_tool(self, tool: ArmSample) -> None:
        """Add the acceleration of a sample of the tool; stamps must increase."""
        if not self.measured_across and (tool.a_x != 0.0 or tool.a_y != 0.0):
            self.measured_across = True
        self.tools.append(tool)

    def set_count_force(self, x: float, y: float, z: float) -> None:
        """Set the arm's force due to rounding, N, in the base frame, for the next forces."""
        each = self.compensation
        if self.orientation is not IDENTITY and self.orientation != IDENTITY:
            x, y, z = self.turned(x, y, z, True)
        each.count_x, each.count_y, each.count_z = x, y, z

    def put_handle(self, handle: ArmSample) -> None:
        """Add the acceleration of a sample of the handle; stamps must increase."""
        handles = self.handles
        if len(handles) == self.longest:
            del handles[0]
        handles.append(handle)

    def turned(self, x: float, y: float, z: float, is_vector: bool = False) -> Vector:
        """Convert a tool's acceleration, or any vector, from the base's axes to the handle's."""
        from haptic_accel.core.axes import from_base, is_turned

        vector = x, y, z
        if is_vector or is_turned(self.orientation, vector):
            return from_base(self.orientation, vector)
        return vector

    @property
    def waiting(self) -> bool:
        """True while a sample of the tool waits for a sample of the handle."""
        return bool(self.tools)

    def clear(self) -> None:
        """Discard the waiting samples."""
        self.tools.clear()
        self.handles.clear()
        self.has_last = False

    def compute(self, now: float) -> None:
        """Compute the forces of all samples that are ready, and add them to the results.

        After each force, and before the next one, the controller does part of its slow
        computations.

        Parameters
        ----------
        now : float
            Time on the clock of the stamps, ns.
        """
        tools, handles = self.tools, self.handles
        half = self.period / 2
        made = self.compensation
        while tools:
            tool: ArmSample = tools[0]
            stamp: int = tool.stamp
            due = stamp - self.period
            handle: ArmSample | None = None
            while handles:
                handle = handles[0]
                if handle.stamp >= due - half:
                    break
                handle = None
                del handles[0]
            h_x = h_y = h_z = 0.0
            known: bool = False
            if handle is not None:
                h_x, h_y, h_z = handle.a_x, handle.a_y, handle.a_z
                known = handle.stamp < due + half and not self.is_handle_muted
            elif now - stamp < self.longest_wait:
                break
            del tools[0]
            t_x: float = tool.a_x
            t_y: float = tool.a_y
            t_z: float = tool.a_z
            if self.orientation is not IDENTITY:
                t_x, t_y, t_z = self.turned(t_x, t_y, t_z)
            if self.has_last and stamp - self.last >= 1.5 * self.period:
                self.fill(stamp - self.last)
            self.last: int = stamp
            self.has_last = True
            # The first sample has no previous one.
            if not known and self.samples > 0:
                self.without += 1
            self.samples += 1
            self.store(t_x, t_y, t_z)
            made.compute(t_x, t_y, t_z, known, h_x, h_y, h_z)
            if len(self.results) == len(self.made):
                self.made.append(CompensatedSample())
            result: CompensatedSample = self.made[len(self.results)]
            self.results.append(result)
            result.stamp = stamp
            result.d_x, result.d_y, result.d_z = made.desired_x, made.desired_y, made.desired_z
            result.f_x, result.f_y, result.f_z = made.force_x, made.force_y, made.force_z
            if made.first.trace.count >= made.due:
                self.slow.adapt()

    def fill(self, gap: int) -> None:
        """Pass predictions for a gap of lost samples, ns, to the filters, which thus miss none."""
        lost = round(gap / self.period) - 1
        self.lost += lost
        if 0 < lost <= self.longest_bridge:
            self.bridged += lost
            predicted = [each.predict(lost) for each in self.concealments]
            for values in zip(*predicted, strict=True):
                x, y, z = self.axes.vector(values)
                self.compensation.compute(x, y, z, False, 0.0, 0.0, 0.0)

    def store(self, x: float, y: float, z: float) -> None:
        """Store a sample for predictions; one with an axis that is not finite counts as zero."""
        if len(self.concealments) == 1:
            self.concealments[0].put(z)
            return
        if not math.isfinite(x + y + z):
            x = y = z = 0.0
        for concealment, value in zip(self.concealments, (x, y, z), strict=True):
            concealment.put(value)


class HostLoop:
    """Parts of one host, and their order in a tick.

    A tick samples the devices, applies the forces that are due, and computes the forces of later
    ticks, or of the same tick without latency. A clock provides the ticks live, a counter in
    lockstep; the code is the same.

    Parameters
    ----------
    sides : mapping of str to DeviceSide
        Devices by arm, in sampling order; all with the same rate and latency.
    coupling : ArmCoupling, optional
        None if forces come from elsewhere.
    compensation : CompensationPart, optional
        None without a handle.
    decide : callable, optional
        Called with the time in s when a decision is due; calls `ArmCoupling.poll`. The default
        assumes that all subscribers exist, as in lockstep.
    failures : tuple of type
        Exceptions of a device that affect only its arm.
    failed : callable, optional
        Called with an arm and such an exception, to stop the arm's sampling.

    Attributes
    ----------
    samples : list of ArmSample
        Samples read in the last step, or in all steps of the present frame.
    tools : list of ArmSample
        Samples of the tool passed to the compensation.
    commands : list of CoupledForces
        Forces on arms caused by these samples.
    compensated : list of CompensatedSample
        Actuator forces caused by these samples.
    contested : int
        Number of samples that were not passed on, as their topics have other publishers too.
    """

    signals: FloatArray

    def __init__(
        self,
        sides: Mapping[str, DeviceSide],
        coupling: ArmCoupling | None = None,
        compensation: CompensationPart | None = None,
        *,
        decide: Callable[[float], None] | None = None,
        failures: tuple[type[Exception], ...] = (),
        failed: Callable[[str, Exception], None] = lambda arm, error: None,
    ) -> None:
        self.sides: dict[str, DeviceSide] = dict(sides)
        self.coupling: ArmCoupling | None = coupling
        self.compensation: CompensationPart | None = compensation
        self.decide: Callable[[float], None] | None = decide
        self.failures: tuple[type[Exception], ...] = failures
        self.failed: Callable[[str, Exception], None] = failed
        self.each: list[DeviceSide] = list(self.sides.values())
        for arm, side in self.sides.items():
            side.index = int(arm == SLAVE)
        self.master: DeviceSide | None = self.sides.get(MASTER)
        self.slave: DeviceSide | None = self.sides.get(SLAVE)
        self.rate: float = self.each[0].rate
        self.at_once: bool = self.each[0].latency == 0
        self.samples: list[ArmSample] = []
        self.tools: list[ArmSample] = []
        self.commands: list[CoupledForces] = coupling.forces if coupling else []
        self.compensated: list[CompensatedSample] = compensation.results if compensation else []
        self.contested = self.width = 0
        self.mute(set())

    @property
    def complete(self) -> bool:
        """True if no sample or force of a device is pending."""
        return all([side.complete for side in self.each if side.sampling])

    def mute(self, names: set[str]) -> None:
        """Pass on no signals with these topics from now on."""
        from haptic_accel.core import topics

        motions = [
            {each.position.name, each.velocity.name, each.work.name}
            for each in (topics.MASTER, topics.SLAVE)
        ]
        self.mutes_master: bool = not names.isdisjoint(motions[0])
        self.mutes_slave: bool = not names.isdisjoint(motions[1])
        self.mutes_handle: bool = topics.HANDLE_ACCELERATION.name in names
        self.mutes_tool: bool = topics.TOOL_ACCELERATION.name in names
        if self.compensation:
            self.compensation.is_handle_muted = self.mutes_handle

    def forget(self) -> None:
        """Discard the results of earlier steps, whose objects are reused."""
        self.samples.clear()
        self.tools.clear()
        self.commands.clear()
        self.compensated.clear()

    def step(self, tick: int, is_first: bool = True) -> None:
        """Process a tick: the first of its frame, or one that adds its results to the frame's."""
        if is_first:
            self.forget()
        played: ArmSample | None = None
        if self.coupling is not None:
            stamp: int = math.floor(tick * 1e9 / self.rate + 0.5)
            played = self.coupling.begin(tick / self.rate, stamp)
        for side in self.each:
            if side.sampling:
                side.begin(tick)
        self.serve(played, False)
        if self.width:
            self.note(tick * self.width)

    def record(self, rows: Any) -> None:
        """Write the signals of each tick from now on to its row of an array.

        Order: acceleration, position and velocity of the master, and force on it; the same for the
        slave; desired acceleration; actuator force.
        """
        self.signals, self.width = scalars(rows.reshape(-1)), rows[0].size

    def note(self, at: int) -> None:
        """Write the signals of a tick, starting at an index."""
        row = self.signals
        for sample in self.samples:
            to: int = at + 12 * sample.arm
            row[to], row[to + 1], row[to + 2] = sample.a_x, sample.a_y, sample.a_z
            row[to + 3], row[to + 4], row[to + 5] = sample.x, sample.y, sample.z
            row[to + 6], row[to + 7], row[to + 8] = sample.v_x, sample.v_y, sample.v_z
        if self.commands:
            coupled: CoupledForces = self.commands[len(self.commands) - 1]
            if coupled.on_master:
                row[at + 9], row[at + 10], row[at + 11] = coupled.m_x, coupled.m_y, coupled.m_z
            if coupled.on_slave:
                row[at + 21], row[at + 22], row[at + 23] = coupled.s_x, coupled.s_y, coupled.s_z
        if self.compensated:
            result: CompensatedSample = self.compensated[len(self.compensated) - 1]
            row[at + 24], row[at + 25], row[at + 26] = result.d_x, result.d_y, result.d_z
            row[at + 27], row[at + 28], row[at + 29] = result.f_x, result.f_y, result.f_z

    def go_on(self) -> None:
        """Process samples and forces that arrived after their tick."""
        self.forget()
        self.serve(None, True)

    def serve(self, played: ArmSample | None, is_late: bool) -> None:
        """Measure, couple, compensate, apply and watch; an error affects its device only."""
        for side in self.each:
            if side.sampling:
                try:
                    side.read()
                    self.samples.extend(side.samples)
                    if side.receive is not None:
                        side.receive()
                    if not (is_late or self.at_once):
                        side.apply(False)
                except self.failures as error:
                    self.failed(ARMS[side.index], error)
        self.cause(played)
        for side in self.each:
            if side.sampling:
                try:
                    if is_late or self.at_once:
                        side.apply(is_late)
                    if not is_late:
                        side.watch()
                except self.failures as error:
                    self.failed(ARMS[side.index], error)

    def cause(self, played: ArmSample | None) -> None:
        """Pass the samples to coupling and compensation, and the forces to the devices."""
        coupling, compensation = self.coupling, self.compensation
        if coupling is None:
            return
        one: DeviceSide = self.each[0]
        now: float = one.time if one.clock is None else one.clock()
        coupling.passed = len(coupling.forces)
        sample: ArmSample
        # The samples of this step are the last ones of the frame.
        for side in self.each:
            for sample in side.samples:
                if self.mutes_slave if sample.arm else self.mutes_master:
                    self.contested += 1
                else:
                    coupling.put(sample, now)
                if not sample.arm:
                    if compensation is not None:
                        compensation.orientation = sample.orientation
                        self.contested += self.mutes_handle
                        compensation.put_handle(sample)
                elif self.mutes_tool:
                    self.contested += 1
                elif not coupling.passes_tools:
                    coupling.put_tool(sample)
                else:
                    self.tools.append(sample)
                    if compensation is not None:
                        compensation.put_tool(sample)
            side.samples.clear()
        if coupling.is_due(now):
            if self.decide is not None:
                self.decide(now)
            elif coupling.poll(now, 1).release:
                release(self.sides, now)
        coupling.couple()
        for index in range(coupling.passed, len(coupling.forces)):
            forces: CoupledForces = coupling.forces[index]
            if forces.on_master:
                self.command(self.master, True, forces.m_stamp, forces.m_x, forces.m_y, forces.m_z)
            if forces.on_slave:
                self.command(self.slave, True, forces.s_stamp, forces.s_x, forces.s_y, forces.s_z)
        if compensation is None:
            return
        compensation.set_count_force(coupling.count_x, coupling.count_y, coupling.count_z)
        if played is not None:
            self.tools.append(played)
            if self.mutes_tool:
                self.contested += 1
            else:
                compensation.put_tool(played)
        before: int = len(compensation.results)
        compensation.compute(now * 1e9)
        for index in range(before, len(compensation.results)):
            result: CompensatedSample = compensation.results[index]
            self.command(self.master, False, result.stamp, result.f_x, result.f_y, result.f_z)

    def command(
        self, side: DeviceSide | None, is_arm: bool, stamp: int, x: float, y: float, z: float
    ) -> None:
        """Pass a force to its device, which may fail if it accepts forces in advance."""
        if side is not None and side.sampling:
            try:
                side.take(is_arm, stamp, x, y, z)
            except self.failures as error:
                self.failed(ARMS[side.index], error)


def release(sides: Mapping[str, DeviceSide], now: float) -> None:
    """Apply a zero force to each arm, as if computed from the sample at a time, s."""
    for side in sides.values():
        if side.sampling:
            side.command(ARM, round(now * 1e9), 0.0, 0.0, 0.0)
