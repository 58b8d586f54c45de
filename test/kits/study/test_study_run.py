# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel study run`` and ``resume`` with a page, on a rig without a graph."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from kits.study.participating import PageRig
from kits.study.studies import TEXT, write_study

from haptic_accel.kits.study.folder import Study
from haptic_accel.kits.study.protocol import Condition, Protocol
from haptic_accel.kits.study.session import SimulatedRig
from haptic_accel.kits.study.trials import COMPLETE, PresentedStimulus, UndeliveredError
from verbs import next_command, output_of, refusal, status_of

Act = Callable[[Mapping[str, Any]], tuple[str, Any] | None]
"""Returns what a page sends at a screen, or nothing."""


class StandIn(PageRig):
    """Rig in place of the live graph, which waits once before a stimulus."""

    trouble: str = ""

    def __init__(self, protocol: Protocol, folder: Path) -> None:
        super().__init__()
        assert folder.is_dir()
        self._rig = SimulatedRig(protocol)

    def __enter__(self) -> StandIn:
        if self.trouble:
            raise UndeliveredError(self.trouble)
        return self

    def __exit__(self, *_: object) -> None:
        pass

    @property
    def exposure(self) -> float:
        return self._rig.exposure

    def present(
        self, condition: Condition, seconds: float, begun: Callable[[], None]
    ) -> PresentedStimulus:
        return self._rig.present(condition, seconds, begun)


def first_answer(screen: Mapping[str, Any]) -> tuple[str, Any] | None:
    if screen["kind"] == "stimulus":
        return "seen", [screen["id"], None]
    if screen["answers"]:
        return "answer", [screen["id"], screen["answers"][0], 0.5]
    return None


class Visitor:
    """Page of a participant, without a browser: acts once at each screen.

    Attributes
    ----------
    kinds : list of str
        Screens that were seen.
    """

    def __init__(self, act: Act = first_answer) -> None:
        self.kinds: list[str] = []
        self._act = act
        self._thread = threading.Thread()

    def open(self, address: str, *, opened: bool = True) -> None:
        """Visit a page on a thread of its own."""
        self._thread = threading.Thread(target=lambda: asyncio.run(self._visit(address)))
        self._thread.start()

    def close(self) -> None:
        self._thread.join(10.0)
        assert not self._thread.is_alive()

    async def _visit(self, address: str) -> None:
        origin = {"Origin": address.rstrip("/")}
        async with aiohttp.ClientSession(address, headers=origin) as browser:
            await self._send(browser, "open", ["page"])
            seen = set()
            async with browser.ws_connect("/live") as live:
                async for message in live:
                    state = json.loads(message.data) if message.data[:1] == "{" else {}
                    screen = state.get("screen")
                    if screen and screen["id"] not in seen:
                        seen.add(screen["id"])
                        self.kinds.append(screen["kind"])
                        if sent := self._act(screen):
                            await self._send(browser, *sent)

    async def _send(self, browser: aiohttp.ClientSession, action: str, value: Any) -> None:
        content = {"action": action, "value": json.dumps(value)}
        async with browser.post("/command", json=content) as answer:
            assert answer.status == 200, await answer.text()


Visiting = Callable[..., Visitor]


@pytest.fixture
def visitor(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Act], Visitor]]:
    """Return what makes a visitor open the page of the next command."""
    visitors: list[Visitor] = []

    def visit(act: Act = first_answer) -> Visitor:
        visitors.append(Visitor(act))
        monkeypatch.setattr("haptic_accel.commands.show_page", visitors[-1].open)
        return visitors[-1]

    monkeypatch.setattr("haptic_accel.kits.study.live.LiveRig", StandIn)
    yield visit
    for each in visitors:
        each.close()


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return write_study(tmp_path / "study", TEXT.replace("repeats: 12", "repeats: 6"))


def words(study: Study, verb: str = "run") -> tuple[object, ...]:
    return "study", verb, study.folder, "--participant", "P07"


def test_a_participant_goes_through_a_study_whose_log_is_verified_by_its_head(
    study: Study, visitor: Visiting, capsys: pytest.CaptureFixture[str]
) -> None:
    visited = visitor()
    assert status_of(*words(study)) == 0
    shown = capsys.readouterr()
    assert "P07: complete" in shown.out
    for word in ("adaptive", "different", "none"):
        assert word not in shown.out + shown.err
    (session,) = study.sessions
    assert (session.ended, len(session.counted)) == (COMPLETE, 6)
    visited.close()
    # A page that is quick sees the session wait before it begins.
    assert next(kind for kind in visited.kinds if kind != "wait") == "consent"
    assert visited.kinds[-1] == "end"
    noted = shown.out.partition("for the notebook: P07, line ")[2]
    line, _, head = noted.strip().partition(", ")
    verified = " ".join(output_of("study", "verify", study.folder).split())
    assert head in verified
    assert f"│ {line} │" in verified
    assert "1 logs do not contradict the journal" in verified


def test_the_participant_stops_and_goes_on(study: Study, visitor: Visiting) -> None:
    def stop(screen: Mapping[str, Any]) -> tuple[str, Any] | None:
        return ("stop", None) if screen["kind"] == "break" else first_answer(screen)

    visitor(stop)
    shown = output_of(*words(study), status=1)
    assert "P07: stopped by the participant" in shown
    assert next_command(shown) == [str(word) for word in words(study, "resume")]
    visited = visitor()
    assert status_of(*next_command(shown)) == 0
    assert study.sessions[0].ended == COMPLETE
    visited.close()
    assert "consent" not in visited.kinds


def test_ctrl_c_ends_a_sitting(study: Study, visitor: Visiting) -> None:
    def interrupt(screen: Mapping[str, Any]) -> tuple[str, Any] | None:
        if screen["kind"] == "question":
            os.kill(os.getpid(), signal.SIGINT)
            return None
        return first_answer(screen)

    visitor(interrupt)
    assert status_of(*words(study)) == 130
    assert study.sessions[0].ended == "stopped by the operator"


@pytest.mark.usefixtures("visitor")
def test_a_run_that_is_refused_leaves_no_participant(
    study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StandIn, "trouble", "graph: its arms are not engaged after 60 s")
    assert refusal(*words(study), status=1) == StandIn.trouble
    assert study.sessions == []
    assert not study.participant_folder("P07").exists()
    monkeypatch.setattr(StandIn, "trouble", "")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert status_of(*words(study), "--port", taken.getsockname()[1]) == 1
    assert not study.participant_folder("P07").exists()
    study.begin("P07").close()
