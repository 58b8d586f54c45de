# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Masters of the virtual rig: hand, handle with one coil or three, arm and accelerometer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from haptic_accel.core import model
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.handle import mechanics as one
from haptic_accel.core.handle import three_axis as three
from haptic_accel.core.handle.mechanics import held_response
from haptic_accel.core.handle.three_axis import BodyParameters, CoilMounting, SensorMounts
from haptic_accel.core.model import ZERO, AccelerometerParameters, ComplexArray, FloatArray, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.rig import ArmParameters, Rig, accelerometers
from haptic_accel.core.tick import rigs as simulated

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
        0.0, "delay from command to force after the hold: converter, amplifier", "s", 0, 0.02
    )
    force_scale: float = parameter(
        1.0, "ratio of force to commanded force; negative: wires swapped", low=-2.0, high=2.0
    )
    coulomb_friction: float = parameter(0.0, "dry friction of the actuator's bearing", "N", 0, 1.0)
    slip_velocity: float = parameter(
        2e-3, "slip velocity above which dry friction is constant", "m/s", 2e-3, 1.0
    )


@dataclass(frozen=True)
class ExplorationParameters(Checked):
    """Cycle of the scripted hand: approach, press, strokes back and forth, lift."""

    height: float = parameter(0.010, "height of the hand above the surface at rest", "m", 0.0, 0.1)
    approach_time: float = parameter(
        0.6, "time of the hand's approach to the surface, and of its lift", "s", 0.1, 10.0
    )
    # Through the coupling's 250 N/m and the grip's 1500 N/m in series.
    press_depth: float = parameter(
        0.0047, "depth of the hand's set-point below the surface: about 1 N", "m", 0.0, 0.1
    )
    stroke_speed: float = parameter(0.1, "speed of a stroke along the surface", "m/s", 0, 1.0)
    stroke_length: float = parameter(0.08, "length of a stroke along the surface", "m", 0.001, 1.0)
    turn_time: float = parameter(0.15, "time of the turn between two strokes", "s", 0.02, 5.0)
    strokes: int = parameter(4, "number of strokes before the tool is lifted", low=1, high=1000)
    pause: float = parameter(0.2, "rest of the hand after each lift", "s", 0.0, 60.0)


@dataclass(frozen=True)
class HeldRigParameters:
    """Parameters of a simulated handle with any number of coils."""

    handle: model.HandleParameters = field(default_factory=model.HandleParameters)
    grip: model.GripParameters = field(default_factory=model.GripParameters)
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    drive: DriveParameters = field(default_factory=DriveParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    exploration: ExplorationParameters = field(default_factory=ExplorationParameters)


@dataclass(frozen=True)
class MasterRigParameters(HeldRigParameters):
    """Parameters of the simulated master."""

    mount: model.MountParameters = field(default_factory=model.MountParameters)
    second: model.ModeParameters = field(default_factory=model.ModeParameters)


@dataclass(frozen=True)
class SimulatedMasterParameters(MasterRigParameters, Checked):
    """Parameters of the simulated master, with one coil or with three."""

    axes: str = parameter("z", "axes of coils and accelerometer: z, or x, y, z")
    body: BodyParameters = field(default_factory=BodyParameters)
    coils: ClassVar[CoilMounting] = CoilMounting()
    mounts: SensorMounts = field(default_factory=SensorMounts)

    def __post_init__(self) -> None:
        """Check all fields; the axes must be those of one coil or of three."""
        super().__post_init__()
        if Axes.parsed(self.axes) not in (ACTUATOR_AXES, ALL_AXES):
            raise ParameterError(f"axes = {self.axes}: must be z, or x, y, z")


class HeldRig(Rig, ABC):
    """Handle with linear mechanics in a hand that guides it; see `HeldArm`.

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

    ARM: ClassVar[Callable[..., simulated.HeldArm]]
    """Class of the arm's motion."""
    AXES: ClassVar[Axes]
    """Axes of coils and accelerometer."""
    GRAVITY: ClassVar[int]
    """Index of gravity among the inputs."""

    _p: HeldRigParameters

    def __init__(
        self,
        parameters: HeldRigParameters,
        rate: float,
        seed: int = 0,
        hand: simulated.Hand | None = None,
    ) -> None:
        leading = hand or scripted_hand(parameters.exploration)
        sensors = accelerometers(parameters.accelerometer, self.AXES, seed, NOISE_STREAM)
        motion = self._arm = self.ARM(parameters, rate, leading, list(filter(None, sensors)))
        super().__init__(motion)
        self._p, self._seed = parameters, seed
        self._state, self._inputs = np.split(motion.joint, [len(motion.state)])
        self._start = leading.x, leading.z, leading.v_x, leading.v_z
        self.hold(parameters.grip)

    @abstractmethod
    def _mechanics(self) -> tuple[FloatArray, FloatArray]:
        """Return A and B of the mechanics with the present grip."""

    @abstractmethod
    def _rub(self, responses: FloatArray) -> None:
        """Set the responses of the state to friction in each coil.

        Parameters
        ----------
        responses : ndarray, shape (longest, m, n)
            State after 1, 2, ... steps of one unit of each input.
        """

    @abstractmethod
    def _rest(self, state: FloatArray) -> None:
        """Set the state of equilibrium of hand, springs and gravity, for a hand at rest."""

    def change_grip(self, handle: model.HandleParameters) -> None:
        """Change the parameters of the handle from now on, without a jump of the motion."""
        self.handle = handle
        motion, drive = self._arm, self._p.drive
        columns = motion.transitions = transitions(*self._mechanics(), motion.step, motion.longest)
        states, size = len(motion.state), len(motion.joint)
        self._rub(columns.reshape(-1, size, states)[:, states:])
        if drive.coulomb_friction:
            # Number of steps within which constant friction does not reverse a slip.
            reduced_mass = 1 / (1 / handle.m_a + 1 / handle.m_h)
            relaxation = reduced_mass * drive.slip_velocity / drive.coulomb_friction
            motion.friction_steps = max(1, int(min(motion.longest, relaxation / motion.step)))
        resting = np.zeros(states)
        self._rest(resting)
        motion.resting = resting
        if not motion.started:
            self._state[:] = resting

    def hold(self, grip: model.GripParameters) -> None:
        """Change the grip of the same user from now on."""
        self._p = replace(self._p, grip=grip)
        self._inputs[self.GRAVITY] = -grip.gravity
        self._arm.gravity = grip.gravity
        self.change_grip(model.held(self._p.handle, grip, self._seed))

    def counters(self) -> dict[str, int]:
        """Return counts of saturated samples and commands, and of contacts with travel stops."""
        coils = self._arm.coils
        return {
            "accelerometer_saturated": sum(each.accelerometer.saturated for each in coils),
            "actuator_saturated": sum(each.converter.saturated for each in coils),
            "travel_stops_hit": sum(each.hits for each in coils),
        }


class MasterRig(HeldRig):
    """Master: eq. (1) and (2) of the paper along the actuator axis z, a mass along x.

    Parameters as for `HeldRig`.
    """

    ARM = simulated.OneCoil
    AXES = ACTUATOR_AXES
    GRAVITY = one.G

    _p: MasterRigParameters

    @property
    def travel(self) -> float:
        """Displacement of the actuator between its stops, m."""
        return float(self._state[one.Y_A] - self._state[one.Y_H])

    def change_mount(self, mount: model.MountParameters) -> None:
        """Change the accelerometer's mount from now on, without a jump of the motion."""
        self._p = replace(self._p, mount=mount)
        self.change_grip(self.handle)

    def energy(self) -> float:
        """Return kinetic and spring energy of handle, actuator, grip and stops, J."""
        h = self.handle
        y_a, v_a, y_h, v_h, y_u = self._state[[one.Y_A, one.V_A, one.Y_H, one.V_H, one.Y_U]]
        x_h, vx_h, x_u = self._state[[one.X_H, one.VX_H, one.X_U]]
        overrun = max(0.0, abs(y_a - y_h) - self._p.actuator.travel)
        kinetic = h.m_a * v_a**2 + h.m_h * v_h**2 + (h.m_a + h.m_h) * vx_h**2
        springs = h.k_s * (y_a - y_h) ** 2 + h.k_u * ((y_h - y_u) ** 2 + (x_h - x_u) ** 2)
        return float(kinetic + springs + self._p.drive.stop_stiffness * overrun**2) / 2

    def disturb(self, handle_velocity: float = 0.0, actuator_velocity: float = 0.0) -> None:
        """Set velocities along the actuator's axis, m/s: an impact for tests and experiments."""
        self._arm.started = True
        self._state[[one.V_H, one.V_A]] = handle_velocity, actuator_velocity

    def _mechanics(self) -> tuple[FloatArray, FloatArray]:
        p = self._p
        return one.mechanics(self.handle, p.mount, p.accelerometer.bandwidth, p.second)

    def _rub(self, responses: FloatArray) -> None:
        rubbed = self._arm.rubbed = responses[:, one.F_BETWEEN].copy()
        self._arm.travels = (rubbed[:, one.Y_A] - rubbed[:, one.Y_H]).tolist()

    def _rest(self, state: FloatArray) -> None:
        h, gravity = self.handle, self._p.grip.gravity
        state[[one.X_U, one.Y_U, one.VX_U, one.V_U]] = self._start
        sag = (h.m_a + h.m_h) * gravity / h.k_u if h.k_u else 0.0
        state[one.Y_H] = state[one.Y_M] = state[one.Y_U] - sag
        if self._p.second.frequency:
            state[one.Y_S] = state[one.Y_H]
        state[one.Y_A] = state[one.Y_H] - (h.m_a * gravity / h.k_s if h.k_s else 0.0)
        state[one.X_H] = state[one.X_U]


_COORDINATES = np.r_[three.PLACE, three.TURN, three.TRAVEL]
_RATES = np.r_[three.SPEED, three.SPIN, three.SLIP]


class ThreeAxisRig(HeldRig):
    """Master whose handle translates and rotates under three coils.

    The hand holds the handle against translation and rotation, and guides it along x and z. The
    arm pulls at the centre of mass. All rotations are small. Without tilts and offsets, each axis
    equals that of `MasterRig`.

    Parameters as for `HeldRig`.

    Raises
    ------
    ParameterError
        The handle is lighter than two coils.
    """

    ARM = simulated.ThreeCoils
    AXES = ALL_AXES
    GRAVITY = three.FALL

    _p: SimulatedMasterParameters

    @property
    def travel(self) -> Vector:
        """Displacement of each coil between its stops, m."""
        return model.vector(self._state[three.TRAVEL])

    def change_mount(self, mount: model.MountParameters) -> None:
        """Change the accelerometer's mount, along all axes, without a jump of the motion."""
        self._p = replace(self._p, mounts=SensorMounts(mount, mount, mount))
        self.change_grip(self.handle)

    def response(
        self, frequency: npt.ArrayLike, rate: float, coupling: float = 0.0
    ) -> ComplexArray:
        """Return the exact response of the sampled acceleration to coil forces (zero-order hold).

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
        a, b = self._coupled_mechanics(coupling)
        drive = self._p.drive
        along = held_response(a, b[:, three.COILS], three.LOW_PASSED, frequency, rate, drive.delay)
        body = self._p.body
        sensor = three.rotation(body.sensor_axis, body.sensor_rotation).T
        return np.asarray(drive.force_scale * sensor @ along)

    def energy(self) -> float:
        """Return kinetic and spring energy of handle, coils, grip and stops, J."""
        state, p, k_stop = self._state, self._p, self._p.drive.stop_stiffness
        rates, stretched = state[_RATES], state[_COORDINATES] - _hand_coordinates(state)
        kinetic = rates @ three.mass_matrix(self.handle, p.coils) @ rates / 2
        springs = self._stiffness @ stretched**2 / 2
        overrun = np.maximum(0.0, np.abs(state[three.TRAVEL]) - p.actuator.travel)
        return float(kinetic + springs + k_stop * (overrun @ overrun) / 2)

    def disturb(self, handle: Vector = ZERO, coils: Vector = ZERO, spin: Vector = ZERO) -> None:
        """Set velocities of handle and of the coils relative to it, m/s, and its spin, rad/s."""
        self._arm.started = True
        self._state[_RATES] = [*handle, *spin, *coils]

    def _coupled_mechanics(self, coupling: float) -> tuple[FloatArray, FloatArray]:
        p = self._p
        corner = p.accelerometer.bandwidth
        return three.three_axis_mechanics(self.handle, p.body, p.coils, p.mounts, corner, coupling)

    def _mechanics(self) -> tuple[FloatArray, FloatArray]:
        self._stiffness, _ = three.stiffness_and_damping(self.handle)
        return self._coupled_mechanics(0.0)

    def _rub(self, responses: FloatArray) -> None:
        rubbed = responses[:, three.BETWEEN]
        self._arm.rubbed = rubbed.reshape(-1, rubbed.shape[2]).copy()
        self._arm.travels = rubbed[:, :, three.TRAVEL].transpose(0, 2, 1).ravel().tolist()

    def _rest(self, state: FloatArray) -> None:
        p = self._p
        state[three.HAND_X : three.HAND_V_Z + 1] = self._start
        masses = three.mass_matrix(self.handle, p.coils)
        weight = -p.grip.gravity * masses[:, three.PLACE.stop - 1]
        sag = np.divide(weight, self._stiffness, np.zeros(9), where=self._stiffness > 0)
        state[_COORDINATES] = _hand_coordinates(state) + sag
        state[three.BENT] = three.sensed_motion(p.body) @ state[_COORDINATES]


def _hand_coordinates(state: FloatArray) -> FloatArray:
    """Return the coordinates of the handle at which no spring is stretched."""
    displacement = np.zeros(9)
    displacement[0], displacement[2] = state[three.HAND_X], state[three.HAND_Z]
    return displacement


def transitions(a: FloatArray, b: FloatArray, step: float, longest: int) -> FloatArray:
    """Return the exact transitions of x' = A x + B u over 1, 2, ... steps with constant inputs.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    step : float
        Duration of a step, s.
    longest : int
        Maximum number of steps.

    Returns
    -------
    ndarray, shape (longest (n + m), n)
        Columns of the transitions of states and inputs, one below the other.
    """
    # Imported here, as scipy.linalg is slow to import, and most nodes have no rig.
    from scipy.linalg import expm

    states, inputs = b.shape
    exponent = np.zeros((states + inputs, states + inputs))
    exponent[:states, :states] = a
    exponent[:states, states:] = b
    one = expm(exponent * step)
    power = np.eye(states + inputs)
    columns = []
    for _ in range(longest):
        power = power @ one
        columns.append(power[:states].T)
    return np.ascontiguousarray(np.concatenate(columns))


def axes_of(parameters: MasterRigParameters) -> Axes:
    """Return the axes of a simulated master."""
    if isinstance(parameters, SimulatedMasterParameters):
        return Axes.parsed(parameters.axes)
    return ACTUATOR_AXES


def simulated_master(
    parameters: MasterRigParameters, rate: float, seed: int = 0, hand: simulated.Hand | None = None
) -> MasterRig | ThreeAxisRig:
    """Return the simulated master with its number of coils; arguments as for `MasterRig`."""
    if isinstance(parameters, SimulatedMasterParameters) and axes_of(parameters) == ALL_AXES:
        return ThreeAxisRig(parameters, rate, seed, hand)
    return MasterRig(parameters, rate, seed, hand)


def scripted_hand(parameters: ExplorationParameters) -> simulated.ScriptedHand:
    """Return the hand that repeats the cycle of an exploration, at rest before 0."""
    velocity = _cycle(parameters)
    increments = (velocity[:-1] + velocity[1:]) * (simulated.HAND_STEP / 2)
    position = np.vstack([np.zeros(2), np.cumsum(increments, axis=0)])
    position[:, 1] += parameters.height
    return simulated.ScriptedHand(np.hstack([position, velocity]).ravel().tolist())


def _cycle(parameters: ExplorationParameters) -> FloatArray:
    """Return the velocities (x, z) of one cycle at the table's times."""
    travel = parameters.height + parameters.press_depth
    down = _minimum_jerk(parameters.approach_time, -travel)
    strokes = _strokes(parameters)
    still = np.zeros(_points(parameters.pause))
    along = np.concatenate([np.zeros(len(down)), strokes, np.zeros(len(down)), still, [0.0]])
    normal = np.concatenate([down, np.zeros(len(strokes)), -down, still, [0.0]])
    return np.stack([along, normal], axis=1)


def _minimum_jerk(duration: float, distance: float) -> FloatArray:
    """Return minimum-jerk velocities (Flash and Hogan 1985), without the last point."""
    points = _points(duration)
    s = np.arange(points) / points
    velocity = s**2 * (1 - s) ** 2
    return np.asarray(distance * velocity / (velocity.sum() * simulated.HAND_STEP))


def _strokes(parameters: ExplorationParameters) -> FloatArray:
    """Return the velocities of strokes back and forth with smooth turns, ending at the start."""
    turn = _points(parameters.turn_time)
    ramp = (1 - np.cos(np.pi * np.arange(turn) / turn)) / 2
    # A stroke's two half turns are cosine-shaped and cover 2/pi of the distance at full speed.
    cruise_time = parameters.stroke_length / max(parameters.stroke_speed, 1e-3)
    cruise = _points(max(0.0, cruise_time - parameters.turn_time * 2 / np.pi))
    profile = [ramp, np.ones(cruise)]
    direction = 1.0
    for _ in range(parameters.strokes - 1):
        profile.append(direction * (1 - 2 * ramp))
        direction = -direction
        profile.append(direction * np.ones(cruise))
    profile.append(direction * (1 - ramp))
    velocity = np.concatenate(profile)
    if parameters.strokes % 2:
        # An odd number of strokes ends at the far side: return without relevant pressure.
        velocity = np.concatenate([velocity, -velocity])
    # Remove the rounding of the ramps, so that the hand does not drift from cycle to cycle.
    return np.asarray(parameters.stroke_speed * (velocity - velocity.mean()))


def _points(duration: float) -> int:
    return round(duration / simulated.HAND_STEP)
