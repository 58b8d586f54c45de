"""Accelerometer, converters and encoders of the simulated rig."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.parameters import Checked, parameter

GRAVITY = 9.80665
"""Standard gravity, m/s^2 (ISO 80000-3)."""

_NOISE_BLOCK = 4096


@dataclass(frozen=True)
class AccelerometerParameters(Checked):
    """An Analog Devices ADXL320J behind a 16-bit converter, as in the paper."""

    range: float = parameter(
        5 * GRAVITY, "largest acceleration either way (5 g)", unit="m/s^2", low=0, above=True
    )
    bandwidth: float = parameter(
        500.0, "corner of its first-order low-pass (paper)", unit="Hz", low=1.0, high=100e3
    )
    noise_density: float = parameter(
        250e-6 * GRAVITY,
        "noise (ADXL320 data sheet: 250 ug/sqrt(Hz))",
        unit="m/s^2/sqrt(Hz)",
        low=0,
        high=1.0,
    )
    bits: int = parameter(16, "resolution of the converter over the range", low=4, high=32)

    @property
    def noise(self) -> float:
        """Standard deviation of a sample, m/s^2: white noise through the first-order low-pass."""
        # A first-order low-pass lets through as much white noise as an ideal one of pi/2
        # times its corner.
        return self.noise_density * math.sqrt(math.pi / 2 * self.bandwidth)


class Quantizer:
    """A converter with a symmetric range: rounds to its steps and saturates.

    Attributes
    ----------
    saturated : int
        How often the range was exceeded.
    """

    def __init__(self, full_scale: float, bits: int) -> None:
        self._full_scale = full_scale
        self._step = 2 * full_scale / 2.0**bits
        self.saturated = 0

    def convert(self, value: float) -> float:
        """Return the value as the converter gives it."""
        if abs(value) > self._full_scale:
            self.saturated += 1
            return math.copysign(self._full_scale, value)
        return round(value / self._step) * self._step


class Accelerometer:
    """Noise, range and quantisation; the low-pass belongs to the mechanics' state.

    Parameters
    ----------
    parameters : AccelerometerParameters
    seed : int
        Of the noise.
    stream : int
        Tells accelerometers of the same seed apart: their noise is independent.
    """

    def __init__(self, parameters: AccelerometerParameters, seed: int, stream: int = 0) -> None:
        self._converter = Quantizer(parameters.range, parameters.bits)
        self._deviation = parameters.noise
        self._random = np.random.default_rng((seed, stream))
        self._noise: list[float] = []

    def measure(self, low_passed: float) -> float:
        """Return a sample of the acceleration behind the sensor's low-pass, m/s^2."""
        if not self._noise:
            # Drawn in blocks: one call a sample would cost more than the rest together.
            self._noise = self._random.normal(0.0, self._deviation, _NOISE_BLOCK).tolist()
        return self._converter.convert(low_passed + self._noise.pop())

    @property
    def saturated(self) -> int:
        """How many samples exceeded the range."""
        return self._converter.saturated


@dataclass(frozen=True)
class ArmParameters(Checked):
    """What a Phantom Omni's motors and encoders can do (its data sheet)."""

    max_force: float = parameter(3.3, "limit of the motors' force", unit="N", low=0)
    position_resolution: float = parameter(
        55e-6, "resolution of the position", unit="m", low=0, high=1e-3
    )

    def motor_force(self, force: float) -> float:
        """Return a force along one axis as the motors can give it, N; none for NaN."""
        if math.isnan(force):  # which min and max would turn into the full force
            return 0.0
        return min(self.max_force, max(-self.max_force, force))

    def encoded(self, position: float) -> float:
        """Return a position as the encoders give it, m."""
        if self.position_resolution == 0:
            return position
        return round(position / self.position_resolution) * self.position_resolution
