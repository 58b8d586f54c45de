# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The scripted hand: speeds and depths as asked, motion that is smooth and repeats itself."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import FloatArray
from haptic_accel.core.rig.master_rig import ExplorationParameters, scripted_hand
from haptic_accel.core.tick.rigs import HAND_STEP, ScriptedHand

# Few examples: each one tabulates a cycle of seconds.
few = settings(deadline=None, max_examples=20)

explorations = st.builds(
    ExplorationParameters,
    height=st.floats(0.0, 0.05),
    approach_time=st.floats(0.1, 1.0),
    press_depth=st.floats(0.0, 0.02),
    stroke_speed=st.floats(0.02, 0.5),
    stroke_length=st.floats(0.01, 0.1),
    turn_time=st.floats(0.02, 0.5),
    strokes=st.integers(1, 5),
    pause=st.floats(0.0, 0.5),
)


def at(hand: ScriptedHand, time: float) -> tuple[float, float, float, float]:
    """Return x, z and their velocities."""
    hand.lead(time)
    return hand.x, hand.z, hand.v_x, hand.v_z


def period(hand: ScriptedHand) -> float:
    return hand.last * HAND_STEP


def path(hand: ScriptedHand, step: float = 1e-3) -> FloatArray:
    """Rows of time, x, z, v_x, v_z over one cycle."""
    return np.array([(time, *at(hand, time)) for time in np.arange(0.0, period(hand), step)])


def stroke_ends(x: FloatArray) -> list[float]:
    """Return the places where the motion along the surface turns; below 10 nm nothing moves."""
    moves = [(a, b) for a, b in pairwise(x.tolist()) if abs(a - b) > 1e-8]
    return [
        here
        for (before, here), (_, after) in pairwise(moves)
        if (here - before) * (after - here) < 0
    ]


def test_strokes_have_the_speed_asked_for() -> None:
    _, x, z, v_x, _ = path(scripted_hand(ExplorationParameters(stroke_speed=0.1))).T
    assert np.abs(v_x).max() == pytest.approx(0.1, rel=1e-3)
    pressing = z < -0.0046
    full_speed = np.abs(np.abs(v_x[pressing]) - 0.1) < 1e-4
    # Between ramps of 0.15 s each stroke of 0.8 s keeps its speed, four times.
    assert full_speed.sum() * 1e-3 > 4 * 0.65
    assert x.max() - x.min() > 0.08


@pytest.mark.parametrize("length", [0.04, 0.08])
@pytest.mark.parametrize("turn_time", [0.05, 0.15, 0.3])
def test_strokes_have_the_length_asked_for(length: float, turn_time: float) -> None:
    parameters = ExplorationParameters(stroke_length=length, turn_time=turn_time, strokes=6)
    ends = stroke_ends(path(scripted_hand(parameters))[:, 1])
    assert len(ends) == 5
    assert np.abs(np.diff(ends)) == pytest.approx(length, rel=5e-3)


def test_the_hand_presses_as_deep_as_asked_and_rests_as_high() -> None:
    parameters = ExplorationParameters(height=0.02, press_depth=0.005, pause=0.5)
    time, x, z, v_x, _ = path(scripted_hand(parameters)).T
    assert z.min() == pytest.approx(-0.005)
    assert z.max() == pytest.approx(0.02)
    assert (z[np.abs(v_x) > 1e-3] < -0.0049).all(), "it strokes only while it presses"
    resting = time > time[-1] - 0.49
    assert z[resting] == pytest.approx(0.02)
    assert x[resting] == pytest.approx(0.0, abs=1e-9)


def test_the_cycle_is_approach_strokes_lift_and_pause() -> None:
    exploration = scripted_hand(ExplorationParameters())
    # Between the outer two ramps of 0.15 s are 3 turns; strokes are 0.08 m at 0.1 m/s, of
    # which the cosine-shaped half turns cover 2/pi of their time at full speed.
    cruise = 0.8 - 0.15 * 2 / math.pi
    assert period(exploration) == pytest.approx(0.6 + 5 * 0.15 + 4 * cruise + 0.6 + 0.2, abs=0.01)


@few
@given(explorations)
def test_each_cycle_ends_where_it_began(parameters: ExplorationParameters) -> None:
    exploration = scripted_hand(parameters)
    start = (0.0, parameters.height, 0.0, 0.0)
    assert at(exploration, 0.0) == pytest.approx(start)
    # A moment before the end and not at it, which is already the next beginning.
    assert at(exploration, period(exploration) - 1e-9) == pytest.approx(start, abs=1e-7)
    for time in (0.0, 0.123, period(exploration) / 2, period(exploration) - 1e-6):
        again = at(exploration, time + 3 * period(exploration))
        assert again == pytest.approx(at(exploration, time), abs=1e-9)


@few
@given(explorations, st.integers(1, 400))
def test_velocity_is_the_derivative_of_position(
    parameters: ExplorationParameters, microseconds: int
) -> None:
    exploration = scripted_hand(parameters)
    step = 1e-6 * microseconds
    for time in np.linspace(0.0, period(exploration), 200).tolist():
        before, here, after = (at(exploration, time + shift) for shift in (0.0, step / 2, step))
        # The velocity is linear but for a bend here and there, where it is off by what it
        # bends in this step.
        for axis in (0, 1):
            bend = abs(before[axis + 2] - 2 * here[axis + 2] + after[axis + 2])
            mean = (after[axis] - before[axis]) / step
            assert mean == pytest.approx(here[axis + 2], abs=bend + 1e-8)


@few
@given(explorations)
def test_motion_is_continuous(parameters: ExplorationParameters) -> None:
    exploration = scripted_hand(parameters)
    _, x, z, v_x, v_z = path(exploration, 0.5e-3).T
    fastest = max(np.abs(v_x).max(), np.abs(v_z).max())
    assert np.abs(np.diff(x)).max() <= fastest * 0.5e-3 * (1 + 1e-6) + 1e-12
    assert np.abs(np.diff(z)).max() <= fastest * 0.5e-3 * (1 + 1e-6) + 1e-12
    # The steepest part of a turn from speed to -speed is pi/2 times its mean; one of the
    # table's steps may be as much again because ramps begin on it.
    turning = math.pi * parameters.stroke_speed / parameters.turn_time
    assert np.abs(np.diff(v_x)).max() <= turning * 0.5e-3 * 1.5 + 0.05 * parameters.stroke_speed


@few
@given(explorations, st.floats(-10.0, 0.0))
def test_before_it_starts_the_hand_rests(parameters: ExplorationParameters, time: float) -> None:
    assert at(scripted_hand(parameters), time) == (0.0, parameters.height, 0.0, 0.0)


def test_a_hand_may_press_without_stroking() -> None:
    exploration = scripted_hand(ExplorationParameters(stroke_speed=0.0, strokes=1))
    x, z, v_x, v_z = at(exploration, 10.0)
    assert (x, z, v_x, v_z) == pytest.approx((0.0, -0.0047, 0.0, 0.0))
