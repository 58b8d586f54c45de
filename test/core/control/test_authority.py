# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fraction of a force that is used, against known responses of the handle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from band_noise import band_noise
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.control.authority import (
    FAINTEST,
    HUSHED_EVERY,
    HUSHED_FOR,
    HUSHED_RARELY,
    LEAST_LEFT,
    LOWEST,
    POWER_MEMORY,
    RECOVERING,
    RISING,
    SILENT,
    SLIGHT,
    STIRRED,
    WARIEST,
    Authority,
    Listening,
)
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import Trace

RATE = 1000.0

few = settings(deadline=None, max_examples=20)


def texture(seconds: float, rms: float = 2.0, seed: int = 0, rate: float = RATE) -> FloatArray:
    return band_noise(40.0, 300.0, seconds, rms, seed=seed, rate=rate)


def run(
    authority: Authority,
    desired: FloatArray,
    response: FloatArray,
    other: FloatArray | float = 0.0,
    described: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return the fraction and the motion of a handle that responds to the full force.

    The motion is the response times the fraction, plus another motion.
    """
    others = np.broadcast_to(other, desired.shape)
    fractions, moved = [], []
    for wanted, full, more in zip(
        desired.tolist(), response.tolist(), others.tolist(), strict=True
    ):
        moved.append(authority.used * full + more)
        authority.traces[0].push(wanted, moved[-1], 0.0, 0.0)
        authority.update(described)
        fractions.append(authority.used)
    return np.array(fractions), np.array(moved)


def error(desired: FloatArray, moved: FloatArray) -> float:
    return float(np.std(moved - desired) / np.std(desired))


def test_a_handle_that_follows_gets_the_full_force_exactly() -> None:
    desired = texture(3.0)
    disturbed = desired + texture(3.0, 0.3, seed=1)  # an error of 15 %
    fractions, _ = run(Authority(RATE, [Trace()]), desired, disturbed)
    assert np.array_equal(fractions, np.ones_like(fractions))


@few
@given(gain=st.floats(1.5, 100.0), seed=st.integers(0, 100))
def test_a_response_that_is_too_large_is_scaled_to_about_what_is_desired(
    gain: float, seed: int
) -> None:
    desired = texture(2.0, seed=seed)
    fractions, moved = run(Authority(RATE, [Trace()]), desired, gain * desired)
    # The fraction of least error is 1 / gain.
    assert fractions[500:] * gain == pytest.approx(1.0, abs=0.3)
    assert error(desired[500:], moved[500:]) < 0.3


@few
@given(gain=st.floats(0.5, 50.0), seed=st.integers(0, 100))
def test_a_response_to_nothing_desired_is_reduced_until_it_does_no_harm(
    gain: float, seed: int
) -> None:
    desired, unrelated = texture(4.0, seed=seed), texture(4.0, seed=seed + 1000)
    _, moved = run(Authority(RATE, [Trace()]), desired, gain * unrelated)
    assert error(desired[1000:], moved[1000:]) <= 1.02


def test_a_reduction_is_reported_once_it_lasts() -> None:
    desired, unrelated = texture(4.0), texture(4.0, 4.0, seed=1000)
    lasting, jerked = Authority(RATE, [Trace()]), Authority(RATE, [Trace()])
    jerk = np.where(np.arange(len(desired)) < 80, unrelated, 0.0)
    for begin in range(0, len(desired), 100):
        part = slice(begin, begin + 100)
        run(lasting, desired[part], unrelated[part])
        fractions, _ = run(jerked, desired[part], desired[part], jerk[part])
        assert not jerked.reduced
        if begin == 100:
            assert fractions.min() < 0.5
            assert not lasting.reduced
    assert lasting.reduced
    assert fractions.max() == 1.0


def test_a_reduction_does_not_last_while_nothing_is_desired() -> None:
    authority, rest = Authority(RATE, [Trace()]), np.zeros(4000)
    desired, unrelated = texture(0.4), texture(0.4, 4.0, seed=1000)
    fractions, _ = run(authority, desired, unrelated)
    assert fractions[-1] < 0.1
    run(authority, rest, rest)
    assert not authority.reduced, "a short motion of the hand tells nothing of the controller"


@pytest.mark.parametrize("gain", [-0.5, -1.0, -10.0])
def test_swapped_wires_cost_what_is_accepted(gain: float) -> None:
    desired = texture(4.0)
    fractions, moved = run(Authority(RATE, [Trace()]), desired, gain * desired)
    # (1 + f g)^2 = 1 + SLIGHT with the fraction f and the gain g.
    assert error(desired[1000:], moved[1000:]) <= math.sqrt(1.0 + 2.0 * SLIGHT)
    assert fractions[1000:].max() < 0.1


def test_the_full_force_returns_once_the_response_fits() -> None:
    authority = Authority(RATE, [Trace()])
    desired = texture(4.0)
    response = np.concatenate([-5.0 * desired[:2000], desired[2000:]])
    fractions, _ = run(authority, desired, response)
    assert fractions[1999] < 0.02
    assert fractions[2000 + round(12 * POWER_MEMORY * RATE)] == 1.0
    assert not authority.reduced


@pytest.mark.parametrize("described", [False, True])
def test_a_force_that_was_reduced_returns_no_faster_than_a_resonance_shows(
    described: bool,
) -> None:
    authority = Authority(RATE, [Trace()])
    desired = texture(2.0)
    run(authority, desired, 50.0 * texture(2.0, seed=1), described=described)
    fractions, _ = run(authority, desired, desired, described=described)
    assert fractions[0] < 0.1
    assert fractions[-1] == 1.0
    rising = RECOVERING if described else RISING
    assert np.all(fractions[100:] <= fractions[:-100] * rising ** (0.112 / POWER_MEMORY) * 1.001)


def test_noise_that_was_there_before_the_contact_is_not_the_force_s() -> None:
    desired = texture(4.0, 0.5)
    desired[:1000] = 0.0
    noise = np.random.default_rng(3).normal(0.0, 0.5, len(desired))
    fractions, _ = run(Authority(RATE, [Trace()]), desired, desired, noise)
    assert fractions[1500:].mean() > 0.9


def test_after_silence_a_reduced_force_is_used_with_caution() -> None:
    authority = Authority(RATE, [Trace()])
    desired = texture(4.0)
    desired[1000:2000] *= 0.1 * SILENT / 2.0
    used, moved = run(authority, desired, 4.0 * desired)
    known = used[999]
    assert used[1999] == pytest.approx(WARIEST * known, rel=0.01)
    assert authority.fraction == pytest.approx(known, rel=0.3)
    assert used[2500:] == pytest.approx(known, rel=0.4)
    assert error(desired[2000:2200], moved[2000:2200]) < 1.0


def test_silence_changes_nothing_on_a_handle_that_follows() -> None:
    desired = texture(4.0)
    desired[1000:2000] *= 0.1 * SILENT / 2.0
    used, _ = run(Authority(RATE, [Trace()]), desired, desired)
    assert np.array_equal(used, np.ones_like(used))


def test_a_handle_that_rings_as_the_tool_lifts_off_keeps_its_force() -> None:
    desired = texture(2.0)
    desired[1000:1300] *= 0.1
    desired[1300:] *= 0.01
    ringing = np.zeros(len(desired))
    ringing[1000:] = 0.8 * np.exp(-np.arange(1000) / 300.0) * np.sin(np.arange(1000) / 2.0)
    used, _ = run(Authority(RATE, [Trace()]), desired, desired, ringing)
    assert np.array_equal(used, np.ones_like(used))


def test_an_oscillation_in_silence_is_reduced() -> None:
    silence = np.zeros(2000)
    unstable = 20.0 * np.sin(2 * np.pi * 150.0 * np.arange(2000) / RATE)
    fractions, moved = run(Authority(RATE, [Trace()]), silence, unstable)
    assert fractions[-1] < 0.1
    assert np.abs(moved[-500:]).max() < 2.0


def test_what_moves_a_handle_as_described_in_silence_is_not_the_force() -> None:
    silence = np.zeros(1000)
    jolt = 20.0 * np.exp(-np.arange(1000) / 50.0) * np.sin(np.arange(1000) / 10.0)
    authority = Authority(RATE, [Trace()])
    run(authority, silence, silence, jolt, described=True)
    assert authority.fraction == 1.0


def test_gravity_and_the_motion_of_the_hand_do_not_count() -> None:
    desired = texture(4.0)
    time = np.arange(len(desired)) / RATE
    hand = 6.9 + 0.5 * np.sin(2 * np.pi * 1.0 * time)
    fractions, _ = run(Authority(RATE, [Trace()]), desired, desired, hand)
    assert np.array_equal(fractions, np.ones_like(fractions))


def test_samples_that_are_missing_are_bridged() -> None:
    authority, desired = Authority(RATE, [Trace()]), texture(1.0)
    run(authority, desired, np.where(np.arange(len(desired)) % 100 == 0, math.nan, desired))
    assert authority.fraction == 1.0


@pytest.mark.parametrize("rate", [100.0, 500.0, 4000.0])
def test_any_rate_will_do(rate: float) -> None:
    authority = Authority(rate, [Trace()])
    noise = np.random.default_rng(2).standard_normal(round(4 * rate))
    fractions, _ = run(authority, noise, -10.0 * noise)
    assert LOWEST <= fractions[-1] < 0.1
    authority.reset()
    assert authority.fraction == 1.0
    fractions, _ = run(authority, noise, noise)
    assert np.array_equal(fractions, np.ones_like(fractions))


@pytest.mark.parametrize("noise", [0.0, 0.3, 0.5])
def test_a_useless_force_remains_as_large_as_can_be_told_from_noise(noise: float) -> None:
    # From the first sample on there is a texture, so the noise was never heard in silence.
    desired, unrelated = texture(12.0), texture(12.0, seed=1)
    disturbed = texture(12.0, noise, seed=2) if noise else 0.0
    authority = Authority(RATE, [Trace()])
    run(authority, desired, 4.0 * unrelated, disturbed)
    fractions, _ = run(authority, desired, 4.0 * unrelated, disturbed)
    # (4 f)^2 = SLIGHT with the fraction f: what it causes is a small part of the noise.
    assert np.median(fractions) * 4.0 == pytest.approx(math.sqrt(SLIGHT), rel=0.6)


@pytest.mark.parametrize(("stirred", "first"), [(0.5 * STIRRED, 1.0), (3.0 * STIRRED, FAINTEST)])
def test_the_first_contact_of_a_handle_that_moves_in_silence_begins_with_caution(
    stirred: float, first: float
) -> None:
    authority = Authority(RATE, [Trace()])
    desired = texture(5.0)
    desired[:1000] = desired[3000:4000] = 0.0
    noise = np.random.default_rng(3).normal(0.0, stirred, len(desired))
    used, _ = run(authority, desired, desired, noise, described=True)
    assert used[999] == pytest.approx(first, rel=0.01)
    # What follows is known after that, also in later contacts.
    assert np.array_equal(used[1600:], np.ones_like(used[1600:]))


@pytest.mark.parametrize("described", [True, False])
def test_a_force_that_the_limits_cut_is_reduced_for_a_while_unless_the_handle_is_known(
    described: bool,
) -> None:
    authority = Authority(RATE, [Trace()])
    desired = texture(6.0)
    run(authority, desired[:1000], desired[:1000], described=described)
    authority.left_over = 0.9
    used, _ = run(authority, desired[1000:], desired[1000:], described=described)
    assert used[15] == pytest.approx(1.0 if described else 0.9, rel=0.02)
    authority.left_over = 0.1
    used, _ = run(authority, desired[1000:], desired[1000:], described=described)
    assert used.min() == pytest.approx(1.0 if described else LEAST_LEFT, rel=0.05)
    assert used[-1] == 1.0


LISTENED = 0.01
"""Time between two blocks, s."""


def heard(listening: Listening, ringing: float, noise: float, minor: float) -> float:
    """Listen once to a handle that rings at first; return what is heard."""
    listening.begin()
    hushed = 0
    while listening.hushes:
        hushed += 1
        listening.hear(ringing if hushed * LISTENED < HUSHED_FOR / 3 else noise, LISTENED, minor)
    assert hushed * LISTENED == pytest.approx(HUSHED_FOR, abs=2 * LISTENED)
    return listening.heard


def waited(listening: Listening) -> float:
    """Return the time until the next listening is due, s."""
    waited = LISTENED
    while not listening.wait(LISTENED):
        waited += LISTENED
    return waited


def test_the_noise_is_heard_once_the_handle_has_ceased_to_ring() -> None:
    listening = Listening()
    assert listening.wait(0.0)
    assert heard(listening, 100.0, 0.5, minor=0.1) == pytest.approx(0.5, rel=0.1)


def test_a_handle_whose_noise_hides_nothing_is_listened_to_more_and_more_rarely() -> None:
    listening = Listening()
    times = []
    for _ in range(6):
        heard(listening, 0.0, 0.5, minor=1.0)
        times.append(HUSHED_FOR + waited(listening))
    expected = [min(HUSHED_EVERY * 2**number, HUSHED_RARELY) for number in range(1, 7)]
    assert times == pytest.approx(expected, abs=3 * LISTENED)
    heard(listening, 0.0, 0.5, minor=0.1)
    assert HUSHED_FOR + waited(listening) == pytest.approx(HUSHED_EVERY, abs=3 * LISTENED)


def test_a_force_that_falls_is_left_to_ring() -> None:
    listening = Listening()
    listening.postpone()
    assert waited(listening) == pytest.approx(0.3, abs=2 * LISTENED)
