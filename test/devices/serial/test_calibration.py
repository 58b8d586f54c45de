# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Gain, offset and mounting from gravity."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from haptic_accel.core.model import GRAVITY, FloatArray
from haptic_accel.devices.serial.calibration import (
    POSES,
    CalibrationError,
    Rest,
    calibrate,
    calibrate_axes,
    rest,
)

NOMINAL = 49.0 / 32767


@given(st.floats(0.8, 1.2), st.sampled_from([-1, 1]), st.floats(-3000, 3000))
def test_a_flip_finds_gain_and_offset(factor: float, sign: int, offset: float) -> None:
    gain = sign * factor * NOMINAL
    up, down = (Rest(offset + g / gain, 0.3, 40.0) for g in (GRAVITY, -GRAVITY))
    found = calibrate(up, down, NOMINAL)
    assert found.gain == pytest.approx(gain)
    assert found.offset == pytest.approx(offset, abs=1e-6)


def test_standard_errors_are_those_of_repeated_measurements() -> None:
    rng = np.random.default_rng(1)
    noise = 46.0  # counts of an ADXL320J

    def measured() -> tuple[float, float, float, float]:
        up, down = (rest(rng.normal(level, noise, 1000), NOMINAL) for level in (6600.0, -6500.0))
        found = calibrate(up, down, NOMINAL)
        return found.gain, found.gain_error, found.offset, found.offset_error

    gains, gain_errors, offsets, offset_errors = np.array([measured() for _ in range(400)]).T
    assert gain_errors.mean() == pytest.approx(gains.std(), rel=0.1)
    assert offset_errors.mean() == pytest.approx(offsets.std(), rel=0.1)


def test_the_noise_is_that_of_a_sample() -> None:
    rng = np.random.default_rng(1)
    up, down = (rest(rng.normal(level, 50.0, 4000), NOMINAL) for level in (6558.0, -6558.0))
    assert calibrate(up, down, NOMINAL).noise == pytest.approx(50 * NOMINAL, rel=0.05)


@pytest.mark.parametrize(
    ("counts", "named"),
    [
        (1000 * np.sin(np.arange(1000.0)), "the sensor moved"),
        (np.linspace(0, 200, 1000), "the sensor moved"),
        (np.zeros(9), "samples = 9"),
        (np.zeros(0), "samples = 0"),
    ],
)
def test_what_does_not_rest_is_refused(counts: np.ndarray, named: str) -> None:
    with pytest.raises(CalibrationError, match=named):
        rest(counts, NOMINAL)


@pytest.mark.parametrize("apart", [0.0, 0.5 * GRAVITY, 1.4 * 2 * GRAVITY])
def test_what_is_not_turned_over_is_refused(apart: float) -> None:
    up, down = (Rest(sign * apart / 2 / NOMINAL, 0.3, 40.0) for sign in (1, -1))
    with pytest.raises(CalibrationError, match="should by about 19.6"):
        calibrate(up, down, NOMINAL)


# All axes

FACTORS, OFFSETS = np.array([1.08, 0.93, 1.02]), np.array([300.0, -250.0, 40.0])


def held(
    mounting: Rotation,
    names: Iterable[str] = POSES,
    factors: FloatArray = FACTORS,
    offsets: FloatArray = OFFSETS,
    tilts: Sequence[Rotation] = (),
) -> dict[str, Sequence[Rest]]:
    """Return the rests of a sensor in poses, each off by a tilt."""
    found = {}
    for place, name in enumerate(names):
        upward = np.array(POSES[name])
        if tilts:
            upward = tilts[place].apply(upward)
        counts = offsets + mounting.apply(GRAVITY * upward) / (factors * NOMINAL)
        found[name] = [Rest(each, 0.3, 40.0) for each in counts.tolist()]
    return found


def degrees_between(first: FloatArray, second: Rotation) -> float:
    return float(np.degrees((Rotation.from_matrix(first) * second.inv()).magnitude()))


rotations = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(random_state=seed))


@settings(deadline=None, max_examples=30)
@given(rotations)
def test_six_poses_find_every_mounting_with_gains_and_offsets(mounting: Rotation) -> None:
    found = calibrate_axes(held(mounting), NOMINAL)
    assert degrees_between(found.mounting, mounting) < 0.01
    assert found.angle < 0.01
    assert np.allclose(found.gains, FACTORS * NOMINAL, rtol=1e-4)
    assert np.allclose(found.offsets, OFFSETS, atol=1.0)


def test_poses_held_by_hand_leave_gravity_its_size_and_tell_their_error() -> None:
    rng = np.random.default_rng(1)
    mounting = Rotation.from_euler("xyz", [20.0, -30.0, 75.0], degrees=True)
    angles, errors = [], []
    for _ in range(40):
        tilts = [Rotation.from_rotvec(rng.normal(0.0, np.radians(2.0), 3)) for _ in POSES]
        found = calibrate_axes(held(mounting, tilts=tilts), NOMINAL)
        angles.append(found.angle)
        errors.append(degrees_between(found.mounting, mounting))
        assert np.allclose(found.gains, FACTORS * NOMINAL, rtol=0.02)
    assert np.mean(np.array(errors) < angles) >= 0.9
    assert np.mean(angles) < 3 * np.mean(errors)


def test_three_poses_give_the_rotation_alone() -> None:
    mounting = Rotation.from_euler("z", 40.0, degrees=True)
    names = ("x axis up", "y axis down", "z axis up")
    factors, offsets = np.full(3, 1.01), np.zeros(3)
    found = calibrate_axes(held(mounting, names, factors, offsets), NOMINAL)
    assert degrees_between(found.mounting, mounting) < 0.5
    assert (found.gains, found.offsets) == ((NOMINAL,) * 3, (0.0,) * 3)


def test_the_transposed_mounting_turns_what_is_measured_into_the_handle() -> None:
    # The sensor's y axis is the handle's x.
    mounting = Rotation.from_euler("z", 90.0, degrees=True)
    found = calibrate_axes(held(mounting), NOMINAL)
    assert np.allclose(found.mounting, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-4)
    assert np.allclose(found.mounting.T @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-4)
    assert found.parameters("b")["mounting"].startswith("0.0000")


UPRIGHT = Rotation.identity()
EXACT = held(UPRIGHT, factors=np.ones(3), offsets=np.zeros(3))


def changed(*names: str, **others: Sequence[Rest]) -> Mapping[str, Sequence[Rest]]:
    """Return some exact poses, of which some are others."""
    replaced = {name.replace("_", " "): rests for name, rests in others.items()}
    return {name: replaced.get(name, EXACT[name]) for name in names or EXACT}


@pytest.mark.parametrize(
    ("poses", "named"),
    [
        (changed("x axis up", "y axis up"), "poses = 2: must be at least 3"),
        (changed("x axis up", "x axis down", "y axis up"), "too alike"),
        (changed("x axis up", "y axis up", "z axis up", z_axis_up=EXACT["x axis up"]), "alike"),
        (
            held(UPRIGHT, ("x axis up", "y axis up", "z axis up"), 1.1 * np.ones(3), 0 * OFFSETS),
            r"axis up: gravity is 8.92 m/s\^2, must be 9.81 within 5%",
        ),
        (held(UPRIGHT, factors=np.array([1.0, 1.0, 1.4])), "gain of axis z: 1.40 of the nominal"),
        (changed(z_axis_up=EXACT["z axis down"]), "must be|degrees off|too alike"),
        (
            changed(z_axis_up=EXACT["z axis down"], z_axis_down=EXACT["z axis up"]),
            "degrees off the other poses .* inverted",
        ),
    ],
)
def test_poses_without_a_calibration_are_refused(
    poses: Mapping[str, Sequence[Rest]], named: str
) -> None:
    with pytest.raises(CalibrationError, match=named):
        calibrate_axes(poses, NOMINAL)
