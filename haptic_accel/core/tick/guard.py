# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protection of the actuator: estimate of its travel, limits of peak force, heat and travel."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_accel.core.actuator import ActuatorParameters
    from haptic_accel.core.model import Suspension

LARGEST_ACCELERATION: float = 1.0e4
"""Upper bound of plausible measurements, about a thousand g, above the range of any hand tool's
accelerometer, m/s^2."""

CUSHION: float = 0.8
"""Fraction of the travel at which braking of the actuator begins in the compensator, which brakes
early and reports the remaining force."""

CUSHION_END: float = 0.95
"""Fraction of the travel at which that braking ends; the remainder allows for errors of the
estimate."""

WARM: float = 0.1
"""Fraction of the permitted heat up to which the compensator's full peak force is available."""

CUSHION_SPEED: float = 120.0
"""Rate constant with which the approach to the cushion's end begins, 1/s. Early braking shakes the
handle less; with a constant of 400 it is shaken by up to 16 m/s^2 after hard hits."""

CUSHION_SPEED_SHARE: float = 0.4
"""Upper bound of `CUSHION_SPEED` as a fraction of the sampling rate; faster braking would
oscillate."""

ACTUATOR_SETTLING: float = 0.1
"""Settling time of the actuator, after which its earlier position no longer matters, s: five times
2 m_a / b_s of Table I."""

CUSHION_AHEAD: float = 3.5
"""Look-ahead for the cushion, ms, or in samples if longer: braking must begin before the
cushion is reached. With a shorter one the actuator of the paper comes close to its stop after
hard hits."""

HARD = 0.95, 1.0, 0.9, 400.0, 1.5
"""`CUSHION`, `CUSHION_END`, `WARM`, `CUSHION_SPEED`, `CUSHION_AHEAD` of a device's safety layer.
Its margins lie outside the compensator's, so that only one of the two acts."""

TO_WHOLE: float = 6755399441055744.0
"""Sum and difference with this number, 1.5 * 2^52, round to the nearest whole number."""

LEAST_COOLING: float = 2.2250738585072014e-308
"""Lower bound of the share of heat that remains after a sample: the smallest normal number."""


class TravelEstimator:
    """Estimate the actuator's position between its stops from available signals.

    The model is eq. (1) of the paper for the relative motion d = y_a - y_h, m_a d'' + b_s d' + k_s
    d = -f_a - m_a a_h, which does not depend on the hand. The discretisation is exact for inputs
    that are constant within each sample. As the accelerometer also measures gravity, the estimate
    includes the static sag.

    Parameters
    ----------
    suspension : Suspension
        Parameters of actuator or handle.
    rate : float
        Samples per second.

    Attributes
    ----------
    travel : float
        Present displacement of the actuator, m; positive away from the handle along its axis.
    velocity : float
        Present velocity of the actuator relative to the handle, m/s.

    Raises
    ------
    ParameterError
        The rate is not a positive number.
    """

    def __init__(self, suspension: Suspension, rate: float) -> None:
        # scipy.linalg is slow to import: only users of an estimator need it.
        import numpy as np
        from scipy.linalg import expm

        from haptic_accel.core.parameters import check_positive_rate

        check_positive_rate(rate)
        m_a, k_s, b_s = suspension.m_a, suspension.k_s, suspension.b_s
        generator = np.array([[0, 1, 0], [-k_s / m_a, -b_s / m_a, 1], [0, 0, 0]]) / rate
        d_row, v_row, _ = expm(generator).tolist()
        self._m_a: float = m_a
        # Displacement and velocity at the next sample, from the present ones and the push in
        # between.
        self._d_by_d = self._d_by_v = self._d_by_push = 0.0
        self._v_by_d = self._v_by_v = self._v_by_push = 0.0
        self._d_by_d, self._d_by_v, self._d_by_push = d_row
        self._v_by_d, self._v_by_v, self._v_by_push = v_row
        self.travel = self.velocity = 0.0

    def observe(self, actuator_force: float, handle_acceleration: float) -> float:
        """Advance by one sample; return the displacement at its end, m.

        Parameters
        ----------
        actuator_force : float
            Force until the next sample, N.
        handle_acceleration : float
            Measured handle acceleration, gravity included, m/s^2.

        Returns
        -------
        float
            Displacement at the next sample, m.
        """
        push = -actuator_force / self._m_a - handle_acceleration
        d = self.travel
        v = self.velocity
        self.velocity = self._v_by_d * d + self._v_by_v * v + self._v_by_push * push
        travel = self._d_by_d * d + self._d_by_v * v + self._d_by_push * push
        self.travel = travel
        return travel

    def reset(self) -> None:
        """Reset to rest in the middle of the travel."""
        self.travel = self.velocity = 0.0


class ActuatorGuard(TravelEstimator):
    """Limit force, heat and travel of the actuator.

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
    cushion, cushion_end : float
        Fractions of the travel where braking begins, and where the actuator comes to rest.
    warm : float
        Fraction of the permitted heat above which the peak force is reduced.
    speed : float
        Rate constant with which the approach to the cushion's end begins, 1/s.
    look_ahead : float
        Time by which braking begins before the cushion, ms, or in samples if longer.

    Attributes
    ----------
    heat : float
        Mean square of the force over the coil's time constant, N^2.
    requested, allowed : float
        Force requested of this coil, and force allowed instead, N; with several coils see
        `scale_within`.
    saturated, heated, cushioned : int
        Numbers of samples limited by peak force, by heat and by travel.
    """

    def __init__(
        self,
        actuator: ActuatorParameters,
        rate: float,
        cushion: float = CUSHION,
        cushion_end: float = CUSHION_END,
        warm: float = WARM,
        speed: float = CUSHION_SPEED,
        look_ahead: float = CUSHION_AHEAD,
    ) -> None:
        super().__init__(actuator, rate)
        peak = actuator.peak_force
        self._peak: float = peak
        self._bearable: float = min(actuator.continuous_force, peak) ** 2
        self._staying: float = -1.0 / (rate * actuator.thermal_time)
        self._warming: float = -math.expm1(self._staying)
        self._settling: float = math.ceil(rate * ACTUATOR_SETTLING)
        self._k_s: float = actuator.k_s
        self._b_s: float = actuator.b_s
        self._soft: float = cushion * actuator.travel
        self._end: float = cushion_end * actuator.travel
        self._cool: float = 1.0 - warm
        # Below this heat the peak force is allowed, as in `bearable_force`, regardless of
        # rounding.
        staying = max(1.0 - self._warming, LEAST_COOLING)
        lasting = (self._bearable - self._warming * peak * peak) / staying
        self._cold: float = (1.0 - 1e-9) * min(warm * self._bearable, lasting)
        self._speed: float = min(speed, CUSHION_SPEED_SHARE * rate)
        self._fastest: float = 2.0 * rate
        self._ahead: float = look_ahead * max(1e-3, 1.0 / rate)
        self.heat = 0.0
        self.requested = self.allowed = 0.0
        self.saturated = self.heated = self.cushioned = 0

    def within(self, force: float, handle_acceleration: float) -> float:
        """Return the force that may be applied now, N.

        Parameters
        ----------
        force : float
            Requested force, N; finite.
        handle_acceleration : float
            Measured handle acceleration, m/s^2; finite.
        """
        d = self.travel
        soft = self._soft
        ahead = d + self.velocity * self._ahead
        if d > soft or d < -soft or ahead > soft or ahead < -soft:
            force = self.braking_force(force, handle_acceleration)
        allowed = self._peak if self.heat <= self._cold else self.bearable_force()
        if force > allowed or force < -allowed:
            if allowed < self._peak:
                self.heated += 1
            else:
                self.saturated += 1
            force = math.copysign(allowed, force)
        return force

    def advance(self, force: float, handle_acceleration: float) -> None:
        """Update heat and travel with the force, N, that acts for one sample."""
        self.heat += self._warming * (force * force - self.heat)
        self.observe(force, handle_acceleration)

    def bearable_force(self) -> float:
        """Return the permitted force for the present heat, N."""
        bearable = self._bearable
        if bearable == 0.0:
            return 0.0
        heat = self.heat
        peak = self._peak
        left = 1.0 - heat / bearable
        allowed = peak * peak
        if not left >= self._cool:
            allowed = bearable + max(0.0, left) / self._cool * (allowed - bearable)
        # A single sample of peak force can overheat a very small coil.
        most = max(bearable, heat + (bearable - heat) / self._warming)
        return min(peak, math.sqrt(min(allowed, most)))

    def braking_force(self, force: float, handle_acceleration: float) -> float:
        """Return the force, or the force that brakes before the stop ahead if larger, N."""
        ahead = self.travel + self.velocity * self._ahead
        # Outward is positive, except for the force: a positive force pulls the actuator towards
        # the handle.
        side = math.copysign(1.0, ahead)
        d = side * self.travel
        v = side * self.velocity
        # Maximum outward acceleration: that of a critically damped approach or, if this comes too
        # late, of a constant deceleration.
        way = self._end - d
        speed = self._speed
        left = speed * speed * way - 2.0 * speed * v
        if v > speed * way:
            # At most the deceleration to rest within one sample, which also avoids a division by
            # zero.
            left = min(left, -0.5 * v * (v / way if v < self._fastest * way else self._fastest))
        braking = -self._m_a * (left + side * handle_acceleration)
        braking -= self._k_s * d + self._b_s * max(0.0, v)
        if side * force >= braking:
            return force
        self.cushioned += 1
        return side * braking

    def heat_share(self) -> float:
        """Return the heat relative to the continuous force's heat, 0 to 1."""
        return self.heat / self._bearable if self._bearable else 0.0


class Coil(ActuatorGuard):
    """Guard of one coil of a device, with the forces that have acted since its last update.

    Parameters
    ----------
    actuator : ActuatorParameters
    rate : float
        Ticks per second, Hz.
    axis : int
        Component of the actuator's force, 0 to 2.

    Attributes
    ----------
    axis : int
    held : float
        Present force, N.
    acceleration : float
        Latest plausible measurement of the handle, m/s^2.
    """

    def __init__(self, actuator: ActuatorParameters, rate: float, axis: int) -> None:
        super().__init__(actuator, rate, *HARD)
        self.axis: int = axis
        self._rate: float = rate
        self.acceleration = self.held = 0.0
        self._has_ticked = False
        # Integrals of the force, N s, and of its square, N^2 s, since the last update.
        self._impulse = self._heating = 0.0

    def tick(self, now: float, known: bool, handle_acceleration: float) -> None:
        """Update the guard with the forces since the last tick, even after a long pause."""
        # Also false for NaN.
        if known and -LARGEST_ACCELERATION <= handle_acceleration <= LARGEST_ACCELERATION:
            self.acceleration = handle_acceleration
        self.hold(now, self.held)
        if not self._has_ticked:
            self._has_ticked = True
            self._ticked = now
            return
        elapsed = now - self._ticked
        samples = (elapsed * self._rate + TO_WHOLE) - TO_WHOLE
        if samples < 1.0:  # two ticks for one grid point: the forces are counted with the next
            return
        mean = self._impulse / elapsed
        square = self._heating / elapsed
        warming = self._warming if samples == 1.0 else -math.expm1(samples * self._staying)
        self.heat += warming * (square - self.heat)
        self.observe(mean, self.acceleration)
        if samples > 1.0:
            for _ in range(1, int(min(samples, self._settling))):
                self.observe(mean, self.acceleration)
        self._ticked = now
        self._impulse = self._heating = 0.0

    def hold(self, now: float, force: float) -> None:
        """Apply a new force, and integrate the effect of the previous force."""
        if self._has_ticked:
            held = self.held
            time = now - self._since
            self._impulse += held * time
            self._heating += held * held * time
        self._since: float = now
        self.held = force


def scale_within(guards: list[ActuatorGuard]) -> None:
    """Scale the force on several coils as a whole to what their guards allow.

    The requested force of each coil, `requested`, and the force that its guard allows, `allowed`,
    result in the scaled force, which replaces `allowed`. A guard that requests a larger force, in
    order to brake, does not limit the others. If a guard requests the opposite direction, all
    forces are zero.
    """
    share = 1.0
    last: ActuatorGuard | None = None
    for guard in guards:
        part = guard.allowed / guard.requested if guard.requested != 0.0 else 1.0
        if part < share:
            share = part
            last = guard
    for guard in guards:
        if share <= 0.0:
            guard.allowed = 0.0
        elif guard is not last:  # the last one has its guard's force, without rounding
            guard.allowed = guard.requested if last is None else share * guard.requested
