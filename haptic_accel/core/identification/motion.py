# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fit of handle and dry friction to recorded motion.

A fit to responses mistakes dry friction for viscous damping. Here the motion is simulated, with
eq. (1) and (2) of the paper and friction between actuator and handle, and compared with the
recording.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from haptic_accel.core.handle.mechanics import axial_mechanics, zero_order_hold
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import smoothed
from haptic_accel.core.identification.fit import FRICTION, INTERVAL, Coordinates, HandleFit, Point
from haptic_accel.core.model import ComplexArray, FloatArray

# scipy.optimize is slow to import: only a fit needs it.

STEPS = (1e-3, 250e-6)
"""Maximum steps of the simulation in the first and the last search, s. Friction is constant
within a step; all else is integrated exactly. A quarter of the last step changes the motion by a
third of the accelerometer's noise."""

HIGHEST_HARMONIC = 3.0
"""Ratio of the highest compared frequency to the sweep's: dry friction has a third harmonic."""

EXPECTED = {"slip_velocity": (2e-3, 1.0), "friction_lag": (0.0, 200e-6)}
"""Expected values and uncertainties of the parameters of friction reversal; the uncertainty of the
slip velocity is that of its logarithm (assumed: 1 to 5 mm/s, and the micrometres within which
contacts shear). The motion contains little information on them, but they shift the other
parameters."""

PATTERNS = 4.0
"""Number of patterns in the model's error per parameter (assumed; few, as the error repeats at
each reversal of the slip; the actual errors are then one standard error or less)."""

LARGEST_SHARE = 0.49
"""Ratio of the highest compared frequency to the sampling rate."""

_FRICTION_START = 0.01  # N
_DIFFERENCE = 1e-4  # finite difference of the search variables
_CLOSE = 1e-6  # relative step and relative gain that end the search
_NEGLIGIBLE = 0.01  # squared error of the coarse simulation
_SAME = 0.01  # distance of solutions, in search variables, that counts as zero
_LINEAR = 0.2  # relative error of a predicted rise in cost
_MOST_STEPS = 10  # maximum to an end of an interval; three to five suffice
_LONGEST_STEP = 1.0  # in search variables
_LEAST_NOISE = 1e-6  # relative to the strongest line: rounding errors without noise


def fit_motion(
    trials: Sequence[sweeps.IdentificationTrial], sweep: sweeps.SweepParameters, start: HandleFit
) -> HandleFit:
    """Refine a fit to responses, and fit dry friction, to the mean of all repeats.

    Each spectral line is weighted by its scatter between repeats. The standard errors include
    noise and the model's errors. The model's errors are assumed to consist of `PATTERNS`
    independent patterns per parameter, all of the same size. Each parameter has then absorbed one
    pattern, of the residual's mean size.

    Parameters
    ----------
    trials : sequence of IdentificationTrial
        Trials without latency, of one handle with one grip, each from rest.
    sweep : SweepParameters
        Excitation of the handle.
    start : HandleFit
        Initial point of the search; its fitted parameters are free.

    Returns
    -------
    HandleFit
        Fit with `FRICTION` among the fitted parameters.
    """
    initial = start.replaced({"friction": _FRICTION_START})
    coordinates = Coordinates(initial, (*start.standard_errors, *FRICTION))
    coarse, fine = (_Problem(trials, sweep, coordinates, step) for step in STEPS)
    begins = [initial]
    if {"b_s", "b_u"} <= set(coordinates.free):
        begins.append(initial.exchanged())
    minima = [coarse.minimum(coordinates.values(each)) for each in begins]
    lowest = min(minima, key=coarse.cost)
    most = coarse.cost(lowest) + INTERVAL**2 * coarse.inflation(lowest)
    others = [values for values in minima if not np.allclose(values, lowest, atol=_SAME)]
    near = [lowest, *(values for values in others if coarse.cost(values) <= most)]
    # Without friction, or with much noise, the coarse simulation is accurate enough.
    error = fine.residuals(lowest) - coarse.residuals(lowest)
    last = fine if float(error @ error) > _NEGLIGIBLE else coarse
    refined = [last.minimum(values) for values in near] if last is fine else near
    at = min(range(len(refined)), key=lambda index: last.cost(refined[index]))
    fit = last.fit(refined[at], start)
    # The coarse simulation shifts the minimum, but hardly changes the shape around it.
    # An interval contains all values near a minimum whose cost stays below the limit.
    most = min(map(coarse.cost, near)) + INTERVAL**2 * fit.inflation
    ends = [coarse.ends(values, most) for values in near if coarse.cost(values) < most]
    lows, highs = zip(*ends, strict=True)
    shift = refined[at] - near[at]
    bounds = coordinates.bounds(refined[at], trials[0].rate)
    extremes = np.min(lows, axis=0), np.max(highs, axis=0)
    points = [coordinates.point(np.clip(end + shift, *bounds)) for end in extremes]
    errors = {
        name: max(abs(end.value(name) - fit.value(name)) for end in points) / INTERVAL
        for name in coordinates.free
    }
    return replace(fit, standard_errors=errors)


def simulated(
    points: Sequence[Point], force: FloatArray, rate: float, longest_step: float = STEPS[-1]
) -> FloatArray:
    """Return the sampled acceleration of handles that start at rest, m/s^2.

    Parameters
    ----------
    points : sequence of Point
        Handles that all have a rigid mount or all a resonant one; they are simulated together.
    force : ndarray, shape (n,)
        Actuator force immediately after each sample, N.
    rate : float
        Samples per second.
    longest_step : float
        Maximum time in which friction is constant, s.

    Returns
    -------
    ndarray, shape (len(points), n)
    """
    steps = math.ceil(1.0 / (rate * longest_step) - 1e-9)  # steps from one force to the next
    steppings = [_stepping(point, 1.0 / (rate * steps)) for point in points]
    over, rub = (np.array(each) for each in zip(*steppings, strict=True))
    rub, states = rub[..., None], rub.shape[1]
    # State and force at the start of each step, and the fraction of the friction during it.
    count = len(force) * steps
    starts = np.zeros((count + 1, len(points), states + 1, 1))
    starts[:-1, :, states, 0] = np.repeat(force, steps)[:, None]
    shares = np.zeros((count, len(points), 1, 1))
    for now, after, share in zip(starts[:-1], starts[1:, :, :states], shares, strict=True):
        free = over @ now
        np.minimum(np.maximum(free[:, states:], -1.0), 1.0, out=share)
        np.add(free[:, :states], rub * share, out=after)
    known = np.concatenate([starts[:-1], shares], axis=2)[..., 0]
    known = known.reshape(len(force), steps, *known.shape[1:])
    return np.array([_seen(point, known[:, :, at], rate) for at, point in enumerate(points)])


def _stepping(point: Point, time: float) -> tuple[FloatArray, FloatArray]:
    """Return transition matrix of state and force over a step in s, and effect of full friction.

    The last row computes the fraction of the friction that acts. It is proportional to the mean
    slip over the step, including the friction's own effect, up to 1. Constant friction within a
    step thus cannot reverse a slip.

    Returns
    -------
    ndarray, shape (states + 1, states + 1)
    ndarray, shape (states,)
    """
    a, b = axial_mechanics(point.handle, point.mount, point.low_pass_frequency)
    free, push = zero_order_hold(a, b, time)
    bearing = point.bearing
    slip = np.zeros(len(b))
    slip[1], slip[3] = 1.0, -1.0
    # Friction acts between actuator and handle, as the actuator's force does.
    yielding = -float(slip @ push)  # slip removed by a unit of friction
    scale = bearing.slip_velocity + abs(bearing.friction) * yielding / 2
    late = bearing.friction_lag / time
    identity = np.eye(len(b))
    mean = slip @ (0.5 * (free + identity) - late * (free - identity))
    shared = np.append(mean, (0.5 - late) * float(slip @ push)) / scale
    over = np.vstack([np.column_stack([free, push]), shared])
    return over, bearing.friction * push


def _seen(point: Point, before: FloatArray, rate: float) -> FloatArray:
    """Return the sampled acceleration of a handle whose force acts a delay after the sample.

    Parameters
    ----------
    point : Point
    before : ndarray, shape (n, steps, states + 2)
        State, force and fraction of friction at the start of each step.
    rate : float
        Samples per second.
    """
    samples, steps, _ = before.shape
    late = math.ceil(point.delay * rate)  # delay until a force appears, rounded up to samples
    rest = late / rate - point.delay
    step = min(int(rest * rate * steps), steps - 1)
    a, b = axial_mechanics(point.handle, point.mount, point.low_pass_frequency)
    over, push = zero_order_hold(a, b, rest - step / (rate * steps))
    row = np.concatenate([over[-1], [push[-1], point.bearing.friction * push[-1]]])
    acceleration = np.zeros(samples)
    acceleration[max(0, late) : samples + min(0, late)] = (
        before[max(0, -late) : samples - max(0, late), step] @ row
    )
    return acceleration


class _Problem:
    """Residuals of the mean spectrum as a function of the search variables.

    Parameters
    ----------
    trials : sequence of IdentificationTrial
    sweep : SweepParameters
    coordinates : Coordinates
        Conversion between parameters and search variables.
    step : float
        Maximum step of the simulation, s.
    """

    def __init__(
        self,
        trials: Sequence[sweeps.IdentificationTrial],
        sweep: sweeps.SweepParameters,
        coordinates: Coordinates,
        step: float,
    ) -> None:
        self._rate, self._coordinates, self._step = trials[0].rate, coordinates, step
        self._repeat = sweeps.repeat_samples(sweep, self._rate)
        frequency = np.fft.rfftfreq(self._repeat, 1.0 / self._rate)
        highest = min(HIGHEST_HARMONIC * sweep.end_frequency, LARGEST_SHARE * self._rate)
        self._used = (frequency >= sweep.start_frequency) & (frequency <= highest)
        # Usually all trials and repeats have the same force.
        forces = [trial.actuator_force[: sweep.repeats * self._repeat] for trial in trials]
        self._forces, counts = np.unique(forces, axis=0, return_counts=True)
        self._shares = counts / len(trials)
        repeated = np.tile(self._forces[:, : self._repeat], sweep.repeats)
        if np.array_equal(self._forces, repeated):
            self._forces = self._forces[:, : (sweeps.DROPPED_REPEATS + 1) * self._repeat]
        spectra = np.array([self._spectra(trial.handle_acceleration) for trial in trials])
        self._measured = spectra.mean(axis=(0, 1))
        scatter = np.abs(spectra - spectra.mean(axis=1, keepdims=True)) ** 2
        count, repeats, _ = spectra.shape
        self._freedom = count * (repeats - 1)  # degrees of freedom of a line's scatter
        power = smoothed(scatter.sum(axis=(0, 1)) / self._freedom) / (count * repeats)
        least = _LEAST_NOISE * np.abs(self._measured).max()
        self._deviation = np.maximum(np.sqrt(power / 2), least)
        self._at = np.array([np.nan])
        self._residuals, self._jacobian = np.zeros(0), np.zeros((0, 0))

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return normalised errors of real and imaginary parts, then of `EXPECTED`."""
        self._linearise(values)
        return self._residuals

    def jacobian(self, values: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals."""
        self._linearise(values)
        return self._jacobian

    def cost(self, values: FloatArray) -> float:
        """Return the sum of the squared residuals."""
        return float(np.sum(self.residuals(values) ** 2))

    def inflation(self, values: FloatArray) -> float:
        """Return the factor of the noise's variance that includes the model's errors."""
        error = self.residuals(values)[: -len(EXPECTED)]
        free = len(values)
        # Noise may cause a part of the misfit, but may also hide an error of the model.
        misfit = max(0.0, float(error @ error) - (len(error) - free))
        return 1.0 + misfit / (PATTERNS * free)

    def minimum(self, start: FloatArray) -> FloatArray:
        """Return the local minimum of the cost that a search from a point finds."""
        from scipy.optimize import least_squares

        bounds = self._coordinates.bounds(start, self._rate)
        found = least_squares(
            self.residuals,
            np.clip(start, *bounds),
            jac=self.jacobian,
            bounds=bounds,
            x_scale="jac",
            xtol=_CLOSE,
            ftol=_CLOSE,
        )
        return np.asarray(found.x)

    def ends(self, minimum: FloatArray, most: float) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and largest value of each variable whose cost stays below a limit.

        The other variables take the values with the least cost (profile likelihood). A step to an
        end is exact for a linear model; it is repeated where the cost is not as predicted.

        Parameters
        ----------
        minimum : ndarray, shape (n,)
            Local minimum of the cost.
        most : float
            Cost at the ends.
        """
        bounds = self._coordinates.bounds(minimum, self._rate)
        rise = most - self.cost(minimum)
        sides = [(at, sign) for sign in (-1.0, 1.0) for at in range(len(minimum))]
        # The first steps of all variables are simulated at once.
        first = [self._step_to_end(minimum, at, sign, most, bounds) for at, sign in sides]
        errors = self._errors([self._coordinates.point(values) for values in first])
        predicted = np.abs(np.sum(errors**2, axis=1) - most) < _LINEAR * rise
        # The intervals of friction reversal are assumptions, so an estimate is enough.
        reversal = [name in EXPECTED for name in self._coordinates.free]
        predicted |= np.tile(reversal, 2)
        ends = [
            values[at] if good else self._end(minimum, values, at, sign, most, bounds)
            for values, good, (at, sign) in zip(first, predicted.tolist(), sides, strict=True)
        ]
        low, high = np.reshape(ends, (2, len(minimum)))
        return low, high

    def _end(
        self,
        minimum: FloatArray,
        values: FloatArray,
        at: int,
        sign: float,
        most: float,
        bounds: tuple[FloatArray, FloatArray],
    ) -> float:
        """Return the most distant value of a variable whose cost stays below the limit."""
        rise = most - self.cost(minimum)
        inside = minimum
        for _ in range(_MOST_STEPS):
            cost = self.cost(values)
            if cost > most + rise:
                values = (values + inside) / 2
                continue
            if cost <= most + _LINEAR * rise and sign * (values[at] - inside[at]) > 0.0:
                inside = values
            following = self._step_to_end(values, at, sign, most, bounds)
            change = abs(following[at] - values[at])
            if cost <= most + _LINEAR * rise and change <= _LINEAR * abs(values[at] - minimum[at]):
                break
            values = following
        return float(inside[at])

    def _step_to_end(
        self,
        values: FloatArray,
        at: int,
        sign: float,
        most: float,
        bounds: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Return the end of a variable's interval, for residuals that are linear around a point.

        Parameters
        ----------
        values : ndarray, shape (n,)
        at : int
            Index of the variable.
        sign : float
            Direction, -1 or 1.
        most : float
            Cost at the end.
        bounds : tuple of ndarray, shape (n,)
            Lower and upper bounds of the variables.
        """
        jacobian, residuals = self.jacobian(values), self.residuals(values)
        low, high = bounds
        free = np.ones(len(values), dtype=bool)
        step = np.zeros(len(values))
        for _ in range(2):  # repeat without variables out of bounds
            used = jacobian[:, free]
            covariance = np.linalg.pinv(used.T @ used)
            slope = used.T @ residuals
            newton = -covariance @ slope
            room = max(0.0, most - float(residuals @ residuals) - float(slope @ newton))
            column = np.count_nonzero(free[:at])  # variable's index among the free ones
            toward = covariance[column]
            own = float(toward[column])
            step[:] = 0.0
            step[free] = newton + sign * toward * math.sqrt(room / own)
            outside = (values + step <= low) & (step < 0) | (values + step >= high) & (step > 0)
            outside[at] = False
            if not outside.any():
                break
            free &= ~outside
        step *= min(1.0, _LONGEST_STEP / float(np.abs(step).max()))
        return np.clip(values + step, low, high)

    def fit(self, values: FloatArray, start: HandleFit) -> HandleFit:
        """Return the fit for a solution."""
        error = self.residuals(values)[: -len(EXPECTED)]
        point = self._coordinates.point(values)
        point = point.replaced({"friction": max(0.0, point.value("friction"))})
        missed = error * np.tile(self._deviation, 2)
        return replace(
            start,
            handle=point.handle,
            mount=point.mount,
            delay=point.delay,
            bearing=point.bearing,
            residual=math.sqrt(float(np.mean(error**2))),
            relative_residual=float(np.linalg.norm(missed) / np.linalg.norm(self._measured)),
            count=len(error),
            inflation=self.inflation(values),
            limited=self._coordinates.limited(values),
        )

    def _linearise(self, values: FloatArray) -> None:
        """Simulate the handle, and variants with small changes of each parameter."""
        if np.array_equal(values, self._at):
            return
        shifted = values + _DIFFERENCE * np.eye(len(values))
        parts = self._errors([self._coordinates.point(each) for each in (values, *shifted)])
        self._at, self._residuals = values.copy(), parts[0]
        self._jacobian = (parts[1:] - parts[0]).T / _DIFFERENCE

    def _errors(self, points: Sequence[Point]) -> FloatArray:
        """Return the residuals of several points, shape (len(points), n)."""
        errors = (self._simulated(points) - self._measured) / self._deviation
        return np.hstack([errors.real, errors.imag, [_unexpected(point) for point in points]])

    def _simulated(self, points: Sequence[Point]) -> ComplexArray:
        """Return the mean spectra of simulated handles, shape (len(points), lines)."""
        total = np.zeros((len(points), len(self._measured)), dtype=np.complex128)
        for force, share in zip(self._forces, self._shares, strict=True):
            for index, moved in enumerate(simulated(points, force, self._rate, self._step)):
                total[index] += share * self._spectra(moved).mean(axis=0)
        return total

    def _spectra(self, values: FloatArray) -> ComplexArray:
        """Return the lines of each evaluated repeat, shape (repeats, lines)."""
        kept = values[sweeps.DROPPED_REPEATS * self._repeat :]
        kept = kept[: len(kept) // self._repeat * self._repeat].reshape(-1, self._repeat)
        return np.asarray(np.fft.rfft(kept)[:, self._used])


def _unexpected(point: Point) -> list[float]:
    """Return the normalised deviation of the friction reversal from `EXPECTED`."""
    velocity, spread = EXPECTED["slip_velocity"]
    lag, width = EXPECTED["friction_lag"]
    bearing = point.bearing
    return [
        math.log(bearing.slip_velocity / velocity) / spread,
        (bearing.friction_lag - lag) / width,
    ]
