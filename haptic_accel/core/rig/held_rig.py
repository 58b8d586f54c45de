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

"""Rig of a handle in a hand that leads it: clock, delayed commands, hand, travel stops."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import Axes
from haptic_accel.core.model import (
    AccelerometerParameters,
    GripParameters,
    HandleParameters,
    MountParameters,
    Vector,
    held,
)
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.rig.exploration import TABLE_STEP, Exploration, ExplorationParameters
from haptic_accel.core.rig.instruments import (
    Accelerometer,
    ArmParameters,
    Holding,
    Quantizer,
    VectorAccelerometer,
)
from haptic_accel.core.rig.interface import LONGEST_ADVANCE, clock_step
from haptic_accel.core.rig.linear_system import LinearSystem

STOP_STEPS = 5
"""Steps between updates of a nearby travel stop's force (50 us)."""

NOISE_STREAM = 1
"""Random stream of the handle's accelerometer, independent of the slave's with the same seed."""


@dataclass(frozen=True)
class DriveParameters(Checked):
    """Simulated converter, amplifier, bearing and travel stops of the actuator."""

    bits: int = parameter(14, "resolution of the converter of the force", "bit", 4, 32)
    stop_stiffness: float = parameter(
        3e4, "stiffness of the travel stops (assumed: rubber)", "N/m", 0, 1e5
    )
    stop_damping: float = parameter(
        10.0, "damping of the travel stops (assumed)", "N s/m", 0, 20.0
    )
    delay: float = parameter(
        0.0,
        "delay from command to force in addition to the hold: converter, amplifier, computation",
        "s",
        0,
        0.02,
    )
    force_scale: float = parameter(
        1.0,
        "ratio of force to commanded force; negative if the coil's wires are swapped",
        low=-2.0,
        high=2.0,
    )
    coulomb_friction: float = parameter(0.0, "dry friction of the actuator's bearing", "N", 0, 1.0)
    slip_velocity: float = parameter(
        2e-3, "slip velocity above which dry friction is constant", "m/s", 2e-3, 1.0
    )


@dataclass(frozen=True)
class HeldRigParameters:
    """Parameters of a simulated handle, whatever its number of coils."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    grip: GripParameters = field(default_factory=GripParameters)
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    drive: DriveParameters = field(default_factory=DriveParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    exploration: ExplorationParameters = field(default_factory=ExplorationParameters)


class Hand(Protocol):
    """Interface of the user's hand: desired position of the handle."""

    def at(self, time: float) -> tuple[float, float, float, float]:
        """Return x, z in m and their velocities in m/s at a time in s; at rest at 0."""


class HeldRig(ABC):
    """Handle with linear mechanics in a hand that leads it.

    The system is linear between commands and advanced exactly, except for travel stops and dry
    friction. The force of a nearby stop is updated every 50 us. Friction is held for a sample at
    most and follows the mean slip. Everything stands still until the first force. The hand rests
    until the arm's first force (engagement), then starts to explore. A released arm returns to its
    start, and the hand starts again with the next force.

    Parameters
    ----------
    parameters : HeldRigParameters
    rate : float
        Sampling rate, Hz.
    seed : int
        Seed of the accelerometer's noise and of the user's grip.
    hand : Hand, optional
        Hand that replaces the scripted one.

    Attributes
    ----------
    handle : HandleParameters
        Handle with this user's grip.
    """

    AXES: ClassVar[Axes]
    """Axes of coils and accelerometer."""
    HAND: ClassVar[tuple[int, int, int, int]]
    """States of the hand: x, z and their velocities."""
    HAND_INPUTS: ClassVar[tuple[int, int]]
    """Inputs of the hand's accelerations along x and z."""
    FORCES: ClassVar[Any]
    """Inputs of the actuator's force."""
    GRAVITY: ClassVar[int]
    """Input of gravity."""

    _p: HeldRigParameters
    _accelerometer: Accelerometer | VectorAccelerometer
    _system: LinearSystem
    _friction_steps: int

    def __init__(
        self, parameters: HeldRigParameters, rate: float, seed: int, hand: Hand | None
    ) -> None:
        self._p = parameters
        self._seed = seed
        self.handle = held(parameters.handle, parameters.grip, seed)
        self._step = clock_step(rate)
        self._stall = round(LONGEST_ADVANCE / self._step)
        self._longest = min(round(1.0 / rate / self._step), round(TABLE_STEP / self._step))
        limit, drive = parameters.actuator, parameters.drive
        coils = range(len(self.AXES.names))
        self._converters = [Quantizer(limit.peak_force, drive.bits) for _ in coils]
        self._stops = [TravelStop(limit.travel, drive, self._step) for _ in coils]
        self._build_mechanics()
        self._leading = hand or Exploration(parameters.exploration)
        self._delay = round(parameters.drive.delay / self._step)
        self._commands: deque[tuple[int, Any]] = deque()
        self._now = 0
        self._started = False
        self._holding = Holding()
        self._explored_since: int | None = None
        self._hand_until = 0  # end of the hand's present acceleration
        self._led = -1, (0.0, 0.0, 0.0, 0.0)  # time and motion of the hand's last update
        self._rest()

    @abstractmethod
    def change_mount(self, mount: MountParameters) -> None:
        """Change the accelerometer's mount from now on, without a jump of the motion."""

    @abstractmethod
    def _build_mechanics(self) -> None:
        """Build the mechanics with the present grip, and the steps for which friction holds."""

    @abstractmethod
    def _pull(self, x: float, y: float, z: float) -> bool:
        """Set the inputs of the arm's force, N; return True if one is not zero."""

    @abstractmethod
    def _rest(self) -> None:
        """Set the state of equilibrium of hand, springs and gravity."""

    @abstractmethod
    def _move(self, steps: int) -> int:
        """Advance the mechanics by at most `steps`; return the number of steps advanced."""

    def advance(self, time: float) -> None:
        """Integrate the physics up to `time`, s. Times in the past are ignored."""
        due = round(time / self._step) - self._now
        longest = self._stall if self._started else 0
        if due > longest:
            skipped = due - longest
            self._now += skipped
            if self._explored_since is not None:
                self._explored_since += skipped
            due = longest
        let_go = self._holding.ends(max(0, due) * self._step)
        while due > 0:
            due -= self._advance(due)
        if self._commands:
            self._apply_commands()
        if let_go:
            self._put_back()

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        if self._explored_since is None:
            self._started = True
            self._explored_since = self._hand_until = self._now
        motor_force = self._p.arm.motor_force
        x, y, z = motor_force(force[0]), motor_force(force[1]), motor_force(force[2])
        self._holding.command(free=not self._pull(x, y, z))

    def change_grip(self, handle: HandleParameters) -> None:
        """Change the parameters of the handle from now on, without a jump of the motion."""
        before = self._system
        self.handle = handle
        self._build_mechanics()
        self._system.state[:], self._system.inputs[:] = before.state, before.inputs
        if not self._started:
            self._rest()

    def hold(self, grip: GripParameters) -> None:
        """Change the grip of the same user from now on."""
        self._p = replace(self._p, grip=grip)
        self.change_grip(held(self._p.handle, grip, self._seed))
        self._system.inputs[self.GRAVITY] = -grip.gravity

    def release(self) -> None:
        """Set all forces to zero."""
        self._commands.clear()
        self._system.inputs[self.FORCES] = 0.0
        self._pull(0.0, 0.0, 0.0)
        self._holding.command(free=True)

    def counters(self) -> dict[str, int]:
        """Return counts of saturated samples and commands, and of contacts with travel stops."""
        return {
            "accelerometer_saturated": self._accelerometer.saturated,
            "actuator_saturated": sum(each.saturated for each in self._converters),
            "travel_stops_hit": sum(each.hits for each in self._stops),
        }

    def _drive(self, coil: int, force: float) -> float:
        """Return the force of a coil for a command, N, rounded and limited; 0 for NaN."""
        converted = self._converters[coil].convert(0.0 if math.isnan(force) else force)
        self._started = self._started or converted != 0.0
        return self._p.drive.force_scale * converted

    def _command(self, forces: Any) -> None:
        """Apply the forces of the coils after their delay."""
        self._commands.append((self._now + self._delay, forces))
        self._apply_commands()

    def _friction_time(self, reduced_mass: float) -> int:
        """Return the number of steps within which held friction does not reverse a slip."""
        drive = self._p.drive
        if not drive.coulomb_friction:
            return self._longest
        relaxation = reduced_mass * drive.slip_velocity / drive.coulomb_friction
        return max(1, int(min(self._longest, relaxation / self._step)))

    def _advance(self, due: int) -> int:
        """Advance by at most `due` steps, until an input may change; return their number."""
        if self._commands:
            self._apply_commands()
        if self._now >= self._hand_until:
            self._lead_hand()
        steps = min(due, self._hand_until - self._now, self._friction_steps)
        if self._commands:
            steps = min(steps, max(1, self._commands[0][0] - self._now))
        steps = self._move(steps)
        self._now += steps
        return steps

    def _apply_commands(self) -> None:
        """Apply the commands whose delay has passed."""
        while self._commands and self._commands[0][0] <= self._now:
            self._system.inputs[self.FORCES] = self._commands.popleft()[1]

    def _put_back(self) -> None:
        """Set hand and handle to rest at their initial position."""
        self._explored_since = None
        self._hand_until = self._now
        self._system.state[:] = 0.0
        self._rest()

    def _lead_hand(self) -> None:
        """Set the hand's motion for at most a step of its table."""
        self._hand_until = self._now + self._longest
        x, z, v_x, v_z = self._hand(self._now)
        _, _, next_x, next_z = self._hand(self._hand_until)
        duration = self._longest * self._step
        self._set_hand(x, z, v_x, v_z)
        inputs, (a_x, a_z) = self._system.inputs, self.HAND_INPUTS
        inputs[a_x], inputs[a_z] = (next_x - v_x) / duration, (next_z - v_z) / duration

    def _set_hand(self, x: float, z: float, v_x: float, v_z: float) -> None:
        # One by one, as an array reads four numbers faster than a tuple.
        state, (x_u, z_u, vx_u, vz_u) = self._system.state, self.HAND
        state[x_u], state[z_u], state[vx_u], state[vz_u] = x, z, v_x, v_z

    def _hand(self, now: int) -> tuple[float, float, float, float]:
        steps = 0 if self._explored_since is None else now - self._explored_since
        if steps != self._led[0]:
            self._led = steps, self._leading.at(steps * self._step)
        return self._led[1]


class TravelStop:
    """Stops on both sides of a coil, whose force is held for some steps.

    Parameters
    ----------
    travel : float
        Free travel either way, m.
    drive : DriveParameters
    step : float
        Step of the rig's clock, s.

    Attributes
    ----------
    hits : int
        Number of contacts.
    """

    def __init__(self, travel: float, drive: DriveParameters, step: float) -> None:
        self._travel, self._step = travel, step
        self._stiffness, self._damping = drive.stop_stiffness, drive.stop_damping
        self._touching = False
        self.hits = 0

    def near(self, offset: float, slip: float, steps: int) -> bool:
        """Return True if the coil may touch the stop within a number of steps."""
        reach = abs(offset) + 2 * abs(slip) * steps * self._step
        return self._touching or reach > self._travel / 2

    def force(self, offset: float, slip: float) -> float:
        """Return the force of the stops on the coil, N, held for `STOP_STEPS` steps."""
        overrun = abs(offset) - self._travel
        before, self._touching = self._touching, overrun > 0
        if not self._touching:
            return 0.0
        self.hits += not before
        outward = math.copysign(1.0, offset) * slip
        # The force is held for some steps. Its mid-time value returns no more energy than was
        # stored.
        held = STOP_STEPS * self._step
        push = self._stiffness * (overrun + outward * held / 2) + self._damping * outward
        return -math.copysign(max(0.0, push), offset)

    def energy(self, offset: float) -> float:
        """Return the elastic energy at a displacement in m, J."""
        return self._stiffness * max(0.0, abs(offset) - self._travel) ** 2 / 2
