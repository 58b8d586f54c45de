# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the decoupling of three coils."""

import numpy as np
import pytest

from haptic_accel.core.control import decoupling
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import ComplexArray, FloatArray, Vector, vector
from haptic_accel.core.tick.control import VectorConvolution

BAND = np.linspace(10.0, 450.0, 50)


def coupled_by(coupling: FloatArray, rate: float = 1000.0) -> MatrixPlant:
    return MatrixPlant((Plant(), Plant(), Plant()), coupling, rate)


def response(taps: FloatArray, rate: float) -> ComplexArray:
    return coupled_by(taps, rate).coupling_response(BAND)


def ringing(rate: float) -> FloatArray:
    """Return a coupling of -10 dB by modes from 90 to 240 Hz that ring for a tenth of a second."""
    time = np.arange(round(0.1 * rate)) / rate
    coupling = np.zeros((3, 3, len(time)))
    for index in range(9):
        to, of = divmod(index, 3)
        if to != of:
            turns = 2 * np.pi * (80.0 + 20.0 * index)
            pulse = np.exp(-0.15 * turns * time) * np.sin(turns * time + index)
            coupling[to, of] = (-1) ** index * 0.1 * turns / rate * pulse
    coupling[:, :, 0] += np.eye(3)
    return coupling


def test_a_coupling_with_a_known_inverse_gets_it() -> None:
    # (I + N z^-1)^-1 = I - N z^-1 + N^2 z^-2, as N^3 = 0.
    nilpotent = np.array([[0.0, 0.4, -0.2], [0.0, 0.0, 0.3], [0.0, 0.0, 0.0]])
    inverse = np.stack([np.eye(3), -nilpotent, nilpotent @ nilpotent], axis=2)
    found = decoupling.full_decoupling(coupled_by(np.stack([np.eye(3), nilpotent], axis=2)))
    assert response(found, 1000.0) == pytest.approx(response(inverse, 1000.0), abs=3e-3)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_a_coupling_that_rings_is_undone_on_both_sides(rate: float) -> None:
    coupling = ringing(rate)
    found = decoupling.full_decoupling(coupled_by(coupling, rate))
    coupled, decoupled = response(coupling, rate), response(found, rate)
    unity = np.broadcast_to(np.eye(3), coupled.shape)
    assert np.abs(coupled - unity).max() > 0.2
    assert coupled @ decoupled == pytest.approx(unity, abs=5e-3)
    assert decoupled @ coupled == pytest.approx(unity, abs=5e-3)


def test_a_coupling_without_dynamics_is_inverted_exactly() -> None:
    directions = np.array([[1.0, 0.2, 0.0], [-0.1, 1.0, 0.3], [0.0, 0.1, 1.0]])
    plant = coupled_by(directions[:, :, np.newaxis])
    found = decoupling.full_decoupling(plant)
    assert found.shape == (3, 3, 1)
    assert found[:, :, 0] @ directions == pytest.approx(np.eye(3))


def test_no_coupling_changes_no_bit() -> None:
    found = decoupling.full_decoupling(MatrixPlant.uncoupled(Plant(), 1000.0))
    assert np.array_equal(found, np.eye(3)[:, :, np.newaxis])


def filtered(stream: VectorConvolution, value: Vector) -> Vector:
    stream.process(*value)
    return stream.x, stream.y, stream.z


def test_a_sample_is_filtered_as_the_whole_signal() -> None:
    random = np.random.default_rng(0)
    taps, values = random.normal(size=(3, 3, 7)), random.normal(size=(40, 3))
    whole = sum(
        np.stack([np.convolve(values[:, of], taps[to, of])[:40] for to in range(3)], axis=1)
        for of in range(3)
    )
    stream = VectorConvolution(taps)
    assert [filtered(stream, vector(each)) for each in values] == pytest.approx(whole)


def test_a_constant_past_is_no_step() -> None:
    taps = np.random.default_rng(0).normal(size=(3, 3, 7))
    stream = VectorConvolution(taps)
    stream.fill(0.0, 1.0, 9.8)
    assert filtered(stream, (0.0, 1.0, 9.8)) == pytest.approx(taps.sum(axis=2) @ (0.0, 1.0, 9.8))
