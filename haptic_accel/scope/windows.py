# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Last seconds of the graph's signals: derived signals, metrics, and measures of an interval."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXIS, NAMES, Axes
from haptic_accel.core.control import filters
from haptic_accel.core.control.channel import FADING, LISTENING
from haptic_accel.core.control.error_bound import bounds
from haptic_accel.core.control.fallback import LEAST_DESIRED
from haptic_accel.core.control.filters import comparable
from haptic_accel.core.evaluation.metrics import (
    Spectra,
    evaluate,
    indistinguishable,
    lengths,
    spectra,
)
from haptic_accel.core.handle.plant import Dynamics
from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import LATENCY, NANOSECONDS, IntArray, grid_indices, half_period
from haptic_accel.core.tick import TravelEstimator
from haptic_accel.core.tick.device_side import LATE_TIME

PERIOD = 2.0
"""Minimum time before and between computations of the lowest error, s: the input's length."""

SHARE = 0.05
"""Fraction of a core that these computations may use: one takes 0.15 s at 1 kHz, and longer at a
higher rate."""

LOWEST_CORNER = 0.1
"""Corner of a high-pass that leaves the desired acceleration unchanged, Hz: the compensator has
filtered it already."""

_pool = ThreadPoolExecutor(1, "lowest error")  # the page's server must not wait


class LowestError:
    """Lowest possible error for a continuous input, computed at intervals on a separate thread."""

    def __init__(self) -> None:
        self._computed: Future[tuple[float | None, float]] | None = None
        self._value: float | None = None
        self._due = time.monotonic() + PERIOD

    def follow(self, bound: Callable[[], float]) -> float | None:
        """Return the last result; if due, start the computation for the latest input.

        Parameters
        ----------
        bound : callable
            Returns the least error for the latest input, %, or raises ValueError.

        Returns
        -------
        float or None
            Error in percent, as `Evaluation.nrmse_percent`; None before the first result.
        """
        if self._computed and self._computed.done():
            self._value, spent = self._computed.result()
            self._due = time.monotonic() + max(PERIOD, spent / SHARE)
            self._computed = None
        if self._computed is None and time.monotonic() >= self._due:
            self._computed = _pool.submit(_timed, bound)
        return self._value


def _timed(bound: Callable[[], float]) -> tuple[float | None, float]:
    """Return the bound, %, and the CPU time of its computation, s."""
    start = time.thread_time()
    found = None
    with suppress(ParameterError, ValueError):  # the input is not finite, or too short
        found = bound()
    return found, time.thread_time() - start


LONGEST_WINDOW = 5.0
"""Longest time that a page can show, s."""

HIGHEST_RATE = 20e3
"""Highest sampling rate at which the longest window fits into a ring, Hz."""

LOWEST_RATE = 10.0
"""Lowest sampling rate from which signals are derived, Hz: a fifth of the nodes' lowest."""

LARGEST_VALUE = 1e6
"""Largest accepted value of a signal, SI unit: beyond any sensor's range, with finite squares."""

SLACK = 1.25
"""Capacity of a ring relative to the longest read, so that no sample is overwritten while read."""

CAPACITY = int(LONGEST_WINDOW * HIGHEST_RATE * SLACK)
"""Capacity of a ring, samples."""

METRICS_WINDOW = 2.0
"""Length of the signals for metrics, s: two to four strokes of the hand."""

GAP = 0.5
"""Gap in the stamps after which derived signals start again, s: nodes were restarted."""

HELD = 0.1
"""Time for which the last force stays in effect, s; then the device has removed it."""

RATE_SAMPLES = 500
"""Number of samples for the estimate of the sampling rate."""

FEWEST = 50
"""Minimum number of samples for a sampling rate and for metrics."""

LEAST_VIBRATION = 0.5
"""RMS of the desired acceleration below which the tool counts as touching nothing, m/s^2: motion
in the air gives 0.2, and dragging over the paper's smoothest surface 1.3."""

CONTROLLER_CHANGE_TIME = LISTENING + FADING
"""Time from the choice of a controller until it alone computes the force, s."""

CLOUD_POINTS = 800
"""Maximum number of points of the regression cloud: more cannot be distinguished."""


class Ring:
    """Latest samples of one signal, written by one thread and read by another.

    A sample is stored before it is counted, and readers avoid the oldest samples, which are
    overwritten next.

    Parameters
    ----------
    capacity : int
        Number of samples stored; readers get at most `capacity` / `SLACK` of them.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._stamps = np.zeros(capacity, np.int64)
        self._values = np.zeros(capacity)
        self._capacity = capacity
        self._readable = int(capacity / SLACK)
        self.count = 0
        """Total number of samples stored so far."""

    def put(self, stamp: int, value: float) -> None:
        """Add a sample with its stamp in ns."""
        index = self.count % self._capacity
        self._stamps[index] = stamp
        self._values[index] = value
        self.count += 1

    def extend(self, stamps: IntArray, values: FloatArray) -> None:
        """Add samples; of too many, only the last that fit."""
        stamps, values = stamps[-self._capacity :], values[-self._capacity :]
        indices = np.arange(self.count, self.count + len(stamps)) % self._capacity
        self._stamps[indices] = stamps
        self._values[indices] = values
        self.count += len(stamps)

    def since(self, count: int) -> tuple[int, IntArray, FloatArray]:
        """Return the newest samples after the first `count`, up to the readers' limit.

        Returns
        -------
        tuple
            Value to pass as `count` next time; stamps in ns and values, each of shape (n,).
        """
        end = self.count
        indices = np.arange(max(count, end - self._readable, 0), end) % self._capacity
        return end, self._stamps[indices], self._values[indices]

    def last(self, seconds: float) -> tuple[IntArray, FloatArray]:
        """Return the samples of the last seconds before the newest stamp, in order."""
        oldest = self.newest - int(seconds * NANOSECONDS)
        _, stamps, values = self.since(0)
        # Start behind the last older stamp: if a clock was set back, only later samples count.
        older = np.flatnonzero(stamps < oldest)
        first = int(older[-1]) + 1 if len(older) else 0
        return stamps[first:], values[first:]

    @property
    def newest(self) -> int:
        """Stamp of the newest sample, ns; 0 while there is none."""
        return int(self._stamps[(self.count - 1) % self._capacity]) if self.count else 0


@dataclass(frozen=True)
class GraphSettings:
    """Settings of a graph that are needed to show its signals.

    Attributes
    ----------
    high_pass_frequency : float
        Corner frequency of the compensator's high-pass, Hz.
    actuator : ActuatorParameters
        Limits of the actuator, and the suspension of its moving mass.
    latency : int
        Samples from the cause of a force to the tick at which the force takes effect.
    granted_delay : int
        Additional delay, in samples, that the present controller may give the handle's response.
    plant : Plant or None
        Plant along one axis, from which the lowest possible error follows; None if unknown.
    noise : float
        Standard deviation of a sample of the handle's accelerometer, if known, m/s^2.
    assumed : bool
        True for defaults, used until a compensator has reported its own parameters.
    """

    high_pass_frequency: float = filters.HIGH_PASS_FREQUENCY
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    latency: int = LATENCY
    granted_delay: int = 1
    plant: Dynamics | None = None
    noise: float = 0.0
    assumed: bool = True

    @property
    def after(self) -> int:
        """Number of samples from a desired acceleration to the compared response."""
        return self.latency + self.granted_delay


@dataclass(frozen=True)
class Metrics:
    """Metrics of the last `METRICS_WINDOW`, and the points of two plots.

    Attributes
    ----------
    values : dict
        Finite numbers by name; metrics of too few samples are missing. ``rate``: samples of the
        handle acceleration per second. ``nrmse_percent``, ``slope`` (desired on actual) and
        ``r2``: comparison with the handle acceleration shifted back by latency and granted delay,
        missing where the tool touches nothing. ``lowest_percent``: lowest ``nrmse_percent`` of any
        filter for such an input, where a plant is known. ``indistinguishable_percent``: share of
        the vibration in which a hand could not perceive the difference of strength, missing if a
        hand would perceive neither. ``rms_desired``, ``rms_actual``: m/s^2. ``age_p50``,
        ``age_p99``: time from the tool's sample to the arrival of the actuator force here, s.
        ``peak_force``, ``peak_travel``: largest magnitudes, N and m.
    spectra : Spectra or None
        Spectra of desired and actual acceleration; None if there are too few samples.
    desired, actual : ndarray
        At most `CLOUD_POINTS` pairs of accelerations, m/s^2.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    spectra: Spectra | None = None
    desired: FloatArray = field(default_factory=lambda: np.zeros(0))
    actual: FloatArray = field(default_factory=lambda: np.zeros(0))


class Windows:
    """Signals that a page shows, along one axis.

    Attributes
    ----------
    axis : str
        Axis of the signals.
    by_axis : dict of Windows
        Signals of all axes of the rig, in order.
    desired, handle, force, age : Ring
        Received signals: desired acceleration, measured handle acceleration (m/s^2), actuator
        force (N) and its age on arrival (s).
    arm_force, position : Ring
        Received signals, if requested by a page: force of the slave's arm on the tool (N) and the
        tool's position (m).
    actual, travel : Ring
        Signals derived by `advance`: handle acceleration without gravity and hand motion
        (m/s^2), and position of the actuator's moving mass between its stops (m).
    vectors : dict
        Latest vectors of `frames.VECTORS`, if requested by a page.
    settings : GraphSettings
        Settings of the graph; may be replaced by another thread at any time.
    """

    def __init__(self, axis: str = NAMES[ACTUATOR_AXIS]) -> None:
        self.axis = axis
        self.by_axis: dict[str, Windows] = {axis: self}
        self.desired, self.handle, self.force, self.age = Ring(), Ring(), Ring(), Ring()
        self.actual, self.travel = Ring(), Ring()
        self.arm_force, self.position = Ring(), Ring()
        self.vectors: dict[str, Vector] = {}
        self.settings = GraphSettings()
        self._derivation: Derivation | None = None
        self._derived = 0
        self._compared_from = 0
        self._lowest = LowestError()

    def show_axes(self, axes: Axes) -> None:
        """Store the signals along some axes; the last replaces a missing actuator's axis."""
        self.axis = self.axis if self.axis in axes.names else axes.names[-1]
        known = {**self.by_axis, self.axis: self}
        self.by_axis = {name: known.get(name) or Windows(name) for name in axes.names}

    def restart_comparison(self) -> None:
        """Restrict the comparison to samples from now on, as after a change."""
        self._lowest = LowestError()
        self._compared_from = self.handle.newest + int(CONTROLLER_CHANGE_TIME * NANOSECONDS)

    def leave_out(self, duration: int) -> None:
        """Restart the comparison after a gap of `duration` in the stamps, ns."""
        self.restart_comparison()
        self._compared_from += duration

    def advance(self) -> None:
        """Derive signals from the newest handle samples."""
        rate, settings = live_rate(self.handle), self.settings
        if rate is None:
            return
        derivation = self._derivation
        if derivation is None or (derivation.rate, derivation.settings) != (rate, settings):
            derivation = self._derivation = Derivation(settings, rate)
        # Derive up to the newest force, which arrives slightly later than its sample.
        newest = self.force.newest
        _, stamps, values = self.handle.since(self._derived)
        ready = len(stamps)
        if newest and self.handle.newest - newest <= HELD * NANOSECONDS:
            ready = int(np.searchsorted(stamps, newest + int(half_period(rate)), "right"))
        if not ready:
            return
        self._derived = self.handle.count - (len(stamps) - ready)
        stamps, values = stamps[:ready], values[:ready]
        causes = stamps - round(settings.latency * NANOSECONDS / rate)
        forces = held(*self.force.last(LONGEST_WINDOW), causes, rate)
        actual, travel = derivation.derive(stamps, values, forces)
        self.actual.extend(stamps, actual)
        self.travel.extend(stamps, travel)

    def metrics(self) -> Metrics:
        """Return metrics of the last `METRICS_WINDOW`."""
        values: dict[str, float] = {}
        for name, ring in (("peak_force", self.force), ("peak_travel", self.travel)):
            _, signal = ring.last(METRICS_WINDOW)
            if len(signal):
                values[name] = np.max(np.abs(signal))
        _, ages = self.age.last(METRICS_WINDOW)
        if len(ages):
            values["age_p50"], values["age_p99"] = np.quantile(ages, (0.5, 0.99))
        rate = live_rate(self.handle)
        if rate is None:
            return Metrics(_finite(values))
        values["rate"] = rate
        desired, actual = self._compared(rate)
        try:
            found = spectra(desired, actual, rate) if len(desired) >= FEWEST else None
        except ValueError:  # a value is not finite, or too large
            found = None
        if found is None:
            return Metrics(_finite(values))
        values["indistinguishable_percent"] = 100.0 * indistinguishable(desired, actual, rate)
        values["rms_desired"], values["rms_actual"] = np.sqrt(np.mean([desired**2, actual**2], 1))
        if values["rms_desired"] >= LEAST_VIBRATION:
            evaluation = evaluate(desired, actual, rate, delay=0.0)
            values["nrmse_percent"] = evaluation.nrmse_percent
            values["slope"] = evaluation.slope_desired_on_actual
            values["r2"] = evaluation.r2
            settings = self.settings
            if settings.plant:
                least = partial(
                    bounds,
                    *(settings.plant, rate, desired),
                    granted_delay=settings.granted_delay,
                    noise=settings.noise,
                    high_pass_frequency=LOWEST_CORNER,
                    actuator=settings.actuator,
                )
                values["lowest_percent"] = self._lowest.follow(lambda: least().limited) or math.nan
        else:
            self._lowest = LowestError()
        step = len(desired) // CLOUD_POINTS + 1
        return Metrics(_finite(values), found, desired[::step], actual[::step])

    def _compared(self, rate: float) -> tuple[FloatArray, FloatArray]:
        """Return desired and actual acceleration, preprocessed as for the evaluation of a bag."""
        stamps, handle = self.handle.last(METRICS_WINDOW)
        first = int(np.searchsorted(stamps, self._compared_from, "right"))
        desired = self.desired.last(METRICS_WINDOW)
        pairs = paired(*desired, stamps[first:], handle[first:], self.settings.after, rate)
        if not len(pairs[0]):
            return pairs
        return filters.comparable(*pairs, self.settings.high_pass_frequency, rate)


class Derivation:
    """Signals derived from the handle acceleration, sample by sample.

    The high-pass is causal, as a page shows the present; with a third of the compensator's corner
    frequency, it hardly shifts the signal. Metrics use the zero-phase filter.

    Parameters
    ----------
    settings : GraphSettings
    rate : float
        Sampling rate, Hz.
    """

    def __init__(self, settings: GraphSettings, rate: float) -> None:
        self.rate, self.settings = rate, settings
        corner = min(settings.high_pass_frequency * filters.MOTION_SHARE, rate / 4)
        self._sections = filters.high_pass(corner, rate)
        self._estimator = TravelEstimator(settings.actuator, rate)
        self._newest: int | None = None
        self._memory = np.zeros((len(self._sections), 2))

    def derive(
        self, stamps: IntArray, handle: FloatArray, forces: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return acceleration without gravity and hand motion, and travel, of the next samples.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
            Stamps in ns; n is at least 1.
        handle, forces : ndarray, shape (n,)
            Handle acceleration, m/s^2, and actuator force, N.
        """
        from scipy import signal

        if not (self._follows(int(stamps[0])) and np.isfinite(self._memory).all()):
            # Start in the steady state of the first sample, so that gravity causes no step.
            self._memory = signal.sosfilt_zi(self._sections) * handle[0]
            self._estimator.reset()
        self._newest = int(stamps[-1])
        actual, self._memory = signal.sosfilt(self._sections, handle, zi=self._memory)
        sample = self._estimator.observe
        travel = [sample(*pair) for pair in zip(forces.tolist(), handle.tolist(), strict=True)]
        return actual, np.array(travel)

    def _follows(self, stamp: int) -> bool:
        """Return true if a sample follows the last one within `GAP`."""
        return self._newest is not None and 0 < stamp - self._newest < GAP * NANOSECONDS


def live_rate(ring: Ring) -> float | None:
    """Estimate a signal's rate from its newest stamps, Hz; None if no rate is plausible.

    Unlike an average, the median step, to four digits, stays the same from update to update: a new
    rate would reset the filters.
    """
    _, stamps, _ = ring.since(max(ring.count - RATE_SAMPLES, 0))
    if len(stamps) < FEWEST:
        return None
    period = float(np.median(np.diff(stamps)))
    rate = float(f"{NANOSECONDS / period:.4g}") if period > 0 else 0.0
    return rate if LOWEST_RATE <= rate <= HIGHEST_RATE * SLACK else None


def held(stamps: IntArray, values: FloatArray, moments: IntArray, rate: float) -> FloatArray:
    """Return the active command at each moment: the newest one up to half a period later.

    Parameters
    ----------
    stamps, values : ndarray, shape (m,)
        Commands and their stamps, ns, in order.
    moments : ndarray, shape (n,)
        Moments in ns.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    ndarray, shape (n,)
        Active commands; zero before the first, and if the newest is older than `HELD`.
    """
    if not len(stamps):
        return np.zeros(len(moments))
    newest = np.searchsorted(stamps, moments + int(half_period(rate)), "right") - 1
    is_held = (newest >= 0) & (moments - stamps[newest] <= HELD * NANOSECONDS)
    return np.where(is_held, values[newest], 0.0)


def paired(
    desired_stamps: IntArray,
    desired: FloatArray,
    actual_stamps: IntArray,
    actual: FloatArray,
    shift: int,
    rate: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the samples of two signals that lie on corresponding points of the sampling grid.

    Parameters
    ----------
    desired_stamps, actual_stamps : ndarray, shapes (m,) and (n,)
        Stamps in ns, in order.
    desired, actual : ndarray, shapes (m,) and (n,)
    shift : int
        Number of samples by which an actual sample follows its desired sample.
    rate : float
        Sampling rate, Hz.

    Returns
    -------
    tuple of ndarray, each of shape (k,)
        Corresponding samples; k is at most the smaller of m and n.
    """
    if not len(desired_stamps) or not len(actual_stamps):
        return np.zeros(0), np.zeros(0)
    start = int(actual_stamps[0])
    _, first, second = np.intersect1d(
        grid_indices(desired_stamps, start, rate) + shift,
        grid_indices(actual_stamps, start, rate),
        return_indices=True,
    )
    return desired[first], actual[second]


def _finite(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if math.isfinite(value)}


INTERVAL_MARGIN = 0.25
"""Time before and after an interval that is filtered together with it, s: a period of the filter's
corner frequency (5 Hz), to remove the hand's motion from short intervals, too."""

AT_LIMIT = 0.999
"""Fraction of the peak force from which a force counts as limited."""


@dataclass(frozen=True)
class IntervalMeasures:
    """Measures of the signals in an interval; for several axes, of the vectors' magnitudes.

    Attributes
    ----------
    begin, end : int
        System times of the first and last sample, ns.
    rms, peak : float
        RMS and peak of the handle's acceleration without hand motion, m/s^2.
    desired_rms : float
        RMS of the desired acceleration, m/s^2.
    error : float or None
        NRMSE, with the handle shifted by latency and granted delay, %; None below `LEAST_DESIRED`.
    clipped, lost : float
        Shares of forces at the limit of a coil, and of missing samples, %.
    """

    begin: int
    end: int
    rms: float
    peak: float
    desired_rms: float
    error: float | None
    clipped: float
    lost: float


def measure(windows: Windows, begin: int, end: int, rate: float) -> IntervalMeasures | None:
    """Return the measures of an interval; None without samples.

    Parameters
    ----------
    windows : Windows
        Signals from `INTERVAL_MARGIN` before the interval to `INTERVAL_MARGIN` after it.
    begin, end : int
        System times, ns.
    rate : float
        Samples per second.
    """
    settings, margin = windows.settings, round(INTERVAL_MARGIN * NANOSECONDS)
    stamps, handle = _signal(windows, "handle", begin - margin, end + margin)
    desired_stamps, desired_values = _signal(windows, "desired", begin - margin, end + margin)
    _, forces = _signal(windows, "force", begin, end)
    handle_indices = np.arange(float(len(stamps)))
    shift = settings.after
    desired, found = paired(desired_stamps, desired_values, stamps, handle_indices, shift, rate)
    index = found.astype(int)
    moments = stamps[index]
    within = (moments >= begin) & (moments <= end)
    if np.count_nonzero(within) < 2:
        return None
    strength = _rms(lengths(desired[within]))
    compared, actual = comparable(desired, handle[index], settings.high_pass_frequency, rate)
    compared, actual, moments = compared[within], actual[within], moments[within]
    evaluated = strength >= LEAST_DESIRED
    error = evaluate(compared, actual, rate, delay=0.0).nrmse_percent if evaluated else None
    largest = np.abs(forces).reshape(len(forces), -1).max(axis=1, initial=0.0)
    limited = largest >= AT_LIMIT * settings.actuator.peak_force
    return IntervalMeasures(
        begin=int(moments[0]),
        end=int(moments[-1]),
        rms=_rms(lengths(actual)),
        peak=float(lengths(actual).max()),
        desired_rms=strength,
        error=error,
        clipped=100.0 * float(np.mean(limited)) if len(limited) else 0.0,
        lost=max(lost_percent(each, begin, end, rate) for each in (stamps, desired_stamps)),
    )


def lost_percent(stamps: IntArray, begin: int, end: int, rate: float) -> float:
    """Return the share of missing samples between two times in ns, %.

    Examples
    --------
    >>> stamps = np.delete(np.arange(0, 100_000_000, 1_000_000), [7, 8])
    >>> lost_percent(stamps, 0, 99_000_000, 1000.0)
    2.0
    """
    within = stamps[(stamps >= begin) & (stamps <= end)]
    expected = 1 + int((end - begin) * rate / NANOSECONDS)
    found = len(np.unique(grid_indices(within, begin, rate))) if len(within) else 0
    return 100.0 * max(0, expected - found) / expected


def late_percent(before: Mapping[str, str], after: Mapping[str, str], rate: float) -> float:
    """Return the share of time with a late force of the actuator between two counts, %.

    Parameters
    ----------
    before, after : mapping
        Counts of a device, by their names in diagnostics.
    rate : float
        Samples per second.

    Examples
    --------
    >>> names = "actuator force due", "actuator force late (s)"
    >>> before, after = (dict(zip(names, them)) for them in (("0", "0.0"), ("2000", "0.02")))
    >>> late_percent(before, after, 1000.0)
    1.0
    """
    names = "actuator force due", f"actuator force {LATE_TIME}"
    due, late = (float(after.get(name, 0)) - float(before.get(name, 0)) for name in names)
    return min(100.0, 100.0 * late * rate / due) if due > 0 else 0.0


def _signal(windows: Windows, name: str, begin: int, end: int) -> tuple[IntArray, FloatArray]:
    """Return stamps and values of a signal; a column for each of several axes."""
    columns = []
    for each in windows.by_axis.values():
        _, stamps, values = getattr(each, name).since(0)
        first, last = np.searchsorted(stamps, (begin, end))
        columns.append((stamps[first:last], values[first:last]))
    if len(columns) == 1:
        return columns[0]
    shortest = min(len(stamps) for stamps, _ in columns)
    together = np.column_stack([values[:shortest] for _, values in columns])
    return columns[0][0][:shortest], together


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
