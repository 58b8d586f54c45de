# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names of differences, from responses of plants that have exactly one of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.control.diagnosis import FITTING, RAISING, Diagnosis
from haptic_accel.core.control.feedback_design import GripRange
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, HandleParameters, MountParameters
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial
from haptic_accel.setup.setup import Setup

RATE = 1000.0
LINES = np.arange(129) * RATE / 256
INNER = (LINES > 0.0) & (LINES < 450.0)
INTERVAL = 0.064
PAPER = Plant(mount=MountParameters(287.0, 0.105), delay=68e-6).coupled()
IDEAL = Plant(bandwidth=100e3).coupled()

few = settings(deadline=None, max_examples=25)


def named(
    described: Plant,
    response: ComplexArray,
    coherence: float = 0.99,
    seconds: float = 0.5,
    evaluations: float = 8.0,
    level: float = 1e-2,
) -> str:
    """Return the name for a response of the real plant over the described one."""
    ratio = np.ones(len(LINES), dtype=np.complex128)
    ratio[INNER] = response / described.response(LINES[INNER], RATE)
    density = np.where((LINES > 20.0) & (LINES < 400.0), level, 0.0)
    diagnosis = Diagnosis(described, RATE, LINES)
    for _ in range(round(seconds / INTERVAL)):
        diagnosis.judge(ratio, np.full(len(LINES), coherence), density, INTERVAL, evaluations)
    return diagnosis.difference


def response(plant: Plant) -> ComplexArray:
    return plant.response(LINES[INNER], RATE)


@pytest.mark.parametrize("described", [IDEAL, PAPER])
@pytest.mark.parametrize("number", range(9))
def test_ordinary_hands_are_no_difference(described: Plant, number: int) -> None:
    hand = GripRange().grips(described.handle)[number]
    assert named(described, response(replace(described, handle=hand))) == ""


@few
@given(
    scale=st.one_of(st.floats(0.35, 0.5), st.floats(2.2, 3.0)),
    number=st.integers(0, 8),
)
@pytest.mark.parametrize("described", [IDEAL, PAPER])
def test_a_scale_that_no_hand_explains_is_named(
    described: Plant, scale: float, number: int
) -> None:
    hand = GripRange().grips(described.handle)[number]
    text = named(described, scale * response(replace(described, handle=hand)))
    assert text.startswith("the force per mass is ")
    expected = scale * described.handle.m_h / hand.m_h
    # The bearing's force, which no hand changes, counts as the hand's.
    assert float(text.split()[5]) == pytest.approx(expected, rel=0.12)


@few
@given(scale=st.floats(0.78, 1.4))
@pytest.mark.parametrize("described", [IDEAL, PAPER])
def test_a_scale_that_a_hand_explains_has_no_name(described: Plant, scale: float) -> None:
    assert named(described, scale * response(described)) == ""


@few
@given(scale=st.sampled_from([0.5, 2.0]), more=st.floats(0.3e-3, 1.2e-3))
def test_a_scale_and_a_delay_are_named_together(scale: float, more: float) -> None:
    late = replace(PAPER, delay=PAPER.delay + more)
    mass, delay = named(PAPER, scale * response(late)).split(", the ")
    assert float(mass.split()[5]) == pytest.approx(scale, rel=0.1)
    assert float(delay.split()[2]) == pytest.approx(1e3 * more, abs=0.11)


@pytest.mark.parametrize("described", [IDEAL, PAPER])
def test_swapped_wires_are_named(described: Plant) -> None:
    assert "opposite direction" in named(described, -response(described))


@few
@given(more=st.floats(0.2e-3, 2.8e-3), number=st.integers(0, 8))
def test_more_delay_is_named(more: float, number: int) -> None:
    hand = GripRange().grips(PAPER.handle)[number]
    text = named(PAPER, response(replace(PAPER, handle=hand, delay=PAPER.delay + more)))
    assert text.endswith("later than described")
    assert float(text.split()[3]) == pytest.approx(1e3 * more, abs=0.11)


@pytest.mark.parametrize("more", [0.6e-3, 1.5e-3])
def test_no_delay_is_named_without_a_low_pass(more: float) -> None:
    # It shows in whole samples only.
    assert "later" not in named(IDEAL, response(replace(IDEAL, delay=more)))


def test_less_delay_has_no_name() -> None:
    slow = replace(PAPER, delay=500e-6)
    assert named(slow, response(replace(slow, delay=100e-6))) == ""


@few
@given(frequency=st.floats(70.0, 350.0), damping=st.floats(0.01, 0.15))
@pytest.mark.parametrize("described", [IDEAL, PAPER])
def test_a_mode_is_named_at_its_frequency(
    described: Plant, frequency: float, damping: float
) -> None:
    if described.mount.frequency and abs(frequency / described.mount.frequency - 1.0) < 0.2:
        return  # nearly as described
    text = named(
        described, response(replace(described, mount=MountParameters(frequency, damping)))
    )
    assert text.endswith("is not described")
    # Lines are 4 Hz apart, and a damped mode has its peak below its frequency.
    assert float(text.split()[3]) == pytest.approx(frequency, rel=0.1, abs=6.0)


def test_a_name_needs_time_and_ends_with_the_difference() -> None:
    assert named(IDEAL, 0.7 * response(IDEAL), seconds=RAISING / 2) == ""
    diagnosis = Diagnosis(IDEAL, RATE, LINES)
    density, coherence = np.full(len(LINES), 1e-2), np.ones(len(LINES))

    def judge(scale: float, seconds: float) -> str:
        ratio = np.full(len(LINES), scale, dtype=np.complex128)
        for _ in range(round(seconds / INTERVAL)):
            diagnosis.judge(ratio, coherence, density, INTERVAL, 8.0)
        return diagnosis.difference

    assert judge(0.7, 0.5)
    assert judge(1.0, FITTING / 2)
    assert judge(1.0, FITTING) == ""


@pytest.mark.parametrize("coherence", [0.0, 0.5])
def test_an_incoherent_response_has_no_name(coherence: float) -> None:
    assert named(IDEAL, 0.5 * response(IDEAL), coherence) == ""


def test_a_weak_force_shows_nothing() -> None:
    assert named(IDEAL, -response(IDEAL), seconds=20 * INTERVAL, level=1e-6) == ""


def test_a_grip_without_a_spring_can_be_judged() -> None:
    free = Plant(HandleParameters(k_u=0.0, b_u=0.0), coupling=0.0)
    assert named(free, response(free)) == ""


def test_a_tap_alone_shows_a_mode_but_no_scale() -> None:
    mode = replace(PAPER, mount=MountParameters(150.0, 0.05))
    assert named(PAPER, response(mode), evaluations=3.0).startswith("a mode near")
    assert named(PAPER, 0.7 * response(PAPER), evaluations=3.0) == ""
    assert named(PAPER, 0.7 * response(PAPER)).startswith("the force per mass")


@pytest.mark.parametrize("rig", ["ideal", "paper"])
def test_swapped_wires_are_named_though_the_force_is_reduced_at_once(rig: str) -> None:
    # What is left of the force after some blocks shows nothing: the landing has to do.
    setup = Setup.of(GraphArguments(rig=rig, controller="inverse", duration=1.5))
    swapped = {"master_device": {"simulated.drive.force_scale": -1.0}}
    trial = lockstep_trial(setup.changed(swapped))
    assert any("swap the wires of the coil" in words for _, words in trial.warnings)


@pytest.mark.parametrize(("frequency", "level"), [(58.0, 3.0), (82.0, 1.0)])
def test_dry_friction_under_a_line_is_no_difference(frequency: float, level: float) -> None:
    # Its third and fifth harmonics are coherent with what compensates it.
    time = np.arange(5000) / 1000.0
    line = (
        np.minimum(time / 0.2, 1.0) * level * math.sqrt(2.0) * np.sin(2 * np.pi * frequency * time)
    )
    setup = Setup.of(GraphArguments(rig="paper", controller="inverse", duration=5.0))
    assert lockstep_trial(setup, recording=line).warnings == ()
