# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel doctor audio`` with sound cards of ALSA's plug-ins."""

from __future__ import annotations

import io
import json
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.process import INTERRUPTED
from haptic_accel.devices.audio import JACK, ListedCard
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup
from running import PATIENCE, piped
from sound_cards import QUAD, RATE, received_of_four, sound_card
from verbs import refusal, status_of

pytestmark = pytest.mark.quiet


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    with sound_card(tmp_path):
        yield tmp_path


def doctor(folder: Path, *words: str) -> subprocess.Popen[str]:
    return piped(folder, "-m", "haptic_accel.cli.main", "doctor", "audio", *words)


def ended(command: subprocess.Popen[str]) -> list[str]:
    text, _ = command.communicate(timeout=PATIENCE)
    assert "Traceback" not in text
    return text.splitlines()


Tried = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def tried(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Tried:
    """Run the verb in this process: ``tried(ANSWERS, *WORDS)`` returns its status and lines."""
    monkeypatch.chdir(folder)

    def run(answers: str, *words: str) -> tuple[int, list[str]]:
        monkeypatch.setattr("sys.stdin", io.StringIO(answers))
        status = status_of("doctor", "audio", *words)
        shown = capsys.readouterr()
        return status, (shown.out + shown.err).splitlines()

    return run


def test_cards_are_listed_with_what_is_in_between(folder: Path, tried: Tried) -> None:
    status, lines = tried("", "--json", "cards.json")
    assert status == 0, lines
    assert lines[-1] == "next: haptic-accel doctor audio device:=stereo"
    found = json.loads((folder / "cards.json").read_text())["cards"]
    cards = {card["name"]: card for card in found}
    server = "ALSA's plug-in, or a sound server"
    expected = {"name": QUAD, "channels": 4, "rate": RATE, "server": "", "is_default": False}
    assert cards[QUAD] == expected
    assert cards["default"]["server"] == server
    assert cards["default"]["is_default"]
    row = next(line for line in lines if f" {QUAD} " in line)
    assert [cell.strip() for cell in row.strip("│").split("│")] == [QUAD, "nothing", "4", "44100"]


def test_the_channels_that_were_felt_are_written_into_the_file(folder: Path, tried: Tried) -> None:
    file = folder / "rig.yaml"
    file.write_text("coupler: {ros__parameters: {k_m: 300.0}}  # soft\n")
    words = f"device:={QUAD}", "preset:=exciter", "file:=rig.yaml"
    status, lines = tried("5\n\n3, 4\n", *words)
    assert status == 0, lines
    channels = [line for line in lines if line.startswith("channel")]
    assert channels == [f"channel {number}" for number in (1, 2, 3, 4)]
    assert "audio.channels = 5: must be at most 4" in lines
    assert any(line.startswith("to be identified: force at full scale") for line in lines)
    assert any(line.startswith("a first touch, not a bench") for line in lines)
    assert "# soft" in file.read_text()
    setup = Setup.of(GraphArguments.from_specified(params_file=str(file), controller="none"))
    own, options = setup.node("master_device")
    assert own.actuator_device == "audio"
    assert own.latency == setup.node("compensator")[0].latency == 5  # as sound_card.md states
    audio = options["audio"]
    assert (audio.preset, audio.device, audio.channels) == ("exciter", QUAD, "3, 4")


def test_a_tone_is_soft_rises_and_is_on_one_channel_only(folder: Path, tried: Tried) -> None:
    assert tried("4\n", f"device:={QUAD}")[0] == 0
    *others, tone = received_of_four(folder).T  # the last channel was the last to be opened
    assert not np.any(others)
    assert 0.05 < np.abs(tone).max() <= 0.1 + 1e-6
    assert np.abs(np.diff(tone)).max() < 1.01 * 0.1 * 2 * np.pi * 100 / RATE
    spectrum = np.abs(np.fft.rfft(tone))
    assert np.fft.rfftfreq(len(tone), 1 / RATE)[spectrum.argmax()] == pytest.approx(100, abs=1)
    assert not tone[-1000:].any()


@pytest.mark.parametrize(
    ("words", "answers", "told"),
    [
        (["preset:=dualsense"], "", "audio.device = 'DualSense': No output device matching"),
        ([f"device:={QUAD}"], "", "the input ended before a channel was named: nothing written"),
    ],
)
def test_what_cannot_be_tried_is_said_in_one_line(
    folder: Path, tried: Tried, words: list[str], answers: str, told: str
) -> None:
    status, lines = tried(answers, *words)
    assert status == 1
    assert lines[-1].startswith(f"haptic-accel: {told}"), lines
    assert not (folder / "audio.yaml").exists()


def test_an_interrupt_ends_the_tones_and_writes_nothing(folder: Path) -> None:
    command = doctor(folder, f"device:={QUAD}")
    assert command.stdout
    while "which one did you feel?" not in command.stdout.readline():
        pass
    command.send_signal(signal.SIGINT)
    assert "".join(ended(command)) == ""
    assert command.returncode == INTERRUPTED
    assert not (folder / "audio.yaml").exists()


@pytest.mark.parametrize("words", [(), ("preset:=dualsense",)])
def test_without_a_card_it_says_what_to_plug_in(
    folder: Path, words: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "nothing.conf").write_text("pcm.none { type hw  card 31 }")
    monkeypatch.setenv("ALSA_CONFIG_PATH", str(folder / "nothing.conf"))
    command = doctor(folder, *words)
    assert ended(command) == [
        "haptic-accel: no sound card with an output that can be used: stop JACK if it runs, plug a"
        " game controller in by a USB cable, or a card with an amplifier; in a container, let it"
        " have /dev/snd"
    ]
    assert command.returncode == 1


def listed(name: str, channels: int, server: str) -> ListedCard:
    return ListedCard(name, channels, RATE, server, is_default=False)


@pytest.mark.parametrize(
    ("cards", "advised"),
    [
        ([listed("system", 2, JACK)], "stop JACK if it runs"),
        ([listed("system", 2, JACK), listed("coil", 2, "")], "audio device:=coil"),
        ([listed("DualSense", 4, JACK), listed("coil", 2, "plug-in")], "audio device:=coil"),
        ([listed("DualSense", 2, ""), listed("coil", 2, "plug-in")], "audio device:=DualSense"),
        ([listed("coil", 2, ""), listed("DualSense", 4, "")], "audio preset:=dualsense"),
    ],
)
def test_what_is_advised_is_not_refused_next(
    cards: list[ListedCard],
    advised: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("haptic_accel.cli.doctor.audio.sound_cards", lambda: cards)
    status = status_of("doctor", "audio")
    said = capsys.readouterr()
    assert advised in (said.err if status else said.out)
    assert bool(status) == ("JACK" in advised)


def test_a_card_that_needs_more_latency_than_allowed_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_accel.devices.audio.BLOCKS_AHEAD", 40)
    monkeypatch.setattr("builtins.input", lambda _: "1")
    file = folder / "audio.yaml"
    told = refusal("doctor", "audio", f"device:={QUAD}", f"file:={file}", status=1)
    assert "sound card quad: needs latency:=61 with 64 samples a block, must be at most 20" in told
    assert not file.exists()
