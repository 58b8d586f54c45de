# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The family of handles: its ranges, and that it is the same everywhere."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from handle_family import (
    FORCE_DEVIATION,
    FRICTION,
    MODE_DAMPING,
    MODE_FREQUENCY,
    MORE_DELAY,
    Played,
    member,
)

from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import MountParameters

SECONDS = 8.0
DESCRIBED = Plant()


PER_KIND = 8


def of_kind(kind: str) -> list[Played]:
    return [member(kind, number, DESCRIBED, SECONDS) for number in range(PER_KIND)]


def value(found: Played, name: str) -> float:
    return float(found.changes["master_device"][f"simulated.{name}"])


@pytest.mark.parametrize(
    ("kind", "name", "low", "high"),
    [
        ("one mode", "mount.frequency", *MODE_FREQUENCY),
        ("one mode", "mount.damping", *MODE_DAMPING),
        ("modes in series", "second.frequency", *MODE_FREQUENCY),
        ("modes in parallel", "second.share", 0.2, 0.8),
        ("resonance and antiresonance", "mount.frequency", 0.0, 0.0),
        ("force constant", "drive.force_scale", 1 - FORCE_DEVIATION[1], 1 + FORCE_DEVIATION[1]),
        ("more delay", "drive.delay", *MORE_DELAY),
        ("friction", "drive.coulomb_friction", *FRICTION),
        ("polarity", "drive.force_scale", -1.0, -1.0),
    ],
)
def test_values_are_within_their_ranges(kind: str, name: str, low: float, high: float) -> None:
    found = [value(each, name) for each in of_kind(kind)]
    assert low <= min(found) <= max(found) <= high
    assert low == high or len(set(found)) == PER_KIND


def test_a_mode_drifts_within_the_range_in_small_steps_within_the_trial() -> None:
    for each in of_kind("drifting mode"):
        times = [time for time, _ in each.grips]
        mounts = [mount for _, mount in each.grips if isinstance(mount, MountParameters)]
        frequencies = [value(each, "mount.frequency"), *(mount.frequency for mount in mounts)]
        assert len(mounts) == len(times)
        assert times[0] >= 1.0
        assert times[-1] < SECONDS
        assert MODE_FREQUENCY[0] <= min(frequencies) < max(frequencies) <= MODE_FREQUENCY[1]
        ratio = frequencies[-1] / frequencies[0]
        assert 2**0.5 <= max(ratio, 1 / ratio) <= 2.0 * (1 + 1e-9)
        for before, after in pairwise(frequencies):
            assert abs(np.log(after / before)) < 0.011


def test_a_member_is_the_same_again_and_another_seed_gives_another() -> None:
    one, same = (member("friction", 3, DESCRIBED, SECONDS) for _ in range(2))
    assert one == same
    assert member("friction", 3, DESCRIBED, SECONDS, seed=1) != one
