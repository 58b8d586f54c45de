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
"""Orthogonal multisines as excitation of a handle with three coils, and their detection.

Each coil has a multisine whose lines have the magnitudes and group delays of the logarithmic sweep
(Mueller and Massarani, J. Audio Eng. Soc. 49(6), 2001): force and travel at each frequency are
those of the sweep, and the crest factor is as low. A trial has four realisations, in which the
coils' signs are columns of a Hadamard matrix. The excitations of the coils are thus orthogonal at
every line, and all nine elements of the response are known at the same lines with the least
variance for a given force (Dobrowiecki and Schoukens, Automatica 43(10), 2007; Pintelon and
Schoukens, System Identification, 2nd ed., 2012). Three realisations would do with turned phases in
place of signs. With signs, each coil always has the same waveform: its dry friction, which is the
same in both directions, distorts all realisations alike, and is fitted as for one axis.
"""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.axes import ALL_AXES, Axes
from haptic_accel.core.identification import sweep
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError

SIGNS: FloatArray = np.array(
    [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, -1.0, 1.0]]
)
"""Signs of the coils in each realisation, shape (4, 3): columns of a Hadamard matrix."""

FADE = 0.05
"""Time in which the force rises at the start of a realisation, s (assumed; part of the repeat that
is not evaluated)."""


def multisine(parameters: sweep.SweepParameters, rate: float) -> FloatArray:
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
    samples = sweep.repeat_samples(parameters, rate)
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    low, high = parameters.band
    used = (frequency >= low) & (frequency <= high)
    octaves = np.log(frequency[used] / low)
    growth = parameters.duration / math.log(high / low)  # time for a factor e of frequency
    amplitude = parameters.start_amplitude + (octaves / math.log(high / low)) * (
        parameters.end_amplitude - parameters.start_amplitude
    )
    # The sweep spends growth / f seconds per Hz at the frequency f.
    line = amplitude * np.sqrt(growth / frequency[used]) / parameters.duration
    # The group delay growth * octaves, integrated over frequency; a sine at the start.
    turns = growth * (frequency[used] * octaves - frequency[used] + low) + 0.25
    spectrum = np.zeros((3, len(frequency)), dtype=np.complex128)
    for coil in range(3):
        begins = coil * parameters.duration / 3
        spectrum[coil, used] = line * np.exp(-2j * np.pi * (turns + begins * frequency[used]))
    return np.asarray(np.fft.irfft(spectrum * (samples / 2), samples).T)


def orthogonal_excitation(parameters: sweep.SweepParameters, rate: float) -> FloatArray:
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


def trial_forces(axes: Axes, parameters: sweep.SweepParameters, rate: float) -> FloatArray:
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
    return sweep.excitation(parameters, rate)[:, np.newaxis]


def repeats_of_trial(axes: Axes, parameters: sweep.SweepParameters) -> int:
    """Return the number of repeats in a trial of `trial_forces`."""
    return parameters.repeats * (len(SIGNS) if axes == ALL_AXES else 1)


def kept_periods(values: FloatArray, parameters: sweep.SweepParameters, rate: float) -> FloatArray:
    """Return the evaluated periods of a signal recorded from the start of the excitation on.

    Parameters
    ----------
    values : ndarray, shape (m, 3)
        m must be at least the length of the excitation.

    Returns
    -------
    ndarray, shape (4, repeats - 1, n, 3)
        Periods of each realisation but the first, in which the handle settles.
    """
    period = sweep.repeat_samples(parameters, rate)
    whole = len(SIGNS) * parameters.repeats * period
    periods = values[:whole].reshape(len(SIGNS), parameters.repeats, period, 3)
    return periods[:, sweep.DROPPED_REPEATS :]
