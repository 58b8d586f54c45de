# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples on the grid of their stamps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core import sampling
from haptic_accel.core.parameters import ParameterError

START = 1_700_000_000_000_000_000
PERIOD = 1_000_000


def stamps_at(where: object) -> sampling.IntArray:
    """Return stamps on the grid of 1 kHz."""
    return START + np.asarray(where, dtype=np.int64) * PERIOD


@settings(max_examples=40)
@given(st.sets(st.integers(0, 99), min_size=1), st.integers(0, 400_000))
def test_what_is_there_keeps_its_place_and_what_is_not_holds(there: set[int], late: int) -> None:
    start = 1_700_000_000_000_000_000
    where = np.array(sorted(there))
    stamps = start + where * 1_000_000 + late
    found = sampling.grid_indices(stamps, start, 1000.0)
    np.testing.assert_array_equal(found, where)
    held, seen = sampling.on_grid(found, where.astype(float), 100)
    np.testing.assert_array_equal(np.flatnonzero(seen), where)
    for place in range(100):
        before = [one for one in where if one <= place]
        assert held[place] == (before[-1] if before else where[0])


def test_what_lies_outside_is_not_used() -> None:
    held, seen = sampling.on_grid(np.array([-1, 1, 5]), np.array([9.0, 2.0, 9.0]), 3)
    np.testing.assert_array_equal(held, [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(seen, [False, True, False])


@given(st.sampled_from([100.0, 400.0, 1000.0, 3000.0, 4000.0]), st.integers(0, 5))
def test_the_rate_is_found_in_spite_of_jitter_and_loss(rate: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    places = np.flatnonzero(random.random(2000) > 0.1)
    noise = random.uniform(-0.1, 0.1, len(places))
    stamps = START + np.rint((places + noise) * 1e9 / rate).astype(np.int64)
    assert sampling.sampling_rate(stamps) == rate


def test_a_rate_that_is_stated_is_taken_where_the_stamps_agree() -> None:
    stamps = START + np.arange(500, dtype=np.int64) * 3_003_003
    assert sampling.sampling_rate(stamps, 333.0) == 333.0
    assert sampling.sampling_rate(stamps, 1000.0) == 333.0
    odd = START + np.arange(500, dtype=np.int64) * 2_994_012
    assert sampling.sampling_rate(odd) == pytest.approx(334.0)


@pytest.mark.parametrize("stamps", [[], [5], [5, 5, 5]])
def test_no_rate_is_found_where_stamps_do_not_advance(stamps: list[int]) -> None:
    with pytest.raises(ParameterError, match="rate not found"):
        sampling.sampling_rate(np.array(stamps, dtype=np.int64))


def test_stamps_with_little_between_long_silences_lie_on_no_grid() -> None:
    with pytest.raises(ParameterError, match="4 samples in 1 s are not on a sampling grid"):
        sampling.sampling_rate(stamps_at([0, 1, 999, 1000]), 1000.0)


def test_rates_are_the_same_within_a_tenth_of_the_stated_one() -> None:
    found = [sampling.same_rate(rate, 1000.0) for rate in (899.0, 900.0, 1100.0, 1101.0)]
    assert found == [False, True, True, False]
    assert sampling.half_period(4000.0) == 125_000.0


def test_samples_are_missing_where_a_step_is_longer_than_one_and_a_half_periods() -> None:
    assert sampling.missing_samples(stamps_at([0, 1, 2, 3])) == 0
    assert sampling.missing_samples(stamps_at([0, 1, 2, 4, 5, 9, 10, 11])) == 4
    jitter = np.array([0, 240_000, -90_000, 240_000, 0])
    assert sampling.missing_samples(stamps_at(np.arange(5)) + jitter) == 0
    assert sampling.missing_samples(stamps_at([5, 5, 5])) == 0


def test_arms_are_coupled_from_the_first_force_of_a_stretch_that_has_any() -> None:
    let_go = np.zeros((1, 3))
    stretch = np.zeros((50, 3))
    stretch[20:] = 0.3  # encoders take a while to see that the hand has moved
    stamps = np.concatenate([stamps_at([0]), stamps_at(np.arange(500, 550)), stamps_at([900])])
    values = np.concatenate([let_go, stretch, let_go])
    samples = stamps_at(np.arange(1000))
    found = [(START + 500 * PERIOD, START + 549 * PERIOD)]
    assert sampling.coupled_stretches(stamps, values, samples) == found
    assert sampling.coupled_stretches(stamps[::-1], values[::-1], samples) == found
    assert sampling.coupled_stretches(stamps, values, samples[:0]) == found
    assert sampling.coupled_stretches(stamps[:1], let_go, samples) == []
    assert sampling.coupled_stretches(stamps[:0], let_go[:0], samples) == []


def test_silence_and_zeros_both_end_a_stretch() -> None:
    acting = np.zeros((1000, 3))
    acting[200:400, 1] = acting[600:, 2] = -1.0
    stamps = stamps_at(np.concatenate([np.arange(800), np.arange(1000, 1200)]))
    found = [
        ((a - START) // PERIOD, (b - START) // PERIOD)
        for a, b in sampling.coupled_stretches(stamps, acting, stamps_at(np.arange(1200)))
    ]
    assert found == [(0, 399), (600, 799), (1000, 1199)]


def test_a_gap_of_the_recorder_ends_no_stretch() -> None:
    # Forces are lost for 300 samples; of the arm's own samples 50 are recorded meanwhile.
    kept = np.concatenate([np.arange(400), np.arange(700, 1000)])
    forces = np.ones((len(kept), 3))
    samples = stamps_at(np.sort(np.append(kept, np.arange(500, 550))))
    whole = [(START, START + 999 * PERIOD)]
    assert sampling.coupled_stretches(stamps_at(kept), forces, samples) == whole
    forces[399] = 0.0  # with this force the arms were let go
    parts = [(START, START + 398 * PERIOD), (START + 700 * PERIOD, START + 999 * PERIOD)]
    assert sampling.coupled_stretches(stamps_at(kept), forces, samples) == parts
