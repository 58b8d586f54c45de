# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bring-up of emulated boards, by a person whose hands are the emulator's keys."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp
import pytest
import yaml

from browsing import messages
from haptic_accel.core.process import DONE, INTERRUPTED, WRONG_ARGUMENTS
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.devices.serial.protocol import FULL_SCALE
from haptic_accel.kits.bringup.bench import STEPS
from haptic_accel.setup.files import note_step, noted_steps, read_parameter_file
from refusals import assert_refused, rows
from running import Command, Start, piped, python
from sound_cards import NAME, sound_card, sound_world
from terminals import Terminal

WORDS = ["-m", "haptic_accel.cli.main", "bringup"]
PORTS = "ports:=boards/slave,boards/master"


class Hands:
    """A person who does what is asked; each answer as asked for."""

    def __init__(self, boards: Terminal) -> None:
        self._boards = boards

    def press(self, key: bytes) -> None:
        self._boards.press(key)
        time.sleep(0.3)  # samples of before have arrived

    def meter(self) -> str:
        count = self._boards.text.count("current ")
        self._boards.press(b"m")
        self._boards.wait_for("current ", count + 1)
        self._boards.wait_for(" A\r\n", count + 1)
        return re.findall(r"current (\S+) A", self._boards.text)[-1]

    def answer(self, request: str) -> str | None:
        """Do what is asked; return the answer, None where there is nothing to type."""
        acts: dict[str, Callable[[], str | None]] = {
            "upwards": lambda: self.press(b"u") or "",
            "downwards": lambda: self.press(b"d") or "",
            "tap the handle": lambda: self.press(b"h"),
            "tap the tool": lambda: self.press(b"t"),
            "type the current": self.meter,
            "pull the USB": lambda: self.press(b"x"),
            "plug it in": lambda: None,
            "try again, or type s": lambda: "s",
            "try again": lambda: "",
        }
        for words, act in acts.items():
            if words in request:
                return act()
        self.press(b"l")
        return ""


def bring_up(folder: Path, hands: Hands | CardHands, *words: str) -> tuple[int, list[str]]:
    lines = []
    with piped(folder, *WORDS, *words) as command:
        assert command.stdin
        assert command.stdout
        for line in command.stdout:
            lines.append(line.rstrip())
            if line.startswith("> ") and (answer := hands.answer(line)) is not None:
                command.stdin.write(f"{answer}\n")
                command.stdin.flush()
    return command.returncode, lines


@pytest.mark.live
@pytest.mark.slow
def test_unknown_boards_become_a_rig_in_five_steps(
    terminals: Any, domain: int, tmp_path: Path
) -> None:
    words = ("-m", "haptic_accel.cli.main", "emulate", "serial", "folder:=boards")
    boards = terminals(*words, "fault_seconds:=3")
    boards.wait_for("keys: ")
    hands = Hands(boards)
    short = tmp_path / "short.yaml"
    short.write_text("/**/identifier: {ros__parameters: {trials: 1}}\n", encoding="utf-8")
    status, lines = bring_up(tmp_path, hands, PORTS, "params_file:=short.yaml")
    text = "\n".join(lines)
    assert status == 0, text
    assert lines[-1] == "next: haptic-accel teleop params_file:=rig.yaml controller:=adaptive"
    for passed in ("of the handle", "taps on the tool", "current 0.1 A", "forwards", "axis z"):
        assert any(line.startswith("ok: ") and passed in line for line in lines), text
    # The boards and the handle are those that are emulated.
    values = read_parameter_file(tmp_path / "rig.yaml")
    truth = RigParameters().master
    assert values["master_device"]["serial.port"] == str(tmp_path / "boards" / "master")
    assert values["master_device"]["serial.calibration.gain"] == pytest.approx(
        truth.accelerometer.range / FULL_SCALE, rel=5e-3
    )
    found = values["compensator"]["plant.handle.m_h"]
    assert found == pytest.approx(MasterRigParameters().handle.m_h, rel=0.1)
    steps = ("connect", "calibrate", "make_safe", "identify", "prove")
    assert (*noted_steps(tmp_path / "rig.yaml"),) == steps
    # What is done is not done again.
    status, lines = bring_up(tmp_path, hands)
    assert status == 0
    assert sum(line.startswith("done ") for line in lines) == 5
    assert not any(line.startswith("> ") for line in lines)


@pytest.mark.quiet
def test_without_boards_it_says_what_to_plug_in_and_ends(tmp_path: Path) -> None:
    done = python(*WORDS, "ports:=nowhere", cwd=tmp_path, input="")
    assert done.returncode == 1
    assert "NOT PASSED: " in done.stdout
    assert "nowhere: there is no such port" in done.stdout
    assert done.stderr.startswith("haptic-accel: the input ended")


# At a page


class AtPage:
    """A person at the page of a bring-up."""

    def __init__(self, command: Command) -> None:
        self._address = command.wait_for("^http").split()[0]
        self._number = 0

    def asked(self) -> dict[str, Any]:
        """Return the state that shows the next request."""
        state = asyncio.run(self._look())
        self._number = state["number"]
        return state

    def answer(self, text: str) -> None:
        """Answer the request that was shown."""
        asyncio.run(self._send(f"{self._number}:{text}"))

    async def _look(self) -> dict[str, Any]:
        async for message in messages(self._address):
            if message.type is aiohttp.WSMsgType.TEXT:
                state: dict[str, Any] = json.loads(message.data)
                if state["asks"] and state["number"] > self._number:
                    return state
        raise AssertionError

    async def _send(self, value: str) -> None:
        command = {"action": "answer", "value": value}
        async with (
            aiohttp.ClientSession(headers={"Origin": self._address.rstrip("/")}) as session,
            session.post(f"{self._address}command", json=command) as answer,
        ):
            assert answer.status == 200, await answer.text()


@pytest.fixture
def at_page(
    haptic_accel: Start, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[Command, AtPage]]:
    """Start a bring-up at a page."""
    for screen in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(screen, raising=False)

    def started(*words: str) -> tuple[Command, AtPage]:
        command = haptic_accel("bringup", "--page", *words)
        return command, AtPage(command)

    return started


@pytest.mark.quiet
def test_a_page_answers_and_the_terminal_has_the_same_lines(at_page: Callable[..., Any]) -> None:
    command, person = at_page("ports:=nowhere")
    first = person.asked()
    assert first["request"] == "press Enter to try again"
    assert [line["kind"] for line in first["lines"]] == ["failed", "plain", "failed", "plain"]
    person.answer("")
    second = person.asked()
    assert len(second["lines"]) == 2 * len(first["lines"])
    for line in second["lines"]:
        command.wait_for(f"^{re.escape(line['text'])}$")
    assert command.end(signal.SIGINT) == INTERRUPTED
    assert "Traceback" not in command.text


@pytest.mark.quiet
@pytest.mark.parametrize("end", ["page", "Ctrl-C"])
def test_a_page_shows_the_next_command_until_it_is_closed(
    at_page: Callable[..., Any], tmp_path: Path, end: str
) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text("/**: {ros__parameters: {rate: 1000.0}}\n", encoding="utf-8")
    for step in STEPS:
        note_step(rig, step, "2026-11-26 12:00: nothing to do")
    command, person = at_page()
    assert person.asked()["ended"] == command.wait_for("^next: ")
    if end == "page":
        person.answer("")
    assert command.end(None if end == "page" else signal.SIGINT) == DONE


@pytest.mark.quiet
def test_a_page_shows_why_a_bring_up_failed(at_page: Callable[..., Any]) -> None:
    command, person = at_page("master:=can", "slave:=simulated")
    reason = person.asked()["ended"]
    assert reason.startswith("can.interface")
    person.answer("")
    assert command.end() == WRONG_ARGUMENTS
    assert command.lines.count(reason) == 1


@pytest.mark.slow  # a busy machine loses blocks of an emulated card: measured again
@pytest.mark.live
def test_a_coil_on_a_sound_card_is_made_safe(tmp_path: Path) -> None:
    given = {"/**": {"latency": 5}, "/**/master_device": {"audio": {"device": NAME}}}
    content = {node: {"ros__parameters": values} for node, values in given.items()}
    (tmp_path / "card.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    devices = ["master:=simulated", "slave:=simulated", "actuator:=audio"]
    with sound_card(tmp_path):
        done = python(*WORDS, *devices, "params_file:=card.yaml", cwd=tmp_path, input="\n")
    assert done.returncode == 1
    assert f"handle: sound card {NAME}, channel 1" in done.stdout
    passed = [line for line in done.stdout.splitlines() if line.startswith("ok: ")]
    for measured in ("moves the handle", "forwards", "per newton", "emergency stop"):
        assert any(measured in line for line in passed), done.stdout
    assert [*noted_steps(tmp_path / "rig.yaml")] == ["connect", "calibrate", "make_safe"]


class CardHands:
    """Person with handle and tool on a sound card: answers, and taps until both were seen.

    Parameters
    ----------
    world : Popen
        Handle, tool and sensors.
    """

    def __init__(self, world: subprocess.Popen[str]) -> None:
        self.world = world
        self.taps = False
        self.tries = 4  # of an identification: a busy machine loses blocks, which is refused
        threading.Thread(target=self._tap, daemon=True).start()

    def _tap(self) -> None:
        while self.world.poll() is None:
            if self.taps:
                self.world.send_signal(signal.SIGUSR1)
            time.sleep(0.3)

    def answer(self, line: str) -> str | None:
        """Return the answer to a request; None for an action."""
        self.taps = "tap the" in line
        if self.taps:
            return None
        if "type s to stop" in line:
            self.tries -= 1
            return "" if self.tries else "s"
        return "s" if "type s" in line else ""  # 5 % are not reached beside the world


@pytest.mark.slow  # a busy machine loses blocks of an emulated card: measured again
@pytest.mark.live
def test_handle_and_tool_on_a_sound_card_become_a_rig(
    domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs = {"device": "system", "block": 128, "scales": "100", "ac_corner": 10.0}
    given = {
        "/**": {"latency": 17},
        "/**/master_device": {"audio": inputs | {"full_scale": 5.0}},
        "/**/slave_device": {"audio": inputs | {"inputs": "2"}},
        "/**/identifier": {"trials": 1},
    }
    content = {node: {"ros__parameters": values} for node, values in given.items()}
    (tmp_path / "card.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    devices = ["actuator:=audio", "accelerometers:=audio", "master:=none", "slave:=none"]
    with sound_world(tmp_path) as (environment, world):
        for name in ("JACK_DEFAULT_SERVER", "JACK_NO_START_SERVER"):
            monkeypatch.setenv(name, environment[name])
        status, lines = bring_up(tmp_path, CardHands(world), *devices, "params_file:=card.yaml")
    text = "\n".join(lines)
    assert status == 0, text
    for passed in ("taps on the tool", "full scale 100", "forwards", "in time"):
        assert any(line.startswith("ok: ") and passed in line for line in lines), text
    assert "% with adaptive" in text
    found = read_parameter_file(tmp_path / "rig.yaml")["compensator"]["plant.handle.m_h"]
    assert found == pytest.approx(MasterRigParameters().handle.m_h, rel=0.1)


@pytest.mark.quiet
def test_arms_on_can_are_connected_with_what_their_file_says(start: Any, tmp_path: Path) -> None:
    arms = start("-m", "haptic_accel.cli.main", "emulate", "can", "folder:=arms")
    arms.wait_for("teleop master:=can")
    words = ("master:=can", "slave:=can", "params_file:=arms/can.yaml")
    done = python(*WORDS, *words, cwd=tmp_path, input="\n\n")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("move it away, to the left and up") == 2
    assert "ok: no accelerometer on both arms" in done.stdout
    values = read_parameter_file(tmp_path / "rig.yaml")
    assert values["master_device"]["can.channel"] == str(tmp_path / "arms" / "master")


REFUSED = {
    "bringup redo:=paint": "redo = 'paint': must be one of ...",
    "bringup master:=violin": "master = 'violin': must be one of simulated, ...",
    "bringup params_file:=nowhere.yaml": "params_file: .../nowhere.yaml: ...: No such file ...",
    "bringup rate:=5": "rate = 5.0: must be from 100 to 10000 Hz",
}
"""Line of each command line, in which ... stands for any text."""


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)
