# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Slave of the virtual rig: an arm's tip that slides on a surface, with an accelerometer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from haptic_accel.core.axes import Axes, along_actuator
from haptic_accel.core.model import AccelerometerParameters, FloatArray
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.rig import ArmParameters, Rig, accelerometers
from haptic_accel.core.tick.rigs import Tip

PHYSICS_STEP = 100e-6
"""Maximum integration step of the contact, s; half of it changes results by less than 1 %."""


Vibrating: TypeAlias = Callable[[float, float], float]
"""Function from speed and normal force to an acceleration, called once per sample."""

PROFILE_STEP = 5e-6
"""Spacing of the height profile, m: a sixtieth of the shortest wavelength allowed."""

PROFILE_POINTS = 2**16
"""Number of points in the profile, which repeats every 0.33 m; strokes are shorter."""

LATERAL_STREAM = 4
"""Random stream of the slopes across the stroke, independent of the profile along it."""

NOISE_STREAM = 2
"""Random stream of the tool's accelerometer, independent of the master's with the same seed."""


@dataclass(frozen=True)
class ToolParameters(Checked):
    """Tip of the slave arm."""

    mass: float = parameter(
        0.060, "mass of arm and tool: 45 g of a Phantom Omni and 15 g of tool", "kg", 0.001, 10.0
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
class SurfaceParameters(Checked):
    """Parameters of a surface: contact, friction, and two kinds of texture."""

    name: str = parameter("plain", "name of the surface in results")
    stiffness: float = parameter(
        3e6, "contact force divided by penetration^1.5 (Hertz)", "N/m^1.5", 1e3, 1e8
    )
    contact_damping: float = parameter(
        1.5, "factor of penetration velocity in the force (Hunt and Crossley 1975)", "s/m", 0, 1e3
    )
    friction: float = parameter(
        0.3, "coefficient of sliding friction on the surface", low=0.0, high=2.0
    )
    roughness: float = parameter(0.0, "RMS height of the irregular texture", "m", 0.0, 1e-3)
    shortest_wavelength: float = parameter(
        0.4e-3, "shortest wavelength of the irregular texture (tip's filter)", "m", 0.3e-3, 0.1
    )
    longest_wavelength: float = parameter(
        4e-3, "longest wavelength of the irregular texture", "m", 0.3e-3, 0.1
    )
    roughness_exponent: float = parameter(
        1.0, "negative exponent of height power over spatial frequency", low=0.0, high=6.0
    )
    bump_height: float = parameter(0.0, "height of raised features; 0 for none", "m", 0.0, 1e-3)
    bump_width: float = parameter(
        0.6e-3, "width of a raised feature at half height", "m", 0.1e-3, 0.05
    )
    bump_pitch: float = parameter(2e-3, "mean distance between raised features", "m", 0.2e-3, 0.1)
    bump_irregularity: float = parameter(
        0.0, "standard deviation of the features' distance, divided by its mean", low=0.0, high=1.0
    )
    texture: str = parameter(
        "", "texture whose acceleration is added to that of the profile: its name or file; or none"
    )


@dataclass(frozen=True)
class SlaveRigParameters:
    """Parameters of the simulated slave."""

    tool: ToolParameters = field(default_factory=ToolParameters)
    accelerometer: AccelerometerParameters = field(default_factory=AccelerometerParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)


class SlaveRig(Rig):
    """Tip of an arm on a textured surface; see `Tip`.

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
        self._seed = seed
        axes = Axes.parsed(parameters.tool.axes)
        self._sensors = accelerometers(parameters.accelerometer, axes, seed, NOISE_STREAM)
        played = [] if recording is None else _played(recording, axes)
        self._tip = Tip(parameters, rate, physics_step, self._sensors, played)
        super().__init__(self._tip)
        self._tip.texture = texture
        self._lay(parameters.surface)

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
        tip = self._tip
        tip.texture = texture
        pressed = max(0.0, tip.depth())
        # The same elastic force with another stiffness (Hertz).
        pressed *= (tip.stiffness / surface.stiffness) ** (2 / 3)
        self._lay(surface)
        tip.lift = 0.0
        excess = tip.depth() - pressed
        if pressed > 0 or excess > 0:
            tip.lift = -excess

    def counters(self) -> dict[str, int]:
        """Return the count of out-of-range samples of the accelerometer."""
        return {"accelerometer_saturated": sum(each.saturated for each in self._sensors if each)}

    def energy(self) -> float:
        """Return the kinetic energy and the contact's elastic energy, J."""
        tip = self._tip
        penetration = max(0.0, tip.depth())
        kinetic = tip.mass * (tip.v_x**2 + tip.v_z**2) / 2
        return kinetic + tip.stiffness * float(penetration**2.5) / 2.5

    def disturb(self, velocity_x: float = 0.0, velocity_z: float = 0.0) -> None:
        """Set the tip's velocity, m/s, for tests and experiments."""
        tip = self._tip
        tip.started = True
        tip.v_x, tip.v_z = velocity_x, velocity_z

    def _lay(self, surface: SurfaceParameters) -> None:
        """Place a section of a surface under the tip."""
        tip = self._tip
        tip.spacing = PROFILE_STEP
        tip.stiffness, tip.damping = surface.stiffness, surface.contact_damping
        tip.sliding = surface.friction
        profile = height_profile(surface, self._seed)
        tip.heights, tip.rises = profile.tolist(), (np.roll(profile, -1) - profile).tolist()
        if tip.sideways:
            # On a surface without a preferred direction, the slopes across the stroke are as large
            # as those along it, and at one point independent of them.
            lateral = height_profile(surface, (self._seed, LATERAL_STREAM))
            tip.across = (np.roll(lateral, -1) - lateral).tolist()


def _played(recording: FloatArray, axes: Axes) -> list[float]:
    """Return the samples of a recording, without the axes that the tool does not measure."""
    if recording.ndim == 1:
        recording = recording[:, np.newaxis] * along_actuator(1.0)
    if recording.ndim != 2 or recording.shape[1] != 3:
        raise ParameterError(
            f"recording: has the shape {recording.shape}: must be one column, or x, y and z"
        )
    return np.where(np.isin(range(3), axes.indices), recording, 0.0).ravel().tolist()


def height_profile(surface: SurfaceParameters, seed: int | tuple[int, int]) -> FloatArray:
    """Return heights in m at multiples of `PROFILE_STEP`, periodic in `PROFILE_POINTS`.

    Parameters
    ----------
    surface : SurfaceParameters
    seed : int or tuple of int
        Seed of the texture; another seed yields another piece of the same material.
    """
    random = np.random.default_rng(seed)
    return _roughness(surface, random) + _bumps(surface, random)


def _roughness(surface: SurfaceParameters, random: np.random.Generator) -> FloatArray:
    """Return Gaussian noise with a power-law spectrum between two wavelengths."""
    turns = random.random(PROFILE_POINTS // 2 + 1)
    if surface.roughness == 0:
        return np.zeros(PROFILE_POINTS)
    frequency = np.fft.rfftfreq(PROFILE_POINTS, PROFILE_STEP)
    within = frequency >= 1 / surface.longest_wavelength
    within &= frequency <= 1 / surface.shortest_wavelength
    amplitude = frequency[within] ** (-surface.roughness_exponent / 2)
    spectrum = np.zeros(len(frequency), dtype=complex)
    spectrum[within] = amplitude * np.exp(2j * np.pi * turns[within])
    heights = np.fft.irfft(spectrum, PROFILE_POINTS)
    deviation = heights.std()
    # If no wavelength of a periodic profile lies between the two, the surface is smooth.
    return np.asarray(heights * (surface.roughness / deviation if deviation > 0 else 0.0))


def _bumps(surface: SurfaceParameters, random: np.random.Generator) -> FloatArray:
    """Return Gaussian ridges at regular or irregular distances."""
    length = PROFILE_POINTS * PROFILE_STEP
    if surface.bump_height == 0:
        return np.zeros(PROFILE_POINTS)
    count = max(1, round(length / surface.bump_pitch))
    spread = surface.bump_irregularity * length / count
    centres = np.arange(count) * (length / count) + random.normal(0.0, 1.0, count) * spread
    places = np.round(centres / PROFILE_STEP).astype(int) % PROFILE_POINTS
    impulses = np.bincount(places, minlength=PROFILE_POINTS)
    position = np.arange(PROFILE_POINTS) * PROFILE_STEP
    distance = np.minimum(position, length - position)
    # Full width at half height of a Gaussian: 2 sqrt(2 ln 2) standard deviations.
    sigma = surface.bump_width / (2 * np.sqrt(2 * np.log(2)))
    ridge = surface.bump_height * np.exp(-0.5 * (distance / sigma) ** 2)
    return np.asarray(np.fft.irfft(np.fft.rfft(impulses) * np.fft.rfft(ridge), PROFILE_POINTS))
