"""What keeps the actuator whole: its peak force, its heat, its travel."""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.actuator.travel import TravelEstimator

CUSHION = 0.8
"""Share of the travel from which on the actuator is held back."""

CUSHION_END = 0.95
"""Share of the travel at which it is to stand still: the rest is for errors of the estimate."""

WARM = 0.1
"""Share of the heat it bears up to which the coil is allowed its full peak."""

HARD_CUSHION = 0.95
"""As `CUSHION`, where force is only held back that others should not have asked for."""

HARD_CUSHION_END = 1.0
"""As `CUSHION_END`, there."""

HARD_WARM = 0.9
"""As `WARM`, there."""

CUSHION_SPEED = 400.0
"""How fast it may approach that, per second: 0.25 m/s across the cushion of the paper's coil."""

CUSHION_SPEED_SHARE = 0.4
"""Of the rate, which it may not exceed: a brake as fast as the loop would ring."""

FORGOTTEN = 0.1
"""Time after which an actuator is where its force holds it, wherever it was before, s: five times
2 m_a / b_s of Table I."""

CUSHION_AHEAD = 1.5
"""How far it looks ahead, ms, or samples where these are longer: there is no time to brake for
what is seen only once it is there."""


@dataclass(frozen=True)
class Margins:
    """How long before its limits an actuator is held back.

    Attributes
    ----------
    cushion, cushion_end : float
        Shares of the travel.
    warm : float
        Share of the heat.
    """

    cushion: float = CUSHION
    cushion_end: float = CUSHION_END
    warm: float = WARM


COMFORT = Margins()
"""Of who makes the force: it comes to rest gently, and says what is left of it."""

HARD = Margins(HARD_CUSHION, HARD_CUSHION_END, HARD_WARM)
"""Of who applies it: outside `COMFORT`, so that both never quarrel over the same force."""


class ActuatorGuard:
    """Limits force, heat and travel, in this order of the harm they do.

    Heat is the square of the force averaged over the coil's time constant. The force allowed
    falls from the peak to the continuous one as the coil warms up, which heat therefore never
    exceeds. Travel is estimated; near the stops a cushion lets the actuator only be accelerated
    outwards so far that it comes to rest before them as a critically damped spring would, and
    brakes what is faster. It does not push back, so that it adds no energy.

    Parameters
    ----------
    actuator : ActuatorParameters
    rate : float
        Samples per second.
    margins : Margins

    Attributes
    ----------
    saturated, heated, cushioned : int
        Samples whose force was limited, by reason.
    """

    def __init__(
        self, actuator: ActuatorParameters, rate: float, margins: Margins = COMFORT
    ) -> None:
        self._peak = actuator.peak_force
        self._bearable = min(actuator.continuous_force, actuator.peak_force) ** 2
        self._staying = -1.0 / (rate * actuator.thermal_time)
        self._warming = -math.expm1(self._staying)
        self._forgotten = math.ceil(rate * FORGOTTEN)
        self._estimator = TravelEstimator(actuator, rate)
        self._m_a, self._k_s, self._b_s = actuator.m_a, actuator.k_s, actuator.b_s
        self._soft = margins.cushion * actuator.travel
        self._end = margins.cushion_end * actuator.travel
        self._cool = 1.0 - margins.warm
        self._speed = min(CUSHION_SPEED, CUSHION_SPEED_SHARE * rate)
        self._ahead = CUSHION_AHEAD * max(1e-3, 1.0 / rate)
        self.saturated = self.heated = self.cushioned = 0
        self.reset()

    @property
    def heat(self) -> float:
        """Share of what the coil bears for ever, 0 to 1."""
        return self._heat / self._bearable if self._bearable else 0.0

    @property
    def travel(self) -> float:
        """Where the actuator is, m."""
        return self._estimator.travel

    def limited(self, force: float, handle_acceleration: float) -> float:
        """Return the force that may be applied until the next sample, N.

        Parameters
        ----------
        force : float
            Wanted, N; finite.
        handle_acceleration : float
            As measured, m/s^2; finite.
        """
        force = self.within(force, handle_acceleration)
        self.advance(force, handle_acceleration)
        return force

    def within(self, force: float, handle_acceleration: float) -> float:
        """Return the force that may be applied now, N; parameters as for `limited`."""
        d, v = self._estimator.travel, self._estimator.velocity
        if abs(d) > self._soft or abs(d + v * self._ahead) > self._soft:
            force = self._cushioned(force, handle_acceleration)
        allowed = self._allowed()
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
        """Note what acted since the last sample.

        Parameters
        ----------
        force : float
            Its mean, N.
        handle_acceleration : float
            As measured, m/s^2.
        square : float, optional
            Mean of the square of a force that was not held, N^2.
        samples : int
            How many it acted for; more than one where some were missed.
        """
        heat = force * force if square is None else square
        warming = self._warming if samples == 1 else -math.expm1(samples * self._staying)
        self._heat += warming * (heat - self._heat)
        for _ in range(min(samples, self._forgotten)):
            self._estimator.sample(force, handle_acceleration)

    def reset(self) -> None:
        """Take the actuator for cold, in the middle and at rest."""
        self._heat = 0.0
        self._estimator.reset()

    def _allowed(self) -> float:
        """Return the force that the coil bears as warm as it is."""
        bearable, heat = self._bearable, self._heat
        if not bearable:
            return 0.0
        left = 1.0 - heat / bearable
        if left >= self._cool:
            allowed = self._peak**2
        else:
            allowed = bearable + max(0.0, left) / self._cool * (self._peak**2 - bearable)
        # A coil can be so small that a single sample of its peak overheats it.
        most = max(bearable, heat + (bearable - heat) / self._warming)
        return min(self._peak, math.sqrt(min(allowed, most)))

    def _cushioned(self, force: float, handle_acceleration: float) -> float:
        """Return the force, or what brakes for the stop ahead if that is more."""
        d, v = self._estimator.travel, self._estimator.velocity
        # All outwards, but force, of which a positive one pulls the actuator to the handle.
        side = math.copysign(1.0, d + v * self._ahead)
        d, v, outward = side * d, side * v, max(0.0, side * v)
        speed = self._speed
        # The largest acceleration outwards of an approach that is critically damped.
        left = speed * speed * (self._end - d) - 2.0 * speed * v
        braking = -self._m_a * (left + side * handle_acceleration)
        braking -= self._k_s * d + self._b_s * outward
        if side * force >= braking:
            return force
        self.cushioned += 1
        return side * braking
