# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of the inputs of a sound card, from records whose scale is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from haptic_accel.core.model import GRAVITY, FloatArray
from haptic_accel.devices import sound_calibration
from haptic_accel.devices.serial.calibration import CalibrationError

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
    found = sound_calibration.by_gravity(up, down, "input 1")
    assert found.scale == pytest.approx(scale, rel=1e-3)
    assert found.noise == pytest.approx(NOISE, rel=0.05)


def test_an_ac_coupled_input_is_named() -> None:
    with pytest.raises(CalibrationError, match="input 1: .* AC-coupled"):
        sound_calibration.by_gravity(noise(1) / 100, noise(2) / 100, "input 1")


@pytest.mark.parametrize("scale", [80.0, -400.0])
def test_a_sensor_beside_a_calibrated_one_has_its_scale_and_polarity(scale: float) -> None:
    moved = shaking()
    own, rest, other = (ac_coupled(moved) + noise(2)) / scale, noise(3) / scale, moved + noise(4)
    found = sound_calibration.by_reference(own, rest, other, RATE, "input 2")
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
    found = sound_calibration.by_force(force, own, rest, RATE, MASS, "input 1")
    assert found.scale == pytest.approx(scale, rel=0.01)


def test_an_automatic_gain_is_refused() -> None:
    force, response = forced(80.0, 128)
    response[len(response) // 2 :] *= 2
    with pytest.raises(CalibrationError, match="differs from a strong one's by 100%.*automatic"):
        sound_calibration.by_force(force, response, noise(3) / 80, RATE, MASS, "input 1")


def test_a_mass_that_resonates_is_refused() -> None:
    force, response = forced(80.0, 128)
    mode = signal.iirpeak(150.0, 3.0, fs=RATE)
    distorted = signal.lfilter(*mode, response)
    with pytest.raises(CalibrationError, match="input 1: its (gain changes|phase)"):
        sound_calibration.by_force(force, distorted, noise(3), RATE, MASS, "input 1")


def test_the_input_of_another_sensor_is_named() -> None:
    with pytest.raises(CalibrationError, match="input 2: coherence 0.*shaken"):
        sound_calibration.by_reference(noise(2) / 80, noise(3), shaking(), RATE, "input 2")


def test_clipping_and_an_unplugged_input_are_refused() -> None:
    moved = shaking()
    with pytest.raises(CalibrationError, match="input 2: [0-9]+ of 192000 samples at full scale"):
        sound_calibration.by_reference(np.clip(moved / 5, -1, 1), noise(3), moved, RATE, "input 2")
    with pytest.raises(CalibrationError, match="input 2: constant; is it unplugged"):
        sound_calibration.by_reference(np.full(len(moved), 0.01), noise(3), moved, RATE, "input 2")


def test_strokes_on_a_contact_microphone_get_a_usual_strength_and_no_unit() -> None:
    stroked, quiet = noise(1, 0.02), noise(2, 0.001)
    found = sound_calibration.relative(stroked, quiet, "input 1")
    assert np.std(stroked) * found.scale == pytest.approx(3.0)
    assert "relative, no acceleration" in found.text
    with pytest.raises(CalibrationError, match=r"input 1: strokes are 1\.0 times the noise"):
        sound_calibration.relative(noise(3, 0.001), quiet, "input 1")


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
    found = sound_calibration.digital_scales(name)
    assert found == (scales and pytest.approx(scales))
