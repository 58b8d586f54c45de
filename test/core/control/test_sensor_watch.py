# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Broken accelerometers: they are named within a second, and no controller learns from them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from haptic_accel.core.control.controllers import OWN_CONTROLLERS
from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.core.tick import MASTER, SLAVE
from sensed_rigs import Sensor, run_sensed

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
