# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Taps: vibration after an impact of the tool, as decaying modes or from recordings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, ParameterError, check_positive_rate, parameter
from haptic_accel.core.sampling import resampled
from haptic_accel.core.surfaces.texture import Provenance

MOST_MODES = 3
"""Maximum number of modes of a tap; two or three describe wood, metal and rubber (Okamura et al.
2001)."""

THRESHOLD_SPEED = 5e-3
"""Impact speed below which a contact causes no tap, m/s: about the speed of a hand that rests on a
surface."""

REFRACTORY_TIME = 0.03
"""Minimum time between taps, s; a stiff contact bounces for 20 to 50 ms."""

CROSS_FADE = 0.03
"""Time from a tap until the texture has its full amplitude, s."""

LONGEST_TAP = 0.5
"""Maximum duration of a tap, s."""

MOST_SPEEDS = 100
"""Maximum number of impact speeds in a recorded set."""

LONGEST_RECORDING = 10.0
"""Maximum duration of a recorded tap, s."""

_REST = 1e-3  # relative amplitude at which a mode ends: far below perceptible levels


@dataclass(frozen=True)
class Mode(Checked):
    """Decaying sinusoid: amplitude v exp(-decay t) sin(2 pi frequency t + phase)."""

    frequency: float = parameter(200.0, "frequency", "Hz", 1.0, 20e3)
    decay: float = parameter(60.0, "decay rate", "1/s", 0.0, 1e5, above=True)
    amplitude: float = parameter(50.0, "acceleration per impact speed", "1/s", 0.0, 1e6)
    phase: float = parameter(0.0, "phase at the impact", "rad", -2 * math.pi, 2 * math.pi)


@dataclass(frozen=True, eq=False)
class TapModel:
    """Acceleration after an impact: modes, or a recorded set.

    Attributes
    ----------
    modes : tuple of Mode
        At most `MOST_MODES`; empty for a recorded set.
    speeds : ndarray, shape (m,)
        Impact speeds of the recorded set, m/s, increasing and above 0.
    samples : ndarray, shape (m, k)
        Acceleration for each impact speed, m/s^2; the first sample is one period after the impact.
    rate : float
        Samples per second of the recorded set.
    provenance : Provenance

    Raises
    ------
    ParameterError
        Both or neither of modes and recordings are specified, or values and shapes are invalid.
    """

    modes: tuple[Mode, ...] = ()
    speeds: FloatArray = field(default_factory=lambda: np.empty(0))
    samples: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    rate: float = 1000.0
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        """Check that there are either modes or recordings, and that they are complete."""
        check_positive_rate(self.rate)
        if bool(self.modes) == bool(np.size(self.speeds)):
            raise ParameterError("tap: must have either modes or a recorded set")
        if len(self.modes) > MOST_MODES:
            raise ParameterError(f"tap: {len(self.modes)} modes: must be at most {MOST_MODES}")
        if np.size(self.speeds):
            self._check_recordings()

    def _check_recordings(self) -> None:
        if self.speeds.ndim != 1 or self.speeds[0] <= 0 or np.any(np.diff(self.speeds) <= 0):
            raise ParameterError("tap: speeds of the recorded set must increase from above 0 m/s")
        if self.samples.ndim != 2 or len(self.samples) != len(self.speeds):
            raise ParameterError(
                f"tap: samples of shape {self.samples.shape}: must have one row per impact speed, "
                f"{len(self.speeds)}"
            )
        if len(self.speeds) > MOST_SPEEDS:
            raise ParameterError(
                f"tap: {len(self.speeds)} impact speeds: must be at most {MOST_SPEEDS}"
            )
        if (seconds := self.samples.shape[1] / self.rate) > LONGEST_RECORDING:
            raise ParameterError(
                f"tap: samples of {seconds:g} s: must be at most {LONGEST_RECORDING:g} s"
            )
        if not (self.samples.size and np.all(np.isfinite(self.samples))):
            raise ParameterError("tap: samples of the recorded set must be finite numbers")

    def waveforms(self, rate: float) -> tuple[FloatArray, FloatArray]:
        """Return impact speeds in m/s, and the acceleration for each of them, at another rate.

        Parameters
        ----------
        rate : float
            Samples per second.

        Returns
        -------
        speeds : ndarray, shape (m,)
        accelerations : ndarray, shape (m, k)
            Acceleration, m/s^2, without modes above the Nyquist frequency.
        """
        check_positive_rate(rate)
        if self.modes:
            return np.ones(1), _ringing(self.modes, rate)[np.newaxis]
        return self.speeds, np.array([resampled(row, self.rate, rate) for row in self.samples])


class Tap:
    """Taps on one material, processed sample by sample.

    Between two recorded impact speeds the recordings are interpolated. Outside their range, and
    for modes, the acceleration is proportional to the impact speed. Overlapping taps add up.

    Parameters
    ----------
    model : TapModel
    rate : float
        Samples per second.

    Raises
    ------
    ParameterError
        `rate` is not a positive number, or is out of range for resampling the recordings.
    """

    def __init__(self, model: TapModel, rate: float) -> None:
        speeds, waves = model.waveforms(rate)
        # A row of zeros for zero speed, so that amplitudes are interpolated below the slowest tap.
        self._speeds = np.concatenate([[0.0], speeds])
        self._waves = np.vstack([np.zeros((1, waves.shape[1])), waves])
        self._refractory = math.ceil(REFRACTORY_TIME * rate)
        self._fade = math.ceil(CROSS_FADE * rate)
        self._wave = np.zeros(0)
        self._age = max(self._refractory, self._fade)  # samples since the last tap

    def strike(self, speed: float) -> None:
        """Start a tap, whose first acceleration is the next result of `synthesize`.

        Parameters
        ----------
        speed : float
            Impact speed, m/s. No tap starts below `THRESHOLD_SPEED`, or within `REFRACTORY_TIME`
            of the last one.
        """
        if speed < THRESHOLD_SPEED or self._age < self._refractory:
            return
        upper = min(int(np.searchsorted(self._speeds, speed)), len(self._speeds) - 1)
        lower, higher = self._speeds[upper - 1 : upper + 1]
        if speed > higher:
            wave = self._waves[upper] * (speed / higher)
        else:
            share = (speed - lower) / (higher - lower)
            wave = (1 - share) * self._waves[upper - 1] + share * self._waves[upper]
        rest = self._wave[self._age :]
        wave[: len(rest)] += rest
        self._wave, self._age = wave, 0

    def synthesize(self) -> float:
        """Return the acceleration of one sample, m/s^2; 0 after the end of all taps."""
        self._age += 1
        return float(self._wave[self._age - 1]) if self._age <= len(self._wave) else 0.0

    @property
    def texture_share(self) -> float:
        """Factor of the texture in the last sample, 0 to 1; 0 at the start of a tap."""
        if self._age >= self._fade:
            return 1.0
        return 0.5 - 0.5 * math.cos(math.pi * self._age / self._fade)


def _ringing(modes: tuple[Mode, ...], rate: float) -> FloatArray:
    """Return the acceleration after an impact at 1 m/s, starting one period later."""
    slowest = min(mode.decay for mode in modes)
    duration = min(-math.log(_REST) / slowest, LONGEST_TAP)
    time = np.arange(1, max(round(duration * rate), 1) + 1) / rate
    wave = np.zeros(len(time))
    for mode in modes:
        if mode.frequency < rate / 2:
            turn = 2 * np.pi * mode.frequency * time + mode.phase
            wave += mode.amplitude * np.exp(-mode.decay * time) * np.sin(turn)
    return wave
