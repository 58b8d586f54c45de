# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the check of the axes: turned sensors are named, other hands are not."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from haptic_accel.core.control.alignment import Alignment
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import Trace

RATE = 1000.0
NOISE = 0.2
"""What no force causes, m/s^2 RMS: three times the noise of the paper's accelerometer."""


def textures(seconds: float = 2.0) -> FloatArray:
    """Return three independent textures, 1.5 m/s^2 RMS each."""
    noise = np.random.default_rng(1).normal(size=(round(seconds * RATE), 3))
    band = signal.butter(2, [30, 250], "bandpass", fs=RATE, output="sos")
    passed = signal.sosfilt(band, noise, axis=0)
    return np.asarray(1.5 * passed / passed.std(axis=0))


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


@pytest.mark.parametrize("gains", [(1.0, 1.0, 1.0), (0.6, 1.5, 1.0), (-1.0, 1.0, 1.0)])
def test_another_hand_or_a_wrong_polarity_is_no_turned_sensor(
    gains: tuple[float, float, float],
) -> None:
    expected = textures()
    along = expected[:, :1] * (1.0, 0.8, -0.5)
    for each in (expected, along):
        assert set(judged(each, each * gains)) == {""}


def test_a_small_angle_is_none() -> None:
    expected = textures()
    assert set(judged(expected, expected @ turned(4.0, (1, 1, 1)).T)) == {""}


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


def test_little_motion_tells_nothing() -> None:
    expected = textures() / 20.0
    assert set(judged(expected, expected @ turned(45.0, (1, 0, 0)).T)) == {""}


def test_missing_samples_count_as_none() -> None:
    expected = textures()
    measured = expected.copy()
    measured[::50] = np.nan
    assert set(judged(expected, measured)) == {""}


@pytest.mark.parametrize("begin", range(0, 1800, 300))
def test_noise_as_loud_as_the_motion_tells_nothing(begin: int) -> None:
    # Other coils explain a part of it by chance, the more the shorter it is.
    expected = 0.2 * np.roll(textures(), begin, axis=0)
    other = 0.2 * np.roll(textures(), begin + 900, axis=0)
    assert set(judged(expected, expected + other)) == {""}


def test_a_single_tap_tells_nothing() -> None:
    # Its directions are equal by chance, as of a friction that it overcomes.
    expected = textures()
    expected[60:] *= 1e-3
    assert set(judged(expected, expected @ turned(45.0, (1, 0, 0)).T)) == {""}


def test_motion_while_a_limit_acts_is_not_judged() -> None:
    expected = textures()
    measured = expected @ turned(45.0, (1, 0, 0)).T
    coils = Coils()
    for index, warning in enumerate(coils.run(expected, measured)):
        if (index + 1) % 50 == 0 and index < 1000:
            coils.trace.limited = index + 1
        assert not warning or index > 1100
    assert warning
