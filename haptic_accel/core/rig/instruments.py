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

"""Accelerometer, converters, encoders and release detection of the simulated rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXIS, Axes
from haptic_accel.core.model import AccelerometerParameters, Sample, Vector
from haptic_accel.core.parameters import Checked, parameter

_NOISE_BLOCK = 4096

_NEXT_AXIS = 10
"""Distance between the random streams of two axes, above all other streams of a seed."""


class Quantizer:
    """Converter with a symmetric range: rounding to steps, and saturation.

    Attributes
    ----------
    saturated : int
        Number of values beyond the range.
    """

    def __init__(self, full_scale: float, bits: int) -> None:
        self._full_scale = full_scale
        self._step = 2 * full_scale / 2.0**bits
        self.saturated = 0

    def convert(self, value: float) -> float:
        """Return the value after conversion."""
        if abs(value) > self._full_scale:
            self.saturated += 1
            return math.copysign(self._full_scale, value)
        return round(value / self._step) * self._step if self._step else 0.0


class Accelerometer:
    """Accelerometer with noise, range and quantisation; its low-pass is part of the mechanics.

    Parameters
    ----------
    parameters : AccelerometerParameters
    seed : int
        Seed of the noise.
    stream : int
        Number of the random stream; accelerometers with equal seed and different streams have
        independent noise.
    """

    def __init__(self, parameters: AccelerometerParameters, seed: int, stream: int = 0) -> None:
        self._converter = Quantizer(parameters.range, parameters.bits)
        self._deviation = parameters.noise
        self._random = np.random.default_rng((seed, stream))
        self._noise: list[float] = []

    def measure(self, low_passed: float, *, noisy: bool = True) -> float:
        """Return a sample for an acceleration after the sensor's low-pass, m/s^2."""
        if not noisy:
            return self._converter.convert(low_passed)
        if not self._noise:
            # Drawn in blocks, as one call per sample would dominate the computing time.
            self._noise = self._random.normal(0.0, self._deviation, _NOISE_BLOCK).tolist()
        return self._converter.convert(low_passed + self._noise.pop())

    @property
    def saturated(self) -> int:
        """Number of saturated samples."""
        return self._converter.saturated


class VectorAccelerometer:
    """Accelerometers along the axes of a device, with independent noise.

    Parameters
    ----------
    parameters : AccelerometerParameters
        Parameters of each axis.
    axes : Axes
    seed : int
        Seed of the noise.
    stream : int
        Number of the random stream of the noise along z.
    """

    def __init__(
        self, parameters: AccelerometerParameters, axes: Axes, seed: int, stream: int
    ) -> None:
        self._axes = [
            (index, Accelerometer(parameters, seed, stream + _NEXT_AXIS * (ACTUATOR_AXIS - index)))
            for index in axes.indices
        ]

    def measure(self, low_passed: Sequence[float], *, noisy: bool = True) -> Vector:
        """Return a sample for accelerations along x, y, z after the low-pass, m/s^2."""
        measured = [0.0, 0.0, 0.0]
        for index, axis in self._axes:
            measured[index] = axis.measure(low_passed[index], noisy=noisy)
        x, y, z = measured
        return x, y, z

    @property
    def saturated(self) -> int:
        """Number of saturated samples of all axes."""
        return sum(axis.saturated for _, axis in self._axes)


@dataclass(frozen=True)
class ArmParameters(Checked):
    """Limits of an arm's motors and encoders; defaults from the Phantom Omni's data sheet."""

    max_force: float = parameter(3.3, "limit of the force of the arm's motors", unit="N", low=0)
    position_resolution: float = parameter(55e-6, "resolution of the arm's position", "m", 0, 1e-3)

    def motor_force(self, force: float) -> float:
        """Return a motor force along one axis, limited to the maximum, N; zero for NaN."""
        if abs(force) <= self.max_force:
            return force
        return 0.0 if math.isnan(force) else math.copysign(self.max_force, force)

    def encoded(self, position: float) -> float:
        """Return a position rounded to the encoders' resolution, m."""
        resolution = self.position_resolution
        return round(position / resolution) * resolution if resolution else position

    def reading(self, position: Vector, velocity: Vector, acceleration: Vector) -> Sample:
        """Return the readings of an arm at a position in m, with rounded position."""
        x, y, z = position
        return Sample((self.encoded(x), self.encoded(y), self.encoded(z)), velocity, acceleration)


PUT_BACK_AFTER = 0.2
"""Time without force and without commands after which an arm returns to its start, s. It is longer
than the coupler takes to release both arms when one stops sending."""


class Holding:
    """Detect the release of an arm from the commands of its motors.

    A coupling with zero force repeats its commands, and thus holds the arm.

    Examples
    --------
    >>> holding = Holding()
    >>> holding.command(free=True)
    >>> holding.ends(0.15), holding.ends(0.15), holding.ends(0.15)
    (False, True, False)
    """

    def __init__(self) -> None:
        self._free = True
        self._silence = math.inf  # not held yet

    def command(self, *, free: bool) -> None:
        """Record a command; `free` if its force is zero."""
        self._free = free
        self._silence = 0.0

    def ends(self, seconds: float) -> bool:
        """Advance to a time; return True, once, when the arm has been released."""
        self._silence += seconds
        if not (self._free and PUT_BACK_AFTER < self._silence < math.inf):
            return False
        self._silence = math.inf
        return True
