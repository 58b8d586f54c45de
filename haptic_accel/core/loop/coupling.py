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

"""Coupling part of the loop: from the samples of both arms to the forces on both."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from haptic_accel.core.coupling.engagement import Decision, Engagement
from haptic_accel.core.coupling.pairing import Motion, Pairing
from haptic_accel.core.coupling.passive import PassivePair
from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.loop.wiring import ArmCommand, Tool
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.topics import ARMS

CORRECTION_TIME = 0.02
"""Time constant with which the observer returns to the measured position, s: several counts of 55
um at 10 mm/s, as in the vibration of a texture."""

STEP_MEMORY = 1.0
"""Time constant with which the largest step is forgotten, s: several reversals of a stroke."""

COARSEST = 1e-3
"""Step beyond which a position is no count, but has jumped, m: as for the simulated encoders."""

FINEST = 1e-6
"""Step below which a position counts as smooth, m: 0.3 mN through the paper's spring."""


class CountObserver:
    """Estimate an arm's position between the counts of its encoders, from its velocity.

    The estimate moves with the velocity and returns to the measured position in
    `CORRECTION_TIME`. It is never farther from it than the largest recent step between two samples
    that the velocity does not explain: a count for rounded positions, and nothing for smooth ones.
    So neither resolution nor geometry of the encoders must be known. After a jump the estimate
    starts anew. Where the velocity is late, the estimate is late by less; without velocity it is
    the measured position.

    Parameters
    ----------
    rate : float
        Samples per second.

    Examples
    --------
    >>> observer = CountObserver(1000.0)
    >>> observer.rounding((0.0, 0.0, 1e-3), (0.0, 0.0, 0.01))
    (0.0, 0.0, 0.0)
    """

    def __init__(self, rate: float) -> None:
        self._half = 0.5 / rate
        self._left = 1.0 - 1.0 / (1.0 + CORRECTION_TIME * rate)
        self._kept = 1.0 - 1.0 / (1.0 + STEP_MEMORY * rate)
        self.restart()

    def restart(self) -> None:
        """Forget the motion and the steps."""
        self._before: tuple[Vector, Vector] | None = None
        self._rounding, self._steps = [0.0] * 3, [0.0] * 3

    def rounding(self, position: Vector, velocity: Vector) -> Vector:
        """Return measured minus estimated position, m, for the next sample, in m and m/s."""
        before, self._before = self._before, (position, velocity)
        if before is None:
            return ZERO
        (was, speed_was), rounding, steps = before, self._rounding, self._steps
        # Comparisons, as calls of min, max and abs would take most of the time.
        for axis in (0, 1, 2):
            speed = velocity[axis]
            step = position[axis] - was[axis] - (speed + speed_was[axis]) * self._half
            if not -COARSEST < step < COARSEST:  # or no number
                self.restart()
                return ZERO
            size = step if step > 0.0 else -step
            largest = self._kept * steps[axis]
            steps[axis] = largest = largest if largest > size else size
            left = (rounding[axis] + step) * self._left if speed and largest > FINEST else 0.0
            left = left if left < largest else largest
            rounding[axis] = left if left > -largest else -largest
        x, y, z = rounding
        return x, y, z


class CouplingPart:
    """Engage both arms, and compute the forces of each tick from the samples of both.

    Parameters
    ----------
    coupling : PositionPositionCoupling or PassivePair
    engagement : Engagement
        Engagement of both arms.
    rate : float
        Samples per second of both arms.
    longest : int
        Maximum number of waiting samples of an arm, and of the tool.
    counted : bool
        True if the compensation in this process uses `count_force`, which is zero otherwise.

    Attributes
    ----------
    engagement : Engagement
    count_force : tuple of float
        Part of the newest force on the master that the encoders' rounding causes, N.
    """

    def __init__(
        self,
        coupling: PositionPositionCoupling | PassivePair,
        engagement: Engagement,
        rate: float,
        longest: int = 1,
        *,
        counted: bool = True,
    ) -> None:
        self._coupling, self.engagement = coupling, engagement
        self._counted = counted
        self._pairing = Pairing(rate, longest)
        self._observers = CountObserver(rate), CountObserver(rate)
        self.count_force = ZERO
        self._engaging = False
        self._tools: deque[Tool] = deque(maxlen=longest)

    @property
    def engaged(self) -> bool:
        """True while the arms are coupled."""
        return self._coupling.engaged

    @property
    def held(self) -> int:
        """Number of ticks with an earlier sample in place of a missing one."""
        return self._pairing.held

    @property
    def waiting(self) -> bool:
        """True while a sample of one arm waits for the other arm's."""
        return self._pairing.waiting

    def begin(self, now: float, stamp: int) -> None:
        """Begin a tick: nothing to do here."""

    def put(self, arm: str, motion: Motion, now: float) -> None:
        """Add a sample of an arm, from `ARMS`, at a time in s."""
        self.engagement.position_received(arm, now, motion)
        self._pairing.put(ARMS.index(arm), motion)

    def put_tool(self, tool: Tool) -> None:
        """Add a sample of the tool; `tools` yields it unchanged."""
        self._tools.append(tool)

    def tools(self) -> Iterator[Tool]:
        """Yield each sample of the tool once, for the compensation."""
        while self._tools:
            yield self._tools.popleft()

    def poll(self, now: float, listeners: int) -> Decision:
        """Couple the arms at their next samples, or uncouple them, if this is due.

        Arguments as for `Engagement.missing`.
        """
        decision = self.engagement.decide(now, listeners)
        if decision.release:
            self._engaging = False
            self._coupling.disengage()
            self.count_force = ZERO
        if decision.engage:
            self._engaging = True
        return decision

    def clear(self) -> None:
        """Discard the waiting samples."""
        self._pairing.clear()

    def commands(self) -> Iterator[ArmCommand]:
        """Yield the forces of each tick with samples of both arms, while engaged."""
        for master, slave in self._pairing.pairs():
            if self._engaging:
                self._engaging = False
                self._coupling.engage(master.position, slave.position)
                for observer in self._observers:
                    observer.restart()
            if not self._coupling.engaged or self.engagement.interrupted:
                continue
            motions = master.position, slave.position, master.velocity, slave.velocity
            if isinstance(self._coupling, PassivePair):
                forces = self._coupling.forces(*motions, (master.work, slave.work))
            else:
                forces = self._coupling.forces(*motions)
            if self._counted:
                self.count_force = self._rounded(master, slave)
            # The sample of one arm causes the force on the other.
            for arm, motion, force in zip(ARMS, (slave, master), forces, strict=True):
                yield ArmCommand(arm, motion.stamp, force)

    def _rounded(self, master: Motion, slave: Motion) -> Vector:
        """Return the force on the master that the rounding of both positions causes, N."""
        on_master, on_slave = self._observers
        x, y, z = on_master.rounding(master.position, master.velocity)
        s_x, s_y, s_z = on_slave.rounding(slave.position, slave.velocity)
        stiffness, scale = self._coupling.felt
        return (
            stiffness * (s_x / scale - x),
            stiffness * (s_y / scale - y),
            stiffness * (s_z / scale - z),
        )
