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

from dataclasses import dataclass, field, replace

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXES, ACTUATOR_AXIS, along_actuator
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
from haptic_accel.core.model import ModeParameters, MountParameters, Sample, Vector
from haptic_accel.core.rig.held_rig import (
    NOISE_STREAM,
    STOP_STEPS,
    Hand,
    HeldRig,
    HeldRigParameters,
)
from haptic_accel.core.rig.instruments import Accelerometer
from haptic_accel.core.rig.linear_system import LinearSystem


@dataclass(frozen=True)
class MasterRigParameters(HeldRigParameters):
    """Parameters of the simulated master."""

    mount: MountParameters = field(default_factory=MountParameters)
    second: ModeParameters = field(default_factory=ModeParameters)


class MasterRig(HeldRig):
    """Master: eq. (1) and (2) of the paper along the actuator axis z, a mass along x.

    Parameters as for `HeldRig`.
    """

    AXES = ACTUATOR_AXES
    HAND = (X_U, Y_U, VX_U, V_U)
    HAND_INPUTS = (AX_U, A_U)
    FORCES = F_A
    GRAVITY = G

    _p: MasterRigParameters
    _accelerometer: Accelerometer

    def __init__(
        self,
        parameters: MasterRigParameters,
        rate: float,
        seed: int = 0,
        hand: Hand | None = None,
    ) -> None:
        self._accelerometer = Accelerometer(parameters.accelerometer, seed, NOISE_STREAM)
        super().__init__(parameters, rate, seed, hand)
        (self._stop,) = self._stops

    @property
    def travel(self) -> float:
        """Displacement of the actuator between its stops, m."""
        state = self._system.state
        return float(state[Y_A] - state[Y_H])

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""
        state = self._system.state.tolist()
        # The sensor is held against gravity, which it measures as an upward acceleration.
        low_passed = state[MEASURED] + self._p.grip.gravity
        return self._p.arm.reading(
            (state[X_H], 0.0, state[Y_H]),
            (state[VX_H], 0.0, state[V_H]),
            along_actuator(self._accelerometer.measure(low_passed, noisy=self._started)),
        )

    def apply_actuator_force(self, force: Vector) -> None:
        """Set the voice coil's force, N, rounded and limited by its converter and amplifier.

        NaN sets the force to zero.
        """
        self._command(self._drive(0, force[ACTUATOR_AXIS]))

    def change_mount(self, mount: MountParameters) -> None:
        """Change the accelerometer's mount from now on, without a jump of the motion."""
        self._p = replace(self._p, mount=mount)
        self.change_grip(self.handle)

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
        self._friction = drive.coulomb_friction
        self._friction_steps = self._friction_time(1 / (1 / h.m_a + 1 / h.m_h))
        response = self._system.step_response(F_BETWEEN)
        travels = (response[:, Y_A] - response[:, Y_H]).tolist()
        # By the number of steps: response to a unit of friction, and travel with full friction.
        self._rubbed = [
            (each, drive.slip_velocity * steps * self._step + self._friction * travel)
            for steps, (each, travel) in enumerate(zip(response, travels, strict=True), start=1)
        ]

    def _rest(self) -> None:
        """Set the state of equilibrium of hand, spring and gravity."""
        h, gravity, state = self.handle, self._p.grip.gravity, self._system.state
        self._set_hand(*self._hand(self._now))
        self._system.inputs[G] = -gravity
        sag = (h.m_a + h.m_h) * gravity / h.k_u if h.k_u else 0.0
        state[Y_H] = state[Y_M] = state[Y_U] - sag
        if self._p.second.frequency:
            state[Y_S] = state[Y_H]
        state[Y_A] = state[Y_H] - (h.m_a * gravity / h.k_s if h.k_s else 0.0)
        state[X_H] = state[X_U]

    def _pull(self, x: float, y: float, z: float) -> bool:
        inputs = self._system.inputs
        inputs[F_X], inputs[F_Z] = x, z
        return bool(x or z)

    def _move(self, steps: int) -> int:
        """Advance the mechanics by at most `steps`; return the number of steps advanced."""
        y_a, v_a, y_h, v_h = self._ends.tolist()
        offset, slip = y_a - y_h, v_a - v_h
        if self._stop.near(offset, slip, steps):
            steps = min(steps, STOP_STEPS)
            self._system.inputs[F_BETWEEN] = self._stop.force(offset, slip)
        if self._friction:
            self._rub(offset, steps)
        else:
            self._system.advance(steps)
        return steps

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
