# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math

import pytest
from identification_coverage import (
    KINDS,
    LARGEST_FRICTION,
    LONGEST_DELAY,
    NOISE,
    RATE,
    Outcome,
    coverage,
    identified,
    random_rig,
)

from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.trial import run_identification


@pytest.mark.parametrize("kind", KINDS)
def test_a_rig_depends_on_nothing_but_kind_and_index(kind: str) -> None:
    assert random_rig(kind, 3) == random_rig(kind, 3)
    assert random_rig(kind, 3) != random_rig(kind, 4)


@pytest.mark.parametrize("kind", KINDS)
def test_rigs_lie_within_their_ranges(kind: str) -> None:
    rigs = [random_rig(kind, index) for index in range(20)]
    for rig in rigs:
        assert NOISE[0] * 0.999 <= rig.accelerometer.noise <= NOISE[1] * 1.001
        assert 0.0 <= rig.drive.delay <= LONGEST_DELAY
        assert 0.0 <= rig.drive.coulomb_friction <= LARGEST_FRICTION
        assert 1000.0 <= rig.handle.k_u <= 2250.0  # 1500 N/m by a factor of 1.5 at most
    assert {rig.drive.delay > 0.0 for rig in rigs} == {False, True}


def test_coverage_leaves_out_what_is_refused_or_doubted() -> None:
    outcomes = [
        Outcome("ideal", 0, 1.0, errors={"m_h": 0.5}),
        Outcome("ideal", 1, 1.0, errors={"m_h": -2.0}),
        Outcome("ideal", 2, 1.0, errors={"m_h": 9.0}, doubts=("m_h",)),
        Outcome("ideal", 3, 1.0, refused="saturated"),
        Outcome("paper", 0, 1.0, errors={"m_h": 1.0, "mount_frequency": -math.inf}),
    ]
    table = coverage(outcomes)
    assert list(table.headings) == ["kind", "rigs", "refused", "doubted", "m_h", "mount_frequency"]
    ideal, paper = table.rows
    assert list(ideal) == ["ideal", "4", "1", "1", "50", ""]
    assert list(paper) == ["paper", "1", "0", "0", "100", "0"]


@pytest.mark.slow
def test_intervals_cover_the_truth_on_random_rigs() -> None:
    errors = []
    for kind in KINDS:
        for index in range(8):
            rig = random_rig(kind, index)
            outcome = identified(rig, run_identification(rig, SweepParameters(), RATE, index, 4))
            if not (outcome.refused or outcome.doubts):
                errors += outcome.errors.values()
    assert len(errors) > 60
    # With 95 %, fewer than 88 % of 80 would be 2.9 standard deviations.
    assert sum(abs(each) <= 1.0 for each in errors) > 0.88 * len(errors)
    # None is confidently wrong.
    assert max(map(abs, errors)) < 3.0
