# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, signal
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces import texture
from haptic_accel.core.surfaces.texture import Texture, TextureModel, from_polynomial

RISING = st.lists(st.floats(0.05, 1.0), min_size=1, max_size=21).map(
    lambda steps: np.cumsum(steps)[:-1] * np.pi / np.sum(steps)
)
"""Up to 20 line spectral frequencies in (0, pi), none close to another."""


def test_known_line_spectra() -> None:
    # 1 / A(z) = 1: the frequencies lie at equal distances; order 1: at arccos(-a_1).
    assert texture.from_polynomial(np.array([1.0, 0.0, 0.0])) == pytest.approx(
        np.pi / 3 * np.arange(1, 3)
    )
    assert texture.from_polynomial(np.array([1.0, -0.5])) == pytest.approx(np.arccos(0.5))
    assert texture.to_polynomial(np.empty((2, 0))).tolist() == [[1.0], [1.0]]


@given(RISING)
def test_rising_frequencies_are_those_of_a_stable_polynomial(lsf: np.ndarray) -> None:
    polynomial = texture.to_polynomial(lsf)
    assert np.all(np.abs(np.roots(polynomial)) < 1 + 1e-9)
    assert texture.from_polynomial(polynomial) == pytest.approx(lsf, abs=1e-6)


def test_an_unstable_polynomial_is_refused() -> None:
    with pytest.raises(ParameterError, match="not inside the unit circle"):
        texture.from_polynomial(np.array([1.0, -2.0, 1.5]))


def test_order_is_strict_and_within_zero_to_pi() -> None:
    assert texture.is_ordered(np.array([[0.1, 0.2], [1.0, 3.1]]))
    for wrong in ([0.0, 1.0], [0.2, 0.2], [0.3, 0.2], [1.0, np.pi]):
        assert not texture.is_ordered(np.array([[0.1, 0.2], wrong]))


def test_levinson_finds_the_filter_of_an_autocovariance() -> None:
    polynomial = np.array([1.0, -1.2, 0.72])
    response = lfilter([2.0], polynomial, np.eye(1, 500)[0])
    covariance = np.array([response[lag:] @ response[: 500 - lag] for lag in range(5)])
    (found, white), variances = texture.levinson(np.array([covariance, np.eye(1, 5)[0]]))
    assert found == pytest.approx([*polynomial, 0.0, 0.0], abs=1e-6)
    assert variances[0, [0, 2, 4]] == pytest.approx([covariance[0], 4.0, 4.0])
    assert white.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]


@given(RISING)
def test_an_autocovariance_solves_the_equations_of_its_polynomial(lsf: np.ndarray) -> None:
    polynomial = texture.to_polynomial(lsf)
    covariance = texture.autocovariance(polynomial, lags=len(lsf) + 3)
    extended = np.append(polynomial, np.zeros(3))
    innovation = toeplitz(covariance) @ extended  # Yule and Walker
    assert innovation == pytest.approx(np.eye(1, len(extended))[0], abs=1e-7 * covariance[0])


def test_the_power_of_filtered_noise_is_the_sum_of_the_squares_of_its_response() -> None:
    forward, feedback = np.array([2.0, 0.5, -0.3, 0.1]), np.array([1.0, -1.2, 0.72])
    response = lfilter(forward, feedback, np.eye(1, 500)[0])
    assert texture.power_gain(forward, feedback) == pytest.approx(response @ response)
    pair = texture.power_gain(
        np.array([forward, [1, 0, 0, 0]]), np.array([feedback, [1.0, -0.5, 0.0]])
    )
    assert pair == pytest.approx([response @ response, 4 / 3])


SPEEDS = np.array([0.0, 0.2, 0.0, 0.2, 0.11])
FORCES = np.array([0.0, 0.0, 5.0, 4.0, 2.0])
FASTEST = (0.2, 4.0)
"""A node."""


def model(polynomial: tuple[float, ...] = (1.0, -0.5), rate: float = 1000.0) -> TextureModel:
    """Return a texture with one filter, and a deviation of 2 m/s^2 away from the axes."""
    lsf = np.tile(from_polynomial(np.array(polynomial)), (5, 1))
    return TextureModel(
        "one", rate, SPEEDS, FORCES, lsf, deviation=2.0 * (SPEEDS > 0) * (FORCES > 0)
    )


def steady(texture: Texture, speed: float, force: float, count: int) -> np.ndarray:
    """Return samples at one point, after the speed has come through its low-pass."""
    texture.block(np.full(500, speed), np.full(500, force))
    return texture.block(np.full(count, speed), np.full(count, force))


def test_weights_are_those_of_the_nearest_point_of_the_hull() -> None:
    points = np.random.default_rng(0).uniform(0, [0.4, 10.0], (500, 2))
    places = model().locate(*points.T)
    affine = np.einsum("mij,mj->mi", places.affine, np.column_stack([points, np.ones(500)]))
    assert affine == pytest.approx(places.weights, abs=1e-9)
    assert np.all(places.weights >= 0)
    assert places.weights.sum(axis=1) == pytest.approx(1.0)
    scale = np.array([0.2, 5.0])
    nodes, points = np.column_stack([SPEEDS, FORCES]) / scale, points / scale
    nearest = places.interpolate(nodes)
    # All of a convex set lies behind its nearest point.
    away = points - nearest
    assert np.all(np.einsum("mnj,mj->mn", nodes - nearest[:, None], away) <= 1e-9)
    inside = (points[:, 0] <= 1) & (points[:, 1] <= 1 - 0.2 * points[:, 0])
    assert 50 < inside.sum() < 450
    assert np.abs(away[inside]).max() < 1e-9


def test_triangles_cover_the_hull_once() -> None:
    corners = np.column_stack([SPEEDS, FORCES, np.ones(5)])[model().triangles]
    assert np.abs(np.linalg.det(corners)).sum() / 2 == pytest.approx(0.2 * (5 + 4) / 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "rate = 0.0: must be above 0 Hz"),
        ({"deviation": np.array([0, 0, 0, -1.0, 1])}, "deviation = -1: must be finite"),
        ({"deviation": np.ones(5)}, "deviation: must be 0 where speed or force is 0"),
        ({"speeds": np.array([0, 0, 0, np.nan, 1])}, "speeds = nan: must be finite"),
        ({"forces": np.zeros(3)}, r"forces: shape \(3,\): must be \(5,\)"),
        ({"lsf": np.tile([2.0, 1.0], (5, 1))}, "lsf: must increase within 0 to pi at each node"),
        ({"ma_lsf": np.full((5, 1), 4.0)}, "ma_lsf: must increase within 0 to pi at each node"),
        ({"forces": SPEEDS}, "nodes: must not be in line in speed and force"),
        ({"forces": np.zeros(5)}, "nodes: must not be in line"),
        ({"speeds": np.array([0, 1.0])}, r"forces: shape \(5,\): must be \(2,\)"),
        ({"coulomb_friction": -0.1}, "coulomb_friction = -0.1: must be at least 0"),
    ],
)
def test_a_wrong_model_is_refused_in_one_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message) as refused:
        replace(model(), **change)
    assert "\n" not in str(refused.value)


def test_samples_have_the_spectrum_of_the_model() -> None:
    texture = model((1.0, -1.2, 0.72))
    samples = steady(Texture(texture, 1000, seed=1), *FASTEST, count=20_000)
    frequency, density = signal.welch(samples, 1000, nperseg=128)
    expected = texture.spectrum(*FASTEST, frequency)
    inside = slice(3, -3)
    assert 10 * np.log10(density / expected)[inside] == pytest.approx(0.0, abs=1.5)
    # Box, Jenkins: variance of a second-order process.
    variance = 4 * (1 + 0.72) / ((1 - 0.72) * ((1 + 0.72) ** 2 - 1.2**2))
    assert samples.var() == pytest.approx(variance, rel=0.05)
    assert integrate.trapezoid(expected, frequency) == pytest.approx(variance, rel=0.01)


def test_gain_and_moving_average_shape_the_samples() -> None:
    zero = replace(
        model((1.0,)),
        ma_lsf=np.full((5, 1), from_polynomial(np.array([1.0, 0.6]))),
        gain=np.full(5, 3),
    )
    samples = steady(Texture(zero, 1000, seed=1), *FASTEST, count=20_000)
    assert samples.var() == pytest.approx(9 * 4 * (1 + 0.36), rel=0.05)
    assert np.mean(samples[1:] * samples[:-1]) / samples.var() == pytest.approx(
        0.6 / 1.36, abs=0.02
    )
    assert zero.spectrum(*FASTEST, np.array([0.0])) == pytest.approx(2 / 1000 * 36 * 1.6**2)


def test_a_seed_gives_the_same_samples_one_by_one_and_in_a_block() -> None:
    random = np.random.default_rng(0)
    speeds, forces = random.uniform(0, 0.3, 300), random.uniform(-1, 6, 300)
    block = Texture(model(), 1000, seed=3).block(speeds, forces)
    again = Texture(model(), 1000, seed=3)
    assert [again.synthesize(*at) for at in zip(speeds, forces, strict=True)] == block.tolist()
    assert Texture(model(), 1000, seed=4).block(speeds, forces).tolist() != block.tolist()


def test_out_of_contact_a_texture_rings_down_by_its_filter_and_at_rest_nothing_is_felt() -> None:
    texture = Texture(model(), 1000, seed=1)
    assert not texture.block(np.zeros(50), np.full(50, 3.0)).any()
    last = steady(texture, *FASTEST, count=1)[-1]
    assert texture.synthesize(FASTEST[0], 0.0) == pytest.approx(0.5 * last)
    assert texture.synthesize(FASTEST[0], 0.0) == pytest.approx(0.25 * last)


def test_speed_comes_through_a_low_pass_of_20_hz() -> None:
    texture = Texture(model((1.0,), rate=4000), 4000, seed=1)
    step = texture.block(np.full(200, 0.05), np.full(200, 2.0))
    noise = np.random.default_rng(1).standard_normal(256)[:200]
    # Of white noise, the deviation tells the speed: 2 m/s^2 at 0.11 m/s, linear from rest.
    speed = 0.11 * np.abs(step / noise) / 2
    phase = 2 * np.pi * 20 * np.arange(200) / 4000 / np.sqrt(2)
    expected = 0.05 * (1 - np.exp(-phase) * (np.cos(phase) + np.sin(phase)))
    assert speed == pytest.approx(expected, abs=1e-3)


def test_rms_is_interpolated_between_different_spectra() -> None:
    low, high = (from_polynomial(np.array([1.0, a, 0.9])) for a in (-1.8, 1.0))
    mixed = replace(model((1.0, 0.0, 0.0)), lsf=np.array([low, low, low, low, high]))
    assert mixed.rms[4] ** 2 == pytest.approx(4 * 1.9 / (0.1 * (1.9**2 - 1)))
    half = (0.5 * (mixed.rms[3] + mixed.rms[4])) ** 2
    at = (0.5 * (SPEEDS[3] + SPEEDS[4]), 0.5 * (FORCES[3] + FORCES[4]))
    frequency = np.linspace(0.0, 500.0, 5001)
    assert integrate.trapezoid(mixed.spectrum(*at, frequency), frequency) == pytest.approx(half)
    samples = steady(Texture(mixed, 1000, seed=1), *at, count=20_000)
    assert samples.var() == pytest.approx(half, rel=0.1)


def test_no_point_has_more_noise_than_the_nodes_around_it() -> None:
    # A node so near to the axis that a cell reaches over it.
    near = replace(model((1.0,)), speeds=np.array([0.0, 0.2, 0.0, 0.2, 0.001]))
    texture = Texture(near, 1000, seed=1)
    for speed in np.linspace(0.0005, 0.004, 8):
        assert steady(texture, float(speed), 2.0, 1000).std() < 2.0 * 1.1


def test_saturation_is_counted() -> None:
    texture = Texture(model((1.0,)), 1000, seed=1, limit=2.0)
    samples = steady(texture, *FASTEST, count=10_000)
    assert np.abs(samples).max() == 2.0
    at_limit = np.sum(np.abs(samples) == 2.0)
    # A normal number is beyond one deviation in 31.7 % of cases.
    assert at_limit == pytest.approx(3173, rel=0.06)
    assert texture.saturated >= at_limit


@pytest.mark.parametrize("rate", [500.0, 1000.0, 2500.0])
def test_another_rate_keeps_the_spectrum_below_its_nyquist_frequency(rate: float) -> None:
    known = model((1.0, -1.2, 0.72), rate=4000)
    other = known.at_rate(rate)
    assert (other.rate, other.lsf.shape) == (rate, known.lsf.shape)
    assert other.deviation[:3] == pytest.approx(0.0)

    frequency = np.linspace(0.0, rate / 2, 20_001)
    delay = np.exp(-2j * np.pi * frequency / 4000)
    density = 2 / 4000 * np.abs(2 / (1 - 1.2 * delay + 0.72 * delay**2)) ** 2
    polynomial = texture.to_polynomial(other.lsf[3])
    response = signal.lfilter([other.deviation[3]], polynomial, np.eye(1, 400)[0])
    for lag in range(3):
        turning = np.cos(2 * np.pi * frequency * lag / rate)
        expected = integrate.trapezoid(density * turning, frequency)
        assert response[lag:] @ response[: 400 - lag] == pytest.approx(expected, rel=1e-4)


def test_a_higher_rate_keeps_the_spectrum_and_adds_next_to_nothing_above() -> None:
    known = model((1.0, -1.2, 0.72))
    other = known.at_rate(4000.0)
    frequency = np.arange(20.0, 450.0)
    error = 10 * np.log10(
        other.spectrum(*FASTEST, frequency) / known.spectrum(*FASTEST, frequency)
    )
    assert np.sqrt(np.mean(error**2)) < 4
    above = integrate.trapezoid(other.spectrum(*FASTEST, np.arange(500.0, 2000.0)))
    below = integrate.trapezoid(known.spectrum(*FASTEST, np.arange(0.0, 500.0)))
    assert above < 0.3 * below


def test_the_same_rate_is_the_same_model() -> None:
    known = model()
    assert known.at_rate(1000.0) is known
    with pytest.raises(ParameterError, match="rate = -1"):
        known.at_rate(-1.0)
    with pytest.raises(ParameterError, match="rate = 40: must be above 40 Hz"):
        Texture(known, 40, seed=1)
