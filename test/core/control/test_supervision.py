# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages about a handle: unknown modes at once, ordinary hands and noise never."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from band_noise import band_noise
from scipy import signal

from haptic_accel.core.control.diagnosis import FITTING, ORDINARY
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.handle.mechanics import grid_for
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray, MountParameters
from haptic_accel.core.tick import Trace

RATE = 1000.0
PLANT = Plant()
MODES = [(f, z) for f in (120.0, 180.0, 250.0, 320.0) for z in (0.03, 0.1, 0.3)]


def with_mode(frequency: float, damping: float, plant: Plant = PLANT) -> Plant:
    return replace(plant, mount=replace(plant.mount, frequency=frequency, damping=damping))


def response(plant: Plant, force: FloatArray, rate: float = RATE) -> FloatArray:
    """Return the acceleration that a plant's impulse response gives for a force."""
    grid = grid_for(rate, 1000)
    taps = grid.sequence(plant.delayed(1).response(grid.frequency, rate))[:1000]
    return np.asarray(np.convolve(force, taps)[: len(force)])


def force(seconds: float, rms: float = 0.3, seed: int = 1, rate: float = RATE) -> FloatArray:
    """Return noise from 30 to 450 Hz."""
    return band_noise(30.0, 450.0, seconds, rms, seed=seed, rate=rate)


def feed(supervisor: ResponseSupervisor, sent: FloatArray, measured: FloatArray) -> list[str]:
    """Give all samples, each with the acceleration one sample before; return the warnings."""
    before = np.append(0.0, measured[:-1])
    warnings = []
    for known, now in zip(before.tolist(), sent.tolist(), strict=True):
        supervisor.trace.push(0.0, known, now, 0.0)
        supervisor.update()
        warnings.append(supervisor.warning)
    return warnings


def supervisor(plant: Plant = PLANT, rate: float = RATE) -> ResponseSupervisor:
    return ResponseSupervisor(plant.delayed(1), rate, Trace())


@pytest.mark.parametrize(
    ("known", "frequency", "damping"),
    [*((PLANT, *mode) for mode in MODES), (with_mode(290.0, 0.11), 180.0, 0.05)],
)
def test_an_unknown_mode_is_told_within_a_second(
    known: Plant, frequency: float, damping: float
) -> None:
    sent = force(1.0)
    watching = supervisor(known)
    warning = feed(watching, sent, response(with_mode(frequency, damping), sent))[-1]
    assert warning.startswith("the handle is not as described ")
    assert " Hz: run identify" in warning
    assert not watching.described
    assert watching.fitting == 0.0


def test_it_names_the_bands_that_deviate() -> None:
    sent = force(2.0)
    measured = response(PLANT, sent)
    wide, narrow = supervisor(), supervisor()
    upper = signal.butter(8, 170.0, "highpass", fs=RATE, output="sos")
    warning = feed(wide, sent, measured + 3.0 * signal.sosfilt(upper, measured))[-1]
    assert warning.split(",")[0] in (
        "the handle is not as described above 150 Hz: run identify",
        "the handle is not as described above 190 Hz: run identify",
    )
    between = signal.butter(4, [120.0, 190.0], "bandpass", fs=RATE, output="sos")
    warning = feed(narrow, sent, measured + 3.0 * signal.sosfilt(between, measured))[-1]
    assert warning.startswith("the handle is not as described between ")


@pytest.mark.parametrize("plant", [PLANT, with_mode(290.0, 0.11)])
@pytest.mark.parametrize("number", range(9))
def test_ordinary_hands_are_not_told(plant: Plant, number: int) -> None:
    sent = force(3.0)
    other = replace(plant, handle=ORDINARY.grips(plant.handle)[number])
    watching = supervisor(plant)
    assert not any(feed(watching, sent, response(other, sent)))
    assert watching.fitting >= FITTING


def test_noise_and_the_motion_of_the_hand_are_not_told() -> None:
    noise = np.random.default_rng(2).standard_normal(3000)
    motion = 3.0 * np.sin(2 * np.pi * 2.0 * np.arange(3000) / RATE)
    silent = np.zeros(3000)
    watching = supervisor()
    assert not any(feed(watching, silent, 9.81 + motion + 0.1 * noise))
    assert watching.fitting == 0.0  # nothing was excited
    sent = force(3.0, rms=0.1)
    measured = response(PLANT, sent) + motion + 0.5 * noise
    assert not any(feed(supervisor(), sent, measured))


def test_a_force_within_dry_friction_tells_nothing() -> None:
    stuck = replace(PLANT, friction=0.04)
    sent = force(2.0, rms=0.02)
    assert not any(feed(supervisor(stuck), sent, 0.2 * response(PLANT, sent)))


def test_what_was_told_stays_until_the_handle_has_fitted_for_a_while() -> None:
    sent = force(1.0)
    watching = supervisor()
    feed(watching, sent, response(with_mode(180.0, 0.1), sent))
    silent = np.zeros(2000)
    assert all(feed(watching, silent, silent))
    again = force(FITTING + 4.0, seed=3)
    warnings = feed(watching, again, response(PLANT, again))
    assert all(warnings[: round(FITTING * RATE)])
    assert warnings[-1] == ""


def test_a_sensor_at_its_range_ends_the_time_of_fitting() -> None:
    sent = force(3.0)
    watching = supervisor()
    feed(watching, sent, response(PLANT, sent))
    assert watching.fitting > 0.0
    watching.trace.push(0.0, math.inf, 0.0, 0.0)
    assert watching.fitting == 0.0
    assert watching.described


@pytest.mark.parametrize("rate", [50.0, 140.0, 4000.0])
def test_any_rate_will_do(rate: float) -> None:
    sent = 0.3 * np.random.default_rng(1).standard_normal(round(2 * rate))
    plant = replace(PLANT, mount=MountParameters())
    assert not any(feed(supervisor(plant, rate), sent, response(plant, sent, rate)))


def test_reset_forgets_all() -> None:
    sent = force(1.0)
    used, fresh = supervisor(), supervisor()
    feed(used, sent, response(with_mode(180.0, 0.1), sent))
    used.reset()
    measured = response(PLANT, sent)
    assert feed(used, sent, measured) == feed(fresh, sent, measured)
    assert np.array_equal(used.ratio, fresh.ratio)
