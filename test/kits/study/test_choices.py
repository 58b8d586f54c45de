# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Preferences, confusions and similarities against textbook data and other methods."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize, stats

from haptic_accel.core.model import FloatArray
from haptic_accel.kits.study import choices

# Citations between Biometrika, Comm. Statist., JASA and JRSS-B (Stigler 1994): Agresti,
# "Categorical Data Analysis", 2002, page 448, and the R package BradleyTerry2, whose maximum
# likelihood is 0, -2.949, -0.480, 0.269. Firth's correction of so many counts is 0.005.
CITATIONS = [[0, 730, 498, 221], [33, 0, 68, 17], [320, 813, 0, 142], [284, 276, 325, 0]]

# Home and away wins in the American League of 1987: Agresti 2002, page 438, and BradleyTerry2.
# Milwaukee, Detroit, Toronto, New York, Boston, Cleveland, Baltimore.
BASEBALL_HOME = [
    [(0, 0), (4, 3), (4, 2), (4, 3), (6, 1), (4, 2), (6, 0)],
    [(3, 3), (0, 0), (4, 2), (4, 3), (6, 0), (6, 1), (4, 3)],
    [(2, 5), (4, 3), (0, 0), (2, 4), (4, 3), (4, 2), (6, 0)],
    [(3, 3), (5, 1), (2, 5), (0, 0), (4, 3), (4, 2), (6, 1)],
    [(5, 1), (2, 5), (3, 3), (4, 2), (0, 0), (5, 2), (6, 0)],
    [(2, 5), (3, 3), (3, 4), (4, 3), (4, 2), (0, 0), (2, 4)],
    [(2, 5), (1, 5), (1, 6), (2, 4), (1, 6), (3, 4), (0, 0)],
]

# Borg, Groenen, "Modern Multidimensional Scaling", 2005, section 8.6: dissimilarities, and raw
# stress 0.0175 after 35 iterations.
BORG_GROENEN = [[0, 5, 3, 4], [5, 0, 2, 2], [3, 2, 0, 1], [4, 2, 1, 0]]


def wins_of(home: list[list[tuple[int, int]]]) -> FloatArray:
    at_home, away = np.moveaxis(np.array(home), -1, 0)
    return at_home + away.T


def relative(wins: FloatArray | list[list[int]], to: int) -> FloatArray:
    worths = np.array([each.value for each in choices.bradley_terry(wins)])
    return worths - worths[to]


def test_citations_between_journals() -> None:
    assert relative(CITATIONS, 0) == pytest.approx([0, -2.949, -0.480, 0.269], abs=0.006)


def test_worths_are_the_maximum_of_the_likelihood_under_jeffreys_prior() -> None:
    wins = wins_of(BASEBALL_HOME)
    compared = wins + wins.T

    def loss(free: FloatArray) -> float:
        worths = np.append(free, 0.0)
        differences = worths[:, None] - worths
        p = 1 / (1 + np.exp(-differences))
        weights = compared * p * (1 - p)
        information = (np.diag(weights.sum(axis=1)) - weights)[:-1, :-1]
        return -float(np.sum(wins * np.log(p)) + np.linalg.slogdet(information)[1] / 2)

    expected = optimize.minimize(loss, np.zeros(6), tol=1e-10).x
    assert relative(wins, 6)[:-1] == pytest.approx(expected, abs=1e-4)


@given(st.integers(0, 40), st.integers(0, 40))
def test_two_conditions_have_the_corrected_log_odds(first: int, second: int) -> None:
    if first + second:
        found = choices.bradley_terry([[0, first], [second, 0]])
        # Haldane 1955, Anscombe 1956: half a choice is added to either side.
        odds = math.log((first + 0.5) / (second + 0.5))
        assert found[0].value - found[1].value == pytest.approx(odds, abs=1e-6)


def test_conditions_that_are_never_compared_are_refused() -> None:
    with pytest.raises(ValueError, match="must connect all conditions"):
        choices.bradley_terry([[0, 3, 0], [2, 0, 0], [0, 0, 0]])


def preferences(worths: FloatArray, spread: float, rng: np.random.Generator) -> FloatArray:
    """Return wins of ten participants, five choices of each pair; worths differ between them."""
    own = worths + spread * rng.normal(size=(10, len(worths)))
    p = 1 / (1 + np.exp(own[:, None, :] - own[:, :, None]))
    upper = np.triu(rng.binomial(5, p), 1)
    return upper + np.triu(5 - upper, 1).transpose(0, 2, 1)


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_worths_of_many_studies_are_unbiased_and_covered(spread: float) -> None:
    worths = np.array([0.6, 0.1, -0.2, -0.5])
    generators = (np.random.default_rng([seed, 6]) for seed in range(300))
    found = [choices.bradley_terry(preferences(worths, spread, rng)) for rng in generators]
    values = np.array([[each.value for each in study] for study in found])
    pairs = [zip(study, worths, strict=True) for study in found]
    held = [[each.low <= worth <= each.high for each, worth in study] for study in pairs]
    # The worth of the group is nearer to 0 than that of its members: a mean of curves is flat.
    assert values.mean(axis=0) == pytest.approx(worths, abs=0.02 if spread == 0 else 0.05)
    assert np.mean(held) == pytest.approx(0.95, abs=0.025)


def test_information_is_the_likelihood_ratio_of_scipy() -> None:
    # McGill, Psychometrika 19, 1954: G = 2 n ln(2) bits. Counts as in the voiceless stops and
    # fricatives of Miller and Nicely's tables: near-diagonal, unequal margins.
    counts = np.array([[80, 43, 64, 17], [71, 84, 55, 5], [66, 76, 107, 12], [18, 12, 9, 175]])
    g = stats.chi2_contingency(counts, correction=False, lambda_="log-likelihood").statistic
    found = choices.information_transfer(counts)
    n = counts.sum()
    assert found.uncorrected == pytest.approx(g / (2 * n * math.log(2)))
    assert found.bits == pytest.approx((g - 9) / (2 * n * math.log(2)))
    assert found.categories == pytest.approx(2**found.bits)


def test_known_channels() -> None:
    # Shannon 1948: four symbols without error are 2 bits; a binary channel with one error in ten
    # transfers 1 - H(0.1) = 0.531 bits.
    assert choices.information_transfer(np.eye(4) * 10**6).bits == pytest.approx(2.0, abs=1e-4)
    binary = choices.information_transfer(np.array([[9, 1], [1, 9]]) * 10**5)
    assert binary.bits == pytest.approx(0.531, abs=1e-3)
    assert choices.information_transfer(np.ones((3, 3))).bits == 0.0
    assert math.isnan(choices.information_transfer(np.zeros((3, 3))).bits)


def test_the_information_of_guesses_is_corrected() -> None:
    rng = np.random.default_rng(8)
    tables = rng.multinomial(125, [1 / 25] * 25, 300).reshape(300, 5, 5)
    found = [choices.information_transfer(table) for table in tables]
    assert np.mean([each.uncorrected for each in found]) > 0.08
    unclipped = np.mean([each.uncorrected for each in found]) - 16 / (2 * 125 * math.log(2))
    assert unclipped == pytest.approx(0.0, abs=0.01)
    assert np.mean([each.bits for each in found]) < 0.025


def test_a_textbook_scaling() -> None:
    found = choices.scale_dissimilarities(BORG_GROENEN)
    distances = np.linalg.norm(found.points[:, None] - found.points, axis=2)
    raw = np.sum((np.array(BORG_GROENEN) - distances) ** 2) / 2
    assert raw == pytest.approx(0.0175, abs=2e-4)
    assert found.stress == pytest.approx(math.sqrt(2 * raw / np.sum(distances**2)))


@settings(max_examples=20, deadline=None)
@given(st.integers(3, 8), st.integers(0, 1000))
def test_distances_in_a_plane_are_recovered(k: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(k, 2))
    wanted = np.linalg.norm(points[:, None] - points, axis=2)
    found = choices.scale_dissimilarities(wanted)
    distances = np.linalg.norm(found.points[:, None] - found.points, axis=2)
    assert distances == pytest.approx(wanted, abs=1e-6)
    assert found.stress == pytest.approx(0.0, abs=1e-6)
    assert found.points.mean(axis=0) == pytest.approx([0, 0], abs=1e-9)
