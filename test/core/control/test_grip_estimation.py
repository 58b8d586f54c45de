# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.estimation import (
    LARGEST_FACTORS,
    SMALLEST,
    AdaptationParameters,
    GripEstimator,
)
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import AccelerometerParameters, HandleParameters
from haptic_accel.core.rig.master_rig import DriveParameters, MasterRig, MasterRigParameters
from haptic_accel.core.tick import Trace

RATE = 1000.0
TABLE_I = HandleParameters()
SOFT = replace(TABLE_I, m_h=0.1, k_u=900.0, b_u=7.0)
STIFF = replace(TABLE_I, m_h=0.16, k_u=2600.0, b_u=19.0)
PLANT = Plant()


def estimator(**parameters: float) -> GripEstimator:
    return GripEstimator(Trace(), PLANT, RATE, AdaptationParameters(**parameters))


def rig(handle: HandleParameters, noise: float = 0.0, rate: float = RATE) -> MasterRig:
    sensor = AccelerometerParameters(noise_density=noise, bits=32)
    return MasterRig(
        MasterRigParameters(handle, drive=DriveParameters(bits=32), accelerometer=sensor), rate
    )


def drive(
    of: GripEstimator,
    master: MasterRig,
    seconds: float,
    force: float = 0.5,
    start: float = 0.0,
    rate: float = RATE,
    tone: float = 0.0,
    missing_every: int = sys.maxsize,
) -> None:
    """Excite the handle by white force, N RMS, and let the estimator see it.

    With a tone, Hz, the force is that, with `force` as its amplitude. Of so many accelerations one
    is missing.
    """
    random = np.random.default_rng(0)
    first = round(start * rate)
    applied = 0.0
    measured = 0.0
    for index in range(first, first + round(seconds * rate)):
        master.advance(index / rate)
        # Both of the sample before.
        known = math.nan if index % missing_every == missing_every - 1 else measured
        of.trace.push(0.0, known, applied, 0.0)
        measured = master.measure().acceleration[ACTUATOR_AXIS]
        wave = math.sin(2 * math.pi * tone * index / rate) if tone else random.normal()
        applied = force * wave
        master.apply_actuator_force(along_actuator(applied))
        of.update()


def grip_of(handle: HandleParameters) -> np.ndarray:
    return np.array([handle.m_h, handle.b_u, handle.k_u])


@pytest.mark.parametrize("handle", [TABLE_I, SOFT, STIFF])
@pytest.mark.parametrize("noise", [0.0, 0.00245])
def test_the_grip_is_found_from_force_and_acceleration(
    handle: HandleParameters, noise: float
) -> None:
    found = estimator()
    drive(found, rig(handle, noise), 3.0)
    assert found.estimates > 5
    assert found.grip[0] == pytest.approx(handle.m_h, rel=0.05)
    assert found.grip[1] == pytest.approx(handle.b_u, rel=0.15)
    # Above 15 Hz stiffness hardly counts.
    assert found.grip[2] == pytest.approx(handle.k_u, rel=0.35)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("rate", "seconds"), [(4000.0, 2.5), (30.0, 5.0)])
def test_it_is_found_at_4_khz_too_and_works_at_30_hz_without_a_warning(
    rate: float, seconds: float
) -> None:
    found = GripEstimator(Trace(), PLANT, rate, AdaptationParameters())
    drive(found, rig(SOFT, rate=rate), seconds, rate=rate)
    assert np.isfinite(found.grip).all()
    assert rate < 1000.0 or found.grip[0] == pytest.approx(SOFT.m_h, rel=0.05)


@pytest.mark.parametrize("noise", [0.0, 0.00245])
def test_a_change_of_grip_is_followed_within_a_seventh_of_a_second(noise: float) -> None:
    found = estimator()
    master = rig(SOFT, noise)
    drive(found, master, 2.0)
    master.change_grip(STIFF)
    drive(found, master, 0.15, start=2.0)
    assert found.grip[0] == pytest.approx(STIFF.m_h, rel=0.05)
    assert found.grip[1] == pytest.approx(STIFF.b_u, rel=0.2)


@settings(deadline=None, max_examples=15)
@given(st.floats(0.4, 3.0), st.floats(0.2, 6.0), st.floats(0.2, 8.0))
@example(3.0, 0.2, 8.0)
@example(0.4, 6.0, 0.2)
@example(1.0, 1.0, 1.0)
def test_any_hand_is_found_whatever_the_one_before(mass: float, b: float, k: float) -> None:
    hand = replace(TABLE_I, m_h=mass * TABLE_I.m_h, b_u=b * TABLE_I.b_u, k_u=k * TABLE_I.k_u)
    found = estimator()
    master = rig(STIFF)
    drive(found, master, 0.5)
    master.change_grip(hand)
    drive(found, master, 0.5, start=0.5)
    # What the estimated grip says that the handle takes: a force held for a sample makes a damped
    # handle appear to be larger by b T / 2 m, since the acceleration is sampled at its end.
    frequency = np.array([40.0, 80.0, 160.0])
    s = 2j * np.pi * frequency
    powers = np.stack([np.ones_like(s), 1 / s, 1 / s**2])
    expected, measured = grip_of(hand) @ powers, found.grip @ powers
    stretch = abs(hand.b_u / hand.m_h - TABLE_I.b_u / TABLE_I.m_h) / RATE / 2
    assert np.abs(measured / expected - 1.0).max() < 0.1 + 1.5 * stretch
    assert found.at_end == {}


@pytest.mark.parametrize(
    ("beyond", "end"),
    [
        (replace(TABLE_I, m_h=5.0 * TABLE_I.m_h), {"m_h": "upper"}),
        (replace(TABLE_I, m_h=0.2 * TABLE_I.m_h), {"m_h": "lower"}),
        (replace(TABLE_I, b_u=12.0 * TABLE_I.b_u), {"b_u": "upper"}),
        (replace(TABLE_I, k_u=0.01 * TABLE_I.k_u), {"k_u": "lower"}),
    ],
)
def test_a_hand_out_of_range_is_told_until_it_has_gone(
    beyond: HandleParameters, end: dict[str, str]
) -> None:
    found = estimator()
    master = rig(beyond)
    drive(found, master, 1.5)
    assert found.at_end == end
    master.change_grip(TABLE_I)
    drive(found, master, 0.5, start=1.5)
    assert found.at_end == {}


@pytest.mark.parametrize("factor", [LARGEST_FACTORS[0] * 0.99, LARGEST_FACTORS[0] * 1.01])
def test_at_the_bound_it_does_not_flicker(factor: float) -> None:
    found = estimator()
    master = rig(replace(TABLE_I, m_h=float(factor) * TABLE_I.m_h), noise=0.01)
    told = []
    for second in range(4):
        drive(found, master, 1.0, start=float(second), force=0.1)
        told.append(bool(found.at_end))
    assert sum(a != b for a, b in pairwise(told)) <= 1


@pytest.mark.parametrize("force", [0.0, 1e-3])
def test_without_excitation_it_stays_put(force: float) -> None:
    found = estimator()
    drive(found, rig(SOFT, noise=0.00245), 3.0, force=force)
    assert found.estimates == 0
    assert found.grip == pytest.approx(grip_of(TABLE_I))


def test_what_was_learnt_stays_while_nothing_is_felt() -> None:
    found = estimator()
    master = rig(SOFT, noise=0.00245)
    drive(found, master, 3.0)
    drive(found, master, 1.0, force=0.0, start=3.0)  # the last look that saw excitation
    looks = found.estimates
    learnt = found.grip.copy()
    drive(found, master, 5.0, force=0.0, start=4.0)
    assert found.estimates == looks
    assert found.grip == pytest.approx(learnt)


def test_a_single_frequency_leaves_no_nonsense() -> None:
    found = estimator()
    drive(found, rig(SOFT), 3.0, tone=90.0)
    factors = found.grip / grip_of(TABLE_I)
    assert np.all(factors > 0.3)
    assert np.all(factors < 3.0)


@pytest.mark.parametrize("tone", [90.0, 180.0])
def test_a_line_in_noise_leaves_the_grip_as_assumed(tone: float) -> None:
    found = estimator()
    master = rig(TABLE_I, noise=0.005)
    deviations = []
    for second in range(4):
        drive(found, master, 1.0, force=0.1, start=float(second), tone=tone)
        deviations.append(np.abs(found.grip / grip_of(TABLE_I) - 1.0).max())
    assert found.estimates > 100
    assert max(deviations) < 0.35


def test_some_missing_samples_do_no_harm_many_stop_it() -> None:
    for every, looks in ((200, True), (20, False)):
        found = estimator()
        drive(found, rig(SOFT), 3.0, missing_every=every)
        assert (found.estimates > 0) == looks
        if looks:
            assert found.grip[0] == pytest.approx(SOFT.m_h, rel=0.1)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31), st.floats(0.0, 100.0), st.floats(0.0, 1e4))
@example(0, 1.0, 0.0)
@example(0, 0.5, 0.0)
def test_whatever_it_sees_the_grip_stays_in_the_safe_set(
    seed: int, force: float, acceleration: float
) -> None:
    found = estimator()
    random = np.random.default_rng(seed)
    signals = random.normal(0.0, 1.0, (1500, 2)) * (force, acceleration)
    for f, a in signals.tolist():
        found.trace.push(0.0, a, f, 0.0)
        found.update()
    assert np.isfinite(found.grip).all()
    factors = found.grip / grip_of(TABLE_I)
    assert np.all(factors >= np.array(SMALLEST) * (1 - 1e-9))
    assert np.all(factors <= np.array(LARGEST_FACTORS) * (1 + 1e-9))
    if not acceleration:  # an accelerometer that is dead
        assert factors == pytest.approx(1.0)
        assert found.at_end == {}


def test_reset_forgets_the_grip() -> None:
    used, fresh = estimator(), estimator()
    drive(used, rig(SOFT), 2.0)
    used.reset()
    assert used.grip == pytest.approx(grip_of(TABLE_I))
    drive(used, rig(STIFF), 2.0)
    drive(fresh, rig(STIFF), 2.0)
    assert used.grip == pytest.approx(fresh.grip)
