# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of a broken accelerometer, and of a tool's sensor that picks up the handle."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.control.controllers import OWN_CONTROLLERS
from haptic_accel.core.control.sensor_faults import HEARS
from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.core.tick import MASTER, SLAVE
from nightly import rest_slow
from sensed_rigs import Mixture, Result, Sensor, run_sensed

BODIES = {MASTER: "handle", SLAVE: "tool"}

Fault = Callable[[float, float], float]
"""What is measured instead of an acceleration, m/s^2, by a number between 0 and 1."""

UNUSABLE: dict[str, Fault] = {
    "no number": lambda z, chance: math.nan if chance < 0.15 else z,
    "infinite": lambda z, chance: -math.inf if chance < 0.15 else z,
}


def texture(seconds: float = 1.1) -> FloatArray:
    found = np.random.default_rng(4).standard_normal(round(1000.0 * seconds))
    return np.asarray(2.0 * np.convolve(found, np.ones(4) / 2.0, "same"))


def broken(arm: str, fault: Fault) -> dict[str, Sensor]:
    random = np.random.default_rng(3)

    def measured(handle: Vector, tool: Vector) -> Vector:
        x, y, z = handle if arm == MASTER else tool
        return x, y, fault(z, random.random())

    return {arm: measured}


@pytest.mark.parametrize("arm", BODIES)
@pytest.mark.parametrize("kind", UNUSABLE)
def test_samples_that_are_no_numbers_are_told(arm: str, kind: str) -> None:
    part = run_sensed("inverse", "paper", broken(arm, UNUSABLE[kind]), texture()).part
    text = f"% of the {BODIES[arm]}'s samples are missing, saturated or not numbers"
    assert text in part.slow.warning


@pytest.mark.parametrize("controller", OWN_CONTROLLERS)
def test_spikes_of_the_tool_are_told(controller: str) -> None:
    sensors = broken(SLAVE, lambda z, chance: z + 100.0 * (chance < 0.02))
    assert (
        "% of the tool's samples are spikes"
        in run_sensed(controller, "paper", sensors, texture()).part.slow.warning
    )


@pytest.mark.parametrize("rig", ["paper", "ideal", "three_axis"])
@pytest.mark.parametrize("controller", ["inverse", "adaptive", "feedback"])
def test_a_handle_that_seems_not_to_move_is_told_and_not_pushed_harder(
    controller: str, rig: str
) -> None:
    whole = run_sensed(controller, rig, {}, texture())
    stuck = run_sensed(controller, rig, {MASTER: lambda handle, tool: (0.1, 0.2, 9.8)}, texture())
    assert "the handle's accelerometer does not change" in stuck.part.slow.warning
    assert not whole.part.slow.warning
    # As without its measurements: the inverse of the handle as described.
    assert np.std(stuck.force) < 1.2 * np.std(whole.force)


def test_the_warning_ends_with_the_fault() -> None:
    samples = itertools.count()
    sensors = broken(SLAVE, lambda z, chance: math.nan if next(samples) < 600 else z)
    assert not run_sensed("inverse", "paper", sensors, texture(1.6)).part.slow.warning


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
