# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Physical parameters of the handle, fitted to estimates of its frequency response."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from haptic_accel.core.handle.mechanics import ACCELEROMETER_CORNER, RIGID, sampled_response
from haptic_accel.core.identification.estimate import Band, FrequencyResponse
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, MountParameters
from haptic_accel.core.parameters import ParameterError

# scipy.optimize and scipy.linalg are slow to import: only a fit needs them.

DEFAULT_FREE = ("b_s", "m_h", "k_u", "b_u", "delay")
"""Fitted parameters. The actuator's mass and spring can be measured on the bench."""

LONGEST_DELAY = 0.01
"""Upper bound of a fitted delay, s: ten times the delay in the paper."""

EARLIEST_DELAY = -0.001
"""Lower bound of a fitted delay, s: the sampling may occur after the stamp."""

MOUNT = ("mount_frequency", "mount_damping")
"""Optional fitted parameters: the mode of the accelerometer's mount."""

FRICTION = ("friction", "slip_velocity", "friction_lag")
"""Parameters of dry friction. They are fitted to the motion, as a frequency response does not show
them."""

INTERVAL = 1.96
"""Half width of a 95 % interval, in standard errors."""

HANDLE = tuple(field.name for field in fields(HandleParameters))
"""Parameters of the handle."""

_UNITS = {"delay": 1e-3, "friction": 0.01, "friction_lag": 1e-4}
"""Units, s and N, of the parameters that may be zero; all others use logarithms."""
_REACH = math.log(1e3)  # a parameter is searched within this factor of its initial value
_BOUNDS: dict[str, Any] = {  # in search units: mount as logarithms
    "delay": (EARLIEST_DELAY / _UNITS["delay"], LONGEST_DELAY / _UNITS["delay"]),
    "friction": (-0.02 / _UNITS["friction"], 10.0 / _UNITS["friction"]),  # below 0 by noise
    "friction_lag": (-1e-3 / _UNITS["friction_lag"], 2e-3 / _UNITS["friction_lag"]),
    "mount_frequency": np.log((20.0, 1990.0)),  # finite differences stay below 2000
    "mount_damping": np.log((0.011, 1.9)),
}
_START_FACTORS = {  # grips vary by these factors between people
    **dict.fromkeys(("b_s", "m_h", "k_u", "b_u"), (0.3, 1.0, 3.0)),
    "mount_frequency": (0.7, 1.0, 1.4),
}
_START_DELAYS = 2.5e-4  # spacing, s: 60 degrees of phase at 200 Hz would be 8e-4
_START_LINES = 40  # lines in the search for initial values
_NEAR = 1e-3  # samples by which an identified delay may be below a whole number
_SETTLED = 7.0  # number of time constants until a low-pass follows a jump within 0.1 %
_SHORT = 0.06  # longest time constant, in sampling periods, that counts as no low-pass
_AT_LIMIT = 1e-4  # distance, in search variables, that counts as at a limit


@dataclass(frozen=True)
class Friction:
    """Dry friction between actuator and handle.

    Attributes
    ----------
    friction : float
        Friction while the actuator slips, N.
    slip_velocity : float
        Slip velocity for full friction, m/s.
    friction_lag : float
        Delay of the friction behind the slip, s.
    """

    friction: float = 0.0
    slip_velocity: float = 2e-3
    friction_lag: float = 0.0


@dataclass(frozen=True)
class Point:
    """Model parameters of a recording: the handle and its accelerometer.

    Attributes
    ----------
    handle : HandleParameters
    mount : MountParameters
        Mount of the accelerometer.
    delay : float
        Delay in addition to the hold and the accelerometer's low-pass, s.
    low_pass_frequency : float
        Corner frequency of the accelerometer, Hz.
    bearing : Friction
        Dry friction of the actuator's bearing; not visible in a response.
    """

    handle: HandleParameters
    mount: MountParameters
    delay: float
    low_pass_frequency: float
    bearing: Friction

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return the model's response at frequencies in Hz, for signals sampled at a rate."""
        return sampled_response(
            self.handle, frequency, rate, self.delay, self.low_pass_frequency, self.mount
        )

    def value(self, name: str) -> float:
        """Return a parameter of the handle, ``delay``, one of `MOUNT` or of `FRICTION`."""
        if name == "delay":
            return self.delay
        if name in FRICTION:
            return float(getattr(self.bearing, name))
        if name in MOUNT:
            return float(getattr(self.mount, name.removeprefix("mount_")))
        return float(getattr(self.handle, name))

    def replaced(self, values: dict[str, float]) -> Point:
        """Return the point with other values for the named parameters."""
        handle = {n: v for n, v in values.items() if n in HANDLE}
        mount = {n.removeprefix("mount_"): v for n, v in values.items() if n in MOUNT}
        bearing = {n: v for n, v in values.items() if n in FRICTION}
        return replace(
            self,
            handle=replace(self.handle, **handle),
            mount=replace(self.mount, **mount),
            delay=values.get("delay", self.delay),
            bearing=replace(self.bearing, **bearing),
        )

    def exchanged(self) -> Point:
        """Return the point with exchanged damping of bearing and grip.

        Both dampings mainly affect two coefficients of eq. (3): s^3 by b_u + (1 + m_h/m_a) b_s,
        and s^2 by b_u b_s, which gives two solutions. Only coefficients that are small above 10 Hz
        distinguish the solutions. A search may find the wrong one.
        """
        handle = self.handle
        ratio = 1.0 + handle.m_h / handle.m_a
        return self.replaced({"b_s": handle.b_u / ratio, "b_u": handle.b_s * ratio})


@dataclass(frozen=True)
class Coordinates:
    """Free parameters as search variables of order one.

    Attributes
    ----------
    known : Point
        Values of the fixed parameters.
    free : tuple of str
        Names of the free parameters.
    """

    known: Point
    free: tuple[str, ...]

    def values(self, point: Point) -> FloatArray:
        """Return the search variables of a point, shape (n,)."""
        pairs = ((name, point.value(name)) for name in self.free)
        return np.array(
            [value / _UNITS[name] if name in _UNITS else math.log(value) for name, value in pairs]
        )

    def point(self, values: FloatArray) -> Point:
        """Return the point for search variables."""
        return self.known.replaced(
            {
                name: value * _UNITS[name] if name in _UNITS else math.exp(value)
                for name, value in zip(self.free, values.tolist(), strict=True)
            }
        )

    def bounds(self, start: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds of a search from an initial point.

        Parameters
        ----------
        start : ndarray, shape (n,)
            Search variables of the initial point.
        rate : float
            Samples per second of the recording.
        """
        known = zip(self.free, self.values(self.known).tolist(), strict=True)
        pairs = [_BOUNDS.get(name, (value - _REACH, value + _REACH)) for name, value in known]
        if "delay" in self.free and self.known.low_pass_frequency > rate:
            at = self.free.index("delay")
            pairs[at] = self._continuous(start[at] * _UNITS["delay"], rate)
        low, high = np.transpose(pairs)
        return low, high

    def _continuous(self, delay: float, rate: float) -> tuple[float, float]:
        """Return the range of the delay near a value, in search units, that contains no jump.

        If a force acts just before a sample instead of just after it, a sensor without low-pass
        reacts one sample earlier. A search with derivatives cannot cross this jump, nor should it
        end within the jump, where the delay acts as a gain.
        """
        whole = math.floor(delay * rate + _NEAR)
        settling = _SETTLED / (2 * math.pi * self.known.low_pass_frequency)
        end = (whole + 1) / rate - (settling if settling * rate <= _SHORT else 0.0)
        return whole / rate / _UNITS["delay"], end / _UNITS["delay"]

    def limited(self, values: FloatArray) -> tuple[str, ...]:
        """Return the names of the parameters at a limit of the search.

        The limits of friction and of a delay without low-pass are physical, and do not count.
        """
        low, high = self.bounds(values, math.inf)
        at_limit = (values - low < _AT_LIMIT) | (high - values < _AT_LIMIT)
        return tuple(
            name
            for name, limited in zip(self.free, at_limit.tolist(), strict=True)
            if limited and name not in FRICTION
        )

    def errors(self, point: Point, covariance: FloatArray) -> dict[str, float]:
        """Return standard errors by name, in the parameters' units, from a covariance."""
        deviations = np.sqrt(np.diag(covariance)).tolist()
        return {
            name: deviation * _UNITS.get(name, point.value(name))
            for name, deviation in zip(self.free, deviations, strict=True)
        }


@dataclass(frozen=True)
class HandleFit(Point):
    """Handle model with the best fit to the responses.

    Attributes
    ----------
    handle : HandleParameters
        Fitted and known parameters.
    mount : MountParameters
        Mount of the accelerometer, fitted or known.
    delay : float
        Delay in addition to the hold and the accelerometer's low-pass, s. It is 0 in lockstep,
        where a force acts immediately after the sample that caused it.
    standard_errors : dict
        Standard errors of the fitted parameters by name, in their units. For a fit to responses
        they are based on the Jacobian and the residual and include noise only. In `fit_motion`
        they also include the model's errors.
    residual : float
        Root mean square of the error over the estimates' standard deviation; 1 for a model without
        systematic error.
    relative_residual : float
        Root mean square of |error| over |response|.
    band : tuple of float
        Lower and upper frequency limit of the fit, Hz.
    count : int
        Number of fitted values.
    inflation : float
        Factor of the noise's variance that includes the model's errors.
    limited : tuple of str
        Names of the parameters at a limit of the search: the data does not determine them.
    """

    standard_errors: dict[str, float]
    residual: float
    relative_residual: float
    band: Band
    count: int
    inflation: float
    limited: tuple[str, ...]

    @property
    def certain_friction(self) -> float:
        """Dry friction, N, to compensate; 0 if zero is within its interval."""
        friction = self.bearing.friction
        certain = friction > INTERVAL * self.standard_errors.get("friction", 0.0)
        return friction if certain else 0.0

    @property
    def deviates(self) -> bool:
        """True if the residual exceeds that of pure noise by four standard deviations."""
        return self.residual > 1.0 + 4.0 / math.sqrt(2.0 * self.count)


def fit_handle(
    responses: FrequencyResponse | Sequence[FrequencyResponse],
    *,
    known: HandleParameters | None = None,
    free: Sequence[str] = DEFAULT_FREE,
    delay: float = 0.0,
    low_pass_frequency: float = ACCELEROMETER_CORNER,
    mount: MountParameters = RIGID,
) -> HandleFit:
    """Fit eq. (3) of the paper, with delay, hold and low-pass, to one or more responses.

    The method is complex least squares, in which each line is weighted by its standard deviation.
    Parameters are fitted as logarithms, and thus remain positive.

    Parameters
    ----------
    responses : FrequencyResponse or sequence of FrequencyResponse
        Responses of one handle with one grip; several are pooled.
    known : HandleParameters, optional
        Values of the fixed parameters, and initial values of the others; default: Table I.
    free : sequence of str
        Names of the fitted parameters: fields of `HandleParameters`, at most five, ``"delay"``,
        and for the mount ``"mount_frequency"`` and ``"mount_damping"``.
    delay : float
        Delay if it is fixed, s.
    low_pass_frequency : float
        Corner of the accelerometer's first-order low-pass, Hz.
    mount : MountParameters
        Mount of the accelerometer if it is fixed, otherwise its initial value.

    Returns
    -------
    HandleFit

    Raises
    ------
    ParameterError
        No or too many parameters are free, a name is unknown, or too few lines are coherent.
    """
    if isinstance(responses, FrequencyResponse):
        responses = [responses]
    start = Point(known or HandleParameters(), mount, delay, low_pass_frequency, Friction())
    _check(start, free)
    return _Problem(responses, start, tuple(free)).solve()


class _Problem:
    """Residuals as a function of the free parameters."""

    def __init__(
        self, responses: Sequence[FrequencyResponse], known: Point, free: tuple[str, ...]
    ) -> None:
        self._known, self._free = known, free
        self._coordinates = Coordinates(known, free)
        self._lines = [_weighted(response) for response in responses]
        count = sum(len(lines.frequency) for lines in self._lines)
        if count <= len(free):
            raise ParameterError(
                f"responses: {count} lines with some coherence, must be at least {len(free) + 1}"
            )

    def solve(self) -> HandleFit:
        found = min(map(self._searched, self._starts()), key=self._preference)
        if {"b_s", "b_u"} <= set(self._free):
            exchanged = self._coordinates.point(found.x).exchanged()
            other = self._searched(self._coordinates.values(exchanged))
            found = min(found, other, key=self._preference)
        point = self._coordinates.point(found.x)
        jacobian = np.asarray(found.jac)
        count, free = len(found.fun), len(self._free)
        variance = 2.0 * found.cost / (count - free)
        covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
        ends = [float(lines.frequency[end]) for lines in self._lines for end in (0, -1)]
        return HandleFit(
            **vars(point),
            standard_errors=self._coordinates.errors(point, covariance),
            residual=math.sqrt(2.0 * found.cost / count),
            relative_residual=self._relative(point),
            band=(min(ends), max(ends)),
            count=count,
            inflation=variance,
            limited=self._coordinates.limited(found.x),
        )

    def _searched(self, start: FloatArray) -> Any:
        """Return the least-squares solution from an initial point."""
        from scipy.optimize import least_squares

        bounds = self._coordinates.bounds(start, self._lines[0].rate)
        start = np.clip(start, *bounds)
        return least_squares(self._residuals, start, bounds=bounds, x_scale="jac")

    def _preference(self, found: Any) -> tuple[float, float]:
        """Return the sort key of a solution: its cost, then its distance from the known handle."""
        # Costs may differ by rounding, which depends on the version of a library.
        cost = float(f"{found.cost:.6g}")
        return cost, float(np.linalg.norm(found.x - self._coordinates.values(self._known)))

    def _residuals(self, point: FloatArray) -> FloatArray:
        parts = []
        for line, modelled in _modelled(self._lines, self._coordinates.point(point)):
            error = (modelled - line.response) / line.deviation
            parts += [error.real, error.imag]
        return np.concatenate(parts)

    def _relative(self, point: Point) -> float:
        errors = [
            np.abs(modelled / line.response - 1.0) ** 2
            for line, modelled in _modelled(self._lines, point)
        ]
        return float(np.sqrt(np.mean(np.concatenate(errors))))

    def _starts(self) -> list[FloatArray]:
        """Return initial points: the best of a coarse grid, to avoid local minima in the search.

        Without a low-pass, the delay jumps by whole samples. Delays one sample shorter and longer
        are then added.


        Errors are relative: with weights by standard deviation, a few lines would dominate.
        """
        lines = [_thinned(line) for line in self._lines]
        delays = [self._known.delay]
        if "delay" in self._free:
            delays = np.arange(0.0, LONGEST_DELAY, _START_DELAYS).tolist()
        best, best_cost = self._known, math.inf
        for point in self._grid():
            costs = self._costs(point, delays, lines)
            at = int(np.argmin(costs))
            if costs[at] < best_cost:
                best, best_cost = point.replaced({"delay": delays[at]}), costs[at]
        best_values = self._coordinates.values(best)
        rate = self._lines[0].rate
        if "delay" not in self._free or self._known.low_pass_frequency <= rate:
            return [best_values]
        neighbours = [best.delay + samples / rate for samples in (-1, 0, 1)]
        return [
            self._coordinates.values(best.replaced({"delay": delay}))
            for delay in neighbours
            if EARLIEST_DELAY <= delay <= LONGEST_DELAY
        ]

    def _grid(self) -> Iterator[Point]:
        """Yield the grid of points near the initial point."""
        known = self._known
        varied = {name: f for name, f in _START_FACTORS.items() if name in self._free}
        for factors in product(*varied.values()):
            pairs = zip(varied, factors, strict=True)
            yield known.replaced({name: known.value(name) * factor for name, factor in pairs})

    def _costs(self, point: Point, delays: Sequence[float], lines: Sequence[_Lines]) -> FloatArray:
        """Return the summed squared relative errors for each of several delays."""
        costs = np.zeros(len(delays))
        for line, modelled in _modelled(lines, point.replaced({"delay": 0.0})):
            ratio = modelled / line.response
            # A phase rotation approximates the delay, accurately enough for initial values.
            turns = np.exp(-2j * np.pi * np.outer(delays, line.frequency))
            costs += np.sum(np.minimum(np.abs(turns * ratio - 1.0), 2.0) ** 2, axis=1)
        return costs


@dataclass(frozen=True)
class _Lines:
    """Fitted lines of one response, with the standard deviation of each."""

    frequency: FloatArray
    response: ComplexArray
    deviation: FloatArray
    rate: float


def _modelled(every: Sequence[_Lines], point: Point) -> Iterator[tuple[_Lines, ComplexArray]]:
    """Yield spectral lines with the model's response; equal lines are computed once."""
    frequency, rate, modelled = np.zeros(0), 0.0, np.zeros(0, dtype=np.complex128)
    for lines in every:
        if lines.rate != rate or not np.array_equal(lines.frequency, frequency):
            frequency, rate = lines.frequency, lines.rate
            modelled = point.response(frequency, rate)
        yield lines, modelled


def _weighted(response: FrequencyResponse) -> _Lines:
    """Return the lines of a response with non-zero coherence."""
    used = (response.coherence > 0.0) & (np.abs(response.response) > 0.0)
    # Where a record without noise has a coherence of one, rounding remains.
    smallest = _ROUNDING * np.abs(response.response[used])
    return _Lines(
        response.frequency[used],
        response.response[used],
        np.maximum(response.standard_deviation[used], smallest),
        response.rate,
    )


def _thinned(lines: _Lines) -> _Lines:
    """Return a few of the lines, enough for the search for initial values."""
    every = max(1, len(lines.frequency) // _START_LINES)
    return _Lines(
        lines.frequency[::every], lines.response[::every], lines.deviation[::every], lines.rate
    )


_ROUNDING = 1e-9  # relative


def check_free(free: Sequence[str]) -> None:
    """Reject unknown names of parameters (``friction`` is allowed), too few and too many names.

    Raises
    ------
    ParameterError
    """
    names = (*HANDLE, *MOUNT, "delay", "friction")
    for name in free:
        if name not in names:
            raise ParameterError(f"free = {name!r}: must be among {', '.join(names)}")
    if not set(free) - {"friction"}:
        listed = ", ".join(free) or "()"
        raise ParameterError(f"free = {listed}: must hold at least one parameter besides friction")
    if len(set(free)) < len(free):
        raise ParameterError(f"free = {', '.join(free)}: must hold each parameter once")
    if set(HANDLE) <= set(free):
        raise ParameterError(
            "free = all six parameters of the handle: must be at most five, as eq. (3) has only"
            " five coefficients"
        )


def _check(start: Point, free: Sequence[str]) -> None:
    check_free(free)
    for name in free:
        if name != "delay" and start.value(name) == 0.0:
            raise ParameterError(f"{name} = 0: must be above 0 to be the start of a fit")
    if not EARLIEST_DELAY <= start.delay <= LONGEST_DELAY:
        raise ParameterError(
            f"delay = {start.delay}: must be from {EARLIEST_DELAY:g} to {LONGEST_DELAY:g} s"
        )
    if not (math.isfinite(start.low_pass_frequency) and start.low_pass_frequency > 0.0):
        raise ParameterError(
            f"low_pass_frequency = {start.low_pass_frequency}: must be above 0 Hz"
        )
