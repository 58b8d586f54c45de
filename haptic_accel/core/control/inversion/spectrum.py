# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Spectrum of tool acceleration for the design of a filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, parameter

# scipy.signal takes half a second to import: only the measurement of a spectrum needs it.

ToolSpectrum = Callable[[FloatArray], FloatArray]
"""One-sided power spectral density of tool acceleration, (m/s^2)^2/Hz, at frequencies in Hz."""

TEXTURE_DENSITY = 0.15
"""Density in the middle of the texture, m/s^2/sqrt(Hz): 1.4 m/s^2 RMS in total, as for rough
wood."""

HAND_DENSITY = 0.02
"""Density of slow motion of hand and arm below the texture, m/s^2/sqrt(Hz)."""

SENSOR_DENSITY = 0.0025
"""Noise density of the tool's accelerometer, m/s^2/sqrt(Hz) (ADXL320 data sheet: 250
ug/sqrt(Hz))."""

SEGMENT_SECONDS = 0.5
"""Length of the segments of a measured spectrum, s: lines 2 Hz apart."""


@dataclass(frozen=True)
class TexturePrior(Checked):
    """Spectrum of an unknown surface: broadband texture, slow motion and noise.

    Its power rises with the fourth power of frequency and falls with the sixth. A narrower prior
    gives smaller errors on textures within it, and larger errors elsewhere.
    """

    # Assumed, as the surface is not known.
    rise: float = parameter(
        20.0, "lower corner of the expected texture spectrum", "Hz", 1.0, 1000.0
    )
    # Waves shorter than 0.5 mm: 200 Hz at 0.1 m/s.
    fall: float = parameter(
        200.0, "upper corner of the expected texture spectrum", "Hz", 10.0, 10e3
    )

    def __call__(self, frequency: FloatArray) -> FloatArray:
        """Return the one-sided density, (m/s^2)^2/Hz, at frequencies in Hz, shape (n,)."""
        squared = (frequency / self.rise) ** 2
        texture = TEXTURE_DENSITY**2 * (squared / (1.0 + squared)) ** 2
        falling = (1.0 + (frequency / self.fall) ** 2) ** 3
        return np.asarray((texture + HAND_DENSITY**2) / falling + SENSOR_DENSITY**2)


PRIOR = TexturePrior()
"""Spectrum of an unknown surface."""


def measured_spectrum(acceleration: FloatArray, rate: float) -> ToolSpectrum:
    """Return the spectrum of a recorded tool acceleration by Welch's method.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        Recorded tool acceleration, m/s^2; at least two samples.
    rate : float
        Samples per second.

    Returns
    -------
    callable
        Linear between the lines, and at least the noise of the tool's accelerometer.
    """
    from scipy import signal

    segment = min(len(acceleration), round(SEGMENT_SECONDS * rate))
    lines, power = signal.welch(acceleration, rate, nperseg=segment)
    floor = SENSOR_DENSITY**2

    def spectrum(frequency: FloatArray) -> FloatArray:
        # The mean was removed, so the line at 0 Hz is meaningless.
        return np.maximum(np.interp(frequency, lines[1:], power[1:]), floor)

    return spectrum
