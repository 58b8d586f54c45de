# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A sound card as the whole bench: a handle and a tool behind JACK, without hardware."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import threading
import time as clocks
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from port_audio import BLOCK, RATE, PortAudio, Stream

from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.model import LATER, HandleParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices import sound_bench
from haptic_accel.devices.audio import (
    JACK,
    AudioActuator,
    AudioParameters,
    InputParameters,
    recorded,
)
from haptic_accel.devices.interface import DeviceError, NoParameters
from haptic_accel.setup.node_parameters import build_device, build_parameters
from nightly import rest_slow
from running import Start, nodes_of, wait_until
from sound_cards import SOUND_RIG, sound_world


@settings(max_examples=10)
@given(st.floats(-3e-4, 3e-4), st.floats(0.0, 1e5), st.integers(0, 2**32 - 1))
def test_a_cards_clock_is_known_from_late_readings(drift: float, start: float, seed: int) -> None:
    late = np.random.default_rng(seed).exponential(2e-4, 20_000)
    clock, true = sound_bench.CardClock(RATE), RATE * (1 + drift)
    errors = []
    for tick, delay in enumerate(late):
        now = start + tick * 1e-3 + delay
        count = int((now - start) * true) // BLOCK * BLOCK
        clock.observe(count, now)
        errors.append(clock.time(count) - (start + count / true))
    assert np.abs(errors[10_000:]).max() < 1e-4
    assert clock.jumps <= 1  # at the start, if the first reading was late
    assert clock.drift == pytest.approx(-drift, abs=5e-5)
    assert clock.index(clock.time(12_345.5)) == pytest.approx(12_345.5)


@pytest.mark.parametrize("samples", [RATE // 50, BLOCK])
def test_lost_samples_begin_the_clock_again(samples: int) -> None:
    clock = sound_bench.CardClock(RATE)
    for tick in range(1000):
        lost = 0 if tick < 500 else samples
        clock.observe(48 * tick - lost, 10.0 + tick * 1e-3)
    assert clock.jumps == 1
    assert clock.drift == pytest.approx(0.0, abs=1e-9)
    assert clock.time(48 * 999 - samples) == pytest.approx(10.999)


def test_an_answer_is_found_after_its_delay_and_silence_is_none() -> None:
    noise = np.random.default_rng(0).uniform(-1, 1, 20_000)
    silence = np.random.default_rng(1).normal(0, 1, (22_000, 1))
    answer = silence.copy()
    answer[777:20_777, 0] -= noise
    delay, strength = sound_bench.likest(noise, answer)
    assert delay == 777
    assert strength == pytest.approx(1.0, abs=0.05)
    with pytest.raises(DeviceError, match="does not answer the coil .correlation 0.0"):
        sound_bench.likest(noise, silence)


@pytest.mark.parametrize(
    ("given", "refused"),
    [
        (
            {"inputs": "1, 2", "scales": "1 1"},
            "audio.inputs = '1, 2': must be one channel, or three",
        ),
        (
            {"inputs": "1, x", "scales": "1"},
            "audio.inputs = '1, x': must be different whole numbers",
        ),
        ({}, "audio.scales = '': must be the acceleration at full scale"),
        ({"scales": "1, 2"}, "audio.scales"),
    ],
)
def test_wrong_inputs_are_refused(given: dict[str, Any], refused: str) -> None:
    arm = sound_bench.NoArm(NoParameters(), 1e3, 0)
    with pytest.raises(ParameterError, match=re.escape(refused)):
        sound_bench.CardAccelerometer(InputParameters(**given), 1000.0, arm, False)


def sensor_on(card: PortAudio, patched: pytest.MonkeyPatch, kind: type = InputParameters) -> Any:
    """Return the accelerometer of a handle on a card."""
    patched.setattr("haptic_accel.devices.audio.sound_library", lambda: card)
    arm = sound_bench.NoArm(NoParameters(), 1e3, 0)
    return sound_bench.CardAccelerometer(kind(scales="100"), 1000.0, arm, to_base_axes=False)


HEARD = [(1.0, True), (-0.4, True), (0.1, False), (0.0, False)]


@pytest.mark.parametrize(("hears", "is_refused"), HEARD)
@pytest.mark.parametrize("is_first", [True, False])
def test_a_tool_that_answers_the_coil_is_refused(
    hears: float, is_refused: bool, is_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_accel.devices.audio.sound_library", PortAudio)
    arm = sound_bench.NoArm(NoParameters(), 1e3, 0)
    parameters = InputParameters(inputs="2", scales="50")
    tool = sound_bench.CardAccelerometer(parameters, 1000.0, arm, to_base_axes=True)
    handle = sensor_on(PortAudio(), monkeypatch)
    noise = np.random.default_rng(0).uniform(-1, 1, 20_000)
    answer = np.random.default_rng(1).normal(0, 0.1, (22_000, 2))
    answer[500:20_500, 0] += noise
    answer[500:20_500, 1] += 2.0 * hears * noise  # of half the scale
    said = "tool's accelerometer answers the coil with"
    handle.open()
    try:
        if is_first:
            tool.open()
        refused = False
        try:
            handle.card.take_answer(noise, answer, 100.0)
            if not is_first:
                tool.open()
        except DeviceError as error:
            refused = said in str(error)
        assert refused == is_refused
    finally:
        tool.close()
        handle.close()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -1.5, 1.0])
def test_a_sample_that_cannot_be_spoils_no_later_one(
    value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = sensor_on(PortAudio(spoiled=value), monkeypatch)
    device.open()
    seen: list[Any] = []
    while len(seen) < 80:
        time = clocks.monotonic()
        while (sample := device.read(time)) is LATER:
            clocks.sleep(1e-3)
        seen.append(sample and sample.acceleration[ACTUATOR_AXIS])
    felt = np.array([each for each in seen if each is not None])
    assert np.isfinite(felt).all()
    assert felt[-10:] == pytest.approx(25.0)
    wrong = value != 1.0
    assert device.counters()["audio_wrong"] == wrong
    assert ("audio.inputs: 1 samples not finite" in device.problem) == wrong
    device.close()


@pytest.mark.parametrize(
    ("card", "refused"),
    [
        (PortAudio(gives=False), "sound card card: nothing for "),
        (PortAudio(plays=False), "sound card card: plays nothing of what it is given"),
        (PortAudio(outputs=1), "audio.channels = '2': channel 2 must be at most 1"),
        (PortAudio(outputs=0), "audio.device = '': card has 0 outputs, must have at least 1"),
        (PortAudio(outputs=1, host=JACK), "audio.device = '': card has 1 outputs, must have at "),
    ],
)
def test_a_card_that_cannot_be_a_bench_is_refused_in_one_line(
    card: PortAudio, refused: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_accel.devices.audio.FIRST_BLOCK", 0.3)
    sensor = sensor_on(card, monkeypatch, AudioParameters)
    output = partial(sound_bench.BenchOutput, sensor=sensor)
    device = AudioActuator(AudioParameters(channels="2"), 1e3, sensor, 9, card=output)
    with pytest.raises((DeviceError, ParameterError)) as found:
        device.open()
    assert str(found.value).startswith(refused)
    assert str(found.value).isprintable()


SOUND = np.full((48, 1), 0.5)


@pytest.mark.parametrize(
    ("recordings", "refused"),
    [
        ([("input overflow", SOUND), (None, SOUND)], ""),
        ([("input overflow", SOUND)] * 5, "lost samples .input overflow. while it recorded"),
        ([(None, np.append(SOUND, [[np.nan]], 0))], "gave samples that are not finite numbers"),
        ([None], "gives no samples within 0.1 s"),
    ],
)
def test_a_recording_is_whole_or_made_again_or_refused(
    recordings: list[Any], refused: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    card = PortAudio(recordings=recordings)
    monkeypatch.setattr("haptic_accel.devices.audio.sound_library", lambda: card)
    monkeypatch.setattr("haptic_accel.devices.audio.FIRST_BLOCK", 0.1)
    if refused:
        with pytest.raises(DeviceError, match=f"^device = 'card': {refused}"):
            recorded("card", 1e-3, 1)
    else:
        assert recorded("card", 1e-3, 1)[0] == pytest.approx(SOUND)


def test_a_card_whose_server_is_gone_holds_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haptic_accel.devices.audio.LONGEST_END", 0.05)
    device = sensor_on(card := PortAudio(), monkeypatch)
    device.open()
    monkeypatch.setattr(Stream, "close", lambda _: threading.Event().wait())
    left_out: list[Any] = []
    monkeypatch.setattr("atexit.unregister", left_out.append)
    device.close()
    assert left_out == [card._exit_handler]  # which would wait at the end of the process, too


def test_no_arm_without_accelerometers_is_refused() -> None:
    own, options = build_parameters("slave_device", {"device": "none"})
    with pytest.raises(
        ParameterError, match="device = none: must come with accelerometers:=audio"
    ):
        build_device("slave_device", own, options)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Run handle and tool behind a card; yield the parameter file of the rig."""
    with sound_world(tmp_path) as (environment, _):
        for name in ("JACK_DEFAULT_SERVER", "JACK_NO_START_SERVER"):
            monkeypatch.setenv(name, environment[name])
        file = tmp_path / "rig.yaml"
        file.write_text(SOUND_RIG)
        yield file


LATENCY = "latency:=17"


@pytest.mark.slow  # a busy machine loses blocks of an emulated card: measured again
@pytest.mark.live
def test_a_handle_is_identified_through_a_card(bench: Path, start: Start) -> None:
    command = start(
        *("-m", "haptic_accel.cli.main", "identify", f"params_file:={bench}", "rig:=ideal"),
        *(LATENCY, "trials:=2", "--json", "found.json", "--update", bench),
    )
    assert command.end() == 0, command.text
    found = json.loads((bench.parent / "found.json").read_text())
    mass = found["parameters"]["m_h"]["value"]
    assert mass == pytest.approx(HandleParameters().m_h, rel=0.05)
    assert abs(found["delay_us"]) < 150.0


@pytest.mark.live
@pytest.mark.parametrize("end", rest_slow([signal.SIGINT, signal.SIGKILL]))
def test_a_card_that_is_lost_is_said_and_leaves_no_force_and_no_process(
    bench: Path, start: Start, domain: int, end: signal.Signals
) -> None:
    command = start(
        *("-m", "haptic_accel.cli.main", "teleop", f"params_file:={bench}", "rig:=ideal"),
        *(LATENCY, "controller:=inverse", "record:=false"),
    )
    command.wait_for("engaged")
    subprocess.run(["pkill", "-f", f"jackd.*-n {os.environ['JACK_DEFAULT_SERVER']} "], check=True)
    command.wait_for("master_device.*sound card system: .*: device closed, no force")
    # PortAudio cannot close a stream without JACK's server, unlike without a card of ALSA.
    command.end(end)
    wait_until(lambda: nodes_of(domain) == {}, "no process is left")
