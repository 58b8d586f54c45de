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

"""Slave of the virtual rig: an arm's tip that slides on a surface, with an accelerometer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXES, Axes, along_actuator
from haptic_accel.core.model import ZERO, AccelerometerParameters, FloatArray, Sample, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.rig.instruments import ArmParameters, Holding, VectorAccelerometer
from haptic_accel.core.rig.interface import LONGEST_ADVANCE, clock_step
from haptic_accel.core.rig.surface import (
    PROFILE_POINTS,
    PROFILE_STEP,
    SurfaceParameters,
    height_profile,
)

PHYSICS_STEP = 100e-6
"""Maximum integration step of the contact, s; half of it changes results by less than 1 %."""


Vibrating: TypeAlias = Callable[[float, float], float]
"""Function from speed and normal force to an acceleration, called once per sample."""

LATERAL_STREAM = 4
"""Random stream of the slopes across the stroke, independent of the profile along it."""

NOISE_STREAM = 2
"""Random stream of the tool's accelerometer, independent of the master's with the same seed."""


@dataclass(frozen=True)
class ToolParameters(Checked):
    """Tip of the slave arm."""

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
    axes: str = parameter("z", "axes of the tool's accelerometer: some of x, y, z")

    def __post_init__(self) -> None:
        """Check all fields, and the names of the axes."""
        super().__post_init__()
        Axes.parsed(self.axes)


@dataclass(frozen=True)
class SlaveRigParameters:
    """Parameters of the simulated slave."""

    tool: ToolParameters = field(default_factory=ToolParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)


class SlaveRig:
    """Point mass with friction, driven by the arm's motors, in contact with a textured surface.

    The surface can only push (Hertz contact with Hunt-Crossley damping). Harder pressing makes the
    contact stiffer and transmits more of the texture. The tip's height follows the profile at the
    speed of the stroke. The tip stands still until the arm's first force, and returns to its start
    after a release.

    The accelerometer measures the tip's acceleration along its axes: along the stroke (x) friction
    and slope of the surface, across it (y) the normal force on the lateral slope. The tip's own
    lateral motion is neglected, as it is a hundredth of the texture's wavelengths.

    Parameters
    ----------
    parameters : SlaveRigParameters
    rate : float
        Sampling rate, Hz.
    seed : int
        Seed of the texture and the accelerometer's noise.
    recording : ndarray, optional
        Tool acceleration in m/s^2 at `rate`, repeated in place of the simulation from the first
        sample after the arm's first force: along z, shape (n,), or x, y, z, shape (n, 3).
    physics_step : float
        Maximum integration step, s.
    texture : callable, optional
        As for `change_surface`.

    Raises
    ------
    ParameterError
        The recording has another shape.
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
        axes = Axes.parsed(parameters.tool.axes)
        self._accelerometer = VectorAccelerometer(
            parameters.accelerometer, axes, seed, NOISE_STREAM
        )
        self._seed = seed
        self._law = tip_law(parameters.tool, parameters.surface, seed)
        self._recording = None if recording is None else _played(recording, axes)
        self._corner = 2 * math.pi * parameters.accelerometer.bandwidth
        self._force_x = self._force_z = 0.0
        self._holding = Holding()
        self._clock_step = clock_step(rate)
        self._now = 0  # in steps of the clock
        self._started = False
        self._played_since: int | None = None
        self._put_back()

    @property
    def contact_force(self) -> Vector:
        """Force of the surface on the tip, N."""
        motion = self._v_x, self._v_z, 0.0, 0.0
        *_, x, z, _, _ = self._law(self._x, self._z - self._lift, *motion)
        # High above the surface only the joints' friction acts.
        *_, free_x, free_z, _, _ = self._law(self._x, 1.0, *motion)
        mass = self._p.tool.mass
        return mass * (x - free_x), 0.0, mass * (z - free_z)

    def advance(self, time: float) -> None:
        """Integrate the physics up to `time`, s. Times in the past are ignored."""
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
        return self._p.arm.reading(
            (self._x, 0.0, self._z), (self._v_x, 0.0, self._v_z), self._tool_acceleration()
        )

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        self._started = True
        motor_force = self._p.arm.motor_force
        self._force_x, self._force_z = motor_force(force[0]), motor_force(force[2])
        self._holding.command(free=not (self._force_x or self._force_z))

    def apply_actuator_force(self, force: Vector) -> None:
        """Do nothing: the slave's tool has no actuator."""

    def change_surface(self, surface: SurfaceParameters, texture: Vibrating | None = None) -> None:
        """Change the surface under the tip, without a jump of the motion.

        The new height keeps the contact force. Without contact it is not above the tip.

        Parameters
        ----------
        surface : SurfaceParameters
        texture : callable, optional
            Function from speed in m/s and normal force in N to an acceleration in m/s^2, called
            for each sample. The acceleration is added to that of the surface's profile along the
            normal. Along the stroke, it changes the friction (assumed: by the surface's
            coefficient). It has no part across the stroke (assumed).
        """
        self._texture = texture
        pressed = max(0.0, self._penetration())
        # The same elastic force with another stiffness (Hertz).
        pressed *= (self._p.surface.stiffness / surface.stiffness) ** (2 / 3)
        self._p = replace(self._p, surface=surface)
        self._law = tip_law(self._p.tool, surface, self._seed)
        self._lift = 0.0
        excess = self._penetration() - pressed
        if pressed > 0 or excess > 0:
            self._lift = -excess

    def release(self) -> None:
        """Set the motors' force to zero."""
        self._force_x = self._force_z = 0.0
        self._holding.command(free=True)

    def counters(self) -> dict[str, int]:
        """Return the count of out-of-range samples of the accelerometer."""
        return {"accelerometer_saturated": self._accelerometer.saturated}

    def energy(self) -> float:
        """Return the kinetic energy and the contact's elastic energy, J."""
        penetration = max(0.0, self._penetration())
        kinetic = self._p.tool.mass * (self._v_x**2 + self._v_z**2) / 2
        return kinetic + self._p.surface.stiffness * float(penetration**2.5) / 2.5

    def disturb(self, velocity_x: float = 0.0, velocity_z: float = 0.0) -> None:
        """Set the tip's velocity, m/s, for tests and experiments."""
        self._started = True
        self._v_x, self._v_z = velocity_x, velocity_z

    def _put_back(self) -> None:
        """Set the tip to rest at its initial position, above the surface."""
        self._lift = 0.0
        self._x, self._v_x = 0.0, 0.0
        self._z, self._v_z = self._p.tool.height, 0.0
        self._low_passed = self._low_passed_x = self._low_passed_y = 0.0

    def _move(self, due: float) -> None:
        """Move the tip for a time in s."""
        steps = max(1, math.ceil(due / self._longest_step - 1e-6))
        step = due / steps
        decay = math.exp(-self._corner * step)
        # Weights of a step's first and last acceleration in the low-pass, for linear acceleration.
        mean = (1 - decay) / (self._corner * step)
        x, z, self._v_x, self._v_z, low_passed, along, across, *_ = self._law(
            *(self._x, self._z - self._lift, self._v_x, self._v_z, self._force_x, self._force_z),
            *(self._low_passed, steps, step, decay, mean - decay, 1 - mean),
            *(self._low_passed_x, self._low_passed_y),
        )
        self._x, self._z = x, z + self._lift
        self._low_passed, self._low_passed_x, self._low_passed_y = low_passed, along, across

    def _tool_acceleration(self) -> Vector:
        if self._recording is None:
            x, z = self._low_passed_x, self._low_passed
            if self._texture and self._started:
                added = self._texture(abs(self._v_x), self.contact_force[2])
                z += added
                x -= self._p.surface.friction * added * self._direction
            return self._accelerometer.measure((x, self._low_passed_y, z), noisy=self._started)
        if not self._started:
            return ZERO
        if self._played_since is None:
            # From a sample, as the force may change between samples.
            self._played_since = self._now
        # The recording has already passed a sensor, and is played unchanged.
        index = round((self._now - self._played_since) * self._clock_step * self._rate)
        return self._recording[index % len(self._recording)]

    @property
    def _direction(self) -> float:
        """Direction of the sliding along x, from -1 to 1; near 0 at rest, as that of friction."""
        return self._v_x / math.hypot(self._v_x, self._v_z, self._p.tool.slip_velocity)

    def _penetration(self) -> float:
        """Depth of the tip in the surface, m; negative above it."""
        return self._law(self._x, self._z - self._lift, 0.0, 0.0, 0.0, 0.0)[-1]


def _played(recording: FloatArray, axes: Axes) -> list[Vector]:
    """Return the samples of a recording, without the axes that the tool does not measure."""
    if recording.ndim == 1:
        recording = recording[:, np.newaxis] * along_actuator(1.0)
    if recording.ndim != 2 or recording.shape[1] != 3:
        raise ParameterError(
            f"recording: has the shape {recording.shape}: must be one column, or x, y and z"
        )
    return [axes.vector(axes.components(sample)) for sample in recording.tolist()]


Moved = tuple[float, float, float, float, float, float, float, float, float, float, float]
"""Motion of the tip: position and velocity, each tangential before normal, low-passed acceleration
(normal, tangential, lateral), present acceleration (tangential, normal), normal force and
penetration of the contact."""


def tip_law(tool: ToolParameters, surface: SurfaceParameters, seed: int) -> Callable[..., Moved]:
    """Return the law of motion of a tip on one piece of a material.

    The closure has all data in local variables, as simulations spend most of their time here.

    Parameters
    ----------
    tool : ToolParameters
    surface : SurfaceParameters
    seed : int
        Seed of the texture.

    Returns
    -------
    callable
        Function that returns a motion as in `Moved`, in m, m/s, m/s^2 and N. Arguments are the
        tip's position, velocity and motor force, tangential and normal (m, m/s, N). Optional are
        the low-passed normal acceleration, m/s^2, the number of steps, their length, s, the
        low-pass weights of its state and of a step's first and last acceleration, and the
        low-passed tangential and lateral acceleration, which are computed only if the tool
        measures them. Without steps the tip does not move.
    """
    profile = height_profile(surface, seed)
    heights, rises = profile.tolist(), (np.roll(profile, -1) - profile).tolist()
    across: list[float] | None = None
    if Axes.parsed(tool.axes) != ACTUATOR_AXES:
        # On a surface without a preferred direction, the slopes across the stroke are as large as
        # those along it, and at one point independent of them.
        lateral = height_profile(surface, (seed, LATERAL_STREAM))
        across = (np.roll(lateral, -1) - lateral).tolist()
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
        low_x: float = 0.0,
        low_y: float = 0.0,
    ) -> Moved:
        half = step / 2
        half_x = half_z = before = before_x = before_y = 0.0
        # The motors' force changes only at the start, and the low-pass must include this jump.
        for done in range(steps + 1):
            slipping = sqrt(v_x * v_x + v_z * v_z + slow)
            joints = viscous + dry / slipping
            force_x = motor_x - joints * v_x
            force_z = motor_z - joints * v_z
            # The height is linear between points of the profile.
            position = x / spacing
            left = floor(position)
            index = left % points
            rise = rises[index]
            penetration = heights[index] + rise * (position - left) - z
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
            if across:
                a_y = -normal * across[index] / spacing / mass
                if done:
                    low_x = decay * low_x + first * before_x + last * a_x
                    low_y = decay * low_y + first * before_y + last * a_y
                before_x, before_y = a_x, a_y
            # Velocity Verlet scheme, whose energy does not drift.
            if done:
                v_x = half_x + half * a_x
                v_z = half_z + half * a_z
                low_passed = decay * low_passed + first * before + last * a_z
            if done < steps:
                half_x, half_z, before = v_x + half * a_x, v_z + half * a_z, a_z
                x += step * half_x
                z += step * half_z
                # Friction depends on velocity; a predicted one keeps the scheme second-order.
                v_x, v_z = v_x + step * a_x, v_z + step * a_z
        return x, z, v_x, v_z, low_passed, low_x, low_y, a_x, a_z, normal, penetration

    return move
