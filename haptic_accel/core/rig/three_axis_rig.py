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

"""Master with three coils: rigid handle in six degrees of freedom, hand, arm, accelerometer."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from haptic_accel.core.axes import ALL_AXES
from haptic_accel.core.handle.response import held_response
from haptic_accel.core.handle.three_axis import (
    ARM,
    BENT,
    BETWEEN,
    COILS,
    FALL,
    HAND_A_X,
    HAND_A_Z,
    HAND_V_X,
    HAND_V_Z,
    HAND_X,
    HAND_Z,
    LOW_PASSED,
    PLACE,
    SLIP,
    SPEED,
    SPIN,
    TRAVEL,
    TURN,
    BodyParameters,
    CoilMounting,
    SensorMounts,
    mass_matrix,
    rotation,
    sensed_motion,
    stiffness_and_damping,
    three_axis_mechanics,
)
from haptic_accel.core.model import (
    ZERO,
    ComplexArray,
    FloatArray,
    MountParameters,
    Sample,
    Vector,
    vector,
)
from haptic_accel.core.rig.held_rig import (
    NOISE_STREAM,
    STOP_STEPS,
    Hand,
    HeldRig,
    HeldRigParameters,
)
from haptic_accel.core.rig.instruments import VectorAccelerometer
from haptic_accel.core.rig.linear_system import LinearSystem

FRICTION_SWEEPS = 3
"""Sweeps over the coils for their dry friction; each reduces the error to a tenth or less, as a
coil's friction moves another one through the handle by less than a tenth of its own."""


@dataclass(frozen=True)
class ThreeAxisParameters(HeldRigParameters):
    """Parameters of the simulated master with three equal coils."""

    body: BodyParameters = field(default_factory=BodyParameters)
    coils: CoilMounting = field(default_factory=CoilMounting)
    mounts: SensorMounts = field(default_factory=SensorMounts)


class ThreeAxisRig(HeldRig):
    """Master whose handle moves and turns under three coils.

    The hand holds the handle against translation and rotation, and leads it along x and z. The arm
    pulls at the centre of mass. All turns are small. Without tilts and offsets, each axis is that
    of `MasterRig`.

    Parameters
    ----------
    parameters : ThreeAxisParameters
    rate : float
        Sampling rate, Hz.
    seed : int
        Seed of the accelerometers' noise and of the user's grip.
    hand : Hand, optional
        Hand that replaces the scripted one.

    Raises
    ------
    ParameterError
        The handle is lighter than two coils.
    """

    AXES = ALL_AXES
    HAND = (HAND_X, HAND_Z, HAND_V_X, HAND_V_Z)
    HAND_INPUTS = (HAND_A_X, HAND_A_Z)
    FORCES = COILS
    GRAVITY = FALL

    _p: ThreeAxisParameters
    _accelerometer: VectorAccelerometer

    def __init__(
        self,
        parameters: ThreeAxisParameters,
        rate: float,
        seed: int = 0,
        hand: Hand | None = None,
    ) -> None:
        body = parameters.body
        self._accelerometer = VectorAccelerometer(
            parameters.accelerometer, self.AXES, seed, NOISE_STREAM
        )
        self._sensor = rotation(body.sensor_axis, body.sensor_rotation).T
        super().__init__(parameters, rate, seed, hand)

    @property
    def travel(self) -> Vector:
        """Displacement of each coil between its stops, m."""
        return vector(self._system.state[TRAVEL])

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""
        state = self._system.state
        x, y, z = (state[LOW_PASSED] + self._held).tolist()
        low_passed = [a * x + b * y + c * z for a, b, c in self._sensor.tolist()]
        return self._p.arm.reading(
            vector(state[PLACE]),
            vector(state[SPEED]),
            self._accelerometer.measure(low_passed, noisy=self._started),
        )

    def apply_actuator_force(self, force: Vector) -> None:
        """Set the coils' forces, N, each rounded and limited by its converter and amplifier.

        NaN sets a force to zero.
        """
        self._command([self._drive(coil, each) for coil, each in enumerate(force)])

    def change_mount(self, mount: MountParameters) -> None:
        """Change the accelerometer's mount, along all axes, without a jump of the motion."""
        self._p = replace(self._p, mounts=SensorMounts(mount, mount, mount))
        self.change_grip(self.handle)

    def response(
        self, frequency: npt.ArrayLike, rate: float, coupling: float = 0.0
    ) -> ComplexArray:
        """Return the exact response of the sampled acceleration to the held coil forces.

        Parameters
        ----------
        frequency : array_like, shape (f,)
            Hz, above 0 and below half the rate.
        rate : float
            Samples per second.
        coupling : float
            Stiffness of the coupling to the slave, N/m.

        Returns
        -------
        ndarray, shape (f, 3, 3)
            m/s^2 per N; the first index after the frequency is the axis of the acceleration, the
            second that of the coil.
        """
        a, b = self._mechanics(coupling)
        drive = self._p.drive
        along = held_response(a, b[:, COILS], LOW_PASSED, frequency, rate, drive.delay)
        return np.asarray(drive.force_scale * self._sensor @ along)

    def energy(self) -> float:
        """Return kinetic and spring energy of handle, coils, grip and stops, J."""
        state = self._system.state
        rates = np.concatenate([state[SPEED], state[SPIN], state[SLIP]])
        stretched = self._coordinates() - self._hand_coordinates()
        kinetic = rates @ mass_matrix(self.handle, self._p.body, self._p.coils) @ rates / 2
        springs = self._stiffness @ stretched**2 / 2
        stops = (
            stop.energy(offset) for stop, offset in zip(self._stops, self.travel, strict=True)
        )
        return float(kinetic + springs + sum(stops))

    def disturb(self, handle: Vector = ZERO, coils: Vector = ZERO, spin: Vector = ZERO) -> None:
        """Set velocities of handle and of the coils relative to it, m/s, and its spin, rad/s."""
        self._started = True
        state = self._system.state
        state[SPEED], state[SLIP], state[SPIN] = handle, coils, spin

    def _mechanics(self, coupling: float = 0.0) -> tuple[FloatArray, FloatArray]:
        p = self._p
        corner = p.accelerometer.bandwidth
        return three_axis_mechanics(self.handle, p.body, p.coils, p.mounts, corner, coupling)

    def _build_mechanics(self) -> None:
        h, drive = self.handle, self._p.drive
        self._system = LinearSystem(*self._mechanics(), self._step, self._longest)
        self._stiffness, _ = stiffness_and_damping(h, self._p.body)
        # A sensor that is held against gravity measures it as an upward acceleration.
        self._held = np.array([0.0, 0.0, self._p.grip.gravity])
        self._friction = drive.coulomb_friction
        self._friction_steps = self._friction_time(1 / (1 / h.m_a + 1 / h.m_h))
        # By the number of steps: responses to units of friction, and the travels among them.
        self._rubbed = np.stack(
            [self._system.step_response(each) for each in range(BETWEEN.start, BETWEEN.stop)],
            axis=1,
        )
        self._rubbed_travels = self._rubbed[:, :, TRAVEL].transpose(0, 2, 1).tolist()

    def _rest(self) -> None:
        """Set the state of equilibrium of hand, springs and gravity."""
        self._set_hand(*self._hand(self._now))
        state, gravity = self._system.state, self._p.grip.gravity
        self._system.inputs[FALL] = -gravity
        p = self._p
        weight = -gravity * mass_matrix(self.handle, p.body, p.coils)[:, PLACE.stop - 1]
        sag = np.divide(weight, self._stiffness, np.zeros(9), where=self._stiffness > 0)
        state[PLACE], state[TURN], state[TRAVEL] = np.split(self._hand_coordinates() + sag, 3)
        state[BENT] = sensed_motion(p.body) @ self._coordinates()

    def _coordinates(self) -> FloatArray:
        state = self._system.state
        return np.concatenate([state[PLACE], state[TURN], state[TRAVEL]])

    def _hand_coordinates(self) -> FloatArray:
        """Return the coordinates of the handle at which no spring is stretched."""
        state, displacement = self._system.state, np.zeros(9)
        displacement[0], displacement[2] = state[HAND_X], state[HAND_Z]
        return displacement

    def _pull(self, x: float, y: float, z: float) -> bool:
        self._system.inputs[ARM] = x, y, z
        return bool(x or y or z)

    def _move(self, steps: int) -> int:
        """Advance the mechanics by at most `steps`; return the number of steps advanced."""
        state = self._system.state
        offsets, slips = state[TRAVEL].tolist(), state[SLIP].tolist()
        for coil, stop in enumerate(self._stops):
            if stop.near(offsets[coil], slips[coil], steps):
                steps = min(steps, STOP_STEPS)
                push = stop.force(offsets[coil], slips[coil])
                self._system.inputs[BETWEEN.start + coil] = push
        if self._friction:
            self._rub(offsets, steps)
        else:
            self._system.advance(steps)
        return steps

    def _rub(self, offsets: list[float], steps: int) -> None:
        """Advance by a number of steps with constant dry friction in each coil.

        As in `MasterRig`, the friction follows the mean slip, including its own effect and, by
        projected Gauss-Seidel sweeps, that of the other coils' friction.
        """
        free = self._system.after(steps)
        travels = self._rubbed_travels[steps - 1]
        moved = [end - start for end, start in zip(free[TRAVEL].tolist(), offsets, strict=True)]
        creep = self._p.drive.slip_velocity * steps * self._step / self._friction
        friction = [0.0, 0.0, 0.0]
        for _ in range(FRICTION_SWEEPS):
            for coil, own in enumerate(travels):
                x, y, z = friction
                left = moved[coil] - own[0] * x - own[1] * y - own[2] * z
                sticking = friction[coil] + (left - creep * friction[coil]) / (own[coil] + creep)
                friction[coil] = min(self._friction, max(-self._friction, sticking))
        x, y, z = self._rubbed[steps - 1]
        rubbed = friction[0] * x + friction[1] * y + friction[2] * z
        np.subtract(free, rubbed, self._system.state)
