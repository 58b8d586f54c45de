# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Evaluation of recordings of a handle: responses, physical fit and models."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import fmean

import numpy as np

from haptic_accel.core.handle.mechanics import approximate_model
from haptic_accel.core.handle.plant import DiscreteModel
from haptic_accel.core.identification import estimate
from haptic_accel.core.identification import fit as fitting
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.fit import Friction, HandleFit, fit_handle
from haptic_accel.core.identification.motion import fit_motion
from haptic_accel.core.model import ApproximateModel, FloatArray, HandleParameters, MountParameters
from haptic_accel.core.parameters import ParameterError

DISCRETE_ORDER = 7
"""Order of the discrete model: eq. (3) has 4, the accelerometer 1, its mount 2."""

UNEXPLAINED = 2.0
"""Residual with a rigid mount, in standard deviations of the noise, above which a mount mode that
halves it is considered certain."""

UNDECIDED = 3.0
"""Twice the logarithm of the likelihood ratio above which a mode of the mount is not excluded (a
fifth of the rigs without a mode, by the chi-squared distribution with two degrees of freedom)."""

WIDEST = 0.5
"""Half width of an interval, relative to the value, above which a parameter causes a warning
(assumed)."""

LARGEST_MISFIT = 0.1
"""Error of the model, relative to the acceleration, above which the fit causes a warning
(assumed)."""

USUAL_MASSES = 0.005, 1.0
"""Range of plausible masses of handle and hand, kg; a mass outside it suggests a wrong unit. Table
I has 0.128 kg; a stylus alone weighs some grams, and a hand that moves with a handle less than
half a kilogram."""

DEFAULT_FREE = (*fitting.DEFAULT_FREE, "friction")
"""Parameters that are fitted by default."""

GRIP_STAGES = ("response", "mount", "dry friction")
"""Stages of the evaluation of a grip."""

LAST_STAGES = ("fit of all grips", "discrete model")
"""Stages that follow the evaluation of all grips."""

Tell = Callable[[str], None]
"""Callback that receives the name of each stage as it begins."""

Fit = Callable[..., HandleFit]
"""Function `fit_handle` with the accelerometer and the known parameters already set."""

MOUNT_START = MountParameters(frequency=280.0, damping=0.15)
"""Initial mode of the mount for the search, near that of the paper's rig."""


@dataclass(frozen=True)
class GripIdentification:
    """Estimates and fit of a handle that is held with one grip.

    Attributes
    ----------
    trials : list of IdentificationTrial
        Recorded trials, without latency and without outliers of the acceleration.
    responses : list of FrequencyResponse
        The paper's DFT ratio of each trial.
    averaged_h1, averaged_h2 : FrequencyResponse
        H1 and H2 estimates over the segments of all trials, with their coherence.
    fit : HandleFit
        Physical parameters from all trials together.
    undecided : tuple of str
        Warnings about the choice of the model.
    """

    trials: list[sweeps.IdentificationTrial]
    responses: list[estimate.FrequencyResponse]
    averaged_h1: estimate.FrequencyResponse
    averaged_h2: estimate.FrequencyResponse
    fit: HandleFit
    undecided: tuple[str, ...] = ()

    @property
    def doubts(self) -> list[str]:
        """Warnings about the fit, one line each; empty if there are none."""
        return [*self.undecided, *fit_doubts(self.fit)]


@dataclass(frozen=True)
class Identification:
    """Estimates, fit and models of a handle.

    Attributes
    ----------
    grips : dict of str to GripIdentification
        Results by the name of the grip.
    fit : HandleFit
        Physical parameters from all trials of all grips together.
    discrete : DiscreteModel
        Model of all trials, for a compensator if the physical model is incomplete.
    approximate : ApproximateModel
        Invertible model of the pooled handle, of the paper's kind.
    band : tuple of float
        Band of the sweep, Hz.
    """

    grips: dict[str, GripIdentification]
    fit: HandleFit
    discrete: DiscreteModel
    approximate: ApproximateModel
    band: tuple[float, float]

    @property
    def outliers(self) -> list[str]:
        """Outliers in the acceleration, one line per grip; empty if there are none."""
        return [
            f"{name}: {line}"
            for name, grip in self.grips.items()
            for line in outliers(grip.trials)
        ]

    @property
    def doubts(self) -> list[str]:
        """Warnings about the fits of the grips, one line each; empty if there are none."""
        return [f"{name}: {line}" for name, grip in self.grips.items() for line in grip.doubts]


def identify_handle(
    recorded: Mapping[str, Sequence[sweeps.IdentificationTrial]],
    sweep: sweeps.SweepParameters,
    acceleration_range: float,
    bandwidth: float,
    *,
    known: HandleParameters | None = None,
    free: Sequence[str] = DEFAULT_FREE,
    tell: Tell = lambda _: None,
) -> Identification:
    """Estimate responses, fit parameters and choose models from recordings of one handle.

    Parameters
    ----------
    recorded : mapping of str to sequence of IdentificationTrial
        Trials by the name of the grip. Their latency is removed first, so that the identified
        delay is that of the hardware.
    sweep : SweepParameters
        Excitation of the handle.
    acceleration_range, bandwidth : float
        Range, both ways, and bandwidth of the accelerometer, m/s^2 and Hz.
    known : HandleParameters, optional
        Values of the fixed parameters, and initial values of the others; default: Table I.
    free : sequence of str
        Names of the fitted parameters, as in `fit_handle`, and ``"friction"``.
    tell : callable
        Callback with the name of each of the `stages` as it begins; some stages may be skipped.

    Raises
    ------
    RecordingError
        A recording is not suitable; the message contains the reason.
    ParameterError
        There is no trial, or a parameter is out of range.
    """
    if not recorded or not all(recorded.values()):
        raise ParameterError("recorded: must hold at least one trial of every grip")
    fit = partial(fit_handle, known=known, low_pass_frequency=bandwidth)
    grips = {
        name: _identify_grip(
            [trial.aligned.cleaned for trial in trials],
            *(sweep, acceleration_range, fit, free),
            telling(tell, name),
        )
        for name, trials in recorded.items()
    }
    if len(grips) > 1:
        tell(LAST_STAGES[0])
    pooled = _pooled(list(grips.values()), fit, free)
    for name, found in [*((name, grip.fit) for name, grip in grips.items()), ("", pooled)]:
        check_determined(name, found)
    trials = [trial for grip in grips.values() for trial in grip.trials]
    tell(LAST_STAGES[1])
    discrete = estimate.identify_discrete(
        np.concatenate([trial.actuator_force for trial in trials]),
        np.concatenate([centred(trial.handle_acceleration) for trial in trials]),
        DISCRETE_ORDER,
        trials[0].rate,
    )
    return Identification(grips, pooled, discrete, approximate_model(pooled.handle), sweep.band)


def stages(grips: Iterable[str]) -> list[str]:
    """Return the names of the stages of `identify_handle`, in their order.

    Examples
    --------
    >>> stages(["hook"])[2:]
    ['fit of hook: dry friction', 'fit of all grips', 'discrete model']
    """
    return [_stage(grip, stage) for grip in grips for stage in GRIP_STAGES] + [*LAST_STAGES]


def _stage(grip: str, stage: str) -> str:
    return f"fit of {grip}: {stage}"


def telling(tell: Tell, grip: str) -> Tell:
    """Return a callback that adds the name of a grip or axis to the name of a stage."""
    return lambda stage: tell(_stage(grip, stage))


def outliers(trials: Sequence[sweeps.IdentificationTrial]) -> list[str]:
    """Return a message about outliers in the acceleration; empty if there are none."""
    samples = sum(trial.handle_acceleration.size for trial in trials)
    count = sum(trial.counters[sweeps.OUTLIERS] for trial in trials)
    line = f"{count} of {samples} samples of handle_acceleration are outliers: replaced by"
    return [f"{line} interpolation"] * bool(count)


def centred(values: FloatArray) -> FloatArray:
    """Subtract the mean, which consists of gravity and the sensor's offset."""
    return np.asarray(values - values.mean())


def _identify_grip(
    trials: list[sweeps.IdentificationTrial],
    sweep: sweeps.SweepParameters,
    acceleration_range: float,
    fit: Fit,
    free: Sequence[str],
    tell: Tell,
) -> GripIdentification:
    tell(GRIP_STAGES[0])
    forces, accelerations, responses = [], [], []
    for trial in trials:
        force = sweeps.kept_repeats(trial.actuator_force, sweep, trial.rate)
        acceleration = sweeps.kept_repeats(trial.handle_acceleration, sweep, trial.rate)
        estimate.check_recording(force, acceleration, trial.rate, sweep.band, acceleration_range)
        used = sweep.band, sweep.repeats - 1
        responses.append(estimate.dft_ratio(force, acceleration, trial.rate, *used))
        forces.append(force)
        accelerations.append(centred(acceleration))
    whole = np.concatenate(forces), np.concatenate(accelerations)
    averaged = estimate.h1(*whole, trials[0].rate, sweep.band)
    found, doubts = choose_fit(trials, responses, sweep, fit, free, tell)
    return GripIdentification(trials, responses, averaged, estimate.h2(averaged), found, doubts)


def choose_fit(
    trials: Sequence[sweeps.IdentificationTrial],
    responses: Sequence[estimate.FrequencyResponse],
    sweep: sweeps.SweepParameters,
    fit: Fit,
    free: Sequence[str],
    tell: Tell = lambda _: None,
) -> tuple[HandleFit, tuple[str, ...]]:
    """Fit a handle with a rigid mount and with a resonant mount; return the better fit.

    Parameters
    ----------
    trials : sequence of IdentificationTrial
        Trials along one axis, for the fit of dry friction.
    responses : sequence of FrequencyResponse
        Responses estimated from them.
    sweep : SweepParameters
        Band, period and repeats of the trials.
    fit : callable
        Function with the signature of `fit_handle`.
    free : sequence of str
        Names of the fitted parameters.
    tell : callable
        Callback with the second and third of `GRIP_STAGES` as they begin.

    Returns
    -------
    HandleFit
    tuple of str
        Warnings about the choice of the model.
    """
    _, mount, friction = GRIP_STAGES
    of_responses = [name for name in free if name != "friction"]
    rigid = fit(responses, free=of_responses)
    tell(mount)
    moving = fit(responses, free=_with_mount(of_responses), mount=MOUNT_START)
    tell(friction)
    refine = partial(fit_motion, trials, sweep) if "friction" in free else lambda fitted: fitted
    if _obvious(rigid, moving):
        return refine(moving), ()
    if _gain(rigid, moving) > UNDECIDED:
        # In a response, dry friction may appear as a mount.
        return _chosen(refine(rigid), refine(moving))
    return refine(rigid), ()


def check_determined(grip: str, fit: HandleFit) -> None:
    """Reject a fit with parameters at a limit of the search.

    Raises
    ------
    RecordingError
        The message contains the name of the grip.
    """
    if fit.limited:
        values = ", ".join(f"{name} = {fit.value(name):.3g}" for name in fit.limited)
        raise estimate.RecordingError(
            f"{values} ({grip or 'all grips'}): at a limit of the search, so the recording does"
            " not determine it; use a larger amplitude or more trials",
            {"trials": 2},
        )


def fit_doubts(fit: HandleFit) -> list[str]:
    """Return warnings about a fit, one line each; empty if there are none."""
    return [*_unusual(fit), *_wide(fit), *_misfit(fit)]


def _unusual(fit: HandleFit) -> Iterator[str]:
    """Yield a warning if the mass is implausible for a handle, for example due to a wrong unit."""
    low, high = USUAL_MASSES
    if not low <= fit.handle.m_h <= high:
        yield (
            f"m_h = {fit.handle.m_h:.3g} kg: handles have {low:g} to {high:g} kg; the recording's"
            " force may be in another unit than N, or its acceleration in another than m/s^2"
            " (g, mg, mm/s^2)"
        )


def _wide(fit: HandleFit) -> Iterator[str]:
    """Yield a warning if parameters of the handle have wide confidence intervals."""
    wide = [
        f"{name} = {fit.value(name):.3g} \N{PLUS-MINUS SIGN} {fitting.INTERVAL * error:.2g}"
        for name, error in fit.standard_errors.items()
        if name in fitting.HANDLE and fitting.INTERVAL * error > WIDEST * fit.value(name)
    ]
    if wide:
        yield (
            f"{', '.join(wide)}: the recording hardly determines it (95 % interval);"
            " use a larger amplitude or more trials"
        )


def _misfit(fit: HandleFit) -> Iterator[str]:
    """Yield a warning if the model does not explain a large part of the recorded motion."""
    beyond_noise = math.sqrt(max(0.0, 1.0 - 1.0 / max(fit.residual, 1.0) ** 2))
    share = fit.relative_residual * beyond_noise
    if share > LARGEST_MISFIT:
        yield (
            f"residual = {fit.residual:.2f} times the noise, {100 * share:.2g} % of the"
            f" acceleration: must be at most {100 * LARGEST_MISFIT:g} %, the model lacks something"
        )


def _obvious(rigid: HandleFit, moving: HandleFit) -> bool:
    """Return True if responses show a mode of the mount that friction cannot imitate."""
    unexplained = max(UNEXPLAINED, 2.0 * moving.residual)
    return rigid.residual > unexplained and not _at_limit(moving)


def _at_limit(moving: HandleFit) -> bool:
    """Return True if the mode of a mount is at a limit of the search, and thus does not exist."""
    return not set(fitting.MOUNT).isdisjoint(moving.limited)


def _gain(rigid: HandleFit, moving: HandleFit) -> float:
    """Return twice the logarithm of the likelihood ratio of a mount with a mode to a rigid one."""
    gain = rigid.count * rigid.residual**2 - moving.count * moving.residual**2
    return gain / moving.inflation


def _chosen(rigid: HandleFit, moving: HandleFit) -> tuple[HandleFit, tuple[str, ...]]:
    """Return the better of two fits, or the simpler one with a warning.

    By the Bayesian information criterion (Schwarz, Annals of Statistics 6, 1978), a parameter must
    raise twice the log-likelihood by the logarithm of the number of values. With less, the
    intervals of the simpler fit are extended by those of the other.
    """
    gain = _gain(rigid, moving)
    if gain > len(fitting.MOUNT) * math.log(moving.count) and not _at_limit(moving):
        return moving, ()
    if gain <= UNDECIDED:
        return rigid, ()
    extended = {
        name: max(error, abs(moving.value(name) - rigid.value(name)) / fitting.INTERVAL + other)
        for name, error in rigid.standard_errors.items()
        for other in (moving.standard_errors[name],)
    }
    warning = (
        f"mount_frequency = {moving.mount.frequency:.0f} Hz: a mode of the accelerometer's mount"
        " is neither shown nor excluded; use a larger end_frequency or amplitude"
    )
    return replace(rigid, standard_errors=extended), (warning,)


def _pooled(grips: Sequence[GripIdentification], fit: Fit, free: Sequence[str]) -> HandleFit:
    """Fit one handle to several grips, as a compromise.

    The standard deviation of a spectral line is the difference between the grips, not the noise.
    With weights from noise, the few lines with the least noise would dominate.
    """
    if len(grips) == 1:
        return grips[0].fit
    # Use the models of the grips, not the measurements: the models exclude dry friction.
    models = [_modelled(grip) for grip in grips]
    means = [model.response for model in models]
    spread = np.sqrt(np.mean(np.abs(means - np.mean(means, axis=0)) ** 2, axis=0) / 2)
    widened = [_widened(model, spread) for model in models]
    free = [name for name in free if name != "friction"]
    # The fits of the grips have already decided whether the mount has a mode.
    if any(grip.fit.mount.frequency for grip in grips):
        found = fit(widened, free=_with_mount(free), mount=MOUNT_START)
    else:
        found = fit(widened, free=free)
    return _with_friction(found, [grip.fit for grip in grips])


def _modelled(grip: GripIdentification) -> estimate.FrequencyResponse:
    """Return the response of a grip's model, with the uncertainty of one trial."""
    first = grip.responses[0]
    return replace(first, response=grip.fit.response(first.frequency, first.rate))


def _with_friction(found: HandleFit, fits: Sequence[HandleFit]) -> HandleFit:
    """Return a fit with the mean friction of other fits; the grip does not affect friction."""
    if not all("friction" in fit.standard_errors for fit in fits):
        return found
    # The model's errors are common to all fits, so averaging does not reduce the error.
    error = fmean(fit.standard_errors["friction"] for fit in fits)
    return replace(
        found,
        bearing=Friction(fmean(fit.bearing.friction for fit in fits)),
        standard_errors=found.standard_errors | {"friction": error},
    )


def _with_mount(free: Sequence[str]) -> list[str]:
    return list(dict.fromkeys((*free, *fitting.MOUNT)))


def _widened(
    response: estimate.FrequencyResponse, spread: FloatArray
) -> estimate.FrequencyResponse:
    """Return a response with a larger standard deviation of real and imaginary part."""
    deviation = np.hypot(response.standard_deviation, spread)
    noise_to_signal = 2.0 * response.averages * (deviation / np.abs(response.response)) ** 2
    return replace(response, coherence=1.0 / (1.0 + noise_to_signal))
