# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the compensation for three coils."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from band_noise import band_noise
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import NAMES as AXES
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.control.filters import high_passed, without_hand_motion
from haptic_accel.core.handle.mechanics import grid_for
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import (
    ZERO,
    FloatArray,
    HandleParameters,
    MountParameters,
    Vector,
    vector,
)
from haptic_accel.core.parameters import Checked
from nightly import rest_slow
from one_coil import OneCoil

# Compiled objects cannot be copied.
pytestmark = pytest.mark.plain

RATE = 1000.0
LATENCY = 1
GRANTED = 1
CORNER = CompensationParameters().high_pass_frequency
NAMES = tuple(CONTROLLERS)
WITH_FORCE = tuple(name for name in NAMES if name != "none")
REST = (0.0, 1.5, 9.7)
"""Gravity in a turned frame, m/s^2."""

COIL = ActuatorParameters()
WIDE = ActuatorParameters(travel=0.1, continuous_force=100.0, peak_force=100.0)
"""Limits that no texture reaches."""


def an_axis(m_h: float, k_u: float, mount: float = 0.0) -> Plant:
    handle = HandleParameters(m_h=m_h, k_u=k_u)
    return Plant(handle=handle, mount=MountParameters(frequency=mount))


UNEQUAL = (an_axis(0.128, 1500.0), an_axis(0.15, 2500.0, 260.0), an_axis(0.11, 1000.0))


def ringing() -> FloatArray:
    """Return a coupling of about -10 dB: tilted coils, and modes from 90 to 240 Hz."""
    time = np.arange(128) / RATE
    coupling = np.zeros((3, 3, len(time)))
    for index in range(9):
        to, of = divmod(index, 3)
        if to != of:
            turns = 2 * np.pi * (80.0 + 20.0 * index)
            pulse = np.exp(-0.15 * turns * time) * np.sin(turns * time) * turns / RATE
            pulse[0] += 1.1
            coupling[to, of] = (-1) ** index * 0.12 * pulse
    coupling[:, :, 0] += np.eye(3)
    return coupling


COUPLED = MatrixPlant(UNEQUAL, ringing(), RATE)
UNCOUPLED = MatrixPlant(UNEQUAL, np.eye(3)[:, :, np.newaxis], RATE)


def textures(seconds: float, seed: int = 1) -> FloatArray:
    """Return three independent textures, 1.5 m/s^2 RMS each, without gravity."""
    return band_noise(30.0, 250.0, seconds, 1.5, seed=seed, axes=(3,))


class Handle:
    """Handle that moves as a plant says, with the accelerometer's noise and turned axes."""

    def __init__(self, plant: MatrixPlant, turned: FloatArray | None = None) -> None:
        length = 500
        grid = grid_for(RATE, length)
        response = plant.coupled().delayed(LATENCY).response(grid.frequency, RATE)
        pulses = [
            [grid.sequence(response[:, to, of])[:length] for of in range(3)] for to in range(3)
        ]
        seen = np.einsum("ab,bcn->anc", np.eye(3) if turned is None else turned, pulses)
        self._taps = seen.reshape(3, -1)
        self._past = np.zeros((length, 3))
        self._random = np.random.default_rng(3)

    def moved(self, force: Vector) -> FloatArray:
        self._past = np.roll(self._past, 1, axis=0)
        self._past[0] = force
        noise: FloatArray = self._random.normal(0.0, 0.07, 3)
        return np.asarray(self._taps @ self._past.ravel() + noise)


@lru_cache
def built(
    controller: str, plant: MatrixPlant, actuator: ActuatorParameters, changed: str = ""
) -> Compensation:
    """Design once; `changed` is a parameter with another value, as in ``name=value``."""
    own = dict([changed.split("=")]) if changed else {}
    parameters = CompensationParameters(controller, **own)  # type: ignore[arg-type]
    options: dict[str, Checked] = {"actuator": actuator}
    return Compensation(parameters, RATE, options, latency=LATENCY, plant=plant)


def compensation(
    controller: str,
    plant: MatrixPlant = COUPLED,
    actuator: ActuatorParameters = COIL,
    changed: str = "",
) -> Compensation:
    return copy.deepcopy(built(controller, plant, actuator, changed))


def driven(stream: Compensation, handle: Handle, tool: FloatArray) -> tuple[FloatArray, list[str]]:
    """Return the handle's acceleration, and the warning after each sample."""
    before: Vector | None = None
    felt, warnings = [], []
    for each in tool + REST:
        _, force = stream.process(vector(each), before)
        stream.adapt()
        felt.append(handle.moved(force))
        before = vector(felt[-1] + REST)
        warnings.append(stream.diagnostics()[0])
    return np.array(felt), warnings


def answered(stream: Compensation, tool: FloatArray, handle: FloatArray) -> FloatArray:
    """Return the forces for what tool and handle measure, whatever the forces do."""
    forces = []
    for each, felt in zip(tool + REST, handle + REST, strict=True):
        forces.append(stream.process(vector(each), vector(felt))[1])
        stream.adapt()
    return np.array(forces)


def error(tool: FloatArray, felt: FloatArray) -> float:
    """Return the error of the vector after latency and granted delay, %, of the last seconds."""
    late = LATENCY + GRANTED
    desired = np.stack([high_passed(each, CORNER, RATE) for each in tool.T])[:, :-late]
    moved = np.stack([without_hand_motion(each, CORNER, RATE) for each in felt.T])[:, late:]
    inner = slice(1000, -300)
    missed = np.sum((moved - desired)[:, inner] ** 2)
    return float(100.0 * np.sqrt(missed / np.sum(desired[:, inner] ** 2)))


# What it computes


@pytest.mark.parametrize("controller", NAMES)
def test_without_coupling_each_axis_is_that_of_a_single_coil(controller: str) -> None:
    stream = compensation(controller, UNCOUPLED, WIDE)
    around = CompensationParameters(controller)
    singles = [
        OneCoil(around, RATE, {"actuator": WIDE, "plant": own}, latency=LATENCY) for own in UNEQUAL
    ]
    tool = textures(1.0)
    handle = 0.9 * np.roll(tool, 2, axis=0) + REST
    tool += REST
    changes = {300: ("set_gain", 0.5), 500: ("mute", True), 600: ("mute", False), 800: ("reset",)}
    for index in range(len(tool)):
        if index in changes:
            name, *values = changes[index]
            for each in (stream, *singles):
                getattr(each, name)(*values)
        # Forces are reduced together, by what the handle measures in all axes.
        unseen = index % 50 == 7 or CONTROLLERS[controller].reducible
        felt = None if unseen else vector(handle[index])
        desired, force = stream.process(vector(tool[index]), felt)
        alone = [
            single.sample(float(tool[index, axis]), None if felt is None else felt[axis])
            for axis, single in enumerate(singles)
        ]
        assert list(zip(desired, force, strict=True)) == alone
        stream.adapt()
        for single in singles:
            single.adapt()


@pytest.mark.parametrize("controller", ["dynamic", "inverse", "adaptive"])
def test_other_names_of_the_axes_change_nothing(controller: str) -> None:
    order = [2, 0, 1]
    x, y, z = (UNEQUAL[axis] for axis in order)
    renamed = MatrixPlant((x, y, z), COUPLED.coupling[np.ix_(order, order)], RATE)
    one, other = compensation(controller), compensation(controller, renamed)
    tool, handle = textures(0.5), textures(0.5, seed=2)
    for acceleration, felt in zip(tool, handle, strict=True):
        desired, force = one.process(vector(acceleration), vector(felt))
        as_other = other.process(vector(acceleration[order]), vector(felt[order]))
        assert as_other[0] == pytest.approx([desired[axis] for axis in order])
        assert as_other[1] == pytest.approx([force[axis] for axis in order], abs=1e-6)
        one.adapt()
        other.adapt()


def test_the_full_inverse_of_the_coupling_moves_the_handle_as_the_tool() -> None:
    tool = textures(4.0)
    decoupled, ignored = (
        error(tool, driven(compensation("inverse", plant), Handle(COUPLED), tool)[0])
        for plant in (COUPLED, UNCOUPLED)
    )
    assert decoupled < 6.0  # 0.07 m/s^2 of noise is 5 %
    assert ignored > 30.0


@pytest.mark.parametrize("controller", rest_slow(["adaptive", "feedback"]))
def test_others_that_invert_the_plant_do_so_too(controller: str) -> None:
    tool = textures(4.0)
    felt, warnings = driven(compensation(controller), Handle(COUPLED), tool)
    assert error(tool, felt) < 6.0
    assert set(warnings) == {""}


@pytest.mark.parametrize("controller", WITH_FORCE)
def test_a_change_of_the_controller_is_no_jump(controller: str) -> None:
    tool, handle = textures(2.0), Handle(COUPLED)
    stream = compensation("constant")
    stream.select("none")
    forces: list[Vector] = []
    before: Vector | None = None
    for index, each in enumerate(tool + REST):
        if index == 500:
            stream.select(controller)
        forces.append(stream.process(vector(each), before)[1])
        stream.adapt()
        before = vector(handle.moved(forces[-1]) + REST)
    assert stream.controller == controller
    steps = np.linalg.norm(np.diff(forces, axis=0), axis=1)
    assert steps[900:1100].max() < 1.5 * steps[1200:].max()
    assert not np.any(forces[:900])


# One coil alone


@pytest.mark.parametrize("controller", NAMES)
def test_with_a_reduction_the_coil_along_z_is_that_of_a_single_coil(controller: str) -> None:
    stream = compensation(controller, UNCOUPLED, WIDE, "reduction=sum")
    options: dict[str, Checked] = {"actuator": WIDE, "plant": UNEQUAL[2]}
    around = CompensationParameters(controller, reduction="sum")
    single = Compensation(around, RATE, options, latency=LATENCY)
    tool, felt = textures(1.0), 0.9 * textures(1.0, seed=2)
    for each, moved in zip(tool + REST, felt + REST, strict=True):
        # Forces are reduced by what the handle measures, with other rounding.
        handle = None if CONTROLLERS[controller].reducible else vector(moved)
        _, force = stream.process(vector(each), handle)
        _, alone = single.process(vector(each), handle)
        assert force == alone
        stream.adapt()
        single.adapt()


@pytest.mark.parametrize("controller", rest_slow(["inverse", "adaptive", "feedback"], now=2))
def test_with_a_reduction_the_handle_follows_it_along_z(controller: str) -> None:
    tool = textures(4.0)
    stream = compensation(controller, changed="reduction=sum")
    felt, warnings = driven(stream, Handle(COUPLED), tool)
    assert error(tool.sum(axis=1)[:, np.newaxis], felt[:, 2:]) < 6.0
    assert set(warnings) == {""}


@pytest.mark.parametrize("controller", WITH_FORCE)
def test_a_change_of_the_reduction_is_no_jump(controller: str) -> None:
    tool, handle = textures(4.0), Handle(COUPLED)
    stream = compensation(controller, changed="reduction=axis")
    forces: list[Vector] = []
    before: Vector | None = None
    for index, each in enumerate(tool + REST):
        if index in (1000, 2500):
            stream.select_reduction({1000: "none", 2500: "sum"}[index])
        desired, force = stream.process(vector(each), before)
        forces.append(force)
        stream.adapt()
        assert min(map(abs, desired)) > 0.0 or index == 0
        before = vector(handle.moved(force) + REST)
    found = np.array(forces)
    assert not found[:1500, :2].any()
    assert found[1600:3000, :2].std(axis=0).min() > 0.1
    assert not found[3100:, :2].any()
    steps = np.abs(np.diff(found, axis=0)).max(axis=1)
    for changed in (slice(1490, 1600), slice(2990, 3100)):
        assert steps[changed].max() < 1.5 * steps[1700:2900].max()
    assert stream.diagnostics()[0] == ""


def test_a_change_of_the_reduction_at_rest_is_immediate() -> None:
    changed, begun = compensation("inverse"), compensation("inverse", changed="reduction=sum")
    for _ in range(3):
        changed.process(REST, REST)
        begun.process(REST, REST)
    changed.select_reduction("sum")
    for tool in textures(0.2) + REST:
        assert changed.process(vector(tool), REST) == begun.process(vector(tool), REST)


# Faults


@pytest.mark.parametrize(
    ("controller", "axis"),
    [*((name, (1.0, 0.0, 0.0)) for name in WITH_FORCE), ("inverse", (0.0, 0.6, 0.8))],
)
def test_a_sensor_turned_by_ten_degrees_is_told_and_does_no_harm(
    controller: str, axis: Sequence[float]
) -> None:
    turned = Rotation.from_rotvec(np.radians(10.0) * np.array(axis)).as_matrix()
    tool = textures(3.0)
    felt, warnings = driven(compensation(controller), Handle(COUPLED, turned), tool)
    assert "the handle's accelerometer is rotated by" in warnings[1000]
    assert error(tool, felt) < 100.0  # without force


@pytest.mark.parametrize("controller", WITH_FORCE)
def test_other_hands_are_not_taken_for_a_turned_sensor(controller: str) -> None:
    hands = tuple(
        replace(own, handle=replace(own.handle, m_h=own.handle.m_h * m, k_u=own.handle.k_u * k))
        for own, m, k in zip(UNEQUAL, (0.8, 1.2, 1.0), (2.0, 0.6, 1.5), strict=True)
    )
    held = replace(COUPLED, axes=(hands[0], hands[1], hands[2]))
    _, warnings = driven(compensation(controller), Handle(held), textures(2.0))
    assert not any("turned" in each or "axes" in each for each in warnings)


@pytest.mark.parametrize("controller", rest_slow(["inverse", "adaptive", "feedback"], now=2))
def test_a_sensor_that_shows_nothing_right_costs_next_to_nothing(controller: str) -> None:
    turned = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    tool = textures(4.0)
    felt, _ = driven(compensation(controller), Handle(COUPLED, turned), tool)
    assert error(tool, felt) < 102.0


def test_a_warning_names_its_axis() -> None:
    heavy = replace(UNEQUAL[1], handle=replace(UNEQUAL[1].handle, m_h=0.5))
    held = replace(COUPLED, axes=(UNEQUAL[0], heavy, UNEQUAL[2]))
    _, warnings = driven(compensation("inverse"), Handle(held), textures(2.0))
    assert warnings[-1].startswith("y: ")
    assert "x: " not in warnings[-1]


# The coils' limits


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(*[st.floats(-300.0, 300.0)] * 3), min_size=2, max_size=40))
def test_a_force_beyond_the_peak_of_a_coil_keeps_its_direction(tools: list[Vector]) -> None:
    peak = replace(WIDE, peak_force=6.6)
    limited, free = (compensation("dynamic", actuator=each) for each in (peak, WIDE))
    for tool in tools:
        force = np.array(limited.process(tool, ZERO)[1])
        wanted = np.array(free.process(tool, ZERO)[1])
        if np.abs(wanted).max() >= WIDE.peak_force:
            return
        share = min(1.0, 6.6 / max(np.abs(wanted).max(), 1e-9))
        assert np.abs(force).max() <= 6.6
        assert force == pytest.approx(share * wanted)


def test_a_warm_coil_scales_the_force_of_all() -> None:
    warm = replace(WIDE, continuous_force=0.5, thermal_time=0.5)
    limited, free = (compensation("constant", actuator=each) for each in (warm, WIDE))
    shares = []
    for tool in 10.0 * textures(3.0) * (1.0, 0.1, 0.3):
        wanted = np.array(free.process(vector(tool), ZERO)[1])
        force = np.array(limited.process(vector(tool), ZERO)[1])
        assert np.cross(force, wanted) == pytest.approx(np.zeros(3), abs=1e-9)
        shares.append(np.linalg.norm(force) / max(np.linalg.norm(wanted), 1e-9))
    assert min(shares[2000:]) < 0.5
    assert int(limited.diagnostics()[1]["x limited by heat"]) > 0
    assert int(limited.diagnostics()[1]["y limited by heat"]) == 0


def test_a_coil_is_braked_before_its_stop() -> None:
    short = replace(COIL, travel=0.5e-3)
    stream = compensation("inverse", actuator=short)
    for tool in 8.0 * textures(1.0):
        assert np.abs(stream.process(vector(tool), ZERO)[1]).max() <= COIL.peak_force
        values = stream.diagnostics()[1]
        assert max(abs(float(values[f"{name} travel (mm)"])) for name in AXES) <= 0.5
    assert int(values["z limited by travel"]) > 0


# Samples that are none


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1e9])
@pytest.mark.parametrize("axis", range(3))
def test_of_a_tool_sample_with_a_bad_component_nothing_is_felt(bad: float, axis: int) -> None:
    stream, clean = compensation("inverse"), compensation("inverse")
    for index, tool in enumerate(textures(0.2)):
        handle = (0.0, 0.0, 0.01 * (index % 2))
        expected = clean.process(ZERO if index % 20 == 5 else vector(tool), handle)
        if index % 20 == 5:
            tool[axis] = bad
        assert stream.process(vector(tool), handle) == expected
    assert (stream.rejected, stream.untrusted) == (10, 0)


@pytest.mark.parametrize("controller", NAMES)
@pytest.mark.parametrize("axis", rest_slow(range(3)))
def test_of_a_handle_sample_with_a_bad_component_nothing_is_believed(
    controller: str, axis: int
) -> None:
    outputs = []
    for bad in (None, 60.0, math.nan):
        stream = compensation(controller)
        felt: Vector | None = None
        if bad is not None:
            components = np.array([1.0, 2.0, 3.0])
            components[axis] = bad
            felt = vector(components)
        outputs.append([stream.process(vector(each), felt) for each in textures(0.2)])
        assert stream.untrusted + stream.rejected == 199  # the first one is no motion
    assert outputs[0] == outputs[1] == outputs[2]


@pytest.mark.parametrize("controller", NAMES)
def test_whatever_comes_in_the_force_is_finite_and_limited(controller: str) -> None:
    random = np.random.default_rng(7)
    stream = compensation(controller)
    tools, handles = 10.0 * random.standard_cauchy((2, 5000, 3))
    tools[random.random(5000) < 0.01, 1] = math.nan
    handles[random.random(5000) < 0.01, 2] = math.inf
    for index, (tool, handle) in enumerate(zip(tools, handles, strict=True)):
        if random.random() < 1 / 300:
            stream.select(NAMES[random.integers(len(NAMES))])
        desired, force = stream.process(vector(tool), None if index % 99 < 5 else vector(handle))
        stream.adapt()
        assert all(map(math.isfinite, desired))
        assert max(map(abs, force)) <= COIL.peak_force
    assert not any("nan" in each or "inf" in each for each in stream.diagnostics()[1].values())


def test_the_error_of_a_weak_axis_costs_no_force_of_the_strong_ones() -> None:
    stream = compensation("inverse", UNCOUPLED, WIDE)
    tool = textures(3.0) * np.array([1.0, 0.05, 1.0])
    handle = np.roll(tool, LATENCY + GRANTED + 1, axis=0)
    handle[:, 1] = -2.0 * handle[:, 1]  # three times the error of no force along y
    answered(stream, tool, handle)
    assert "force is reduced" not in stream.diagnostics()[0]


def test_a_vector_that_is_worse_than_no_force_costs_all_coils_theirs() -> None:
    stream = compensation("inverse", UNCOUPLED, WIDE)
    tool = textures(3.0)
    forces = answered(stream, tool, -np.roll(tool, LATENCY + GRANTED + 1, axis=0))
    said = "inverse is worse than no compensation: its force is reduced"
    assert said in stream.diagnostics()[0]
    early, late = (np.std(forces[part], axis=0) for part in (slice(0, 100), slice(-500, None)))
    assert (late < 0.1 * early).all()
