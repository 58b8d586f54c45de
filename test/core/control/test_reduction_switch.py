# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the change of the reduction in a running compensation."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from haptic_accel.core.control.channel import FADING, LISTENING
from haptic_accel.core.control.reduction_switch import ReductionSwitch
from haptic_accel.core.model import FloatArray, Vector, vector
from haptic_accel.core.reduction import LIVE_REDUCTIONS, NO_REDUCTION

RATE = 1000.0
NAMES = (NO_REDUCTION, *LIVE_REDUCTIONS)
GRAVITY = (3.0, -4.0, 8.0)
CHANGED = round((LISTENING + FADING) * RATE)


def switch(name: str = NO_REDUCTION) -> ReductionSwitch:
    return ReductionSwitch(name, RATE, unreduced=lambda tool: tool)


def texture(seconds: float) -> FloatArray:
    along = np.random.default_rng(1).normal(0.0, 3.0, round(seconds * RATE))
    return np.asarray(np.outer(along, [0.8, 0.0, 0.6]))


def shaped(stream: ReductionSwitch, tools: FloatArray) -> FloatArray:
    return np.array([stream.process(vector(tool)) for tool in tools])


@pytest.mark.parametrize("after", NAMES)
@pytest.mark.parametrize("before", NAMES)
def test_at_rest_no_change_is_a_step(before: str, after: str) -> None:
    stream = switch(before)
    value = stream.process(GRAVITY)
    stream.select(after)
    for _ in range(2 * CHANGED):
        assert stream.process(GRAVITY) == pytest.approx(value)
    assert (stream.active, stream.alone) == (after, float(after != NO_REDUCTION))


def test_the_next_reduction_is_crossfaded_after_it_has_listened() -> None:
    stream = switch()
    stream.select("sum")
    shares = []
    for _ in range(CHANGED + 1):
        stream.process(GRAVITY)
        shares.append(stream.alone)
    assert shares[: round(LISTENING * RATE)] == [0.0] * round(LISTENING * RATE)
    assert shares[-7:] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0])


def test_after_a_change_the_vibration_is_that_of_the_other_reduction() -> None:
    stream = switch("sum")
    tools = texture(2.0) + GRAVITY
    shaped(stream, tools[:500])
    stream.select(NO_REDUCTION)
    found = shaped(stream, tools[500:])[CHANGED:]
    offset = found - tools[500 + CHANGED :]
    assert np.ptp(offset, axis=0) == pytest.approx(0.0, abs=1e-9)


def test_a_selection_during_a_crossfade_waits_for_its_end() -> None:
    stream = switch()
    stream.select("axis")
    for _ in range(CHANGED - 2):
        stream.process(GRAVITY)
    stream.select("sum")
    stream.process(GRAVITY)
    assert (stream.name, stream.active) == ("sum", NO_REDUCTION)
    active = []
    for _ in range(CHANGED + 1):
        stream.process(GRAVITY)
        active.append(stream.active)
    assert [name for name, before in pairwise(active[::-1]) if name != before] == ["sum"]
    assert active[0] == "axis"


def test_a_selection_taken_back_changes_nothing() -> None:
    stream = switch("axis")
    stream.select("sum")
    stream.process(GRAVITY)
    stream.select("axis")
    assert {stream.process(GRAVITY) for _ in range(2 * CHANGED)} == {(0.0, 0.0, 8.0)}


def test_a_principal_direction_that_was_found_is_followed_while_not_in_use() -> None:
    stream, tools = switch("principal"), texture(8.0)
    shaped(stream, tools[:500])
    stream.select("axis")
    shaped(stream, tools[500:6000])
    stream.select("principal")
    found = shaped(stream, tools[6000:])[CHANGED:, 2]
    along = np.linalg.norm(tools[6000 + CHANGED :], axis=1)
    assert np.abs(found).std() == pytest.approx(along.std(), rel=0.02)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e9])
def test_a_bad_sample_leaves_no_trace(bad: float) -> None:
    stream = switch()
    stream.select("sum")
    spoilt: Vector = (bad, 0.0, 0.0)
    for index in range(2 * CHANGED):
        stream.process(spoilt if index % 50 == 7 else GRAVITY)
    assert stream.process(GRAVITY) == pytest.approx(GRAVITY)
