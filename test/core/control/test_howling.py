# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sensors that are connected to the wrong body: the force ends, and its cause is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.control.controllers import OWN_CONTROLLERS
from haptic_accel.core.control.howling import HEARS
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import MASTER, SLAVE
from nightly import rest_slow
from sensed_rigs import Mixture, Result, run_sensed

RATE, SECONDS = 1000.0, 2.0
CONTACT = 0.8, 1.4
"""Begin and end of the tool's contact, s."""

SILENCE = 0.05
"""Time after the contact from which on there is to be no force, s."""

LEAST = 0.15
"""Force that counts as none, N: 5 % of the limit of the arm's motors."""

Gains = tuple[tuple[float, float], tuple[float, float]]
"""What is measured at the handle and at the tool per acceleration of handle and tool."""

COMPENSATING = [name for name in OWN_CONTROLLERS if name != "none"]

WRONG: dict[str, Gains] = {
    "on the handle": ((1.0, 0.0), (1.0, 0.0)),
    "on the handle, twice the gain": ((1.0, 0.0), (2.0, 0.0)),
    "on the handle, wrong sign": ((1.0, 0.0), (-1.0, 0.0)),
    "swapped": ((0.0, 1.0), (1.0, 0.0)),
    "hears all of the handle": ((1.0, 0.0), (1.0, 1.0)),
    "hears half of the handle": ((1.0, 0.0), (0.5, 0.5)),
    "hears 0.9 of the handle": ((1.0, 0.0), (0.9, 0.1)),
}

RIGHT: Gains = ((1.0, 0.0), (0.0, 1.0))


def touched(seed: int = 0) -> FloatArray:
    """Return the tool's acceleration in contact, beside the sensor's noise."""
    random = np.random.default_rng(seed)
    time = np.arange(round(RATE * SECONDS)) / RATE
    band = signal.butter(2, [40.0, 250.0], "band", fs=RATE, output="sos")
    texture = signal.sosfilt(band, random.standard_normal(len(time)))
    inside = (time >= CONTACT[0]) & (time < CONTACT[1])
    found = 2.0 * texture / texture.std() * inside + 0.05 * random.standard_normal(len(time))
    return np.asarray(found)


def run(controller: str, rig: str, gains: Gains, tool: FloatArray) -> Result:
    sensors = {arm: Mixture(row) for arm, row in zip((MASTER, SLAVE), gains, strict=True)}
    return run_sensed(controller, rig, sensors, tool)


@pytest.mark.parametrize("rig", rest_slow(["paper", "ideal"]))
@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("controller", COMPENSATING)
def test_the_force_is_gone_soon_after_the_tool_is_silent(
    controller: str, kind: str, rig: str
) -> None:
    force, failure, _ = run(controller, rig, WRONG[kind], touched())
    assert np.abs(force[round((CONTACT[1] + SILENCE) * RATE) :]).max() < LEAST
    assert failure in ("", HEARS)


@pytest.mark.parametrize("kind", ["on the handle", "swapped", "hears all of the handle"])
@pytest.mark.parametrize("controller", COMPENSATING)
def test_a_force_that_sustains_itself_is_named_before_any_contact(
    controller: str, kind: str
) -> None:
    tool = touched()[: round(CONTACT[0] * RATE)]
    force, failure, _ = run(controller, "paper", WRONG[kind], tool)
    assert failure == HEARS
    assert not force[-200:].any()


@pytest.mark.parametrize("frequency", [20.0, 57.0, 80.0, 173.0, 350.0])
@pytest.mark.parametrize("controller", ["constant", "dynamic", "inverse"])
@pytest.mark.parametrize("rig", rest_slow(["paper", "ideal"]))
def test_a_shaker_is_not_taken_for_the_handle(controller: str, frequency: float, rig: str) -> None:
    time = np.arange(round(RATE * SECONDS)) / RATE
    tool = 2.0 * np.sin(2.0 * np.pi * frequency * time)
    assert not run(controller, rig, RIGHT, tool).failure


@pytest.mark.parametrize("rig", ["paper", "ideal"])
@pytest.mark.parametrize("controller", COMPENSATING)
def test_a_texture_is_felt_without_a_break(controller: str, rig: str) -> None:
    force, failure, part = run(controller, rig, RIGHT, touched())
    assert not failure
    contact = force[round((CONTACT[0] + 0.1) * RATE) : round(CONTACT[1] * RATE)]
    assert np.convolve(np.abs(contact), np.ones(10), "valid").min() > 0.0
    assert not any(each.suspects for each in part.slow.howling)


@pytest.mark.parametrize("controller", ["inverse", "adaptive"])
@pytest.mark.parametrize("frequency", [60.0, 120.0, 200.0])
def test_a_landing_that_a_deaf_handle_does_not_answer_is_no_sustained_vibration(
    controller: str, frequency: float
) -> None:
    # It lasts as long as the force is faded out, and ends by itself.
    time = np.arange(round(RATE * SECONDS)) / RATE - CONTACT[0]
    ring = np.sin(2.0 * np.pi * frequency * time) * np.minimum(1.0, np.exp((0.04 - time) / 5e-3))
    tool = 8.0 * ring * (time > 0.0) + 0.05 * np.random.default_rng(1).standard_normal(len(time))
    assert not run(controller, "ideal", ((0.05, 0.0), (0.0, 1.0)), tool).failure


def test_selecting_a_controller_tries_it_again() -> None:
    _, failure, part = run("constant", "paper", WRONG["on the handle"], touched())
    assert failure == HEARS
    part.slow.select("constant")
    assert not part.slow.failure
    assert part.slow.controller == "constant"
