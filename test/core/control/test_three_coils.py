# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of decoupling, alignment and reduction of three coils."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from band_noise import band_noise
from scipy.spatial.transform import Rotation

from haptic_accel.core.axes import LIVE_REDUCTIONS, NO_REDUCTION
from haptic_accel.core.control.channel import FADING, LISTENING
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.control.three_coils import Alignment, ReductionSwitch, full_decoupling
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import ComplexArray, FloatArray, Vector, vector
from haptic_accel.core.tick import Trace
from haptic_accel.core.tick.control import VectorConvolution

BAND = np.linspace(10.0, 450.0, 50)


def coupled_by(coupling: FloatArray, rate: float = 1000.0) -> MatrixPlant:
    return MatrixPlant((Plant(), Plant(), Plant()), coupling, rate)


def response(taps: FloatArray, rate: float) -> ComplexArray:
    return coupled_by(taps, rate).coupling_response(BAND)


def ringing(rate: float) -> FloatArray:
    """Return a coupling of -10 dB by modes from 90 to 240 Hz that ring for a tenth of a second."""
    time = np.arange(round(0.1 * rate)) / rate
    coupling = np.zeros((3, 3, len(time)))
    for index in range(9):
        to, of = divmod(index, 3)
        if to != of:
            turns = 2 * np.pi * (80.0 + 20.0 * index)
            pulse = np.exp(-0.15 * turns * time) * np.sin(turns * time + index)
            coupling[to, of] = (-1) ** index * 0.1 * turns / rate * pulse
    coupling[:, :, 0] += np.eye(3)
    return coupling


def test_a_coupling_with_a_known_inverse_gets_it() -> None:
    # (I + N z^-1)^-1 = I - N z^-1 + N^2 z^-2, as N^3 = 0.
    nilpotent = np.array([[0.0, 0.4, -0.2], [0.0, 0.0, 0.3], [0.0, 0.0, 0.0]])
    inverse = np.stack([np.eye(3), -nilpotent, nilpotent @ nilpotent], axis=2)
    found = full_decoupling(coupled_by(np.stack([np.eye(3), nilpotent], axis=2)))
    assert response(found, 1000.0) == pytest.approx(response(inverse, 1000.0), abs=3e-3)


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_a_coupling_that_rings_is_undone_on_both_sides(rate: float) -> None:
    coupling = ringing(rate)
    found = full_decoupling(coupled_by(coupling, rate))
    coupled, decoupled = response(coupling, rate), response(found, rate)
    unity = np.broadcast_to(np.eye(3), coupled.shape)
    assert np.abs(coupled - unity).max() > 0.2
    assert coupled @ decoupled == pytest.approx(unity, abs=5e-3)
    assert decoupled @ coupled == pytest.approx(unity, abs=5e-3)


def test_a_coupling_without_dynamics_is_inverted_exactly() -> None:
    directions = np.array([[1.0, 0.2, 0.0], [-0.1, 1.0, 0.3], [0.0, 0.1, 1.0]])
    plant = coupled_by(directions[:, :, np.newaxis])
    found = full_decoupling(plant)
    assert found.shape == (3, 3, 1)
    assert found[:, :, 0] @ directions == pytest.approx(np.eye(3))


def test_no_coupling_changes_no_bit() -> None:
    found = full_decoupling(MatrixPlant.uncoupled(Plant(), 1000.0))
    assert np.array_equal(found, np.eye(3)[:, :, np.newaxis])


def filtered(stream: VectorConvolution, value: Vector) -> Vector:
    stream.process(*value)
    return stream.x, stream.y, stream.z


def test_a_sample_is_filtered_as_the_whole_signal() -> None:
    random = np.random.default_rng(0)
    taps, values = random.normal(size=(3, 3, 7)), random.normal(size=(40, 3))
    whole = sum(
        np.stack([np.convolve(values[:, of], taps[to, of])[:40] for to in range(3)], axis=1)
        for of in range(3)
    )
    stream = VectorConvolution(taps)
    assert [filtered(stream, vector(each)) for each in values] == pytest.approx(whole)


def test_a_constant_past_is_no_step() -> None:
    taps = np.random.default_rng(0).normal(size=(3, 3, 7))
    stream = VectorConvolution(taps)
    stream.fill(0.0, 1.0, 9.8)
    assert filtered(stream, (0.0, 1.0, 9.8)) == pytest.approx(taps.sum(axis=2) @ (0.0, 1.0, 9.8))


RATE = 1000.0
NOISE = 0.2
"""What no force causes, m/s^2 RMS: three times the noise of the paper's accelerometer."""


def textures(seconds: float = 2.0) -> FloatArray:
    """Return three independent textures, 1.5 m/s^2 RMS each."""
    return band_noise(30.0, 250.0, seconds, 1.5, axes=(3,))


class Coils:
    """Alignment of three coils whose expected acceleration is the force of the sample before."""

    def __init__(self) -> None:
        self._coils = [ResponseSupervisor(Plant(), RATE, Trace()) for _ in range(3)]
        for coil in self._coils:
            coil.taps = np.array([1.0])
        self.alignment, self.trace = Alignment(RATE, self._coils), self._coils[0].trace

    def run(self, expected: FloatArray, measured: FloatArray) -> Iterator[str]:
        """Yield the warning after each sample."""
        for sample in zip(measured.tolist(), np.roll(expected, -1, axis=0).tolist(), strict=True):
            for coil, known, force in zip(self._coils, *sample, strict=True):
                coil.trace.push(0.0, known, force, 0.0)
            self.alignment.update()
            yield self.alignment.warning


def judged(expected: FloatArray, measured: FloatArray) -> list[str]:
    """Return the warning after each sample."""
    noise = np.random.default_rng(2).normal(0.0, NOISE, measured.shape)
    return list(Coils().run(expected, measured + noise + 9.8))


def turned(degrees: float, axis: tuple[float, float, float]) -> FloatArray:
    about = np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)
    return np.asarray(Rotation.from_rotvec(about).as_matrix())


@pytest.mark.parametrize(
    ("axis", "name"),
    [((1, 0, 0), "x"), ((0, 1, 0), "y"), ((0, 0, -1), "z"), ((0.5, 0.0, 1.0), "z")],
)
@pytest.mark.parametrize("degrees", [10.0, 45.0])
def test_a_turned_sensor_is_named_within_a_second(
    axis: tuple[float, float, float], name: str, degrees: float
) -> None:
    expected = textures()
    warnings = judged(expected, expected @ turned(degrees, axis).T)
    assert warnings[1000].endswith(f"degrees, mostly about {name}: run calibrate")
    angle = float(warnings[1000].split("rotated by ")[1].split()[0])
    assert angle == pytest.approx(degrees, abs=3.0)


MOVED = textures()
ALONG = MOVED[:, :1] * (1.0, 0.8, -0.5)
TAP = MOVED * np.where(np.arange(len(MOVED)) < 60, 1.0, 1e-3)[:, np.newaxis]
"""Directions that are equal by chance, as of a friction that a tap overcomes."""

LOST = np.where(np.arange(len(MOVED)) % 50 == 0, np.nan, 1.0)[:, np.newaxis]
ABOUT_X = turned(45.0, (1, 0, 0)).T
LATER = range(0, 1800, 300)
NO_FAULTS = {
    **{f"gains {each}": (MOVED, MOVED * each) for each in ((1, 1, 1), (0.6, 1.5, 1), (-1, 1, 1))},
    **{f"along, {each}": (ALONG, ALONG * each) for each in ((1, 1, 1), (0.6, 1.5, 1), (-1, 1, 1))},
    "small angle": (MOVED, MOVED @ turned(4.0, (1, 1, 1)).T),
    "little motion": (MOVED / 20.0, MOVED / 20.0 @ ABOUT_X),
    "missing samples": (MOVED, MOVED * LOST),
    "single tap": (TAP, TAP @ ABOUT_X),
    # Other coils explain a part of it by chance, the more the shorter it is.
    **{
        f"noise as loud, from {begin}": (
            0.2 * np.roll(MOVED, begin, axis=0),
            0.2 * (np.roll(MOVED, begin, axis=0) + np.roll(MOVED, begin + 900, axis=0)),
        )
        for begin in LATER
    },
}


@pytest.mark.parametrize("kind", NO_FAULTS)
def test_what_is_no_turned_sensor_is_not_told(kind: str) -> None:
    assert set(judged(*NO_FAULTS[kind])) == {""}


def test_a_bent_coil_is_told() -> None:
    expected = textures()
    bent = np.eye(3)
    bent[2, 1] = bent[1, 2] = 0.4
    assert judged(expected, expected @ bent.T)[1000] == (
        "axes do not match the identification: run identify"
    )


def test_a_fault_that_is_mended_is_no_longer_told() -> None:
    expected = textures(6.0)
    measured = expected.copy()
    measured[:1500] = measured[:1500] @ turned(10.0, (1, 0, 0)).T
    warnings = judged(expected, measured)
    assert warnings[1500]
    assert not warnings[-1]


def test_motion_while_a_limit_acts_is_not_judged() -> None:
    coils = Coils()
    for index, warning in enumerate(coils.run(MOVED, MOVED @ ABOUT_X)):
        if (index + 1) % 50 == 0 and index < 1000:
            coils.trace.limited = index + 1
        assert not warning or index > 1100
    assert warning


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
