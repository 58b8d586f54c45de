# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration by gravity, and of a sound card's inputs from records whose scale is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.spatial.transform import Rotation

from haptic_accel.core.model import GRAVITY, FloatArray
from haptic_accel.devices import calibration
from haptic_accel.devices.calibration import (
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


RATE = 48_000
"""Samples per second, Hz."""

SECONDS = 4
NOISE = 0.05
"""Noise of a sensor, m/s²."""

MASS = 0.12
"""Mass of a handle, kg."""


def noise(seed: int, size: float = NOISE, seconds: float = SECONDS) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, size, round(seconds * RATE))


def shaking(seed: int = 1) -> FloatArray:
    """Return an acceleration between 10 and 1000 Hz, of some 3 m/s²."""
    sections = signal.butter(2, (10.0, 1000.0), "bandpass", fs=RATE, output="sos")
    return np.asarray(signal.sosfilt(sections, noise(seed, 15.0)))


def ac_coupled(acceleration: FloatArray) -> FloatArray:
    """Return what an input passes whose first-order corner is at 10 Hz."""
    high_pass = signal.butter(1, 10.0, "high", fs=RATE, output="sos")
    return np.asarray(signal.sosfilt(high_pass, acceleration))


@given(st.floats(20.0, 2000.0), st.booleans(), st.floats(-0.2, 0.2))
def test_gravity_gives_scale_and_polarity(size: float, is_swapped: bool, offset: float) -> None:
    scale = -size if is_swapped else size
    gravity = ((sign * GRAVITY + noise(seed, seconds=1)) for seed, sign in ((1, 1), (2, -1)))
    up, down = (each / scale + offset for each in gravity)
    found = calibration.by_gravity(up, down, "input 1")
    assert found.scale == pytest.approx(scale, rel=1e-3)
    assert found.noise == pytest.approx(NOISE, rel=0.05)


def test_an_ac_coupled_input_is_named() -> None:
    with pytest.raises(CalibrationError, match="input 1: .* AC-coupled"):
        calibration.by_gravity(noise(1) / 100, noise(2) / 100, "input 1")


@pytest.mark.parametrize("scale", [80.0, -400.0])
def test_a_sensor_beside_a_calibrated_one_has_its_scale_and_polarity(scale: float) -> None:
    moved = shaking()
    own, rest, other = (ac_coupled(moved) + noise(2)) / scale, noise(3) / scale, moved + noise(4)
    found = calibration.by_reference(own, rest, other, RATE, "input 2")
    assert found.scale == pytest.approx(scale, rel=0.01)
    assert abs(found.scale - scale) < 4 * found.scale_error + 0.01 * abs(scale)
    assert found.noise == pytest.approx(NOISE, rel=0.05)


def forced(scale: float, delay: int) -> tuple[FloatArray, FloatArray]:
    """Return a force, and the input of a free mass that it moves after a delay in samples."""
    force = shaking() * MASS
    force[len(force) // 2 :] /= 4
    return force, np.concatenate([np.zeros(delay), force])[: len(force)] / MASS / scale


@pytest.mark.parametrize("delay", [0, 128, 700])
@pytest.mark.parametrize("scale", [80.0, -80.0])
def test_a_known_force_on_a_known_mass_gives_the_scale_whatever_the_delay(
    scale: float, delay: int
) -> None:
    force, response = forced(scale, delay)
    own, rest = response + noise(2) / scale, noise(3) / scale
    found = calibration.by_force(force, own, rest, RATE, MASS, "input 1")
    assert found.scale == pytest.approx(scale, rel=0.01)


def test_an_automatic_gain_is_refused() -> None:
    force, response = forced(80.0, 128)
    response[len(response) // 2 :] *= 2
    with pytest.raises(CalibrationError, match="differs from a strong one's by 100%.*automatic"):
        calibration.by_force(force, response, noise(3) / 80, RATE, MASS, "input 1")


def test_a_mass_that_resonates_is_refused() -> None:
    force, response = forced(80.0, 128)
    mode = signal.iirpeak(150.0, 3.0, fs=RATE)
    distorted = signal.lfilter(*mode, response)
    with pytest.raises(CalibrationError, match="input 1: its (gain changes|phase)"):
        calibration.by_force(force, distorted, noise(3), RATE, MASS, "input 1")


def test_the_input_of_another_sensor_is_named() -> None:
    with pytest.raises(CalibrationError, match="input 2: coherence 0.*shaken"):
        calibration.by_reference(noise(2) / 80, noise(3), shaking(), RATE, "input 2")


def test_clipping_and_an_unplugged_input_are_refused() -> None:
    moved = shaking()
    with pytest.raises(CalibrationError, match="input 2: [0-9]+ of 192000 samples at full scale"):
        calibration.by_reference(np.clip(moved / 5, -1, 1), noise(3), moved, RATE, "input 2")
    with pytest.raises(CalibrationError, match="input 2: constant; is it unplugged"):
        calibration.by_reference(np.full(len(moved), 0.01), noise(3), moved, RATE, "input 2")


def test_strokes_on_a_contact_microphone_get_a_usual_strength_and_no_unit() -> None:
    stroked, quiet = noise(1, 0.02), noise(2, 0.001)
    found = calibration.relative(stroked, quiet, "input 1")
    assert np.std(stroked) * found.scale == pytest.approx(3.0)
    assert "relative, no acceleration" in found.text
    with pytest.raises(CalibrationError, match=r"input 1: strokes are 1\.0 times the noise"):
        calibration.relative(noise(3, 0.001), quiet, "input 1")


@pytest.mark.parametrize(
    ("name", "scales"),
    [
        ("333D01 10123455120025600200115: Audio (hw:1,0)", (163.84, 327.68)),
        ("333D01 10123450000025600200115", None),
        ("485B39 200159807943590799265210723", None),  # a conditioner: volts
        ("HDA Intel: ALC (hw:0,0)", None),
        ("", None),
    ],
)
def test_a_sensor_states_its_scales_in_its_name(
    name: str, scales: tuple[float, float] | None
) -> None:
    found = calibration.digital_scales(name)
    assert found == (scales and pytest.approx(scales))
