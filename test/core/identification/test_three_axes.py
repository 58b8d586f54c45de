# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Identification of a handle with three coils against a known plant."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.handle.plant import MatrixPlant
from haptic_accel.core.identification import three_axes
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.fit import DEFAULT_FREE as WITHOUT_FRICTION
from haptic_accel.core.identification.fit import INTERVAL
from haptic_accel.core.identification.sweep import IdentificationTrial, orthogonal_excitation
from haptic_accel.core.parameters import ParameterError
from three_coils import BANDWIDTH, DIRECTIONS, RANGE, RATE, SWEEP, moved, plant, recorded, trials

FREQUENCY = np.arange(20.0, 401.0)


def identify(
    recording: list[IdentificationTrial], free: tuple[str, ...] = WITHOUT_FRICTION
) -> three_axes.ThreeAxisIdentification:
    return three_axes.identify_three_axes(recording, SWEEP, RANGE, BANDWIDTH, free=free)


def errors(found: MatrixPlant, true: MatrixPlant) -> tuple[float, float]:
    """Return the largest errors of all elements, dB and degrees."""
    ratio = found.response(FREQUENCY, RATE) / true.response(FREQUENCY, RATE)
    return (
        float(np.abs(20 * np.log10(np.abs(ratio))).max()),
        float(np.abs(np.angle(ratio, deg=True)).max()),
    )


def test_the_plant_of_a_noisy_recording_is_within_a_tenth_of_a_decibel() -> None:
    told: list[str] = []
    found = three_axes.identify_three_axes(
        trials(plant()), SWEEP, RANGE, BANDWIDTH, free=WITHOUT_FRICTION, tell=told.append
    )
    assert told == three_axes.stages()
    magnitude, phase = errors(found.plant, plant())
    assert magnitude < 0.1
    assert phase < 0.5
    assert found.plant.directions == pytest.approx(plant().directions, abs=0.02)
    assert found.response.coherence.min() > 0.85
    assert not found.doubts
    assert not found.outliers
    for axis, true in zip(found.plant.axes, plant().axes, strict=True):
        assert axis.handle.m_h == pytest.approx(true.handle.m_h, rel=0.01)
        assert axis.mount.frequency == pytest.approx(true.mount.frequency, rel=0.01)
        assert axis.friction == 0.0


@pytest.mark.slow
def test_dry_friction_is_fitted_and_not_part_of_the_plant() -> None:
    found = identify(trials(plant(), 1, friction=0.05), (*WITHOUT_FRICTION, "friction"))
    magnitude, phase = errors(found.plant, plant())
    assert magnitude < 0.2
    assert phase < 1.0
    for axis in found.plant.axes:
        assert axis.friction == pytest.approx(0.05, rel=0.1)


@pytest.mark.slow
def test_a_coupling_that_noise_hides_is_static() -> None:
    handle = MatrixPlant(plant(modes=False).axes, DIRECTIONS[:, :, np.newaxis], RATE)
    found = identify(trials(handle, 1))
    assert found.plant.coupling.shape == (3, 3, 1)
    assert found.plant.directions == pytest.approx(DIRECTIONS, abs=0.01)


def covered(seeds: range) -> float:
    """Return the share of the parameters of all axes that lie in their 95 % intervals."""
    handle = plant(modes=False)
    force = orthogonal_excitation(SWEEP, RATE)
    clean = moved(handle, force)
    inside = []
    for seed in seeds:
        fits = identify([recorded(clean, force, seed)]).fits
        for fit, true in zip(fits.values(), handle.axes, strict=True):
            known = vars(true.handle) | {"delay": true.delay}
            inside += [
                abs(fit.value(name) - known[name]) < INTERVAL * error
                for name, error in fit.standard_errors.items()
            ]
    return float(np.mean(inside))


@pytest.mark.slow
def test_intervals_cover_the_parameters() -> None:
    # Of 30 intervals that are too narrow by half, 20 would hold the truth.
    assert covered(range(2)) >= 0.85


@pytest.mark.slow
def test_intervals_cover_the_parameters_in_fifty_recordings() -> None:
    assert 0.9 <= covered(range(50)) <= 1.0


@pytest.mark.slow
def test_coils_close_to_a_plane_are_refused() -> None:
    flat = np.array([[1.0, 0.1, 0.65], [0.1, 1.0, 0.65], [0.6, 0.6, 0.72]])
    with pytest.raises(RecordingError, match="condition number = .* must be at most 10"):
        identify(trials(plant(flat, modes=False), 1))


def test_no_trial_is_refused() -> None:
    with pytest.raises(ParameterError, match="at least one trial"):
        identify([])
