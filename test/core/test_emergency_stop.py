# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Senders that may stop a node, and the time of its release."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.coupling import engagement

BUTTON = ["/button"]
ALONE: list[str] = []
LATER = 2 * max(engagement.RECENT, engagement.COUPLER_SILENCE)


class Run:
    """A node's stop whose time goes on as a test says."""

    def __init__(self, age: float = engagement.LATCHED_SETTLING) -> None:
        self.now = 100.0
        self.stop = engagement.EmergencyStop(self.now - age)

    def receive(self, *words: bool) -> None:
        for word in words:
            self.stop.receive(word, self.now)

    def released(self, publishers: list[str], seconds: float = 0.0) -> bool:
        """Let time pass and ask for the release; return whether it was granted."""
        self.now += seconds
        refusal = self.stop.release(self.now, publishers)
        assert self.stop.stopped is bool(refusal)
        return not refusal


def test_only_what_is_new_is_said_to_be() -> None:
    run = Run()
    assert not run.stop.stopped
    assert run.stop.receive(True, run.now)
    assert not run.stop.receive(True, run.now)
    assert not run.stop.receive_coupler(True, run.now)
    assert not run.stop.stop()
    assert run.stop.stopped


EVENTS: dict[str, Callable[[Run], object]] = {
    "true": lambda run: run.receive(True),
    "false": lambda run: run.receive(False),
    "coupler stopped": lambda run: run.stop.receive_coupler(True, run.now),
    "coupler free": lambda run: run.stop.receive_coupler(False, run.now),
    "request": lambda run: run.stop.stop(),
    "time": lambda run: setattr(run, "now", run.now + LATER),
}


@pytest.mark.parametrize(
    ("events", "publishers", "later", "released"),
    [
        ("false, true, false, true, false, time, false", ["/rosbag2_player"], 0.0, True),
        ("true", ALONE, 1.01 * engagement.RECENT, True),
        ("true", ALONE, 0.1, False),  # may be repeated
        ("true, false", ALONE, 0.1, False),  # of two senders
        ("true", BUTTON, LATER, False),  # said once and never withdrawn
        ("true, time, false", BUTTON, 0.0, True),
        ("request", BUTTON, 0.0, True),  # there is no reason on the topic
        ("coupler stopped", ALONE, 0.99 * engagement.COUPLER_SILENCE, False),
        ("coupler stopped", ALONE, 1.01 * engagement.COUPLER_SILENCE, True),
        ("coupler stopped, coupler free", ALONE, 0.0, True),
    ],
)
def test_a_stop_is_released_once_nobody_asks_for_it(
    events: str, publishers: list[str], later: float, released: bool
) -> None:
    run = Run()
    for name in events.split(", "):
        EVENTS[name](run)
    assert run.stop.stopped
    assert run.released(publishers, later) is released


def test_a_refusal_names_who_publishes() -> None:
    run = Run()
    run.receive(True)
    refusal = run.stop.release(run.now, ["/a", "/b"])
    assert refusal.startswith("/a and /b published true on the topic")


def test_a_node_that_has_just_started_is_not_released() -> None:
    run = Run(age=0.0)
    assert not run.stop.is_settled(run.now)
    assert run.stop.receive_coupler(True, run.now), "but stopped at any age"
    run.stop.receive_coupler(False, run.now)
    assert run.stop.release(run.now, ALONE) == "has just started: ask again in a second"
    assert not run.released(ALONE, 0.9 * engagement.LATCHED_SETTLING)
    assert run.released(ALONE, 0.2 * engagement.LATCHED_SETTLING)
    assert run.stop.is_settled(run.now)


def test_a_stop_that_began_elsewhere_is_followed_and_not_counted_as_begun_here() -> None:
    run = Run()
    run.stop.follow()
    assert run.stop.stopped
    assert run.stop.began == 0
    assert run.released(ALONE)
    run.stop.stop()
    run.stop.follow()
    run.receive(True)
    assert run.stop.began == 1


@given(st.lists(st.sampled_from([*sorted(EVENTS), "release"]), max_size=40), st.booleans())
def test_whatever_is_said_only_a_release_ends_a_stop(events: list[str], button: bool) -> None:
    run = Run()
    stopped = False
    for name in events:
        if name == "release":
            run.released(BUTTON if button else ALONE)
            stopped = run.stop.stopped
            continue
        EVENTS[name](run)
        stopped |= name in ("true", "coupler stopped", "request")
        assert run.stop.stopped is stopped
