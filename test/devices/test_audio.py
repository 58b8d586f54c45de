# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The actuator behind a sound card, through ALSA's file and null plug-ins."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes, along_actuator
from haptic_accel.core.model import ZERO, Vector, vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.devices import Device, DeviceError, Sample
from haptic_accel.devices.audio import PRESETS, AudioActuator, AudioParameters, HeldForce
from haptic_accel.devices.simulated import SimulatedMaster
from running import python
from sound_cards import JACK_NAME, NAME, QUAD, jack_card, received, received_of_four, sound_card
from sound_cards import RATE as CARD_RATE

RATE = 1000.0
PERIOD = 1 / RATE
LATENCY = 5
BLOCK = 64
START = 100.0
"""Time of the first tick, s."""


@dataclass
class Bench:
    """The clock of the ticks, and what the card received."""

    folder: Path
    now: float = START

    def device(self, latency: int = LATENCY, inner: Device | None = None, **fields: Any) -> Any:
        parameters = AudioParameters(**{"device": NAME, "block": BLOCK, **fields})
        inner = inner or SimulatedMaster(MasterRigParameters(), RATE, 0)
        return AudioActuator(parameters, RATE, inner, latency, lambda: self.now)

    def received(self, channels: int = 2) -> np.ndarray:
        """Return what came to the card after it was closed, full scale 1."""
        return received(self.folder, channels)

    def play(self, forces: np.ndarray, **fields: Any) -> Any:
        """Return a device that has played forces, and is closed."""
        device = self.device(**fields)
        device.open()
        self.run(device, forces)
        device.close()
        return device

    def run(self, device: Any, forces: np.ndarray, first: int = 0) -> list[Any]:
        """Serve ticks as the device node does; a force is due `LATENCY` ticks after its cause."""
        samples = []
        for tick, force in enumerate(forces, first):
            self.now = START + tick * PERIOD
            samples.append(device.read(self.now))
            due = START + (tick + LATENCY) * PERIOD
            device.write(due, actuator_force=along(force))
        return samples


def along(force: Any) -> Vector:
    """Return a force along the axis of a single coil, or that of three coils."""
    return vector(force) if np.ndim(force) else along_actuator(float(force))


class Still(Device):
    """A master at rest."""

    Parameters = AudioParameters

    def __init__(self, axes: Axes = ACTUATOR_AXES) -> None:
        self.axes = axes

    def open(self) -> None: ...

    def read(self, time: float) -> Sample:
        return Sample(ZERO, ZERO, ZERO)

    def write(self, time: float, **forces: Any) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with sound_card(tmp_path):
        yield Bench(tmp_path)


def held(forces: np.ndarray, rate: float, count: int) -> np.ndarray:
    """Return the means of forces held from their due times on, from the first tick."""
    steps = np.concatenate((np.zeros(LATENCY), forces))
    impulse = np.concatenate(([0.0], np.cumsum(steps))) * PERIOD
    edges = np.arange(count + 1) / rate
    return np.diff(np.interp(edges, np.arange(len(steps) + 1) * PERIOD, impulse)) * rate


@pytest.mark.parametrize(
    ("channels", "driven", "scale"),
    [
        ("1", [0], 4.0),
        ("2", [1], -4.0),
        ("3", [2], 4.0),
        ("3, 4", [2, 3], 4.0),
        ("4,2", [1, 3], 4.0),
    ],
)
def test_samples_that_arrive_are_the_forces_that_were_due_on_all_channels_of_the_coil(
    bench: Bench, channels: str, driven: list[int], scale: float
) -> None:
    forces = np.random.default_rng(1).uniform(-3.0, 3.0, 300)
    device = bench.play(forces, device=QUAD, channels=channels, full_scale=scale)
    received = received_of_four(bench.folder)
    # Until the last tick, and ahead of it.
    count = (300 * PERIOD + 2 * BLOCK / CARD_RATE) * CARD_RATE
    assert len(received) == pytest.approx(count, abs=2)
    due = held(forces, CARD_RATE, len(received))
    for channel, signal in enumerate(received.T):
        assert scale * signal == pytest.approx(due if channel in driven else 0.0 * due, abs=1e-4)
    assert device.late == 0
    assert device.counters()["audio_underruns"] == device.counters()["audio_clipped"] == 0


def test_three_coils_are_driven_on_three_channels_with_one_due_time(bench: Bench) -> None:
    forces = np.random.default_rng(2).uniform(-2.0, 2.0, (200, 3))
    turned = {"channels": "2", "full_scale": 4.0, "coil_mounting": "0 1 0, -1 0 0, 0 0 1"}
    device = bench.play(forces, inner=Still(ALL_AXES), **turned)
    assert device.axes == ALL_AXES
    assert "sound card coil, channel 2, 3, 4, " in device.remark
    silent, *signals = bench.received(4).T
    assert not silent.any()
    # The first coil is along y, the second along -x.
    for signal, due in zip(signals, (forces[:, 1], -forces[:, 0], forces[:, 2]), strict=True):
        assert 4.0 * signal == pytest.approx(held(due, CARD_RATE, len(signal)), abs=1e-4)
    assert device.counters()["audio_clipped"] == 0


def test_force_beyond_one_coil_keeps_its_direction_and_no_number_is_no_force(bench: Bench) -> None:
    device = bench.device(inner=Still(ALL_AXES), full_scale=2.0)
    device.open()
    bench.run(device, np.tile([1.0, -4.0, 2.0], (50, 1)))
    bench.run(device, np.tile([1.0, math.nan, 1.0], (50, 1)), first=50)
    device.close()
    received = bench.received(3)
    assert received[round(0.03 * CARD_RATE)] == pytest.approx([0.25, -1.0, 0.5])
    assert not received[-BLOCK:].any()
    assert device.counters()["audio_clipped"] > 1000


def test_force_that_comes_late_is_counted_and_acts_at_once(bench: Bench) -> None:
    device = bench.device()
    device.open()
    bench.run(device, np.zeros(20))
    # The card has the samples of that time.
    device.write(bench.now + PERIOD, actuator_force=along(1.0))
    assert device.late == 1
    bench.run(device, np.full(10, 1.0), first=20)
    device.close()
    signal = bench.received()[:, 0]
    assert signal[round(0.026 * CARD_RATE) :].min() > 0.0


def test_an_underrun_is_counted_once_and_the_due_times_are_kept(bench: Bench) -> None:
    device = bench.device(full_scale=4.0)
    device.open()
    forces = np.sin(np.arange(200) / 7)
    bench.run(device, forces[:100])
    # The machine stands still for 20 ticks, which are read afterwards.
    bench.now += 20 * PERIOD
    for tick in range(100, 120):
        device.read(START + tick * PERIOD)
    bench.run(device, forces[120:], first=120)
    device.close()
    assert device.counters()["audio_underruns"] == 1
    signal, expected = 4.0 * bench.received()[:, 0], held(forces, CARD_RATE, 10000)
    # From the due time of the first force thereafter, less the silence that did not sound.
    missed = round((119 - 99) * PERIOD * CARD_RATE - 2 * BLOCK - 44.1)
    first = round((120 + LATENCY) * PERIOD * CARD_RATE) + 1
    after = signal[first - missed :]
    assert np.abs(after - expected[first : first + len(after)]).max() < 0.02


def test_stop_discards_what_is_not_due_yet(bench: Bench) -> None:
    device = bench.device(full_scale=1.0)
    device.open()
    bench.run(device, np.ones(50))
    device.write(bench.now, actuator_force=ZERO)
    supplied = round((49 * PERIOD + 2 * BLOCK / CARD_RATE + PERIOD) * CARD_RATE)
    for tick in range(50, 80):
        bench.now = START + tick * PERIOD
        device.read(bench.now)
    device.close()
    signal = bench.received()[:, 0]
    assert signal[supplied - 3] == 1.0
    assert not signal[supplied + 3 :].any()


def test_the_simulated_handle_feels_the_force_when_it_is_due(bench: Bench) -> None:
    forces = np.sin(np.arange(100) / 5)
    device = bench.device()
    device.open()
    played = bench.run(device, forces)
    device.close()
    alone = SimulatedMaster(MasterRigParameters(), RATE, 0)
    alone.open()
    due = np.concatenate((np.zeros(LATENCY), forces))
    for tick in range(100):
        time = START + tick * PERIOD
        assert alone.read(time) == played[tick]
        if tick >= LATENCY:
            alone.write(time, actuator_force=along(due[tick]))


TURNED = "1 0 0, 0 1 0, 1 1 0"
FIFTH = {"device": QUAD, "channels": "4, 5"}


@pytest.mark.parametrize(
    ("refused", "fields", "axes"),
    [
        ("latency = 4: must be at least 5 with 64 samples", {"latency": 4}, ACTUATOR_AXES),
        ("latency = 7: must be at least 8", {"block": 128, "latency": 7}, ACTUATOR_AXES),
        ("latency = 20: must be at least 49", {"block": 1024, "latency": 20}, ACTUATOR_AXES),
        ("audio.block = 32: must be at least 45, the samples", {"block": 32}, ACTUATOR_AXES),
        (
            "audio.channels = '4, 5': channel 5 must be at most 4, as the sound card quad has no",
            FIFTH,
            ACTUATOR_AXES,
        ),
        ("audio.channels = '3': channel 3", {"device": "stereo", "channels": "3"}, ACTUATOR_AXES),
        ("audio.channels = '1': channel 3 must be at most 2", {"device": "stereo"}, ALL_AXES),
        ("audio.coil_mounting: axes that are not orthogo", {"coil_mounting": TURNED}, ALL_AXES),
        ("audio.device = 'nowhere': ", {"device": "nowhere"}, ACTUATOR_AXES),
        ("latency = 5: must be", {"block": 4096}, ACTUATOR_AXES),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(
    bench: Bench, refused: str, fields: dict[str, Any], axes: Axes
) -> None:
    with pytest.raises((DeviceError, ParameterError)) as found:
        bench.device(inner=Still(axes), **fields).open()
    assert str(found.value).startswith(refused)
    assert str(found.value).isprintable()


class DriftingCard:
    """A card whose crystal is slow or fast, by the bench's clock; it fetches block by block."""

    rate, block, lead, input_delay = 48000.0, BLOCK, 2 * BLOCK / 48000 + PERIOD, 0.0
    is_exact = False

    def __init__(self, bench: Bench, drift: float) -> None:
        self.bench, self.drift = bench, drift
        self.given, self.started = 0, math.nan
        self.delays: list[float] = []

    def open(self) -> None: ...

    def close(self) -> None: ...

    @property
    def room(self) -> int:
        return 10 * BLOCK

    @property
    def played(self) -> float:
        return (self.bench.now - self.started) * self.rate * (1 + self.drift)

    def sounds(self, now: float) -> float | None:
        queued = self.given - self.played // BLOCK * BLOCK
        return now + queued / self.rate if queued else None

    def write(self, samples: np.ndarray) -> bool:
        if not self.given:
            self.started = self.bench.now
        dry = self.given < self.played
        self.given += len(samples)
        # From now until the last of these samples sounds.
        self.delays.append((self.given - self.played) / self.rate)
        return dry


@pytest.mark.parametrize("drift", [-2e-4, 2e-4])
def test_the_card_s_clock_is_followed(
    bench: Bench, drift: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    card = DriftingCard(bench, drift)
    monkeypatch.setattr("haptic_accel.devices.audio.SoundCard", lambda *given: card)
    device = bench.device(inner=Still())
    device.open()
    for tick in range(8_000):
        bench.now = START + tick * PERIOD
        device.read(bench.now)
    assert device.counters()["audio_underruns"] == 0
    # Unfollowed it would be 1.6 ms by then, and by what the card tells half a block, 0.7 ms.
    settled = np.array(card.delays[4_000:]) - card.lead
    assert np.abs(settled).max() < 0.4e-3


@pytest.fixture
def pad(monkeypatch: pytest.MonkeyPatch) -> str:
    """Name a preset whose card is the one with four channels."""
    preset = PRESETS["dualsense"]._replace(device=QUAD)
    monkeypatch.setitem(PRESETS, "dualsense", preset)
    return "dualsense"


def test_a_preset_gives_card_channels_and_rate(bench: Bench, pad: str) -> None:
    device = bench.play(np.ones(50), preset=pad, device="")
    assert "sound card quad, channel 3, 4, 64 samples a block at 48000 Hz" in device.remark
    assert device.remark.endswith("not calibrated, preset dualsense")
    assert list(received_of_four(bench.folder).any(axis=0)) == [False, False, True, True]


def test_a_rate_that_the_card_does_not_have_is_refused(
    bench: Bench, pad: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PRESETS, pad, PRESETS[pad]._replace(rate=1e8))
    with pytest.raises(DeviceError, match=r"^sound card quad at 1e\+08 Hz: .*Invalid sample rate"):
        bench.device(preset=pad, device="").open()


def test_jack_in_between_is_refused_in_one_line() -> None:
    code = (
        "from haptic_accel.devices.audio import AudioParameters, SoundCard, DeviceError\n"
        f"try: SoundCard(AudioParameters(device={JACK_NAME!r}), 1e-3).open()\n"
        "except DeviceError as error: print(error)"
    )
    with jack_card() as environment:
        done = python("-c", code, env=environment, check=True)
    assert done.stdout == (
        "audio.device = 'system': must not be on JACK, to which PortAudio 19.6 writes beyond its"
        " memory; stop JACK, and name the card itself (hw:)\n"
    )


@given(st.text(max_size=20) | st.lists(st.integers(-2, 9)).map(str), st.sampled_from([1, 3]))
def test_what_is_no_channels_is_refused_in_one_line(channels: str, coils: int) -> None:
    parameters = AudioParameters(channels=channels)
    try:
        found = parameters.channels_of(coils)
    except ParameterError as error:
        assert str(error).startswith("audio.channels = ")
        assert str(error).isprintable()
    else:
        assert len(set(found)) == len(found) >= coils
        assert min(found) >= 1


@pytest.mark.parametrize(
    ("fields", "remarked"),
    [
        ({}, r"sound card coil, channel 1, 64 samples a block at 44100 Hz"),
        ({}, r"3.9 ms ahead, full scale 6.6 N, not calibrated, behind .*, which may resample$"),
        ({"preset": "exciter", "channels": "4"}, "sound card coil, channel 4, .* preset exciter"),
    ],
)
def test_what_it_plays_on_is_remarked(bench: Bench, fields: Any, remarked: str) -> None:
    assert re.search(remarked, bench.play(np.zeros(3), **fields).remark)


def test_a_card_that_is_unplugged_fails_in_one_line_and_closes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sounddevice

    def unplugged(stream: Any) -> int:
        raise sounddevice.PortAudioError("Unanticipated host error")

    device = bench.device()
    device.open()
    bench.run(device, np.zeros(3))
    monkeypatch.setattr(sounddevice.OutputStream, "write_available", property(unplugged))
    with pytest.raises(DeviceError, match="sound card coil: Unanticipated"):
        device.read(bench.now)
    device.close()


def test_without_its_library_it_is_refused_in_one_line() -> None:
    code = (
        "import sys; sys.modules['sounddevice'] = None\n"
        "from haptic_accel.devices import DeviceError\n"
        "from haptic_accel.devices.audio import AudioParameters, SoundCard\n"
        "try: SoundCard(AudioParameters(), 1e-3)\n"
        "except DeviceError as error: print(error)"
    )
    done = python("-c", code, check=True)
    needs = "needs sounddevice and PortAudio: pip install 'haptic_accel[audio]'"
    assert done.stdout == f"audio: {needs}\n"


moments = st.tuples(st.floats(0.0, 1.0), st.floats(-10.0, 10.0))
forces = st.lists(moments, max_size=8, unique_by=lambda force: force[0])


@given(forces, st.integers(1, 40), st.integers(1, 40))
def test_the_impulse_is_that_of_the_held_forces(
    due: list[tuple[float, float]], first: int, second: int
) -> None:
    held = HeldForce()
    for each in due:
        held.put(each[0], [each[1]])
    means = [held.means(0.0, 2.0 * first, first) * 0.5 / first]
    means.append(held.means(0.5, 2.0 * second, second) * 0.5 / second)
    steps = [*sorted(due), (1.0, 0.0)]
    expected = sum(force * (end - start) for (start, force), (end, _) in pairwise(steps))
    assert np.concatenate(means).sum() == pytest.approx(expected, abs=1e-9)
