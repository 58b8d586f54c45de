# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture models built from recordings, against textures that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.texture import Provenance, TextureModel
from haptic_accel.kits.textures.building import Built, Recording, build

RATE = 1000.0
SPEEDS, FORCES = (0.05, 0.1, 0.15, 0.2), (0.5, 1.0, 2.0)
BAND = np.linspace(20.0, 450.0, 216)


def texture(speed: float, force: float) -> tuple[FloatArray, float]:
    """Return polynomial and innovation of a texture: three resonances that move with speed."""
    poles = []
    for frequency, radius in ((60 + 300 * speed, 0.95), (180, 0.9), (330 + 30 * force, 0.85)):
        pole = radius * np.exp(2j * np.pi * frequency / RATE)
        poles += [pole, pole.conj()]
    return np.asarray(np.poly(poles).real), 5 * speed * np.sqrt(force)


def true_density(speed: float, force: float) -> FloatArray:
    polynomial, deviation = texture(speed, force)
    response = signal.freqz([1.0], polynomial, BAND, fs=RATE)[1]
    return np.asarray(2 / RATE * deviation**2 * np.abs(response) ** 2)


def drag(force: float, seconds: float = 1.5, seed: int = 1) -> Recording:
    """Return a recording that stands still for half a second, then takes each of the speeds."""
    random = np.random.default_rng((seed, round(100 * force)))
    speed = np.repeat([0.0, *SPEEDS], [500, *[round(seconds * RATE)] * len(SPEEDS)])
    state, parts = np.zeros(6), []
    for each in (0.0, *SPEEDS):
        polynomial, deviation = texture(each, force)
        noise = random.normal(0.0, deviation, int((speed == each).sum()))
        part, state = signal.lfilter([1.0], polynomial, noise, zi=state)
        parts.append(part)
    return Recording(f"{force} N", RATE, speed, np.full(len(speed), force), np.concatenate(parts))


@pytest.fixture(scope="module")
def built() -> Built:
    return build("known", [drag(force) for force in FORCES], Provenance("simulated"))


def distance(measured: FloatArray, model: FloatArray) -> float:
    return float(np.sqrt(np.mean((10 * np.log10(measured / model)) ** 2)))


def test_order_and_spectra_of_a_known_texture_are_recovered(built: Built) -> None:
    assert built.order == 6
    assert built.model.lsf.shape[1] == 6
    for speed in SPEEDS:
        for force in FORCES:
            model = built.model.spectrum(speed, force, BAND)
            assert distance(true_density(speed, force), model) <= 1.5


def test_what_is_reported_of_segments_left_out_is_as_near(built: Built) -> None:
    assert built.distance <= 1.5
    assert sum(each.seconds for each in built.held_out) == pytest.approx(18.0, abs=0.5)
    rms = [each.modelled_rms / each.rms for each in built.held_out]
    # Of 0.75 s of noise that is narrow-band: its RMS has a deviation of 5 % itself.
    assert np.median(rms) == pytest.approx(1.0, abs=0.05)
    assert rms == pytest.approx([1.0] * len(rms), abs=0.25)


def test_segments_end_where_the_texture_changes(built: Built) -> None:
    changes = {0.5 + 1.5 * n for n in range(5)}
    edges = {each.begin for each in built.segments} | {each.end for each in built.segments}
    assert all(min(abs(change - edge) for edge in edges) <= 0.05 for change in changes)


def test_only_what_was_measured_is_covered_and_standing_still_is_refused(built: Built) -> None:
    assert built.coverage == pytest.approx(0.75 * 0.75, abs=0.02)
    refused = [(each.begin, each.end, each.reason) for each in built.refused]
    assert refused == [(0.0, 0.5, "at rest")] * 3


def test_a_texture_that_changes_with_speed_and_force_is_told_from_a_constant_one(
    built: Built,
) -> None:
    assert built.following.better
    # RMS over the recordings spans a factor of 8: 5 speed sqrt(force).
    assert built.following.rms_error < 0.25 < 0.5 < built.following.constant_rms_error
    assert built.following.distance < built.following.constant_distance - 3.0


def test_power_grows_by_its_law_up_to_the_largest_speed_and_force() -> None:
    # The largest force is never pressed at the largest speed.
    parts = [drag(force) for force in FORCES]
    kept = [
        Recording(each.name, RATE, *(values[begin:end] for values in signals))
        for each, begin, end in zip(parts, (500, 500, 500), (6500, 5000, 3500), strict=True)
        for signals in [(each.speed, each.force, each.acceleration)]
    ]
    model = build("part", kept, Provenance()).model
    for speed, force in ((0.2, 2.0), (0.15, 2.0), (0.2, 1.0)):
        densities = true_density(speed, force), model.spectrum(speed, force, BAND)
        true, own = (np.sqrt(density.mean()) for density in densities)
        # The nearest node is off by 30 or 50 % at the corner.
        assert own == pytest.approx(true, rel=0.25)


def test_a_texture_does_not_fade_within_the_recorded_forces() -> None:
    # Force sways, so that the lightest node has more than the smallest recorded force.
    random = np.random.default_rng(3)
    force = 1.2 + 0.9 * np.sin(np.arange(20_000) / 700)
    noise = random.standard_normal(len(force))
    swaying = Recording("sway", RATE, np.full(len(force), 0.1), force, noise)
    model = build("sway", [swaying], Provenance()).model
    frequency = np.linspace(20.0, 450.0, 100)
    for pressed in (0.35, 1.0, 2.0):
        rms = np.sqrt(model.spectrum(0.1, pressed, frequency).mean() * RATE / 2)
        assert rms == pytest.approx(1.0, abs=0.15)


def test_a_model_is_silent_without_speed_or_force(built: Built) -> None:
    model = built.model
    still = (model.speeds == 0) | (model.forces == 0)
    assert still.sum() == 3
    assert not model.deviation[still].any()
    assert model.deviation[~still].all()
    assert model.spectrum(0.0, 1.0, BAND).max() == 0.0
    assert model.spectrum(0.1, 0.0, BAND).max() == 0.0
    # What is neither is never silent: no triangle of silent nodes alone.
    assert not still[model.triangles].all(axis=1).any()


def test_a_faster_recording_gives_the_same_texture_at_the_rate_of_the_servo_loop() -> None:
    slow = drag(1.0, 1.0)
    speed, force = (np.repeat(each, 4) for each in (slow.speed, slow.force))
    acceleration = np.asarray(signal.resample(slow.acceleration, len(speed)))
    fast = Recording(slow.name, 4 * RATE, speed, force, acceleration)
    one, other = (build("known", [each], Provenance()).model for each in (slow, fast))
    assert other.rate == RATE
    assert distance(*[each.spectrum(0.1, 1.0, BAND) for each in (one, other)]) < 0.5


def test_contact_that_just_began_is_left_to_the_tap() -> None:
    recording = drag(1.0)
    force = np.where(np.arange(len(recording.force)) < 1000, 0.0, 1.0)
    up = Recording("up", RATE, recording.speed, force, recording.acceleration)
    found = build("known", [up], Provenance())
    reasons = [(each.reason, each.begin, each.end) for each in found.refused]
    assert reasons == [("out of contact", 0.0, 1.0), ("landing", 1.0, 1.1)]


def test_a_recording_without_contact_is_refused_with_the_reason() -> None:
    speed, force = np.full((2, 1000), [[0.1], [0.0]])
    recording = Recording("up.csv", RATE, speed, force, np.arange(1000.0))
    with pytest.raises(ParameterError, match=r"^up\.csv: has 0 segments .* \(out of contact\)$"):
        build("known", [recording], Provenance())


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"rate": 100.0}, "drag.csv: rate = 100: must be at least 500 Hz"),
        ({"speed": np.zeros(3)}, "drag.csv: speed: has shape"),
        ({"force": np.full(9, np.nan)}, "drag.csv: force: must be finite"),
        ({"acceleration": np.ones(9)}, "drag.csv: acceleration: must not be constant"),
        (dict.fromkeys(("speed", "force", "acceleration"), np.zeros(0)), "must not be constant"),
    ],
)
def test_a_wrong_recording_is_refused(changed: dict[str, object], says: str) -> None:
    values = {name: np.zeros(9) for name in ("speed", "force", "acceleration")}
    with pytest.raises(ParameterError, match=says):
        Recording(**{"name": "drag.csv", "rate": RATE, **values, **changed})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "acceleration",
    [
        np.sin(2 * np.pi * 100 * np.arange(3000) / RATE),
        np.where(np.arange(3000) < 1500, 0.0, 1.0),
        100.0 * (np.arange(3000) == 1500),
    ],
    ids=["tone", "step", "impact"],
)
@pytest.mark.filterwarnings("error")
def test_what_can_be_predicted_exactly_gives_a_model_too(acceleration: FloatArray) -> None:
    speed, force = np.full((2, 3000), [[0.1], [1.0]])
    found = build("odd", [Recording("odd", RATE, speed, force, acceleration)], Provenance())
    assert np.isfinite(found.distance)


@pytest.mark.parametrize("half", [0, 1])
def test_a_half_of_a_free_movement_predicts_the_other(half: int) -> None:
    moved = free_movement(seconds=20.0)
    signals = (moved.speed, moved.force, moved.acceleration)
    both = zip(*(np.split(each, 2) for each in signals), strict=True)
    halves = [Recording("free", RATE, *parts) for parts in both]
    model = build("free", [halves[half]], Provenance()).model
    for recording in halves:
        measured, modelled, ratio = beside(recording, model)
        assert distance(measured, modelled) <= 3.0
        assert ratio == pytest.approx(1.0, abs=0.1)


def free_movement(seconds: float) -> Recording:
    """Return a recording by a hand: speed and force sway apart, as people explore a surface."""
    block, random = 20, np.random.default_rng(5)
    time = np.arange(round(seconds * RATE)) / RATE
    speed = 0.125 + 0.06 * np.sin(2 * np.pi * 0.43 * time) + 0.015 * np.sin(7.1 * time)
    force = 1.25 + 0.5 * np.sin(2 * np.pi * 0.31 * time + 1.0) + 0.1 * np.sin(5.3 * time)
    state, parts = np.zeros(6), []
    for begin in range(0, len(time), block):
        polynomial, deviation = texture(float(speed[begin]), float(force[begin]))
        noise = random.normal(0.0, deviation, block)
        part, state = signal.lfilter([1.0], polynomial, noise, zi=state)
        parts.append(part)
    return Recording("free", RATE, speed, force, np.concatenate(parts))


def beside(recording: Recording, model: TextureModel) -> tuple[FloatArray, FloatArray, float]:
    """Return densities within the band of a recording and of a model along it, and RMS by RMS."""
    rate, acceleration = recording.rate, recording.acceleration
    frequency, density = signal.welch(acceleration, rate, nperseg=640)
    within = (frequency >= 20) & (frequency <= 450)
    places = zip(recording.speed[::200].tolist(), recording.force[::200].tolist(), strict=True)
    fine = np.linspace(20, 450, 1000)
    grid = np.concatenate([frequency[within], fine])
    modelled = np.mean([model.spectrum(*each, grid) for each in places], axis=0)
    # Not by Welch's windows, which have little of the ends.
    lines, power = signal.periodogram(acceleration, rate, scaling="spectrum")
    measured_power = power[(lines >= 20) & (lines <= 450)].sum()
    ratio = np.sqrt(modelled[-len(fine) :].mean() * 430 / measured_power)
    return density[within], modelled[: -len(fine)], float(ratio)
