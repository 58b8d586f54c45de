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

"""Master of the virtual rig: hand, handle, voice coil, arm and accelerometer."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.handle.mechanics import (
    A_U,
    ACTUATOR_AND_HANDLE,
    AX_U,
    F_A,
    F_BETWEEN,
    F_X,
    F_Z,
    MEASURED,
    V_A,
    V_H,
    V_U,
    VX_H,
    VX_U,
    X_H,
    X_U,
    Y_A,
    Y_H,
    Y_M,
    Y_S,
    Y_U,
    G,
    mechanics,
)
from haptic_accel.core.model import (
    AccelerometerParameters,
    FloatArray,
    GripParameters,
    HandleParameters,
    ModeParameters,
    MountParameters,
    Sample,
    Vector,
    held,
)
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.rig.exploration import TABLE_STEP, Exploration, ExplorationParameters
from haptic_accel.core.rig.instruments import Accelerometer, ArmParameters, Holding, Quantizer
from haptic_accel.core.rig.interface import LONGEST_ADVANCE, clock_step

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
class MasterRigParameters:
    """Parameters of the simulated master."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    grip: GripParameters = field(default_factory=GripParameters)
    mount: MountParameters = field(default_factory=MountParameters)
    second: ModeParameters = field(default_factory=ModeParameters)
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    drive: DriveParameters = field(default_factory=DriveParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    exploration: ExplorationParameters = field(default_factory=ExplorationParameters)


class Hand(Protocol):
    """Interface of the user's hand: desired position of the handle."""

    def at(self, time: float) -> tuple[float, float, float, float]:
        """Return x, z in m and their velocities in m/s at a time in s; at rest at 0."""


class MasterRig:
    """Master: eq. (1) and (2) of the paper along the actuator axis z, a mass along x.

    The system is linear between commands and advanced exactly, except for travel stops and dry
    friction. The force of a nearby stop is updated every 50 us. Friction is held for a sample at
    most and follows the mean slip. Everything stands still until the first force. The hand rests
    until the arm's first force (engagement), then starts to explore. A released arm returns to its
    start, and the hand starts again with the next force.

    Parameters
    ----------
    parameters : MasterRigParameters
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

    def __init__(
        self,
        parameters: MasterRigParameters,
        rate: float,
        seed: int = 0,
        hand: Hand | None = None,
    ) -> None:
        self._p = parameters
        self._seed = seed
        self.handle = held(parameters.handle, parameters.grip, seed)
        self._step = clock_step(rate)
        self._stall = round(LONGEST_ADVANCE / self._step)
        self._longest = min(round(1.0 / rate / self._step), round(TABLE_STEP / self._step))
        self._build_mechanics()
        self._leading = hand or Exploration(parameters.exploration)
        self._accelerometer = Accelerometer(parameters.accelerometer, seed, NOISE_STREAM)
        self._converter = Quantizer(parameters.actuator.peak_force, parameters.drive.bits)
        self._delay = round(parameters.drive.delay / self._step)
        self._commands: deque[tuple[int, float]] = deque()
        self._now = 0
        self._started = False
        self._holding = Holding()
        self._explored_since: int | None = None
        self._hand_until = 0  # end of the hand's present acceleration
        self._led = -1, (0.0, 0.0, 0.0, 0.0)  # time and motion of the hand's last update
        self._touching = False
        self._stop_hits = 0
        self._rest()

    @property
    def travel(self) -> float:
        """Displacement of the actuator between its stops, m."""
        state = self._system.state
        return float(state[Y_A] - state[Y_H])

    def advance(self, time: float) -> None:
        """Integrate the physics until a time in s; a past time changes nothing."""
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

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""
        state = self._system.state.tolist()
        # The sensor is held against gravity, which it measures as an upward acceleration.
        low_passed = state[MEASURED] + self._p.grip.gravity
        acceleration = self._accelerometer.measure(low_passed, noisy=self._started)
        return self._p.arm.reading(state[X_H], state[Y_H], state[VX_H], state[V_H], acceleration)

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        if self._explored_since is None:
            self._started = True
            self._explored_since = self._hand_until = self._now
        inputs, motor_force = self._system.inputs, self._p.arm.motor_force
        f_x, f_z = motor_force(force[0]), motor_force(force[2])
        inputs[F_X], inputs[F_Z] = f_x, f_z
        self._holding.command(free=not (f_x or f_z))

    def apply_actuator_force(self, force: Vector) -> None:
        """Set the voice coil's force, N, rounded and limited by its converter and amplifier.

        NaN sets the force to zero.
        """
        along = force[ACTUATOR_AXIS]
        converted = self._converter.convert(0.0 if math.isnan(along) else along)
        self._started = self._started or converted != 0.0
        acting = self._p.drive.force_scale * converted
        self._commands.append((self._now + self._delay, acting))
        self._apply_commands()

    def change_grip(self, handle: HandleParameters) -> None:
        """Change the parameters of the handle from now on, without a jump of the motion."""
        before = self._system
        self.handle = handle
        self._build_mechanics()
        self._system.state[:], self._system.inputs[:] = before.state, before.inputs
        if not self._started:
            self._rest()

    def change_mount(self, mount: MountParameters) -> None:
        """Change the accelerometer's mount from now on, without a jump of the motion."""
        self._p = replace(self._p, mount=mount)
        self.change_grip(self.handle)

    def hold(self, grip: GripParameters) -> None:
        """Change the grip of the same user from now on."""
        self._p = replace(self._p, grip=grip)
        self.change_grip(held(self._p.handle, grip, self._seed))
        self._system.inputs[G] = -grip.gravity

    def release(self) -> None:
        """Set all forces to zero."""
        self._commands.clear()
        self._system.inputs[[F_A, F_X, F_Z]] = 0.0
        self._holding.command(free=True)

    def counters(self) -> dict[str, int]:
        """Return counts of saturated samples and commands, and of contacts with travel stops."""
        return {
            "accelerometer_saturated": self._accelerometer.saturated,
            "actuator_saturated": self._converter.saturated,
            "travel_stops_hit": self._stop_hits,
        }

    def energy(self) -> float:
        """Return kinetic and spring energy of handle, actuator, grip and stops, J."""
        h = self.handle
        y_a, v_a, y_h, v_h, y_u = self._system.state[[Y_A, V_A, Y_H, V_H, Y_U]]
        x_h, vx_h, x_u = self._system.state[[X_H, VX_H, X_U]]
        overrun = max(0.0, abs(y_a - y_h) - self._p.actuator.travel)
        kinetic = h.m_a * v_a**2 + h.m_h * v_h**2 + (h.m_a + h.m_h) * vx_h**2
        springs = h.k_s * (y_a - y_h) ** 2 + h.k_u * ((y_h - y_u) ** 2 + (x_h - x_u) ** 2)
        return float(kinetic + springs + self._p.drive.stop_stiffness * overrun**2) / 2

    def disturb(self, handle_velocity: float = 0.0, actuator_velocity: float = 0.0) -> None:
        """Set velocities along the actuator's axis, m/s: an impact for tests and experiments."""
        self._started = True
        self._system.state[V_H] = handle_velocity
        self._system.state[V_A] = actuator_velocity

    def _build_mechanics(self) -> None:
        """Build the mechanics of the handle with its present grip."""
        h, drive = self.handle, self._p.drive
        self._system = LinearSystem(
            *mechanics(h, self._p.mount, self._p.accelerometer.bandwidth, self._p.second),
            self._step,
            self._longest,
        )
        self._ends = self._system.state[ACTUATOR_AND_HANDLE]
        self._travel = self._p.actuator.travel
        self._friction = drive.coulomb_friction
        self._friction_steps = self._longest
        if self._friction:
            # Within its time constant, held friction does not reverse a slip.
            reduced_mass = 1 / (1 / h.m_a + 1 / h.m_h)
            relaxation = reduced_mass * drive.slip_velocity / self._friction
            self._friction_steps = max(1, int(min(self._longest, relaxation / self._step)))
        response = self._system.step_response(F_BETWEEN)
        travels = (response[:, Y_A] - response[:, Y_H]).tolist()
        # By the number of steps: response to a unit of friction, and travel with full friction.
        self._rubbed = [
            (each, drive.slip_velocity * steps * self._step + self._friction * travel)
            for steps, (each, travel) in enumerate(zip(response, travels, strict=True), start=1)
        ]

    def _advance(self, due: int) -> int:
        """Advance by at most `due` steps, until an input may change; return their number."""
        if self._commands:
            self._apply_commands()
        if self._now >= self._hand_until:
            self._lead_hand()
        y_a, v_a, y_h, v_h = self._ends.tolist()
        offset, slip = y_a - y_h, v_a - v_h
        steps = self._step_limit(due, offset, slip)
        if self._touching or abs(offset) > self._travel:
            self._system.inputs[F_BETWEEN] = self._stop_force(offset, slip)
        if self._friction:
            self._rub(offset, steps)
        else:
            self._system.advance(steps)
        self._now += steps
        return steps

    def _step_limit(self, due: int, offset: float, slip: float) -> int:
        """Return the number of steps until the next update of an input."""
        steps = min(due, self._hand_until - self._now, self._friction_steps)
        if self._commands:
            steps = min(steps, max(1, self._commands[0][0] - self._now))
        reach = abs(offset) + 2 * abs(slip) * steps * self._step
        return min(steps, STOP_STEPS) if reach > self._travel / 2 else steps

    def _apply_commands(self) -> None:
        """Apply the commands whose delay has passed."""
        while self._commands and self._commands[0][0] <= self._now:
            self._system.inputs[F_A] = self._commands.popleft()[1]

    def _put_back(self) -> None:
        """Set hand and handle to rest at their initial position."""
        self._explored_since = None
        self._hand_until = self._now
        self._system.state[:] = 0.0
        self._rest()

    def _rest(self) -> None:
        """Set the state of equilibrium of hand, spring and gravity."""
        h, gravity, state = self.handle, self._p.grip.gravity, self._system.state
        state[X_U], state[Y_U], state[VX_U], state[V_U] = self._hand(self._now)
        self._system.inputs[G] = -gravity
        sag = (h.m_a + h.m_h) * gravity / h.k_u if h.k_u else 0.0
        state[Y_H] = state[Y_M] = state[Y_U] - sag
        if self._p.second.frequency:
            state[Y_S] = state[Y_H]
        state[Y_A] = state[Y_H] - (h.m_a * gravity / h.k_s if h.k_s else 0.0)
        state[X_H] = state[X_U]

    def _lead_hand(self) -> None:
        """Set the hand's motion for at most a step of its table."""
        self._hand_until = self._now + self._longest
        x, z, v_x, v_z = self._hand(self._now)
        _, _, next_x, next_z = self._hand(self._hand_until)
        duration = self._longest * self._step
        state, inputs = self._system.state, self._system.inputs
        # One by one, as an array reads four numbers faster than a tuple.
        state[X_U], state[Y_U], state[VX_U], state[V_U] = x, z, v_x, v_z
        inputs[AX_U], inputs[A_U] = (next_x - v_x) / duration, (next_z - v_z) / duration

    def _hand(self, now: int) -> tuple[float, float, float, float]:
        steps = 0 if self._explored_since is None else now - self._explored_since
        if steps != self._led[0]:
            self._led = steps, self._leading.at(steps * self._step)
        return self._led[1]

    def _stop_force(self, offset: float, slip: float) -> float:
        """Return the force of a travel stop on the actuator's mass, N; zero in free travel."""
        p = self._p.drive
        overrun = abs(offset) - self._travel
        before, self._touching = self._touching, overrun > 0
        if not self._touching:
            return 0.0
        self._stop_hits += not before
        outward = math.copysign(1.0, offset) * slip
        # The force is held for some steps. Its mid-time value returns no more energy than was
        # stored.
        held = STOP_STEPS * self._step
        push = p.stop_stiffness * (overrun + outward * held / 2) + p.stop_damping * outward
        return -math.copysign(max(0.0, push), offset)

    def _rub(self, offset: float, steps: int) -> None:
        """Advance by a number of steps with constant dry friction.

        Friction follows the mean slip, including its own effect. It thus only dissipates energy,
        and is second-order accurate in the holding time.
        """
        system = self._system
        free = system.after(steps)
        travelled = free.item(Y_A) - free.item(Y_H) - offset
        response, whole = self._rubbed[steps - 1]
        friction = self._friction * min(1.0, max(-1.0, travelled / whole))
        np.subtract(free, friction * response, system.state)


class LinearSystem:
    """Linear system x' = A x + B u, advanced exactly by whole time steps.

    The inputs are constant between calls, like the output of a digital controller. The result is
    therefore independent of the division of an interval.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    step : float
        Smallest step, s.
    longest : int
        Maximum number of steps with a precomputed transition.
    """

    def __init__(self, a: FloatArray, b: FloatArray, step: float, longest: int) -> None:
        # Imported here, as scipy.linalg is slow to import, and most nodes have no rig.
        from scipy.linalg import expm

        states, inputs = b.shape
        exponent = np.zeros((states + inputs, states + inputs))
        exponent[:states, :states] = a
        exponent[:states, states:] = b
        one = expm(exponent * step)
        power = np.eye(states + inputs)
        transitions = []
        for _ in range(longest):
            power = power @ one
            transitions.append(np.ascontiguousarray(power[:states]))
        self._transitions = transitions
        self._longest = longest
        self._joint = np.zeros(states + inputs)
        self.state = self._joint[:states]
        """State, shape (n,): a view that may be written."""
        self.inputs = self._joint[states:]
        """Inputs, shape (m,): a view that may be written."""

    def step_response(self, index: int) -> FloatArray:
        """Return the state's response to one unit of an input, held over a number of steps.

        Parameters
        ----------
        index : int
            Index of the input.

        Returns
        -------
        ndarray, shape (longest, n)
            State after 1, 2, ... steps.
        """
        return np.array([each[:, len(self.state) + index] for each in self._transitions])

    def advance(self, steps: int) -> None:
        """Advance the state by a number of steps with constant inputs."""
        while steps > 0:
            block = min(steps, self._longest)
            self.state[:] = self.after(block)
            steps -= block

    def after(self, steps: int) -> FloatArray:
        """Return the state after a number of steps, at most `longest`, without advancing."""
        # For such a small matrix `dot` takes a third of the time of `@`.
        after: FloatArray = self._transitions[steps - 1].dot(self._joint)
        return after
