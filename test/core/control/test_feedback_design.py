# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Margins against loops computed by hand, and the feedback's design against what it states."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.control.feedback_design import (
    FeedbackDesign,
    GripRange,
    design_feedback,
    encirclements,
    loop_margins,
)
from haptic_accel.core.control.inversion import Goal, TexturePrior, design_inverse
from haptic_accel.core.handle.mechanics import Grid
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import HandleParameters, MountParameters
from haptic_accel.core.parameters import ParameterError

RATE = 4000.0
MARGIN = 0.5
GRID = Grid(1000.0, 8192)
MOUNTED = Plant(mount=MountParameters(280.0, 0.127), delay=225e-6)
FACTORS = st.floats(-1.0, 1.0)


@pytest.fixture(scope="module", params=["rigid", "mounted"])
def plant(request: pytest.FixtureRequest) -> Plant:
    return Plant() if request.param == "rigid" else MOUNTED


@pytest.fixture(scope="module")
def design(plant: Plant) -> FeedbackDesign:
    return designed(plant, Goal(spectrum=TexturePrior(rise=60.0)))


def designed(plant: Plant, goal: Goal) -> FeedbackDesign:
    feedforward = design_inverse(plant, RATE, goal).response
    return design_feedback(plant, RATE, feedforward, goal, margin=MARGIN)


# Margins


@given(st.floats(0.05, 0.95), st.integers(1, 9))
def test_margins_of_a_gain_behind_a_delay(gain: float, samples: int) -> None:
    """|L| is the same everywhere: L circles zero and passes the negative axis."""
    margins = loop_margins(gain * GRID.delay(samples), GRID.frequency)
    assert margins.modulus == pytest.approx(1.0 - gain, abs=1e-3)
    assert margins.gain == pytest.approx(1.0 / gain, rel=1e-3)
    assert margins.phase == margins.delay == math.inf


@given(st.floats(0.05, 1.9))
def test_margins_of_a_summing_loop(gain: float) -> None:
    """L = g / (z - 1): |L| is 1 where 2 sin(w/2) = g, and its angle there is -(pi + w) / 2."""
    z = 1.0 / GRID.delay(1)
    margins = loop_margins(gain / (z - 1.0), GRID.frequency)
    angle = 2.0 * math.asin(gain / 2.0)
    assert margins.gain == pytest.approx(2.0 / gain, rel=1e-3)
    assert margins.phase == pytest.approx((math.pi - angle) / 2.0, abs=1e-3)
    assert margins.delay == pytest.approx((math.pi - angle) / 2.0 / (angle * 1e3), rel=2e-2)
    # |z - 1 + g| / |z - 1| is least at half the rate.
    assert margins.modulus == pytest.approx(min(1.0, 1.0 - gain / 2.0), abs=1e-3)


radii = st.one_of(st.floats(0.0, 0.9), st.floats(1.1, 3.0))


@given(st.lists(st.tuples(radii, st.floats(0.0, math.pi)), min_size=1, max_size=5))
def test_encirclements_count_the_zeros_outside(pairs: list[tuple[float, float]]) -> None:
    curve = np.ones(GRID.points, dtype=complex)
    for radius, angle in pairs:
        zero = radius * np.exp(1j * angle)
        curve = curve * (1.0 - zero * GRID.delay(1)) * (1.0 - zero.conjugate() * GRID.delay(1))
    outside = sum(2 for radius, _ in pairs if radius > 1.0)
    assert encirclements(curve) == -outside


def test_what_turns_too_fast_or_passes_zero_is_not_counted() -> None:
    coarse = Grid(1000.0, 4)
    assert encirclements(coarse.delay(3)) is None
    assert encirclements(np.array([1.0 + 0j, 0.0, -1.0])) is None
    assert encirclements(np.array([1.0 + 0j, math.nan])) is None


# Range of grips


def test_the_range_is_the_handle_and_the_corners_about_it() -> None:
    handle = HandleParameters()
    middle, *corners = GripRange().grips(handle)
    assert middle == handle
    assert len(set(corners)) == 8
    assert {corner.m_h for corner in corners} == {0.7 * handle.m_h, 1.3 * handle.m_h}
    assert {corner.k_u for corner in corners} == {750.0, 3000.0}
    assert {corner.b_u for corner in corners} == {5.5, 22.0}
    assert {(corner.m_a, corner.k_s, corner.b_s) for corner in corners} == {(0.018, 266.0, 2.0)}


# The design


def test_the_stated_margin_is_kept_at_all_corners(design: FeedbackDesign, plant: Plant) -> None:
    frequency = Grid(RATE, 12345).frequency
    for outlook in design.outlooks:
        loop = design.loop(replace(plant, handle=outlook.handle), frequency)
        assert np.abs(1.0 + loop).min() > 0.99 * MARGIN
        assert outlook.margins.modulus == pytest.approx(np.abs(1.0 + loop).min(), rel=0.01)
        assert outlook.margins.gain >= 1.0 / (1.0 - MARGIN) - 1e-6
        assert outlook.margins.phase >= 2.0 * math.asin(MARGIN / 2.0) - 1e-6


@settings(max_examples=20, deadline=None)
@given(mass=FACTORS, stiffness=FACTORS, damping=FACTORS, share=st.floats(0.0, 1.0))
def test_it_is_stable_at_grips_between_and_while_it_fades(
    design: FeedbackDesign,
    plant: Plant,
    mass: float,
    stiffness: float,
    damping: float,
    share: float,
) -> None:
    handle = plant.handle
    between = replace(
        handle,
        m_h=handle.m_h * (1.0 + 0.3 * mass),
        k_u=handle.k_u * 2.0**stiffness,
        b_u=handle.b_u * 2.0**damping,
    )
    frequency = Grid(RATE, 4096).frequency
    loop = design.loop(replace(plant, handle=between), frequency)
    assert np.abs(1.0 + loop).min() > 0.95 * MARGIN
    # Between a share of the answer and the model is a stable system: only this can go round zero.
    full = replace(design, taps=share * design.taps).loop(
        replace(plant, handle=between), frequency
    )
    middle = replace(design, taps=share * design.taps).loop(plant, frequency)
    assert encirclements((1.0 + full) / (1.0 + middle)) == 0


def test_the_error_is_less_at_every_corner_and_the_same_in_the_middle(
    design: FeedbackDesign,
) -> None:
    middle, *corners = design.outlooks
    assert middle.with_feedback == pytest.approx(middle.without, rel=0.02)
    for corner in corners:
        assert corner.with_feedback < corner.without
    assert sum(c.with_feedback for c in corners) < 0.97 * sum(c.without for c in corners)


def test_the_wider_the_texture_the_less_is_there_to_gain(
    design: FeedbackDesign, plant: Plant
) -> None:
    """Bode's integral: what is gained at some frequencies is lost at others."""

    def gain(found: FeedbackDesign) -> float:
        outlooks = found.outlooks
        return 1.0 - sum(o.with_feedback for o in outlooks) / sum(o.without for o in outlooks)

    assert 0.0 < gain(designed(plant, Goal(spectrum=TexturePrior(rise=15.0)))) < gain(design)


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_more_margin_is_less_feedback(rate: float) -> None:
    plant = Plant()
    response = design_inverse(plant, rate).response
    timid, bold = (design_feedback(plant, rate, response, margin=m) for m in (0.95, 0.3))
    assert timid.tightest.margins.modulus >= 0.95 - 1e-9
    assert bold.tightest.margins.modulus >= 0.3 - 1e-9
    assert np.linalg.norm(timid.taps) <= np.linalg.norm(bold.taps)


def test_without_feedforward_it_answers_the_desired_acceleration() -> None:
    plant = Plant()
    design = design_feedback(plant, RATE, lambda f: np.zeros(len(f), complex), foreseen=False)
    assert design.outlooks[0].without == pytest.approx(100.0)
    assert all(outlook.with_feedback < 95.0 for outlook in design.outlooks)
    assert design.tightest.margins.modulus >= 0.5 - 1e-9


def test_the_summary_names_margins_and_errors_of_every_grip(design: FeedbackDesign) -> None:
    lines = design.summary().splitlines()
    assert len(lines) == 3 + len(design.outlooks)
    assert "stated margin 0.50 over 9 grips" in lines[0]
    assert f"{design.tightest.margins.modulus:.2f}" in lines[1]
    assert f"{design.outlooks[0].without:.1f}" in lines[3]


@pytest.mark.parametrize(
    ("rate", "margin"), [(1000.0, 0.0), (1000.0, 1.0), (1000.0, math.nan), (20.0, 0.5)]
)
def test_a_margin_or_rate_that_cannot_be_is_refused(rate: float, margin: float) -> None:
    with pytest.raises(ParameterError, match="^rate = " if rate == 20.0 else "^margin = "):
        design_feedback(Plant(), rate, lambda f: f + 0j, margin=margin)
