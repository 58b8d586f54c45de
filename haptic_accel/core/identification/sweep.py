# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Excitation of a handle, detection of the excitation in a recording, and travel checks.

A single coil is driven by a logarithmic sine sweep. Each of three coils is driven by a multisine
whose lines have the magnitudes and group delays of that sweep (Mueller and Massarani, J. Audio
Eng. Soc. 49(6), 2001): force and travel at each frequency are those of the sweep, and the crest
factor is equally low. A trial has four realisations, in which the coils' signs are columns of a
Hadamard matrix. The excitations of the coils are thus orthogonal at every line, and all nine
elements of the response are known at the same lines with the least variance for a certain force
(Dobrowiecki and Schoukens, Automatica 43(10), 2007; Pintelon and Schoukens, System Identification,
2nd ed., 2012). Three realisations would suffice with rotated phases instead of signs. With signs,
each coil always has the same waveform: its dry friction, which is the same in both directions,
distorts all realisations in the same way, and is fitted as for one axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from haptic_accel.core.axes import ALL_AXES, NAMES, Axes
from haptic_accel.core.identification.estimate import SMALLER, RecordingError, check_pair
from haptic_accel.core.model import FloatArray, Suspension
from haptic_accel.core.outliers import without_outliers
from haptic_accel.core.parameters import Checked, ParameterError, check_positive_rate, parameter
from haptic_accel.core.tick import TravelEstimator

ALIKE = 0.95
"""Minimum correlation of a recorded force with the excitation (assumed)."""

SAMPLES_MISSING = "samples_missing"
"""Status entry of a trial: number of samples that were not recorded."""

OUTLIERS = "outliers"
"""Status entry of a trial: number of false samples of the acceleration that were replaced."""

DROPPED_REPEATS = 1
"""Number of initial repeats that are not evaluated, while the handle settles (paper)."""


@dataclass(frozen=True)
class SweepParameters(Checked):
    """Excitation of the paper: a sine sweep.

    The frequency grows exponentially and the amplitude linearly in time. The amplitude is small at
    frequencies with a large travel of the actuator.
    """

    start_frequency: float = parameter(
        10.0, "frequency of the sweep at its start (paper)", "Hz", 0.1, 100e3
    )
    end_frequency: float = parameter(
        200.0, "frequency of the sweep at its end (paper)", "Hz", 0.1, 100e3
    )
    duration: float = parameter(
        2.0, "duration of each repeat of the sweep (paper)", "s", 0.1, 60.0
    )
    start_amplitude: float = parameter(
        0.24, "amplitude of the sweep's force at its start (paper)", "N", 0, 100.0
    )
    end_amplitude: float = parameter(
        1.68, "amplitude of the sweep's force at its end (paper)", "N", 0, 100.0, above=True
    )
    repeats: int = parameter(
        3, "number of sweeps in a trial; the first is not evaluated (paper)", low=3, high=100
    )

    def __post_init__(self) -> None:
        """Check all fields, and that the frequencies increase.

        Raises
        ------
        ParameterError
            The message contains the field, its value and the allowed range.
        """
        super().__post_init__()
        if not self.end_frequency > self.start_frequency:
            raise ParameterError(
                f"end_frequency = {self.end_frequency:g}: must be above start_frequency"
                f" = {self.start_frequency:g} Hz"
            )
        if self._cycles(self.duration) < 1:
            raise ParameterError(
                f"duration = {self.duration:g}: must hold at least one cycle of the sweep,"
                f" of {self.start_frequency:g} to {self.end_frequency:g} Hz"
            )

    @property
    def band(self) -> tuple[float, float]:
        """Start and end frequency, Hz."""
        return self.start_frequency, self.end_frequency

    @property
    def _growth(self) -> float:
        """Time in which the frequency increases by a factor of e, s."""
        return self.duration / math.log(self.end_frequency / self.start_frequency)

    def _amplitude(self, share: FloatArray) -> FloatArray:
        """Return the amplitudes at shares of the way from the start of the sweep to its end, N."""
        return self.start_amplitude + share * (self.end_amplitude - self.start_amplitude)

    def _cycles(self, time: float) -> float:
        """Return the number of cycles up to a time in s."""
        return self.start_frequency * self._growth * math.expm1(time / self._growth)


def sweep(parameters: SweepParameters, rate: float) -> FloatArray:
    """Return one repeat of the sweep.

    It ends with its last whole cycle. The force is thus zero, without a jump, at both ends, and
    repeats can follow one another. For the rest of the duration, which is less than a cycle, the
    force is zero.

    Parameters
    ----------
    parameters : SweepParameters
    rate : float
        Samples per second, above twice the end frequency.

    Returns
    -------
    ndarray, shape (n,)
        Force, N; n is duration times rate, rounded.

    Raises
    ------
    ParameterError
        The end frequency is not below half the rate.
    """
    time = np.arange(repeat_samples(parameters, rate)) / rate
    growth = parameters._growth
    whole = math.floor(parameters._cycles(float(time[-1])))
    end = growth * math.log1p(whole / (parameters.start_frequency * growth))
    amplitude = parameters._amplitude(time / parameters.duration)
    cycles = parameters.start_frequency * growth * np.expm1(time / growth)
    force = amplitude * np.sin(2 * np.pi * cycles)
    force[time >= end] = 0.0
    return np.asarray(force)


def excitation(parameters: SweepParameters, rate: float) -> FloatArray:
    """Return all repeats of the sweep, one after the other.

    Returns
    -------
    ndarray, shape (repeats * n,)
        Force, N.

    Raises
    ------
    ParameterError
        The end frequency is not below half the rate.
    """
    return np.tile(sweep(parameters, rate), parameters.repeats)


def repeat_samples(parameters: SweepParameters, rate: float) -> int:
    """Return the number of samples of one repeat.

    Raises
    ------
    ParameterError
        The rate is not a number, or the end frequency is not below half of it.
    """
    check_positive_rate(rate)
    if not parameters.end_frequency < rate / 2:
        raise ParameterError(
            f"end_frequency = {parameters.end_frequency:g}: must be below half the rate,"
            f" {rate / 2:g} Hz"
        )
    return round(parameters.duration * rate)


def kept_repeats(values: FloatArray, parameters: SweepParameters, rate: float) -> FloatArray:
    """Return the evaluated part of a recorded signal: all repeats but the first.

    Parameters
    ----------
    values : ndarray, shape (m,)
        Signal from the first sample of `excitation` on; m must be at least the length of the
        excitation.

    Returns
    -------
    ndarray, shape ((repeats - 1) * n,)
        A view.

    Raises
    ------
    ParameterError
        The signal is shorter than the excitation.
    """
    samples = repeat_samples(parameters, rate)
    whole = parameters.repeats * samples
    if len(values) < whole:
        raise ParameterError(f"signal: {len(values)} samples, must be at least {whole}")
    return values[DROPPED_REPEATS * samples : whole]


@dataclass(frozen=True)
class IdentificationTrial:
    """Signals of one trial with the same sampling times, of shape (n,), or (n, 3) for three axes.

    Attributes
    ----------
    rate : float
        Samples per second.
    actuator_force : ndarray
        Force commanded immediately after each sample was measured, N.
    handle_acceleration : ndarray
        Measured acceleration, m/s^2.
    counters : dict
        Counts of out-of-range values and losses by name; all zero in a good trial.
    latency : int
        Delay from sample to force, in samples. An unknown latency becomes part of the identified
        delay.
    """

    rate: float
    actuator_force: FloatArray
    handle_acceleration: FloatArray
    counters: dict[str, int]
    latency: int = 0

    @property
    def aligned(self) -> IdentificationTrial:
        """Trial with each force shifted to the sample that caused it."""
        samples = len(self.actuator_force) - self.latency
        return replace(
            self,
            actuator_force=self.actuator_force[:samples],
            handle_acceleration=self.handle_acceleration[self.latency :],
            latency=0,
        )

    @property
    def cleaned(self) -> IdentificationTrial:
        """Trial whose false samples of the acceleration are replaced by interpolation.

        The force is a command, not a measurement, and remains unchanged.

        Raises
        ------
        RecordingError
            Too many samples are false; see `without_outliers`.
        """
        cleaned, rejected = [], 0
        for axis, values in by_axis(self.handle_acceleration):
            try:
                acceleration, count = without_outliers(f"{axis}handle_acceleration", values)
            except ParameterError as reason:
                raise RecordingError(str(reason)) from None
            cleaned.append(acceleration)
            rejected += count
        whole = np.stack(cleaned, axis=-1).reshape(self.handle_acceleration.shape)
        counters = self.counters | {OUTLIERS: rejected}
        return replace(self, handle_acceleration=whole, counters=counters)


def by_axis(values: FloatArray) -> list[tuple[str, FloatArray]]:
    """Return the signal of each axis with a prefix for messages; the prefix is empty for one axis.

    Parameters
    ----------
    values : ndarray, shape (n,) or (n, 3)

    Examples
    --------
    >>> [name for name, _ in by_axis(np.zeros((2, 3)))]
    ['axis x: ', 'axis y: ', 'axis z: ']
    """
    if values.ndim == 1:
        return [("", values)]
    return [(f"axis {name}: ", each) for name, each in zip(NAMES, values.T, strict=True)]


def check_axes(actuator_force: FloatArray, handle_acceleration: FloatArray) -> None:
    """Reject signals that do not match each other, by axis.

    Raises
    ------
    RecordingError
        See `check_pair`. The message begins with the axis if there are three.
    """
    pairs = zip(by_axis(actuator_force), by_axis(handle_acceleration), strict=True)
    for (axis, force), (_, acceleration) in pairs:
        try:
            check_pair(force, acceleration)
        except RecordingError as reason:
            raise RecordingError(f"{axis}{reason}") from None


def find_trials(
    actuator_force: FloatArray,
    handle_acceleration: FloatArray,
    parameters: SweepParameters,
    rate: float,
    missing: npt.NDArray[np.bool_] | None = None,
    latency: int = 0,
    expected: FloatArray | None = None,
) -> list[IdentificationTrial]:
    """Find the excitation in a recording by its correlation with the force.

    Parameters
    ----------
    actuator_force, handle_acceleration : ndarray, shape (n,) or (n, 3)
        N and m/s^2, on the same sampling times.
    parameters : SweepParameters
        Excitation of the handle.
    rate : float
        Samples per second.
    missing : ndarray of bool, shape (n,), optional
        Mask of the samples that were not recorded, but interpolated.
    latency : int
        Delay from sample to force, in samples.
    expected : ndarray, shape (m,) or (m, 3), optional
        Forces of a trial, N; default: those of `excitation`.

    Returns
    -------
    list of IdentificationTrial
        Trials in recorded order; the counters of each contain its number of missing samples.

    Raises
    ------
    RecordingError
        The signals do not match each other, or the force does not contain the excitation.
    ParameterError
        The end frequency is not below half the rate.
    """
    from scipy import signal

    check_axes(actuator_force, handle_acceleration)
    expected = excitation(parameters, rate) if expected is None else expected
    length = len(expected)
    if len(actuator_force) < length + latency:
        raise RecordingError(
            f"recording: {len(actuator_force)} samples at {rate:g} Hz, must be at least"
            f" {length + latency}, {parameters.repeats} repeats of {parameters.duration:g} s"
        )
    whole, actuator_force = actuator_force, actuator_force[: len(actuator_force) - latency]
    columns = actuator_force.reshape(len(actuator_force), -1)
    product = sum(
        signal.correlate(force, each, mode="valid", method="fft")
        for force, each in zip(columns.T, expected.reshape(length, -1).T, strict=True)
    )
    energy = np.cumsum(np.concatenate([[0.0], np.sum(columns**2, axis=1)]))
    norm = np.sqrt((energy[length:] - energy[:-length]) * float(np.sum(expected**2)))
    # Without a minimum norm, rounding errors of a weak force could resemble the sweep.
    correlation = np.asarray(product / np.maximum(norm, _LEAST_FORCE * float(np.sum(expected**2))))
    starts = []
    best = float(correlation.max())
    while len(correlation) and correlation.max() >= ALIKE:
        start = int(np.argmax(correlation))
        starts.append(start)
        correlation[max(0, start - length + 1) : start + length] = 0.0
    if not starts:
        raise RecordingError(
            f"actuator_force: correlates with the excitation by {best:.2f}, must by {ALIKE:g}: is"
            f" it {parameters.repeats} repeats of {parameters.duration:g} s from"
            f" {parameters.start_frequency:g} to {parameters.end_frequency:g} Hz?"
        )
    gaps = np.zeros(len(whole), dtype=bool) if missing is None else missing
    trials = []
    for start in sorted(starts):
        part = slice(start, start + length + latency)
        counts = {SAMPLES_MISSING: int(np.sum(gaps[part]))}
        found = IdentificationTrial(rate, whole[part], handle_acceleration[part], counts, latency)
        trials.append(found)
    return trials


_LEAST_FORCE = 1e-3  # share of the excitation's energy


SIGNS: FloatArray = np.array(
    [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]]
)
"""Signs of the coils in each realisation, shape (4, 3): columns of a Hadamard matrix."""

FADE = 0.05
"""Time in which the force rises at the start of a realisation, s (assumed; part of the repeat that
is not evaluated)."""


def multisine(parameters: SweepParameters, rate: float) -> FloatArray:
    """Return one period of the multisine of each coil.

    The coils begin a third of the period apart, so that they have different frequencies at any
    time.

    Parameters
    ----------
    parameters : SweepParameters
        Sweep with the same amplitude at each frequency.
    rate : float
        Samples per second, above twice the end frequency.

    Returns
    -------
    ndarray, shape (n, 3)
        Forces of the coils, N; n is duration times rate, rounded.

    Raises
    ------
    ParameterError
        The end frequency is not below half the rate.
    """
    samples = repeat_samples(parameters, rate)
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    low, high = parameters.band
    used = (frequency >= low) & (frequency <= high)
    octaves = np.log(frequency[used] / low)
    growth = parameters._growth
    amplitude = parameters._amplitude(octaves / math.log(high / low))
    # The sweep spends growth / f seconds per Hz at the frequency f.
    line = amplitude * np.sqrt(growth / frequency[used]) / parameters.duration
    # Phase: the integral of the group delay growth * octaves over frequency; a sine at the start.
    turns = growth * (frequency[used] * octaves - frequency[used] + low) + 0.25
    spectrum = np.zeros((3, len(frequency)), dtype=np.complex128)
    for coil in range(3):
        begins = coil * parameters.duration / 3
        spectrum[coil, used] = line * np.exp(-2j * np.pi * (turns + begins * frequency[used]))
    return np.asarray(np.fft.irfft(spectrum * (samples / 2), samples).T)


def orthogonal_excitation(parameters: SweepParameters, rate: float) -> FloatArray:
    """Return all realisations of a trial, each with all its repeats, one after the other.

    Returns
    -------
    ndarray, shape (4 * repeats * n, 3)
        Forces of the coils, N.

    Raises
    ------
    ParameterError
        The end frequency is not below half the rate.
    """
    repeated = np.tile(multisine(parameters, rate), (parameters.repeats, 1))
    fading = min(round(FADE * rate), len(repeated))
    repeated[:fading] *= (0.5 - 0.5 * np.cos(np.pi * np.arange(fading) / fading))[:, np.newaxis]
    return np.concatenate([signs * repeated for signs in SIGNS])


def trial_forces(axes: Axes, parameters: SweepParameters, rate: float) -> FloatArray:
    """Return the forces of a trial of a handle with one coil, or with three.

    Returns
    -------
    ndarray, shape (m, number of axes)
        Forces of the coils, N: those of `excitation` or of `orthogonal_excitation`.

    Raises
    ------
    ParameterError
        There are two axes, or the end frequency is not below half the rate.
    """
    if axes == ALL_AXES:
        return orthogonal_excitation(parameters, rate)
    if len(axes.names) > 1:
        raise ParameterError(
            f"axes = {', '.join(axes.names)}: must be one, or {', '.join(ALL_AXES.names)}, for an"
            " identification"
        )
    return excitation(parameters, rate)[:, np.newaxis]


def repeats_of_trial(axes: Axes, parameters: SweepParameters) -> int:
    """Return the number of repeats in a trial of `trial_forces`."""
    return parameters.repeats * (len(SIGNS) if axes == ALL_AXES else 1)


def kept_periods(values: FloatArray, parameters: SweepParameters, rate: float) -> FloatArray:
    """Return the evaluated periods of a signal that starts with the excitation.

    Parameters
    ----------
    values : ndarray, shape (m, 3)
        m must be at least the length of the excitation.

    Returns
    -------
    ndarray, shape (4, repeats - 1, n, 3)
        Periods of each realisation but the first, in which the handle settles.
    """
    period = repeat_samples(parameters, rate)
    whole = len(SIGNS) * parameters.repeats * period
    periods = values[:whole].reshape(len(SIGNS), parameters.repeats, period, 3)
    return periods[:, DROPPED_REPEATS:]


STOPS_HIT = "travel_stops_hit"
"""Status entry of a trial: number of contacts with a mechanical stop, if known."""

LIMITED = tuple(f"actuator force limited{by}" for by in ("", " by heat", " by travel"))
"""Entries in a trial's counters and a device's diagnostics: number of forces reduced by the safety
layer. The applied force then differs from the command."""

DOUBTFUL, REFUSED = 0.95, 1.1
"""Ratios of estimated to free travel above which a fit causes a warning, or is rejected. The
estimate neglects dry friction and the sensor's offset (assumed: 10 %)."""

Recorded = Mapping[str, Sequence[IdentificationTrial]]
"""Trials by the name of the grip."""


def check_stops(recorded: Recorded) -> None:
    """Reject trials in which the actuator hit its stops or its force was limited.

    Raises
    ------
    RecordingError
        The message names the grip.
    """
    for name, trials in recorded.items():
        for key in (STOPS_HIT, *LIMITED):
            if count := max(trial.counters.get(key, 0) for trial in trials):
                raise RecordingError(
                    f"{key} = {count} ({name}): must be 0; use a smaller amplitude", SMALLER
                )


def check_travel(
    name: str, trial: IdentificationTrial, suspension: Suspension, most: float
) -> str:
    """Estimate the actuator's travel in a trial; return a warning, or an empty string.

    Parameters
    ----------
    name : str
        Name of the grip.
    trial : IdentificationTrial
        Trial without latency; the acceleration includes gravity.
    suspension : Suspension
        Actuator on its fitted suspension. Contacts with the stops make the suspension appear
        softer or less damped.
    most : float
        Free travel in each direction, m.

    Raises
    ------
    RecordingError
        The estimate exceeds the travel by more than its error.
    """
    estimator = TravelEstimator(suspension, trial.rate)
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    travel = max(abs(estimator.observe(*pair)) for pair in pairs)
    found = f"travel = {1e3 * travel:.2f} mm ({name}), as estimated"
    allowed = f"must be at most {1e3 * most:.2f} mm; use a smaller amplitude"
    if travel > REFUSED * most:
        raise RecordingError(f"{found}: {allowed}", SMALLER)
    return f"{found}: {allowed}" if travel > DOUBTFUL * most else ""
