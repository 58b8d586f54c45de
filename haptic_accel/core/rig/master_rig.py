"""The master of the virtual rig: hand, handle, voice coil, arm and accelerometer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.coupling import Vector
from haptic_accel.core.model import FloatArray, HandleParameters
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.rig.exploration import TABLE_STEP, Exploration, ExplorationParameters
from haptic_accel.core.rig.instruments import (
    Accelerometer,
    AccelerometerParameters,
    ArmParameters,
    Quantizer,
)
from haptic_accel.core.rig.interface import LONGEST_ADVANCE, Sample
from haptic_accel.core.rig.linear_system import LinearSystem

RESOLUTION = 10e-6
"""Steps of time in which commands take effect, s; the linear mechanics has no step error."""

STOP_STEPS = 5
"""Steps between looks at the travel stops when one is near (50 us)."""

NOISE_STREAM = 1
"""Keeps this accelerometer's noise apart from the slave's, which may have the same seed."""

# Order of states and inputs of the linear mechanics.
Y_A, V_A, Y_H, V_H, Y_U, V_U, MEASURED, X_H, VX_H, X_U, VX_U = range(11)
F_A, F_Z, F_X, A_U, AX_U, F_STOP = range(6)


@dataclass(frozen=True)
class ActuatorParameters(Checked):
    """The voice coil H2W NCM02-05-005-4JB behind a 14-bit converter, as in the paper."""

    peak_force: float = parameter(6.6, "limit of its force", unit="N", low=0, above=True)
    bits: int = parameter(14, "resolution of the command", low=4, high=32)
    travel: float = parameter(
        3.8e-3, "free travel either way", unit="m", low=0, high=0.1, above=True
    )
    stop_stiffness: float = parameter(
        3e4, "stiffness of the travel stops (assumed: rubber)", unit="N/m", low=0, high=1e5
    )
    stop_damping: float = parameter(
        10.0, "damping of the travel stops (assumed)", unit="N s/m", low=0, high=20.0
    )


@dataclass(frozen=True)
class MasterRigParameters:
    """All parameters of the simulated master."""

    handle: HandleParameters = field(default_factory=HandleParameters)
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    exploration: ExplorationParameters = field(default_factory=ExplorationParameters)


class MasterRig:
    """Eq. (1) and (2) of the paper along the actuator's axis (z), a mass along x.

    Linear between commands and advanced exactly; only the travel stops are not linear, and
    are looked at every 50 us when one is within reach. The hand rests until the arm gets its
    first force (the coupling is alive), then starts to explore.

    Parameters
    ----------
    parameters : MasterRigParameters
    rate : float
        Samples per second at which it is read.
    seed : int
        Of the accelerometer's noise.

    """

    def __init__(self, parameters: MasterRigParameters, rate: float, seed: int = 0) -> None:
        self._p = parameters
        period = 1.0 / rate
        self._step = period / max(1, math.ceil(period / RESOLUTION))
        self._stall = round(LONGEST_ADVANCE / self._step)
        self._longest = min(round(period / self._step), round(TABLE_STEP / self._step))
        self._system = LinearSystem(*_mechanics(parameters), self._step, self._longest)
        self._exploration = Exploration(parameters.exploration)
        self._accelerometer = Accelerometer(parameters.accelerometer, seed, NOISE_STREAM)
        self._converter = Quantizer(parameters.actuator.peak_force, parameters.actuator.bits)
        self._now = 0
        self._explored_since: int | None = None
        self._touching = False
        self._stop_hits = 0
        self._place_hand()
        state = self._system.state
        state[Y_H] = state[Y_A] = state[Y_U]
        state[X_H] = state[X_U]

    @property
    def travel(self) -> float:
        """Where the actuator is between its stops, m."""
        state = self._system.state
        return float(state[Y_A] - state[Y_H])

    def advance(self, time: float) -> None:
        """Let physics run until a time in s; a time that has passed changes nothing."""
        due = round(time / self._step) - self._now
        if due > self._stall:
            skipped = due - self._stall
            self._now += skipped
            if self._explored_since is not None:
                self._explored_since += skipped
            due = self._stall
        while due > 0:
            steps = self._step_limit(due)
            self._advance(steps)
            due -= steps

    def measure(self) -> Sample:
        """Return what encoders and accelerometer say now."""
        state = self._system.state
        encoded = self._p.arm.encoded
        return Sample(
            position=(encoded(float(state[X_H])), 0.0, encoded(float(state[Y_H]))),
            velocity=(float(state[VX_H]), 0.0, float(state[V_H])),
            acceleration=self._accelerometer.measure(float(state[MEASURED])),
        )

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N, each axis up to their limit."""
        if self._explored_since is None:
            self._explored_since = self._now
        inputs, motor_force = self._system.inputs, self._p.arm.motor_force
        inputs[F_X], inputs[F_Z] = motor_force(force[0]), motor_force(force[2])

    def apply_actuator_force(self, force: float) -> None:
        """Set the voice coil's force, N, as its converter and amplifier can give it.

        NaN takes the force off.
        """
        self._system.inputs[F_A] = self._converter.convert(0.0 if math.isnan(force) else force)

    def release(self) -> None:
        """Take all forces off."""
        self.apply_actuator_force(0.0)
        self._system.inputs[[F_X, F_Z]] = 0.0

    def status(self) -> dict[str, int]:
        """Return counts of saturated samples and commands, and of travel stops hit."""
        return {
            "accelerometer_saturated": self._accelerometer.saturated,
            "actuator_saturated": self._converter.saturated,
            "travel_stops_hit": self._stop_hits,
        }

    def energy(self) -> float:
        """Return kinetic and spring energy of handle, actuator, grip and stops, J."""
        h = self._p.handle
        y_a, v_a, y_h, v_h, y_u = self._system.state[[Y_A, V_A, Y_H, V_H, Y_U]]
        x_h, vx_h, x_u = self._system.state[[X_H, VX_H, X_U]]
        overrun = max(0.0, abs(y_a - y_h) - self._p.actuator.travel)
        kinetic = h.m_a * v_a**2 + h.m_h * v_h**2 + (h.m_a + h.m_h) * vx_h**2
        springs = h.k_s * (y_a - y_h) ** 2 + h.k_u * ((y_h - y_u) ** 2 + (x_h - x_u) ** 2)
        return float(kinetic + springs + self._p.actuator.stop_stiffness * overrun**2) / 2

    def disturb(self, handle_velocity: float = 0.0, actuator_velocity: float = 0.0) -> None:
        """Set velocities along the actuator's axis, m/s: a blow, for tests and experiments."""
        self._system.state[V_H] = handle_velocity
        self._system.state[V_A] = actuator_velocity

    def _step_limit(self, due: int) -> int:
        """How many steps may pass before hand and travel stops must be looked at again."""
        steps = min(due, self._longest)
        state = self._system.state
        offset = state[Y_A] - state[Y_H]
        reach = abs(offset) + 2 * abs(state[V_A] - state[V_H]) * steps * self._step
        return min(steps, STOP_STEPS) if reach > self._p.actuator.travel / 2 else steps

    def _advance(self, steps: int) -> None:
        system = self._system
        system.inputs[F_STOP] = self._stop_force()
        self._place_hand()
        ahead = self._hand(self._now + steps)
        duration = steps * self._step
        system.inputs[A_U] = (ahead[3] - system.state[V_U]) / duration
        system.inputs[AX_U] = (ahead[2] - system.state[VX_U]) / duration
        system.advance(steps)
        self._now += steps

    def _place_hand(self) -> None:
        state = self._system.state
        state[X_U], state[Y_U], state[VX_U], state[V_U] = self._hand(self._now)

    def _hand(self, now: int) -> tuple[float, float, float, float]:
        if self._explored_since is None:
            return self._exploration.at(0.0)
        return self._exploration.at((now - self._explored_since) * self._step)

    def _stop_force(self) -> float:
        """Force of a travel stop on the actuator's mass, N; zero in free travel."""
        state, p = self._system.state, self._p.actuator
        offset = float(state[Y_A] - state[Y_H])
        overrun = abs(offset) - p.travel
        touching = overrun > 0
        if touching and not self._touching:
            self._stop_hits += 1
        self._touching = touching
        if not touching:
            return 0.0
        outward = math.copysign(1.0, offset) * float(state[V_A] - state[V_H])
        # The force is held for a while: that of its middle gives back no more than it took.
        held = STOP_STEPS * self._step
        push = p.stop_stiffness * (overrun + outward * held / 2) + p.stop_damping * outward
        push = max(0.0, push)
        return -math.copysign(push, offset)


def _mechanics(parameters: MasterRigParameters) -> tuple[FloatArray, FloatArray]:
    """Return A and B of the linear mechanics, eq. (1) and (2) of the paper in the time domain."""
    h = parameters.handle
    a, b = np.zeros((11, 11)), np.zeros((11, 6))
    for position, velocity in ((Y_A, V_A), (Y_H, V_H), (Y_U, V_U), (X_H, VX_H), (X_U, VX_U)):
        a[position, velocity] = 1.0
    bearing = np.zeros(11)  # force of spring and bearing on the handle
    bearing[[Y_A, Y_H, V_A, V_H]] = h.k_s, -h.k_s, h.b_s, -h.b_s
    grip = np.zeros(11)  # force of the hand on the handle
    grip[[Y_U, Y_H, V_U, V_H]] = h.k_u, -h.k_u, h.b_u, -h.b_u
    grip_x = np.zeros(11)
    grip_x[[X_U, X_H, VX_U, VX_H]] = h.k_u, -h.k_u, h.b_u, -h.b_u
    a[V_A] = -bearing / h.m_a
    b[V_A, [F_A, F_STOP]] = -1 / h.m_a, 1 / h.m_a
    a[V_H] = (bearing + grip) / h.m_h
    b[V_H, [F_A, F_STOP, F_Z]] = 1 / h.m_h, -1 / h.m_h, 1 / h.m_h
    a[VX_H] = grip_x / (h.m_a + h.m_h)
    b[VX_H, F_X] = 1 / (h.m_a + h.m_h)
    b[V_U, A_U] = b[VX_U, AX_U] = 1.0
    # The accelerometer's first-order low-pass of the handle's acceleration.
    corner = 2 * np.pi * parameters.accelerometer.bandwidth
    a[MEASURED] = corner * a[V_H]
    a[MEASURED, MEASURED] = -corner
    b[MEASURED] = corner * b[V_H]
    return a, b
