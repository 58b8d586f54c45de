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
"""Response of a handle with three coils: estimate, covariance, coherence and wiring faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.identification import estimate
from haptic_accel.core.identification.multisine import kept_periods
from haptic_accel.core.identification.sweep import (
    IdentificationTrial,
    SweepParameters,
    by_axis,
    check_axes,
    repeat_samples,
)
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.sampling import BoolArray

COILS = 3
"""Number of coils, and of axes of the acceleration."""

ONSET_TIME, ONSET_RIDGE, ONSET = 0.032, 0.1, 0.4
"""Length of an impulse response, s, weight of its ridge regression, and fraction of the largest
sample from which on one counts as its begin. Without noise they give the sign right for delays to
5 ms, low-passes from 200 Hz and modes from 120 Hz with damping ratios from 0.05 (1296 handles)."""


@dataclass(frozen=True)
class MatrixResponse:
    """Estimated response of the accelerations in three axes to the forces of three coils.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Lines of a period within the band, Hz.
    response : ndarray, shape (n, 3, 3)
        m/s^2 per N; the second index is the axis of the acceleration, the third that of the coil.
    deviation : ndarray, shape (n, 3, 3)
        Standard deviation of real and imaginary part, from the noise and the force's spectra.
    coherence : ndarray, shape (n, 3)
        Multiple coherence: fraction of an acceleration's power that all forces explain.
    shares : ndarray, shape (n, 3, 3)
        Fraction of the power that a coil and noise cause which is due to the coil.
    rate : float
        Samples per second.
    averages : int
        Number of evaluated periods.
    lines : ndarray of bool, shape (m,)
        Mask of the lines in the spectrum of a period.
    """

    frequency: FloatArray
    response: ComplexArray
    deviation: FloatArray
    coherence: FloatArray
    shares: FloatArray
    rate: float
    averages: int
    lines: BoolArray

    def own(self, axis: int) -> estimate.FrequencyResponse:
        """Return the response of an axis to its own coil."""
        response, deviation = self.response[:, axis, axis], self.deviation[:, axis, axis]
        noise_to_signal = 2.0 * self.averages * (deviation / np.abs(response)) ** 2
        return estimate.FrequencyResponse(
            self.frequency, response, 1.0 / (1.0 + noise_to_signal), self.rate, self.averages
        )

    @property
    def cross_coupling(self) -> FloatArray:
        """Acceleration of each axis by each coil over that of the coil's own, dB, shape (3, 3)."""
        power = np.mean(np.abs(self.response) ** 2, axis=0)
        return np.asarray(10 * np.log10(power / np.diag(power)))

    @property
    def condition(self) -> FloatArray:
        """Largest over smallest singular value at each line, shape (n,)."""
        return np.asarray(np.linalg.cond(self.response))


def matrix_response(
    trials: Sequence[IdentificationTrial], sweep: SweepParameters
) -> MatrixResponse:
    """Estimate the response by least squares at each line over all evaluated periods.

    G = A F^H (F F^H)^-1 for the spectra A of the accelerations and F of the forces. The noise is
    the rest, smoothed over adjacent lines; its covariance is that of G times F F^H.

    Parameters
    ----------
    trials : sequence of IdentificationTrial
        Trials of `orthogonal_excitation`, without latency.
    sweep : SweepParameters

    Raises
    ------
    RecordingError
        A signal is not finite, constant, or without force.
    """
    rate = trials[0].rate
    for trial in trials:
        check_axes(trial.actuator_force, trial.handle_acceleration)
        _check_alive(trial)
    forces, accelerations = (
        np.concatenate([kept_periods(getattr(each, name), sweep, rate) for each in trials])
        for name in ("actuator_force", "handle_acceleration")
    )
    frequency = np.fft.rfftfreq(repeat_samples(sweep, rate), 1.0 / rate)
    used = (frequency >= sweep.start_frequency) & (frequency <= sweep.end_frequency)
    force, acceleration = (_spectra(each)[used] for each in (forces, accelerations))
    periods = force.shape[2]
    adjoint = force.conj().swapaxes(1, 2)
    inverse = np.linalg.inv(force @ adjoint)
    response = acceleration @ adjoint @ inverse
    rest = np.sum(np.abs(acceleration - response @ force) ** 2, axis=2) / (periods - COILS)
    noise = np.stack([estimate.smoothed(each) for each in rest.T], axis=1)
    variance = np.diagonal(inverse, axis1=1, axis2=2).real
    power = np.mean(np.abs(force) ** 2, axis=2)
    # The estimate explains a part of the noise, too, which is no coherence.
    explained = np.mean(np.abs(response @ force) ** 2, axis=2) - noise * COILS / periods
    explained = np.maximum(explained, 0.0)
    alone = np.abs(response) ** 2 - noise[:, :, np.newaxis] * variance[:, np.newaxis, :]
    alone = np.maximum(alone, 0.0) * power[:, np.newaxis, :]
    return MatrixResponse(
        np.asarray(frequency[used], dtype=np.float64),
        response,
        np.sqrt(noise[:, :, np.newaxis] * variance[:, np.newaxis, :] / 2),
        explained / (explained + noise),
        alone / (alone + noise[:, :, np.newaxis]),
        rate,
        periods,
        used,
    )


def _spectra(periods: FloatArray) -> ComplexArray:
    """Return the spectra of periods (realisations, repeats, n, 3) as (lines, 3, all periods)."""
    spectra = np.fft.rfft(periods, axis=2)
    return np.moveaxis(spectra.reshape(-1, *spectra.shape[2:]), 0, 2)


def _check_alive(trial: IdentificationTrial) -> None:
    """Reject a force that excites nothing, and an acceleration that does not change."""
    for axis, force in by_axis(trial.actuator_force):
        if (excited := float(np.std(force))) < estimate.SMALLEST_FORCE:
            raise estimate.RecordingError(
                f"{axis}actuator_force: {excited:.3g} N root mean square excites nothing, must be"
                f" at least {estimate.SMALLEST_FORCE:g} N"
            )
    for axis, values in by_axis(trial.handle_acceleration):
        if np.ptp(values) == 0.0:
            raise estimate.RecordingError(
                f"{axis}handle_acceleration: constant at {values[0]:.3g} m/s^2, must change; is"
                " the sensor's axis connected?"
            )


def check_matrix_response(
    found: MatrixResponse, trials: Sequence[IdentificationTrial], acceleration_range: float
) -> None:
    """Reject, by axis, what no plant can be fitted to.

    Parameters
    ----------
    found : MatrixResponse
    trials : sequence of IdentificationTrial
        Trials that the response was estimated from.
    acceleration_range : float
        Range of the sensor, both ways, m/s^2.

    Raises
    ------
    RecordingError
        A sensor's axis is saturated or not coherent with the forces, or a coil has no current,
        acts backwards, or is swapped with another. The message names the axis.
    """
    for trial in trials:
        for axis, values in by_axis(trial.handle_acceleration):
            estimate.check_range(values, acceleration_range, axis)
    band = found.frequency[0], found.frequency[-1]
    _check_coherence(found, band)
    _check_directions(found)
    for coil, name in enumerate(NAMES):
        if _pushes_back(found, coil):
            raise estimate.RecordingError(
                f"axis {name}: its coil pushes against the axis, must push along it; swap the"
                " coil's wires, or make its force constant negative"
            )


def _check_coherence(found: MatrixResponse, band: estimate.Band) -> None:
    """Reject a coil that moves nothing, and an acceleration that no force explains."""
    where = f"on average from {band[0]:g} to {band[1]:g} Hz: must be at least"
    moved = np.mean(found.shares, axis=0)
    for coil, name in enumerate(NAMES):
        if (most := float(moved[:, coil].max())) < estimate.SMALLEST_COHERENCE:
            raise estimate.RecordingError(
                f"axis {name}: coherence = {most:.2f} of its coil with any acceleration {where}"
                f" {estimate.SMALLEST_COHERENCE:g}; is the coil connected?"
            )
    for axis, name in enumerate(NAMES):
        if (coherence := float(np.mean(found.coherence[:, axis]))) < estimate.SMALLEST_COHERENCE:
            raise estimate.RecordingError(
                f"axis {name}: multiple coherence = {coherence:.2f} of its acceleration {where}"
                f" {estimate.SMALLEST_COHERENCE:g}; is the sensor's axis connected?"
            )


def _check_directions(found: MatrixResponse) -> None:
    """Reject a coil that moves another axis more than its own."""
    moved = found.cross_coupling
    most = moved.argmax(axis=0).tolist()
    for coil, axis in enumerate(most):
        if axis == coil:
            continue
        name, other = NAMES[coil], NAMES[axis]
        if most[axis] == coil:
            raise estimate.RecordingError(
                f"axes {name} and {other}: the coil of each moves the other axis,"
                f" {moved[axis, coil]:.0f} and {moved[coil, axis]:.0f} dB above its own, must move"
                " its own; exchange the two coils' wires, or the axes of the sensor"
            )
        raise estimate.RecordingError(
            f"axis {name}: its coil moves axis {other} the most, {moved[axis, coil]:.0f} dB above"
            f" its own, must move its own; is it mounted along {name}?"
        )


def _pushes_back(found: MatrixResponse, axis: int) -> bool:
    """Return whether an axis' own impulse response begins with negative samples.

    A force along the axis accelerates the mass along it at once, whatever the delay, the mode of
    the mount and the low-pass.
    """
    response = found.response[:, axis, axis]
    turns = np.outer(found.frequency, np.arange(round(ONSET_TIME * found.rate))) / found.rate
    basis = np.exp(-2j * np.pi * turns)
    # A ridge regression: the band does not determine all samples.
    normal = (basis.conj().T @ basis).real / len(basis) + ONSET_RIDGE * np.eye(turns.shape[1])
    impulse = np.linalg.solve(normal, (basis.conj().T @ response).real)
    size = np.abs(impulse)
    return bool(impulse[np.argmax(size > ONSET * size.max())] < 0.0)
