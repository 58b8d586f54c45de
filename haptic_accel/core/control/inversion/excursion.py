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

"""Excursion control: attenuate low frequencies only as needed for the actuator's travel."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from haptic_accel.core.control.inversion.convolution import SampleWindow
from haptic_accel.core.control.inversion.design import InverseBank
from haptic_accel.core.model import FloatArray, Suspension
from haptic_accel.core.tick import TravelEstimator, row_dot

HORIZON = 0.05
"""Prediction horizon of the travel, s: a period of the paper's actuator on its spring."""

REVERSION = 0.03
"""Time after which half of a predicted travel is expected to be reversed, s. A tool that has met a
surface, for example, bounces and is held by the coupling. (Without this, the predicted travel at
contact in the virtual rig is twice the real one.)
"""

PERSISTING, LASTING = 8e-3, 16e-3
"""Time for which an input must have had one sign to be expected to last, and for how long it then
is, s. A tool that is turned in gravity, or is hit by something soft, needs more travel than its
past shows, and letting go late does harm; a tool that lands bounces within 8 ms."""

REMEMBERING, UNLIKE = 0.1, 2.0
"""Time constant with which the largest integral of the input over a time of one sign is forgotten,
s, and the factor by which an input must exceed it to be expected to last: otherwise it is a
vibration, which reverses."""

TRAVEL_SETTLING = 0.1
"""Time for which travel persists after its force, s: five times 2 m_a / b_s (Table I)."""

PREDICTION_RATE = 500.0
"""Maximum rate of the prediction, Hz; travel contains little above 100 Hz."""

ATTACK = 1.5e-3
"""Time constant of the attenuation, s: users would feel a step of force; late attenuation is
useless."""

RELEASE = 0.5
"""Time constant of the return of low frequencies, s: a few periods."""

FADING = 0.06
"""Duration of the crossfade to other taps, s. Two filters differ most in the force for the slow
motion of the hand, up to some 3 Hz; a faster change of that force would be felt."""

_BLOCKS = 8  # response lengths in the buffer, so that it is rarely moved
_SETTLED = 1e-3  # negligible change of the bank index
_SURELY = 0.999  # fraction of a squared limit that no rounding of a sum can exceed


class TravelPredictor:
    """Maximum travel of each member of a bank in the next `HORIZON`.

    The prediction assumes that each member has always been in use, and that the input is zero from
    now on, unless it has had one sign for `PERSISTING`, and more than before: then the least of
    that time lasts for `LASTING`. Later travel has a smaller weight (`REVERSION`).

    Parameters
    ----------
    suspension : Suspension
        Parameters of the actuator.
    rate : float
        Samples per second. Above `PREDICTION_RATE` the prediction uses means of several samples.
    """

    def __init__(self, suspension: Suspension, rate: float) -> None:
        self._every = max(1, round(rate / PREDICTION_RATE))
        step = self._every / rate
        estimator = TravelEstimator(suspension, 1.0 / step)
        pulse = [1.0] + [0.0] * (max(2, round(TRAVEL_SETTLING / step)) - 1)
        self._per_force = np.array([estimator.observe(force, 0.0) for force in pulse])
        self._horizon = max(1, round(HORIZON / step))
        self._lasting = max(1, round(LASTING / step))
        self._latest: deque[float] = deque(maxlen=max(1, round(PERSISTING / step)))
        self._forgetting = math.exp(-step / REMEMBERING)
        self._kept = 1.0 / (1.0 + np.arange(self._horizon) * (step / REVERSION))
        self._start = self._count = 0
        self._sum = 0.0

    def expect(self, forces: FloatArray) -> None:
        """Set the response of each member; the predicted travel remains.

        Parameters
        ----------
        forces : ndarray, shape (k, n)
            Force plus the effect of the handle's acceleration after a unit sample, N. The shape
            must not change.
        """
        count, length = forces.shape
        spare = -length % self._every
        if spare:
            forces = np.pad(forces, ((0, 0), (0, spare)))
        held = forces.reshape(count, -1, self._every).sum(axis=2)
        total = held.shape[1] + len(self._per_force) - 1
        size = 1 << total.bit_length()
        spectrum = np.fft.rfft(held, size) * np.fft.rfft(self._per_force, size)
        # Time first, then member: data that move together in time are contiguous.
        self._travels = np.ascontiguousarray(np.fft.irfft(spectrum, size)[:, :total].T)
        self._caused = np.empty_like(self._travels)
        held = np.cumsum(self._travels[: self._horizon - 1], axis=0)
        held[self._lasting :] -= held[: -self._lasting].copy()
        self._held = np.zeros((self._horizon, count))
        self._held[1 : 1 + len(held)] = held

    def observe(self, value: float) -> bool:
        """Add a sample of the members' input; return whether the prediction has advanced."""
        self._sum += value
        self._count += 1
        if self._count < self._every:
            return False
        self._advance(self._sum / self._every)
        self._count, self._sum = 0, 0.0
        return True

    def peaks(self) -> FloatArray:
        """Return the maximum travel of each member, m, shape (k,)."""
        ahead = self._ahead[self._seen]
        if self._persisting:
            ahead = ahead + self._persisting * self._held
        return np.asarray(np.abs(ahead * self._kept[:, None]).max(axis=0))

    def exceeds(self, limit: float) -> bool:
        """Return whether the first member would exceed a travel limit in m."""
        ahead = self._ahead[self._seen, 0]
        if self._persisting:
            ahead = ahead + self._persisting * self._held[:, 0]
        ahead = ahead * self._kept
        # Mostly all travels together are below the limit, which takes a third of the time to see.
        if ahead.dot(ahead) <= _SURELY * limit * limit:
            return False
        return bool(ahead.max() > limit or ahead.min() < -limit)

    def reset(self) -> None:
        """Clear the past."""
        length, count = self._travels.shape
        self._ahead = np.zeros((_BLOCKS * length + self._horizon, count))
        self._start = self._count = 0
        self._sum = self._persisting = 0.0
        self._integral = self._before = 0.0  # over the present sign, and the largest before
        self._latest.clear()
        self._latest.extend([0.0] * (self._latest.maxlen or 0))

    @property
    def _seen(self) -> slice:
        return slice(self._start, self._start + self._horizon)

    def _advance(self, value: float) -> None:
        length = len(self._travels)
        self._start += 1
        if self._start + max(length, self._horizon) > len(self._ahead):
            left = self._ahead[self._start :].copy()
            self._ahead[:] = 0.0
            self._ahead[: len(left)] = left
            self._start = 0
        np.multiply(self._travels, value, out=self._caused)
        self._ahead[self._start : self._start + length] += self._caused
        self._before *= self._forgetting
        if value * self._latest[-1] <= 0.0:
            self._before, self._integral = max(self._before, abs(self._integral)), 0.0
        self._integral += value
        self._latest.append(value)
        least, most = min(self._latest), max(self._latest)
        self._persisting = least if least > 0.0 else min(0.0, most)
        if abs(self._integral) <= UNLIKE * self._before:
            self._persisting = 0.0


class ExcursionControl:
    """Selection among inverses with increasing attenuation of low frequencies.

    As in loudspeaker amplifiers (Klippel, J. Audio Eng. Soc. 40, 1992), the travel of the next
    tens of milliseconds is predicted. The first member of the bank within the limit is used, or a
    weighted mean of two members. Attenuation increases at once, so that it is effective at
    contact, and decreases slowly.

    Parameters
    ----------
    bank : InverseBank
        Inverses from most to least travel.
    suspension : Suspension
        Parameters of the actuator.
    limit : float
        Maximum travel, m.
    rate : float
        Samples per second.

    Attributes
    ----------
    taps : ndarray, shape (k, n)
        Present taps of the members, N per m/s^2.
    position : float
        Member in use, from 0 for the first to k - 1 for the last.
    """

    def __init__(
        self, bank: InverseBank, suspension: Suspension, limit: float, rate: float
    ) -> None:
        self._limit = limit
        # Both inputs move the actuator: m_a d'' + b_s d' + k_s d = -f_a - m_a a_h.
        self._following = suspension.m_a * bank.motion
        self._window = SampleWindow(bank.taps.shape[1])
        self._products = np.empty(bank.taps.shape[1])
        self._attack = -math.expm1(-1.0 / (ATTACK * rate))
        self._release = -math.expm1(-1.0 / (RELEASE * min(rate, PREDICTION_RATE)))
        self._fading = max(1, round(FADING * rate))
        self._predictor = TravelPredictor(suspension, rate)
        self.restart(bank.taps)

    @property
    def changing(self) -> bool:
        """True while other taps are being faded in."""
        return self._left > 0

    def replace(self, taps: FloatArray) -> None:
        """Crossfade to other taps of the members over `FADING`.

        The prediction uses the new taps at once. A running crossfade stops at its present mixture.

        Parameters
        ----------
        taps : ndarray, shape (k, n)
        """
        self._slope = (taps - self.taps) / self._fading
        self._left = self._fading
        self._predictor.expect(taps + self._following)

    def restart(self, taps: FloatArray) -> None:
        """Clear the past, and use these taps of the members, shape (k, n)."""
        self.taps = np.array(taps, dtype=np.float64, order="C")
        self._left = 0
        self._predictor.expect(self.taps + self._following)
        self._predictor.reset()
        self._window.reset()
        self.position = self._target = 0.0

    def process(self, value: float) -> float:
        """Process one sample of the members' input; return the force, N."""
        if self._left:
            self._left -= 1
            self.taps += self._slope
        if self._predictor.observe(value):
            self._choose()
        latest = self._window.push(value)
        self._move()
        member = int(self.position)
        share = self.position - member
        force = row_dot(self.taps, member, latest, 0, self._products)
        if share:
            force += share * (row_dot(self.taps, member + 1, latest, 0, self._products) - force)
        return force

    def _move(self) -> None:
        missing = self._target - self.position
        if abs(missing) > _SETTLED:
            self.position += self._attack * missing
        elif missing:
            self.position = self._target

    def _choose(self) -> None:
        needed = self._needed() if self._predictor.exceeds(self._limit) else 0.0
        if needed > self._target:
            self._target = needed
        elif self._target:
            self._target += self._release * (needed - self._target)
            if self._target < _SETTLED:
                self._target = 0.0

    def _needed(self) -> float:
        """Return the first index whose interpolated peak is within the limit, or the last one."""
        peaks = self._predictor.peaks()
        keeping = peaks <= self._limit
        if not keeping.any():
            return float(len(peaks) - 1)
        first = int(keeping.argmax())
        if not first:
            return 0.0
        before, after = float(peaks[first - 1]), float(peaks[first])
        return first - (self._limit - after) / (before - after)
