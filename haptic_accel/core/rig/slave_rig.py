# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slave of the virtual rig: an arm's tip dragged over a surface, with its accelerometer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from haptic_accel.core.model import AccelerometerParameters, FloatArray, Sample, Vector
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.rig.holding import Holding
from haptic_accel.core.rig.instruments import Accelerometer, ArmParameters
from haptic_accel.core.rig.interface import LONGEST_ADVANCE, clock_step
from haptic_accel.core.rig.surface import (
    PROFILE_POINTS,
    PROFILE_STEP,
    SurfaceParameters,
    height_profile,
)

PHYSICS_STEP = 100e-6
"""Longest step of the contact's integration, s; half of it changes results by less than 1 %."""


Vibrating: TypeAlias = Callable[[float, float], float]
"""Function that returns an acceleration from speed and normal force, sample by sample."""

NOISE_STREAM = 2
"""Random stream of the tool's accelerometer, independent of the master's of the same seed."""


@dataclass(frozen=True)
class ToolParameters(Checked):
    """The slave arm's tip."""

    mass: float = parameter(
        0.060,
        "apparent mass of arm and tool: 45 g of a Phantom Omni (its data sheet) and 15 g of tool",
        "kg",
        0.001,
        10.0,
    )
    viscous_friction: float = parameter(
        3.0, "damping of the arm's joints at the tip (assumed)", "N s/m", 0, 50.0
    )
    coulomb_friction: float = parameter(
        0.1, "dry friction of the joints at the tip (data sheet: below 0.26 N)", "N", 0, 5.0
    )
    slip_velocity: float = parameter(
        5e-3, "speed at which dry friction reaches 0.7 of its maximum", "m/s", 1e-3, 1.0
    )
    height: float = parameter(
        0.010, "height of the tip above the surface at the start", "m", 0, 0.1
    )


@dataclass(frozen=True)
class SlaveRigParameters:
    """All parameters of the simulated slave."""

    tool: ToolParameters = field(default_factory=ToolParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)


class SlaveRig:
    """A point mass with friction, driven by the arm's motors, touching a textured surface.

    The surface can only push (Hertz contact with Hunt-Crossley damping); harder pressing makes it
    stiffer and transmits more of the texture. The tip's height follows the profile at the speed
    of the stroke. It stands still until the arm receives its first force, and is put back to where
    it began when it has been let go.

    Parameters
    ----------
    parameters : SlaveRigParameters
    rate : float
        Samples per second at which it is read.
    seed : int
        Seed of the texture and the accelerometer's noise.
    recording : ndarray, optional
        Tool acceleration in m/s^2 at `rate`, played in a loop in place of the simulated one, from
        the first sample after the arm received its first force.
    physics_step : float
        Longest step of integration, s.
    texture : callable, optional
        As `change_surface` takes it.
    """

    def __init__(
        self,
        parameters: SlaveRigParameters,
        rate: float,
        seed: int = 0,
        recording: FloatArray | None = None,
        physics_step: float = PHYSICS_STEP,
        texture: Vibrating | None = None,
    ) -> None:
        self._p = parameters
        self._texture = texture
        self._rate = rate
        self._longest_step = physics_step
        self._accelerometer = Accelerometer(parameters.accelerometer, seed, NOISE_STREAM)
        self._seed = seed
        self._law = tip_law(parameters.tool, parameters.surface, seed)
        self._recording = None if recording is None else recording.tolist()
        self._corner = 2 * math.pi * parameters.accelerometer.bandwidth
        self._force_x = self._force_z = 0.0
        self._holding = Holding()
        self._clock_step = clock_step(rate)
        self._now = 0  # steps of the clock
        self._started = False
        self._played_since: int | None = None
        self._put_back()

    @property
    def contact_force(self) -> Vector:
        """Force of the surface on the tip, N."""
        motion = self._v_x, self._v_z, 0.0, 0.0
        *_, x, z, _, _ = self._law(self._x, self._z - self._lift, *motion)
        # High above the surface only the joints' friction is left.
        *_, free_x, free_z, _, _ = self._law(self._x, 1.0, *motion)
        mass = self._p.tool.mass
        return mass * (x - free_x), 0.0, mass * (z - free_z)

    def advance(self, time: float) -> None:
        """Integrate the physics until a time in s; a past time changes nothing."""
        passed = round(time / self._clock_step) - self._now
        if passed <= 0:
            return
        self._now += passed
        if self._started:
            due = min(passed * self._clock_step, LONGEST_ADVANCE)
            self._move(due)
            if self._holding.ends(due):
                self._put_back()

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""
        acceleration = self._tool_acceleration()
        return self._p.arm.sample(self._x, self._z, self._v_x, self._v_z, acceleration)

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N, each axis up to their limit."""
        self._started = True
        motor_force = self._p.arm.motor_force
        self._force_x, self._force_z = motor_force(force[0]), motor_force(force[2])
        self._holding.command(free=not (self._force_x or self._force_z))

    def apply_actuator_force(self, force: float) -> None:
        """Do nothing: the slave's tool has no actuator."""

    def change_surface(self, surface: SurfaceParameters, texture: Vibrating | None = None) -> None:
        """Put another surface under the tip; nothing moves at that moment.

        Its height is such that the contact force stays the same, or that it is not above the tip
        if there was no contact.

        Parameters
        ----------
        surface : SurfaceParameters
        texture : callable, optional
            Returns for each sample, from speed in m/s and normal force in N, an acceleration in
            m/s^2 that adds to that of the surface's profile.
        """
        self._texture = texture
        pressed = max(0.0, self._penetration())
        # The same elastic force out of another stiffness (Hertz).
        pressed *= (self._p.surface.stiffness / surface.stiffness) ** (2 / 3)
        self._p = replace(self._p, surface=surface)
        self._law = tip_law(self._p.tool, surface, self._seed)
        self._lift = 0.0
        excess = self._penetration() - pressed
        if pressed > 0 or excess > 0:
            self._lift = -excess

    def release(self) -> None:
        """Take the motors' force off."""
        self._force_x = self._force_z = 0.0
        self._holding.command(free=True)

    def status(self) -> dict[str, int]:
        """Return the count of samples beyond the accelerometer's range."""
        return {"accelerometer_saturated": self._accelerometer.saturated}

    def energy(self) -> float:
        """Return kinetic energy and the contact's elastic energy, J."""
        penetration = max(0.0, self._penetration())
        kinetic = self._p.tool.mass * (self._v_x**2 + self._v_z**2) / 2
        return kinetic + self._p.surface.stiffness * float(penetration**2.5) / 2.5

    def disturb(self, velocity_x: float = 0.0, velocity_z: float = 0.0) -> None:
        """Set the tip's velocity, m/s: a throw, for tests and experiments."""
        self._started = True
        self._v_x, self._v_z = velocity_x, velocity_z

    def _put_back(self) -> None:
        """Set the tip to rest at its initial position, above the surface."""
        self._lift = 0.0
        self._x, self._v_x = 0.0, 0.0
        self._z, self._v_z = self._p.tool.height, 0.0
        self._low_passed = 0.0

    def _move(self, due: float) -> None:
        """Move the tip for a time in s."""
        steps = max(1, math.ceil(due / self._longest_step - 1e-6))
        step = due / steps
        decay = math.exp(-self._corner * step)
        # A step's share of its first and last acceleration in the low-pass, the
        # acceleration taken as linear in between.
        mean = (1 - decay) / (self._corner * step)
        x, z, self._v_x, self._v_z, self._low_passed, *_ = self._law(
            *(self._x, self._z - self._lift, self._v_x, self._v_z, self._force_x, self._force_z),
            *(self._low_passed, steps, step, decay, mean - decay, 1 - mean),
        )
        self._x, self._z = x, z + self._lift

    def _tool_acceleration(self) -> float:
        if self._recording is None:
            added = 0.0
            if self._texture and self._started:
                added = self._texture(abs(self._v_x), self.contact_force[2])
            return self._accelerometer.measure(self._low_passed + added, noisy=self._started)
        if not self._started:
            return 0.0
        if self._played_since is None:
            # From a sample and not from the force, which may fall in the middle between two.
            self._played_since = self._now
        # The recording went through a sensor already: it is played as it is.
        index = round((self._now - self._played_since) * self._clock_step * self._rate)
        return float(self._recording[index % len(self._recording)])

    def _penetration(self) -> float:
        """Depth of the tip in the surface, m; negative above it."""
        return self._law(self._x, self._z - self._lift, 0.0, 0.0, 0.0, 0.0)[-1]


Moved = tuple[float, float, float, float, float, float, float, float, float]
"""Place, velocity, low-passed acceleration and present acceleration of the tip, each along the
surface before normal to it where it has both; normal force of the contact and penetration."""


def tip_law(tool: ToolParameters, surface: SurfaceParameters, seed: int) -> Callable[..., Moved]:
    """Return the law of motion of a tip on one piece of a material.

    A closure, with all it needs in local variables: a simulation spends most of its time here.

    Parameters
    ----------
    tool : ToolParameters
    surface : SurfaceParameters
    seed : int
        Seed of the texture.

    Returns
    -------
    callable
        From place and velocity of the tip and the motors' force, each along the surface and
        normal to it (m, m/s, N), and optionally the low-passed acceleration, m/s^2, the number
        of steps to move, their length, s, and the low-pass' factors of its state and of a step's
        first and last acceleration, to where the tip is then: m, m/s, m/s^2, N, m. Without
        steps it does not move.
    """
    profile = height_profile(surface, seed)
    heights, rises = profile.tolist(), (np.roll(profile, -1) - profile).tolist()
    points, spacing = PROFILE_POINTS, PROFILE_STEP
    stiffness, damping, sliding = surface.stiffness, surface.contact_damping, surface.friction
    mass, viscous, dry = tool.mass, tool.viscous_friction, tool.coulomb_friction
    slow = tool.slip_velocity**2
    floor, sqrt = math.floor, math.sqrt

    def move(
        x: float,
        z: float,
        v_x: float,
        v_z: float,
        motor_x: float,
        motor_z: float,
        low_passed: float = 0.0,
        steps: int = 0,
        step: float = 0.0,
        decay: float = 0.0,
        first: float = 0.0,
        last: float = 0.0,
    ) -> Moved:
        half = step / 2
        half_x = half_z = before = 0.0
        # The motors' force changes only at the beginning: the low-pass must see its jump.
        for done in range(steps + 1):
            slipping = sqrt(v_x * v_x + v_z * v_z + slow)
            joints = viscous + dry / slipping
            force_x = motor_x - joints * v_x
            force_z = motor_z - joints * v_z
            # The height is linear between the points of the profile.
            place = x / spacing
            left = floor(place)
            index = left % points
            rise = rises[index]
            penetration = heights[index] + rise * (place - left) - z
            normal = 0.0
            if penetration > 0:
                slope = rise / spacing
                elastic = stiffness * penetration * sqrt(penetration)
                pushing = elastic * (1 + damping * (slope * v_x - v_z))
                if pushing > 0:
                    normal = pushing
                force_x -= sliding * normal * v_x / slipping + normal * slope
                force_z += normal
            a_x, a_z = force_x / mass, force_z / mass
            # The velocity Verlet scheme, whose energy does not drift.
            if done:
                v_x = half_x + half * a_x
                v_z = half_z + half * a_z
                low_passed = decay * low_passed + first * before + last * a_z
            if done < steps:
                half_x, half_z, before = v_x + half * a_x, v_z + half * a_z, a_z
                x += step * half_x
                z += step * half_z
                # Friction depends on velocity: a predicted one keeps the scheme second-order.
                v_x, v_z = v_x + step * a_x, v_z + step * a_z
        return x, z, v_x, v_z, low_passed, a_x, a_z, normal, penetration

    return move
