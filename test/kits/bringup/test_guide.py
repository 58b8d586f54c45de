# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's side of a bring-up: what pages see, and whose answer counts."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices.observed import Observation
from haptic_accel.kits.bringup.guide import KEPT_LINES, MOST_POINTS, SHOWN, Guide
from haptic_accel.scope.server import CommandError, as_json
from running import PATIENCE, wait_until

STEPS = {"connect": "find the boards", "make_safe": "stop and silence"}


class Signal:
    """Live signal that stands still."""

    def __init__(self, acceleration: FloatArray) -> None:
        self.acceleration = acceleration

    def last(self, seconds: float) -> Observation:
        count = len(self.acceleration)
        place, force = np.full((count, 3), np.nan), np.zeros(count)
        return Observation(count / seconds, self.acceleration, place, force)


@pytest.fixture
def guide() -> Guide:
    return Guide(STEPS)


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor() as made:
        yield made


def answer(guide: Guide, value: Any, action: str = "answer") -> str:
    return asyncio.run(guide.act(action, value))


def asked(
    guide: Guide, pool: ThreadPoolExecutor, request: str, skip: str = ""
) -> tuple[Future[str], int]:
    """Ask on another thread; return what will be answered, and the request's number."""
    answered = pool.submit(guide.ask, request, skip)
    wait_until(lambda: guide.state()["asks"], request)
    return answered, guide.state()["number"]


def test_steps_are_done_now_or_waiting(guide: Guide) -> None:
    assert [step["state"] for step in guide.state()["steps"]] == ["waiting", "waiting"]
    guide.begin(2, "make safe", "stop and silence")
    assert guide.state()["steps"] == [
        {"name": "connect", "purpose": "find the boards", "state": "done"},
        {"name": "make safe", "purpose": "stop and silence", "state": "now"},
    ]


def test_lines_are_those_of_the_step_and_the_newest(guide: Guide) -> None:
    for line in ("ok: at rest", "NOT PASSED: noise 3 m/s^2", "  fix the sensor"):
        guide.tell(line)
    assert [line["kind"] for line in guide.state()["lines"]] == ["ok", "failed", "plain"]
    guide.begin(2, "make safe", "")
    assert guide.state()["lines"] == []
    for number in range(2 * KEPT_LINES):
        guide.tell(str(number))
    lines = guide.state()["lines"]
    assert (len(lines), lines[-1]["text"]) == (KEPT_LINES, str(2 * KEPT_LINES - 1))


def test_an_answer_reaches_the_request_that_waits(guide: Guide, pool: ThreadPoolExecutor) -> None:
    for text in ("0.1", "", "a:b"):
        answered, number = asked(guide, pool, "type the current")
        assert guide.state()["request"] == "type the current"
        assert answer(guide, f"{number}:{text}") == ""
        assert answered.result(PATIENCE) == text
        assert (guide.state()["request"], guide.state()["asks"]) == (None, False)


def test_of_two_answers_the_first_counts_and_none_is_kept_for_the_next_request(
    guide: Guide, pool: ThreadPoolExecutor
) -> None:
    with pytest.raises(CommandError, match="request 1: is answered, or was never made"):
        answer(guide, "1:early")
    answered, number = asked(guide, pool, "hold it upwards")
    answer(guide, f"{number}:first")
    with pytest.raises(CommandError):
        answer(guide, f"{number}:second")
    assert answered.result(PATIENCE) == "first"
    answered, after = asked(guide, pool, "hold it downwards")
    assert after != number
    with pytest.raises(CommandError):
        answer(guide, f"{number}:second")
    assert not answered.done()
    answer(guide, f"{after}:")
    assert answered.result(PATIENCE) == ""


def test_answers_at_the_same_moment_are_one(guide: Guide, pool: ThreadPoolExecutor) -> None:
    answered, number = asked(guide, pool, "press Enter")
    together = threading.Barrier(4)

    def press(name: int) -> str:
        together.wait()
        try:
            return answer(guide, f"{number}:{name}") or str(name)
        except CommandError:
            return ""

    assert list(filter(None, pool.map(press, range(4)))) == [answered.result(PATIENCE)]


@pytest.mark.parametrize(("action", "value"), [("stop", "1:"), ("answer", "1"), ("answer", True)])
def test_what_is_no_answer_is_refused(guide: Guide, action: str, value: object) -> None:
    with pytest.raises(CommandError) as refused:
        answer(guide, value, action)
    assert refused.value.status == 400


@pytest.mark.parametrize("skip", ["go on all the same", "stop", ""])
def test_a_page_offers_to_go_on_where_the_request_does(
    guide: Guide, pool: ThreadPoolExecutor, skip: str
) -> None:
    answered, number = asked(guide, pool, "press Enter to try again", skip)
    assert guide.state()["skip"] == (skip or None)
    answer(guide, f"{number}:s")
    assert answered.result(PATIENCE) == "s"


def test_an_action_is_asked_for_until_something_is_told(guide: Guide) -> None:
    guide.request("tap the handle a few times")
    state = guide.state()
    assert (state["request"], state["asks"]) == ("tap the handle a few times", False)
    guide.tell("ok: taps on the handle are in its signal")
    assert guide.state()["request"] is None


def test_the_signal_has_few_points_with_its_peaks_and_its_gaps(guide: Guide) -> None:
    assert guide.state()["signal"] is None
    signal = np.zeros(round(SHOWN * 10_000))
    signal[1234], signal[2345] = 30.0, -20.0
    signal[3000:4000] = np.nan
    guide.show(Signal(signal))
    shown = json.loads(as_json(guide.state()))["signal"]
    points = shown["acceleration"]
    assert (shown["rate"], shown["missing"]) == (10_000.0, 1000)
    assert len(points) <= MOST_POINTS
    there = [value for value in points if value is not None]
    assert (max(there), min(there)) == (30.0, -20.0)
    assert (len(points) - len(there)) / len(points) == pytest.approx(0.2, abs=0.02)
    guide.show(None)
    assert guide.state()["signal"] is None


def test_few_samples_are_shown_as_they_are(guide: Guide) -> None:
    guide.show(Signal(np.arange(50.0)))
    assert guide.state()["signal"]["acceleration"] == list(range(50))


@pytest.mark.parametrize("done", [True, False])
def test_the_end_is_shown_until_a_page_closes_it(
    guide: Guide, pool: ThreadPoolExecutor, done: bool
) -> None:
    guide.begin(2, "make safe", "")
    closed = pool.submit(guide.end, "next: haptic-accel teleop", done=done)
    wait_until(lambda: guide.state()["asks"], "the end")
    state = guide.state()
    assert state["ended"] == state["request"] == "next: haptic-accel teleop"
    assert [step["state"] for step in state["steps"]] == ["done", "done" if done else "now"]
    answer(guide, f"{state['number']}:")
    closed.result(10)


def test_there_is_neither_a_scene_nor_a_hand(guide: Guide) -> None:
    with pytest.raises(ParameterError, match="scene"):
        guide.scene()
    assert guide.lead(0.0, 0.0).startswith("hand")
