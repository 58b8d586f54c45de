# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Linear mechanics of a handle with three coils: rigid body, hand, coils and accelerometer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.model import FloatArray, HandleParameters, MountParameters
from haptic_accel.core.parameters import Checked, ParameterError, parameter

# Order of states and inputs. Position and velocity of the handle's centre of mass, its rotation,
# each coil's displacement from the handle along its own line, the hand along x and z, the
# accelerometer's low-pass, and position and velocity of its mount.
PLACE, TURN, TRAVEL = slice(0, 3), slice(3, 6), slice(6, 9)
SPEED, SPIN, SLIP = slice(9, 12), slice(12, 15), slice(15, 18)
HAND_X, HAND_Z, HAND_V_X, HAND_V_Z = range(18, 22)
LOW_PASSED, BENT, BENDING = slice(22, 25), slice(25, 28), slice(28, 31)
STATES = 31
COILS, BETWEEN, ARM = slice(0, 3), slice(3, 6), slice(6, 9)
HAND_A_X, HAND_A_Z, FALL = 9, 10, 11
INPUTS = 12

_BODY, _RATES = slice(0, 9), slice(9, 18)  # all coordinates of the bodies, and their velocities


def _sensor(position: float, reason: str = "assumed") -> Any:
    text = f"position of the accelerometer from the centre of mass ({reason})"
    return parameter(position, text, "m", -0.2, 0.2)


GYRATION_RADIUS = 0.030
"""Radius of gyration of handle and hand, m (assumed: a rod of 0.1 m has 0.029 m)."""

GRIP_WIDTH = 0.040
"""Distance of the fingers on the handle, m (assumed: a stylus between thumb and two fingers)."""


@dataclass(frozen=True)
class BodyParameters(Checked):
    """Accelerometer on the rigid handle."""

    sensor_x: float = _sensor(0.006)
    sensor_y: float = _sensor(-0.004)
    sensor_z: float = _sensor(0.020, "assumed: at the stylus' end of the coils")
    sensor_axis: str = parameter(
        "y", "axis of an unknown rotation of the accelerometer", choices=NAMES
    )
    sensor_rotation: float = parameter(0.0, "angle of this rotation", "rad", -math.pi, math.pi)


@dataclass(frozen=True)
class CoilMounting:
    """Directions and positions of the coils on the handle.

    Each coil is tilted, in rad, from its own axis towards the next one (x, y, z, x), and its line
    of action passes the centre of mass at a distance, in m, along the axis after that. The
    defaults, which are assumed, give a cross-coupling of -10 dB.
    """

    tilt_x: float = 0.26
    tilt_y: float = 0.31
    tilt_z: float = 0.22
    offset_x: float = 0.004
    offset_y: float = 0.006
    offset_z: float = 0.005

    @property
    def directions(self) -> FloatArray:
        """Unit vectors of the coils as columns, shape (3, 3)."""
        tilts = self.tilt_x, self.tilt_y, self.tilt_z
        return np.stack(
            [math.cos(t) * _AXES[k] + math.sin(t) * _AXES[k - 2] for k, t in enumerate(tilts)],
            axis=1,
        )

    @property
    def positions(self) -> FloatArray:
        """Points of the lines of action nearest to the centre of mass as columns, m, (3, 3)."""
        offsets = self.offset_x, self.offset_y, self.offset_z
        return np.stack([offset * _AXES[k - 1] for k, offset in enumerate(offsets)], axis=1)


_AXES = np.eye(3)


@dataclass(frozen=True)
class SensorMounts:
    """Light, elastic mount of the accelerometer: a mode along each axis of the handle.

    The mode is between sensor and handle, as in the rig with one coil, whose fitted mode is that
    of bracket and stylus. A bracket bends more easily than it is compressed.
    """

    x: MountParameters = field(default_factory=MountParameters)
    y: MountParameters = field(default_factory=MountParameters)
    z: MountParameters = field(default_factory=MountParameters)


def mass_matrix(handle: HandleParameters, coils: CoilMounting) -> FloatArray:
    """Return the mass matrix of position, rotation and coils, (9, 9), in kg, kg m and kg m^2.

    As in eq. (2) of the paper, the mass m_h is that of everything which moves with the handle
    along an axis while one coil moves freely: it contains the two other coils.

    Raises
    ------
    ParameterError
        The handle is lighter than two coils.
    """
    rigid = handle.m_h - 2 * handle.m_a
    if rigid <= 0:
        raise ParameterError(
            f"m_h = {handle.m_h:g}: must be above {2 * handle.m_a:g} kg, the mass of two coils,"
            " which move with the handle"
        )
    mass = np.zeros((9, 9))
    mass[PLACE, PLACE] = rigid * np.eye(3)
    mass[TURN, TURN] = handle.m_h * GYRATION_RADIUS**2 * np.eye(3)
    mounted = zip(coils.directions.T, coils.positions.T, strict=True)
    for coil, (direction, position) in enumerate(mounted):
        moved = np.zeros((3, 9))  # motion of the coil's centre by all coordinates
        moved[:, PLACE], moved[:, TURN] = np.eye(3), -_cross(position)
        moved[:, TRAVEL.start + coil] = direction
        mass += handle.m_a * moved.T @ moved
    return mass


def stiffness_and_damping(handle: HandleParameters) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and damping of position, rotation and coils, each of shape (9,).

    Half of the grip acts at each end of its width. Units are N/m and N s/m, and for the rotation N
    m/rad and N m s/rad.
    """
    gripped = np.repeat((1.0, (GRIP_WIDTH / 2) ** 2, 0.0), 3)
    suspended = np.repeat((0.0, 0.0, 1.0), 3)
    return (
        handle.k_u * gripped + handle.k_s * suspended,
        handle.b_u * gripped + handle.b_s * suspended,
    )


def sensed_motion(body: BodyParameters) -> FloatArray:
    """Return the matrix from position, rotation and coils to the accelerometer's point, (3, 9)."""
    sensed = np.zeros((3, 9))
    sensed[:, PLACE] = np.eye(3)
    sensed[:, TURN] = -_cross(np.array([body.sensor_x, body.sensor_y, body.sensor_z]))
    return sensed


def three_axis_mechanics(
    handle: HandleParameters,
    body: BodyParameters,
    coils: CoilMounting,
    mounts: SensorMounts,
    corner: float,
    coupling: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return A and B of x' = A x + B u for small rotations, from Lagrange's equations.

    The module's constants are the indices of states and inputs: forces of the coils and between
    coil and handle, N, those of the arm, accelerations of the hand and of gravity, m/s^2. As in
    eq. (1), a coil's force pushes the handle along the coil's direction, and the coil the other
    way. The acceleration is that of the accelerometer's motion along the axes of the handle, after
    its low-pass.

    Parameters
    ----------
    handle : HandleParameters
        Coils with their suspension, handle and grip. The grip is the same along all axes, and
        holds the handle at two points on both sides of its centre of mass.
    body : BodyParameters
    coils : CoilMounting
    mounts : SensorMounts
    corner : float
        Corner of the accelerometer's first-order low-pass, Hz.
    coupling : float
        Stiffness of the coupling to the slave at the centre of mass, N/m.
    """
    a, b = np.zeros((STATES, STATES)), np.zeros((STATES, INPUTS))
    a[_BODY, _RATES] = np.eye(9)
    inverse_mass = np.linalg.inv(mass_matrix(handle, coils))
    stiffness, damping = stiffness_and_damping(handle)
    stiffness[PLACE] += coupling
    a[_RATES, _BODY], a[_RATES, _RATES] = -inverse_mass * stiffness, -inverse_mass * damping
    for axis, position, speed, driven in (
        (0, HAND_X, HAND_V_X, HAND_A_X),
        (2, HAND_Z, HAND_V_Z, HAND_A_Z),
    ):
        a[position, speed] = b[speed, driven] = 1.0
        a[_RATES, position] = handle.k_u * inverse_mass[:, axis]
        a[_RATES, speed] = handle.b_u * inverse_mass[:, axis]
    b[_RATES, COILS], b[_RATES, BETWEEN] = -inverse_mass[:, TRAVEL], inverse_mass[:, TRAVEL]
    b[_RATES, ARM] = inverse_mass[:, PLACE]
    b[SPEED.start + 2, FALL] = 1.0
    # Where the mount is rigid, it moves with its point on the handle.
    sensed = sensed_motion(body)
    a[BENT, BENDING] = np.eye(3)
    a[BENDING], b[BENDING] = sensed @ a[_RATES], sensed @ b[_RATES]
    for axis, mode in enumerate((mounts.x, mounts.y, mounts.z)):
        if mode.frequency:
            a[BENDING.start + axis] = _bent(axis, mode, sensed[axis])
            b[BENDING.start + axis] = 0.0
    omega = 2 * np.pi * corner
    a[LOW_PASSED], b[LOW_PASSED] = omega * a[BENDING], omega * b[BENDING]
    a[LOW_PASSED, LOW_PASSED] -= omega * np.eye(3)
    return a, b


def _bent(axis: int, mode: MountParameters, sensed: FloatArray) -> FloatArray:
    """Return the acceleration of a mode between handle and accelerometer by all states.

    As in `mechanics`, the mass of the mode is neglected.
    """
    own = 2 * np.pi * mode.frequency
    acceleration = np.zeros(STATES)
    acceleration[_BODY], acceleration[_RATES] = own**2 * sensed, 2 * mode.damping * own * sensed
    acceleration[BENT.start + axis] = -(own**2)
    acceleration[BENDING.start + axis] = -2 * mode.damping * own
    return acceleration


def rotation(axis: str, angle: float) -> FloatArray:
    """Return the matrix of a rotation about x, y or z by an angle in rad, shape (3, 3).

    Examples
    --------
    >>> rotation("z", math.pi / 2).round() @ (1, 0, 0)
    array([0., 1., 0.])
    """
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler(axis, angle).as_matrix())


def _cross(vector: FloatArray) -> FloatArray:
    """Return the matrix of the cross product of a vector with another."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
