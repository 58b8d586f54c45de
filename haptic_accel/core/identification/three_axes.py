# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Identification of a handle with three coils: plants of the axes, and their coupling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from haptic_accel.core.axes import HIGHEST_CONDITION, NAMES
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.identification import evaluation
from haptic_accel.core.identification import matrix_response as matrices
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import NOISE_LINES, RecordingError, smoothed
from haptic_accel.core.identification.fit import HandleFit, fit_handle
from haptic_accel.core.identification.motion import simulated
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters
from haptic_accel.core.parameters import ParameterError


@dataclass(frozen=True)
class ThreeAxisIdentification:
    """Estimate, fits and plant of a handle with three coils.

    Attributes
    ----------
    trials : list of IdentificationTrial
        Recorded trials, without latency and without outliers of the acceleration.
    response : MatrixResponse
    fits : dict of str to HandleFit
        Physical parameters by axis.
    plant : MatrixPlant
        Plants of the axes with dry friction where it is certain, and the coupling.
    undecided : tuple of str
        Warnings about the choice of a model.
    """

    trials: list[sweeps.IdentificationTrial]
    response: matrices.MatrixResponse
    fits: dict[str, HandleFit]
    plant: MatrixPlant
    undecided: tuple[str, ...] = ()

    @property
    def doubts(self) -> list[str]:
        """Warnings about the fits, one line each; empty if there are none."""
        doubts = [
            f"axis {name}: {warning}"
            for name, fit in self.fits.items()
            for warning in evaluation.fit_doubts(fit)
        ]
        return [*self.undecided, *doubts]

    @property
    def outliers(self) -> list[str]:
        """Message about outliers in the acceleration; empty if there are none."""
        return evaluation.outliers(self.trials)


def identify_three_axes(
    recorded: Sequence[sweeps.IdentificationTrial],
    sweep: sweeps.SweepParameters,
    acceleration_range: float,
    bandwidth: float,
    *,
    known: HandleParameters | None = None,
    free: Sequence[str] = evaluation.DEFAULT_FREE,
    tell: evaluation.Tell = lambda _: None,
) -> ThreeAxisIdentification:
    """Estimate the response, fit the plant of each axis, and then the coupling.

    The parameters are those of `identify_handle`, with trials of `orthogonal_excitation`.

    Raises
    ------
    RecordingError
        An axis cannot be identified, or the coils' directions are too close to a plane; the
        message names the axis.
    ParameterError
        There is no trial, or a parameter is out of range.
    """
    if not recorded:
        raise ParameterError("recorded: must hold at least one trial")
    for trial in recorded:
        sweeps.check_axes(trial.actuator_force, trial.handle_acceleration)
    trials = [trial.aligned.cleaned for trial in recorded]
    response = matrices.matrix_response(trials, sweep)
    matrices.check_matrix_response(response, trials, acceleration_range)
    fit = partial(fit_handle, known=known, low_pass_frequency=bandwidth)
    fits, undecided = {}, []
    for coil, name in enumerate(NAMES):
        stage = evaluation.telling(tell, f"axis {name}")
        stage(evaluation.GRIP_STAGES[0])
        alone = _alone(trials, response, sweep, coil)
        fits[name], doubts = evaluation.choose_fit(
            alone, [response.own(coil)], sweep, fit, free, stage
        )
        evaluation.check_determined(f"axis {name}", fits[name])
        undecided += [f"axis {name}: {warning}" for warning in doubts]
    tell(LAST_STAGE)
    driven = zip(fits.values(), sweeps.multisine(sweep, response.rate).T, strict=True)
    own = [_as_recorded(found, force, sweep, response) for found, force in driven]
    recorded_own = np.stack(own, axis=1)
    coupling = matrices.fit_coupling(response, recorded_own, _passed(fits, response))
    x, y, z = map(_plant, fits.values())
    plant = MatrixPlant((x, y, z), coupling.taps, response.rate)
    _check_condition(plant)
    undecided += coupling_doubts(response, coupling, recorded_own)
    return ThreeAxisIdentification(trials, response, fits, plant, tuple(undecided))


COMPARED = (20.0, 400.0)
"""Frequency band in which a plant is checked, Hz: the band of textures."""

WEAKEST = 0.1
"""Magnitude, relative to the coil's own response, below which an element is not checked: -20
dB."""

CERTAIN = 4.0
"""Misfit, in standard deviations of the noise, that chance cannot explain."""

LARGEST_UNCERTAINTY = 0.087
"""Twice the standard deviation of an element, relative to its magnitude, that causes a warning:
5 degrees, or 0.8 dB."""

LAST_STAGE = "coupling of the axes"
"""Stage after the fits of the axes."""


def stages() -> list[str]:
    """Return the names of the stages of `identify_three_axes`, in their order."""
    axes = [f"fit of axis {axis}: {stage}" for axis in NAMES for stage in evaluation.GRIP_STAGES]
    return [*axes, LAST_STAGE]


def _alone(
    trials: Sequence[sweeps.IdentificationTrial],
    found: matrices.MatrixResponse,
    sweep: sweeps.SweepParameters,
    axis: int,
) -> list[sweeps.IdentificationTrial]:
    """Return each realisation as a single-axis trial, without the response to other coils.

    Signs are removed, so that all realisations have the same force.
    """
    others = found.response[:, axis].copy()
    others[:, axis] = 0.0
    cut = []
    for trial in trials:
        forces, accelerations = (
            sweeps.kept_periods(values, sweep, trial.rate)
            for values in (trial.actuator_force, trial.handle_acceleration)
        )
        spectra = np.fft.rfft(forces, axis=2)
        coupled = np.zeros(spectra.shape[:3], dtype=np.complex128)
        coupled[:, :, found.lines] = np.einsum("fc,rpfc->rpf", others, spectra[:, :, found.lines])
        alone = accelerations[..., axis] - np.fft.irfft(coupled, forces.shape[2], axis=2)
        signals = zip(sweeps.SIGNS[:, axis], forces[..., axis], alone, strict=True)
        for sign, *pair in signals:
            force, moved = (sign * np.concatenate([each[0], *each]) for each in pair)
            cut.append(sweeps.IdentificationTrial(trial.rate, force, moved, trial.counters))
    return cut


def _as_recorded(
    fit: HandleFit,
    force: FloatArray,
    sweep: sweeps.SweepParameters,
    found: matrices.MatrixResponse,
) -> ComplexArray:
    """Return a fitted axis' response to a periodic force, including the effect of dry friction."""
    if not fit.certain_friction:
        return _causal(fit).response(found.frequency, found.rate)
    (moved,) = simulated([_causal(fit)], np.tile(force, sweeps.DROPPED_REPEATS + 1), found.rate)
    settled = moved[sweeps.DROPPED_REPEATS * len(force) :]
    return np.asarray(np.fft.rfft(settled)[found.lines] / np.fft.rfft(force)[found.lines])


def _passed(fits: Mapping[str, HandleFit], found: matrices.MatrixResponse) -> ComplexArray:
    """Return the ratios of each coil's response with the mount of each axis for `fit_coupling`."""
    frequency = np.append(found.frequency, matrices.above(found))
    ratios = np.zeros((len(frequency), matrices.COILS, matrices.COILS), dtype=np.complex128)
    for coil, fit in enumerate(map(_causal, fits.values())):
        own = fit.response(frequency, found.rate)
        for axis, other in enumerate(fits.values()):
            mounted = replace(fit, mount=other.mount)
            ratios[:, axis, coil] = mounted.response(frequency, found.rate) / own
    return ratios


def coupling_doubts(
    found: matrices.MatrixResponse, coupling: matrices.Coupling, own: ComplexArray
) -> list[str]:
    """Return a warning for each element that the model does not explain, or that is too uncertain.

    Parameters
    ----------
    found : MatrixResponse
    coupling : Coupling
        Coupling fitted to it.
    own : ndarray, shape (n, 3)
        Response of each coil along its own axis, to which the coupling is relative.
    """
    low, high = COMPARED
    inside = (found.frequency >= low) & (found.frequency <= high)
    turns = np.outer(found.frequency, np.arange(coupling.taps.shape[2])) / found.rate
    modelled = np.moveaxis(coupling.taps @ np.exp(-2j * np.pi * turns).T, 2, 0)
    size = np.abs(modelled)
    unknown = 2.0 * coupling.deviation + np.abs(modelled - coupling.response)
    counts = inside[:, np.newaxis, np.newaxis] & (size >= WEAKEST)
    relative = found.response / own[:, np.newaxis, :] / modelled - 1.0
    scatter = found.deviation / np.abs(own)[:, np.newaxis, :] / size
    lines = []
    for axis, coil in np.ndindex(matrices.COILS, matrices.COILS):
        used = counts[:, axis, coil]
        if not used.any():
            continue
        name = f"axis {NAMES[axis]}, coil {NAMES[coil]}"
        frequency = found.frequency[used]
        unsure = (unknown / size)[used, axis, coil]
        mean = np.abs(smoothed(relative[used, axis, coil]))
        surely = mean - CERTAIN * np.sqrt(smoothed(scatter[used, axis, coil] ** 2) / NOISE_LINES)
        worst, vaguest = int(np.argmax(surely)), int(np.argmax(unsure))
        if surely[worst] > evaluation.LARGEST_MISFIT:
            lines.append(
                f"{name}: the model differs from the measured response by"
                f" {100 * mean[worst]:.0f} % near {frequency[worst]:.0f} Hz: must be at most"
                f" {100 * evaluation.LARGEST_MISFIT:g} %"
            )
        elif unsure[vaguest] > LARGEST_UNCERTAINTY:
            lines.append(
                f"{name}: the response is known within {100 * unsure[vaguest]:.0f} % only near"
                f" {frequency[vaguest]:.0f} Hz: use more trials"
            )
    return lines


def _causal(fit: HandleFit) -> HandleFit:
    """Return a fit whose delay is at least 0; noise may make it negative."""
    return replace(fit, delay=max(0.0, fit.delay))


def _plant(fit: HandleFit) -> Plant:
    return Plant(
        handle=fit.handle,
        mount=fit.mount,
        delay=_causal(fit).delay,
        bandwidth=fit.low_pass_frequency,
        friction=fit.certain_friction,
    )


def _check_condition(plant: MatrixPlant) -> None:
    """Reject coils whose directions are nearly in one plane, as the reader of plants does."""
    if not plant.condition <= HIGHEST_CONDITION:
        raise RecordingError(
            f"condition number = {plant.condition:.3g} of the coils' directions: must be at most"
            f" {HIGHEST_CONDITION:g}, or the axes cannot be driven independently; mount the coils"
            " closer to right angles"
        )
