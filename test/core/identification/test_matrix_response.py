# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Estimate of a 3x3 response against a known one, and what is refused by axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.identification.matrix_response import (
    Coupling,
    MatrixResponse,
    above,
    check_matrix_response,
    fit_coupling,
    matrix_response,
)
from haptic_accel.core.identification.sweep import IdentificationTrial, orthogonal_excitation
from haptic_accel.core.identification.three_axes import coupling_doubts
from haptic_accel.core.model import ComplexArray, FloatArray, MountParameters
from nightly import rest_slow
from three_coils import NOISE, RANGE, RATE, SWEEP, moved, plant, recorded, trials

FORCE = orthogonal_excitation(SWEEP, RATE)
HANDLE = plant()
CLEAN = moved(HANDLE, FORCE)


def estimate(*seeds: int) -> MatrixResponse:
    return matrix_response([recorded(CLEAN, FORCE, seed) for seed in seeds], SWEEP)


def test_settled_periods_give_the_response_without_an_error_of_its_own() -> None:
    found = matrix_response([IdentificationTrial(RATE, FORCE, CLEAN, {})], SWEEP)
    assert found.frequency[[0, -1]] == pytest.approx(SWEEP.band)
    assert found.response == pytest.approx(HANDLE.response(found.frequency, RATE), rel=1e-4)
    assert found.coherence == pytest.approx(1.0)


def test_its_standard_deviation_is_that_of_the_noise() -> None:
    scaled = []
    for seed in range(10):
        found = estimate(seed)
        error = (found.response - HANDLE.response(found.frequency, RATE)) / found.deviation
        scaled += [error.real, error.imag]
    assert np.std(scaled, axis=(0, 1)) == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.mean(scaled, axis=(0, 1))).max() < 0.05


def test_the_multiple_coherence_is_the_share_that_all_forces_explain() -> None:
    found = estimate(0, 1)
    forces = np.abs(np.fft.rfft(FORCE[2000:3000], axis=0)[8:451]) ** 2
    signal = np.sum(np.abs(HANDLE.response(found.frequency, RATE)) ** 2 * forces[:, None], axis=2)
    share = signal / (signal + 1000 * NOISE**2)
    assert found.coherence.mean(axis=0) == pytest.approx(share.mean(axis=0), abs=0.002)


def test_coupling_and_condition_are_those_of_the_plant() -> None:
    found = estimate(0)
    true = HANDLE.response(found.frequency, RATE)
    power = np.mean(np.abs(true) ** 2, axis=0)
    assert found.cross_coupling == pytest.approx(10 * np.log10(power / np.diag(power)), abs=0.1)
    assert found.condition[100] == pytest.approx(np.linalg.cond(true[100]), rel=0.02)


def spoilt(name: str) -> list[IdentificationTrial]:
    """Return trials of a handle with a fault of axis y."""
    directions = HANDLE.directions.copy()
    directions[:, 1] = (0.2, 0.3, 1.0)
    driven: dict[str, tuple[MatrixPlant, FloatArray]] = {
        "coil without current": (HANDLE, FORCE * (1.0, 0.0, 1.0)),
        "coil reversed": (HANDLE, FORCE * (1.0, -1.0, 1.0)),
        "coils swapped": (HANDLE, FORCE[:, [0, 2, 1]]),
        "coil turned": (plant(directions), FORCE),
    }
    if name in driven:
        return [recorded(moved(*driven[name]), FORCE)]
    (trial,) = trials(HANDLE, 1)
    acceleration = trial.handle_acceleration.copy()
    if name == "nan":
        acceleration[77, 1] = np.nan
    elif name == "constant":
        acceleration[:, 1] = 0.5
    elif name == "noise":
        acceleration[:, 1] = np.random.default_rng(1).normal(0.0, NOISE, len(acceleration))
    elif name == "saturated":
        acceleration[:, 1] = np.clip(8 * acceleration[:, 1], -RANGE, RANGE)
    elif name == "silent":
        return [replace(trial, actuator_force=FORCE * (1.0, 1e-3, 1.0))]
    return [replace(trial, handle_acceleration=acceleration)]


@pytest.mark.parametrize(
    ("fault", "message"),
    rest_slow(
        [
            ("nan", "axis y: handle_acceleration: holds NaN"),
            ("constant", "axis y: handle_acceleration: constant at 0.5 m/s"),
            ("noise", "axis y: multiple coherence = 0.[01]. .* must be at least 0.7"),
            ("saturated", "axis y: handle_acceleration: .* at the sensor's range of 49"),
            ("silent", "axis y: actuator_force: .* N root mean square .* at least 0.01 N"),
            (
                "coil without current",
                "axis y: coherence = 0.[01]. of its coil .* is the coil connected",
            ),
            ("coil reversed", "axis y: its coil pushes against the axis"),
            ("coils swapped", "axes y and z: the coil of each moves the other axis"),
            ("coil turned", "axis y: its coil moves axis z the most, .* is it mounted along y"),
        ],
        now=7,
    ),
)
def test_a_fault_is_refused_by_axis(fault: str, message: str) -> None:
    recording = spoilt(fault)
    with pytest.raises(RecordingError, match=f"^{message}") as caught:
        check_matrix_response(matrix_response(recording, SWEEP), recording, RANGE)
    assert "\n" not in str(caught.value)


RATE = 1000.0
LINES = np.arange(8.0, 451.0)
MOUNTS = (MountParameters(200.0, 0.1), MountParameters(330.0, 0.1), MountParameters(290.0, 0.1))
DIRECTIONS = np.array([[1.0, 0.3, -0.2], [0.25, 1.0, 0.15], [0.2, -0.3, 1.0]])


def responses(frequency: np.ndarray) -> ComplexArray:
    """Return responses of a coil with the mount of each axis, (n, 3)."""
    return np.stack([Plant(mount=each).response(frequency, RATE) for each in MOUNTS], axis=1)


def measured(noise: float) -> tuple[MatrixResponse, ComplexArray, ComplexArray]:
    """Return the noisy response of rigidly coupled, equal coils, and the arguments of a fit."""
    own = responses(LINES)
    clean = DIRECTIONS * own[:, :, np.newaxis]  # the mount is that of the sensor's axis
    random = np.random.default_rng(1)
    deviation = np.full(clean.shape, noise)
    scatter = random.normal(0.0, noise, (2, *clean.shape))
    ones = np.ones((len(LINES), 3))
    lines = np.ones(501, dtype=bool)
    found = MatrixResponse(
        LINES, clean + scatter[0] + 1j * scatter[1], deviation, ones, clean.real, RATE, 8, lines
    )
    with_all = responses(np.append(LINES, above(found)))
    return found, own, with_all[:, :, np.newaxis] / with_all[:, np.newaxis, :]


def worst(found: Coupling, own: ComplexArray) -> float:
    """Return the largest error of the impulse responses' elements, relative to the true ones."""
    turns = np.outer(LINES, np.arange(found.taps.shape[2])) / RATE
    modelled = np.moveaxis(found.taps @ np.exp(-2j * np.pi * turns).T, 2, 0)
    true = DIRECTIONS * own[:, :, np.newaxis] / own[:, np.newaxis, :]
    inside = (LINES >= 20.0) & (LINES <= 400.0)
    return float(np.abs(modelled / true - 1.0)[inside].max())


def test_modes_of_the_axes_need_not_be_found_in_the_noise() -> None:
    found, own, passed = measured(noise=0.2)
    known = fit_coupling(found, own, passed)
    # Least squares knows a constant of 443 complex lines, the largest of them 40 m/s^2 per N.
    assert worst(known, own) < 0.03
    unknown = fit_coupling(found, own, np.ones_like(passed))
    assert worst(unknown, own) > 2.0 * worst(known, own)
    assert coupling_doubts(found, known, own) == []


def test_a_wrong_ratio_of_modes_is_not_used() -> None:
    found, own, passed = measured(noise=0.02)
    wrong = fit_coupling(found, own, passed.conj() ** 2)
    assert worst(wrong, own) < 0.1


def test_what_the_model_does_not_explain_or_noise_hides_is_doubted() -> None:
    found, own, passed = measured(noise=0.02)
    fitted = fit_coupling(found, own, passed)
    off = fitted.taps.copy()
    off[2, 1] *= 1.2
    (doubt,) = coupling_doubts(found, fitted._replace(taps=off), own)
    assert doubt.startswith("axis z, coil y: the model differs from the measured response by 17 %")
    noisy, own, passed = measured(noise=3.0)
    doubts = coupling_doubts(noisy, fit_coupling(noisy, own, passed), own)
    assert doubts
    assert any("is known within" in each and "use more trials" in each for each in doubts)


@pytest.mark.parametrize("noise", [0.02, 0.5])
def test_the_stated_deviation_is_that_of_the_error(noise: float) -> None:
    found, own, passed = measured(noise)
    fitted = fit_coupling(found, own, passed)
    true = DIRECTIONS * own[:, :, np.newaxis] / own[:, np.newaxis, :]
    within = np.abs(fitted.response - true) < 3.0 * np.sqrt(2.0) * fitted.deviation
    assert within.mean() > 0.9
