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

"""Protection of the actuator: limits of peak force, heat and travel."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.actuator.travel import TravelEstimator

CUSHION = 0.8
"""Fraction of the travel at which braking of the actuator begins."""

CUSHION_END = 0.95
"""Fraction of the travel at which braking ends; the remainder allows for errors of the
estimate."""

WARM = 0.1
"""Fraction of the permitted heat up to which the full peak force is available."""

CUSHION_SPEED = 400.0
"""Rate constant of the approach to the cushion's end, 1/s: with the cushion of the paper's coil,
0.57 mm, a speed of 0.23 m/s at its beginning."""

CUSHION_SPEED_SHARE = 0.4
"""Upper bound of `CUSHION_SPEED` as a fraction of the sampling rate; faster braking would
oscillate."""

ACTUATOR_SETTLING = 0.1
"""Settling time of the actuator, after which its earlier position no longer matters, s: five times
2 m_a / b_s of Table I."""

CUSHION_AHEAD = 1.5
"""Look-ahead for the cushion, ms, or in samples if longer: braking must begin before the cushion
is reached."""


@dataclass(frozen=True)
class Margins:
    """Fractions of the actuator's limits at which braking or force reduction begins.

    Attributes
    ----------
    cushion, cushion_end : float
        Fractions of the travel where braking begins, and where the actuator comes to rest.
    warm : float
        Fraction of the permitted heat above which the peak force is reduced.
    """

    cushion: float = CUSHION
    cushion_end: float = CUSHION_END
    warm: float = WARM


COMFORT = Margins()
"""Soft margins for the compensator, which brakes early and reports the remaining force."""

HARD = Margins(cushion=0.95, cushion_end=1.0, warm=0.9)
"""Hard margins for the device's safety layer. They lie outside `COMFORT`, so that only one of the
two acts."""


class ActuatorGuard:
    """Limits force, heat and travel of the actuator.

    Heat is the square of the force averaged over the coil's time constant. The permitted force
    falls from the peak to the continuous force as the coil warms up. Heat thus never exceeds the
    heat of the continuous force. Travel is estimated. Near the stops a cushion limits the outward
    acceleration: the actuator comes to rest before the stop, like a critically damped spring, and
    faster motion is braked. The cushion adds no energy.

    Parameters
    ----------
    actuator : ActuatorParameters
    rate : float
        Samples per second.
    margins : Margins

    Attributes
    ----------
    saturated, heated, cushioned : int
        Numbers of samples limited for peak force, for heat and for travel.
    """

    def __init__(
        self, actuator: ActuatorParameters, rate: float, margins: Margins = COMFORT
    ) -> None:
        self._peak = actuator.peak_force
        self._bearable = min(actuator.continuous_force, actuator.peak_force) ** 2
        self._staying = -1.0 / (rate * actuator.thermal_time)
        self._warming = -math.expm1(self._staying)
        self._settling = math.ceil(rate * ACTUATOR_SETTLING)
        self._estimator = TravelEstimator(actuator, rate)
        self._m_a, self._k_s, self._b_s = actuator.m_a, actuator.k_s, actuator.b_s
        self._soft = margins.cushion * actuator.travel
        self._end = margins.cushion_end * actuator.travel
        self._cool = 1.0 - margins.warm
        # Below this heat the peak force is allowed, as in `_allowed`, whatever the rounding.
        staying = max(1.0 - self._warming, sys.float_info.min)
        lasting = (self._bearable - self._warming * self._peak**2) / staying
        self._cold = (1.0 - 1e-9) * min(margins.warm * self._bearable, lasting)
        self._speed = min(CUSHION_SPEED, CUSHION_SPEED_SHARE * rate)
        self._ahead = CUSHION_AHEAD * max(1e-3, 1.0 / rate)
        self.saturated = self.heated = self.cushioned = 0
        self.reset()

    @property
    def heat(self) -> float:
        """Heat relative to the continuous force's heat, 0 to 1."""
        return self._heat / self._bearable if self._bearable else 0.0

    @property
    def travel(self) -> float:
        """Estimated displacement of the actuator from its middle, m."""
        return self._estimator.travel

    def limited(self, force: float, handle_acceleration: float) -> float:
        """Return the force that may be applied until the next sample, N.

        Parameters
        ----------
        force : float
            Requested force, N; finite.
        handle_acceleration : float
            Measured handle acceleration, m/s^2; finite.
        """
        force = self.within(force, handle_acceleration)
        self.advance(force, handle_acceleration)
        return force

    def within(self, force: float, handle_acceleration: float) -> float:
        """Return the force that may be applied now, N; parameters as for `limited`."""
        estimator, soft = self._estimator, self._soft
        d = estimator.travel
        if abs(d) > soft or abs(d + estimator.velocity * self._ahead) > soft:
            force = self._cushioned(force, handle_acceleration)
        allowed = self._peak if self._heat <= self._cold else self._allowed()
        if abs(force) > allowed:
            if allowed < self._peak:
                self.heated += 1
            else:
                self.saturated += 1
            force = math.copysign(allowed, force)
        return force

    def advance(
        self,
        force: float,
        handle_acceleration: float,
        *,
        square: float | None = None,
        samples: int = 1,
    ) -> None:
        """Update heat and travel with the force that acted since the last sample.

        Parameters
        ----------
        force : float
            Mean of the force, N.
        handle_acceleration : float
            Measured handle acceleration, m/s^2.
        square : float, optional
            Mean square of the force, N^2, if it was not constant.
        samples : int
            Number of sampling periods of this force; above one if samples were missed.
        """
        heat = force * force if square is None else square
        if samples == 1:
            self._heat += self._warming * (heat - self._heat)
            self._estimator.observe(force, handle_acceleration)
            return
        self._heat += -math.expm1(samples * self._staying) * (heat - self._heat)
        for _ in range(min(samples, self._settling)):
            self._estimator.observe(force, handle_acceleration)

    def reset(self) -> None:
        """Return to a cold actuator at rest in the middle of its travel."""
        self._heat = 0.0
        self._estimator.reset()

    def _allowed(self) -> float:
        """Return the permitted force for the present heat, N."""
        bearable, heat = self._bearable, self._heat
        if not bearable:
            return 0.0
        left = 1.0 - heat / bearable
        if left >= self._cool:
            allowed = self._peak**2
        else:
            allowed = bearable + max(0.0, left) / self._cool * (self._peak**2 - bearable)
        # A single sample of peak force can overheat a very small coil.
        most = max(bearable, heat + (bearable - heat) / self._warming)
        return min(self._peak, math.sqrt(min(allowed, most)))

    def _cushioned(self, force: float, handle_acceleration: float) -> float:
        """Return the force, or the braking force for the stop ahead if larger."""
        d, v = self._estimator.travel, self._estimator.velocity
        # Outward is positive, except for the force: a positive one pulls the actuator to the
        # handle.
        side = math.copysign(1.0, d + v * self._ahead)
        d, v, outward = side * d, side * v, max(0.0, side * v)
        speed = self._speed
        # Maximum outward acceleration of a critically damped approach.
        left = speed * speed * (self._end - d) - 2.0 * speed * v
        braking = -self._m_a * (left + side * handle_acceleration)
        braking -= self._k_s * d + self._b_s * outward
        if side * force >= braking:
            return force
        self.cushioned += 1
        return side * braking


def scaled_within(force: Sequence[float], allowed: Sequence[float]) -> Sequence[float]:
    """Return a force on several coils, scaled as a whole to what their guards allow.

    Parameters
    ----------
    force, allowed : sequence of float
        Force of each coil, and what its guard allows in place of it, N. A guard that asks for more
        force, in order to brake, does not limit the others; one that asks for the opposite allows
        none.

    Examples
    --------
    >>> scaled_within((4.0, 3.0, 0.0), (2.0, 3.0, 0.0))
    (2.0, 1.5, 0.0)
    """
    share, last = 1.0, -1
    for coil, (requested, most) in enumerate(zip(force, allowed, strict=True)):
        if most != requested != 0.0 and most / requested < share:
            share, last = most / requested, coil
    if last < 0:
        return force
    if share <= 0.0:
        return (0.0,) * len(force)
    # Exactly what the guard allows, without rounding.
    return tuple(
        most if coil == last else share * requested
        for coil, (requested, most) in enumerate(zip(force, allowed, strict=True))
    )
