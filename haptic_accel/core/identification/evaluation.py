"""From recordings of a handle to the models that describe it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from haptic_accel.core.identification.approximate import approximate_model
from haptic_accel.core.identification.discrete import DiscreteModel, identify_discrete
from haptic_accel.core.identification.estimate import (
    FrequencyResponse,
    check_recording,
    dft_ratio,
    h1,
    h2,
)
from haptic_accel.core.identification.fit import DEFAULT_FREE, MOUNT, HandleFit, fit_handle
from haptic_accel.core.identification.sweep import (
    IdentificationTrial,
    SweepParameters,
    kept_repeats,
)
from haptic_accel.core.model import (
    ApproximateModel,
    FloatArray,
    HandleParameters,
    MountParameters,
)
from haptic_accel.core.parameters import ParameterError

DISCRETE_ORDER = 7
"""Of the discrete model: eq. (3) has 4, the accelerometer 1, its mount 2."""

UNEXPLAINED = 2.0
"""Residual, in standard deviations of the noise, above which a model is said to lack something."""

MOUNT_START = MountParameters(frequency=280.0, damping=0.15)
"""Where the search for a mode of the accelerometer's mount starts, as on the paper's rig."""


@dataclass(frozen=True)
class GripIdentification:
    """What was found of a handle held in one way.

    Attributes
    ----------
    trials : list of IdentificationTrial
        What was recorded.
    responses : list of FrequencyResponse
        The paper's DFT ratio of each trial.
    averaged_h1, averaged_h2 : FrequencyResponse
        H1 and H2 estimates over the segments of all trials, with their coherence.
    fit : HandleFit
        Physical parameters, all trials pooled.
    """

    trials: list[IdentificationTrial]
    responses: list[FrequencyResponse]
    averaged_h1: FrequencyResponse
    averaged_h2: FrequencyResponse
    fit: HandleFit


@dataclass(frozen=True)
class Identification:
    """What was found of a handle.

    Attributes
    ----------
    grips : dict of str to GripIdentification
        By the name of the grip.
    fit : HandleFit
        Physical parameters, all trials of all grips pooled.
    discrete : DiscreteModel
        Of all trials: what a compensator can use where physics does not explain all.
    approximate : ApproximateModel
        The paper's kind of invertible model of the pooled handle.
    band : tuple of float
        Of the sweep, Hz.
    """

    grips: dict[str, GripIdentification]
    fit: HandleFit
    discrete: DiscreteModel
    approximate: ApproximateModel
    band: tuple[float, float]


def identify_handle(
    recorded: Mapping[str, Sequence[IdentificationTrial]],
    sweep: SweepParameters,
    acceleration_range: float,
    bandwidth: float,
    *,
    known: HandleParameters | None = None,
    free: Sequence[str] = DEFAULT_FREE,
    order: int = DISCRETE_ORDER,
) -> Identification:
    """Estimate, fit and choose models from recordings of one handle.

    Parameters
    ----------
    recorded : mapping of str to sequence of IdentificationTrial
        Trials by the name of the grip.
    sweep : SweepParameters
        What excited the handle.
    acceleration_range, bandwidth : float
        Of the accelerometer, m/s^2 either way and Hz.
    known : HandleParameters, optional
        Values of what is not free, and where the search starts; Table I otherwise.
    free : sequence of str
        What is fitted, as `fit_handle` has it.
    order : int
        Of the discrete model.

    Raises
    ------
    RecordingError
        A recording is of no use, and why.
    ParameterError
        There is no trial, or a parameter is out of range.
    """
    if not recorded or not all(recorded.values()):
        raise ParameterError("recorded: must hold at least one trial of every grip")
    fitting = _Fitting(known, tuple(free), bandwidth)
    grips = {
        name: _identify_grip(list(trials), sweep, acceleration_range, fitting)
        for name, trials in recorded.items()
    }
    fit = _pooled(list(grips.values()), fitting)
    trials = [trial for grip in grips.values() for trial in grip.trials]
    discrete = identify_discrete(
        np.concatenate([trial.actuator_force for trial in trials]),
        np.concatenate([centred(trial.handle_acceleration) for trial in trials]),
        order,
        trials[0].rate,
    )
    return Identification(grips, fit, discrete, approximate_model(fit.handle), sweep.band)


def centred(values: FloatArray) -> FloatArray:
    """Return values without their mean: gravity and the sensor's offset."""
    return np.asarray(values - values.mean())


def _identify_grip(
    trials: list[IdentificationTrial],
    sweep: SweepParameters,
    acceleration_range: float,
    fitting: _Fitting,
) -> GripIdentification:
    forces, accelerations, responses = [], [], []
    for trial in trials:
        force = kept_repeats(trial.actuator_force, sweep, trial.rate)
        acceleration = kept_repeats(trial.handle_acceleration, sweep, trial.rate)
        check_recording(force, acceleration, trial.rate, sweep.band, acceleration_range)
        responses.append(dft_ratio(force, acceleration, trial.rate, sweep.band, sweep.repeats - 1))
        forces.append(force)
        accelerations.append(centred(acceleration))
    force, acceleration = np.concatenate(forces), np.concatenate(accelerations)
    rate = trials[0].rate
    return GripIdentification(
        trials,
        responses,
        h1(force, acceleration, rate, sweep.band),
        h2(force, acceleration, rate, sweep.band),
        fitting.of_one_grip(responses),
    )


def _pooled(grips: Sequence[GripIdentification], fitting: _Fitting) -> HandleFit:
    """Fit one handle to several grips, between which it is a compromise.

    There it is not noise that a line's deviation comes from but the difference of the grips: with
    noise for a weight, the few lines that have least of it would decide alone.
    """
    if len(grips) == 1:
        return grips[0].fit
    means = [np.mean([response.response for response in g.responses], axis=0) for g in grips]
    spread = np.sqrt(np.mean(np.abs(means - np.mean(means, axis=0)) ** 2, axis=0) / 2)
    widened = [_widened(response, spread) for g in grips for response in g.responses]
    # Whether the mount gives, the grips have told.
    moving = any(grip.fit.mount.frequency for grip in grips)
    return fitting.with_mount(widened) if moving else fitting.rigid(widened)


def _widened(response: FrequencyResponse, spread: FloatArray) -> FrequencyResponse:
    """Return a response with a deviation, of real and of imaginary part, added to its own."""
    deviation = np.hypot(response.standard_deviation, spread)
    noise_to_signal = 2.0 * response.averages * (deviation / np.abs(response.response)) ** 2
    return replace(response, coherence=1.0 / (1.0 + noise_to_signal))


@dataclass(frozen=True)
class _Fitting:
    """What all fits of an identification have in common."""

    known: HandleParameters | None
    free: tuple[str, ...]
    bandwidth: float

    def of_one_grip(self, responses: Sequence[FrequencyResponse]) -> HandleFit:
        """Fit the handle alone; where much is unexplained, with a mode of the mount too."""
        rigid = self.rigid(responses)
        if rigid.residual <= UNEXPLAINED:
            return rigid
        moving = self.with_mount(responses)
        return moving if moving.residual < rigid.residual / 2 else rigid

    def rigid(self, responses: Sequence[FrequencyResponse]) -> HandleFit:
        return fit_handle(
            responses, known=self.known, free=self.free, low_pass_frequency=self.bandwidth
        )

    def with_mount(self, responses: Sequence[FrequencyResponse]) -> HandleFit:
        return fit_handle(
            responses,
            known=self.known,
            free=list(dict.fromkeys((*self.free, *MOUNT))),
            mount=MOUNT_START,
            low_pass_frequency=self.bandwidth,
        )
