# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Senders that may stop a node, and the time of its release."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.emergency_stop import (
    COUPLER_SILENCE,
    LATCHED_SETTLING,
    RECENT,
    EmergencyStop,
)

BUTTON = ["/button"]
ALONE: list[str] = []
LATER = 2 * max(RECENT, COUPLER_SILENCE)


class Run:
    """A node's stop whose time goes on as a test says."""

    def __init__(self, age: float = LATCHED_SETTLING) -> None:
        self.now = 100.0
        self.stop = EmergencyStop(self.now - age)

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


def test_a_stop_that_is_played_with_its_release_stays() -> None:
    run = Run()
    run.receive(False, True, False, True, False)
    assert run.stop.stopped
    run.now += 1000.0
    run.receive(False)
    assert run.stop.stopped
    assert run.released(["/rosbag2_player"])


def test_the_stop_of_a_sender_that_has_gone_can_be_released() -> None:
    run = Run()
    run.receive(True)
    assert run.released(ALONE, 1.01 * RECENT)


def test_the_stop_of_a_sender_that_repeats_it_is_not_released() -> None:
    run = Run()
    for _ in range(30):
        run.receive(True)
        assert not run.released(ALONE, 0.1)
    run.receive(True, False)  # of two senders
    assert not run.released(ALONE, 0.1)


def test_a_stop_that_was_said_once_and_never_withdrawn_is_not_released() -> None:
    run = Run()
    run.receive(True)
    assert not run.released(BUTTON, LATER)
    assert run.stop.release(run.now, ["/a", "/b"]).startswith(
        "/a and /b published true on the topic"
    )
    run.receive(False)
    assert run.stop.stopped, "what withdraws a stop releases nothing"
    assert run.released(BUTTON)


def test_a_stop_by_request_has_no_reason_on_the_topic() -> None:
    run = Run()
    run.stop.stop()
    assert run.released(BUTTON)


def test_the_coupler_withdraws_its_own_stop_or_goes() -> None:
    run = Run()
    run.stop.receive_coupler(True, run.now)
    assert not run.released(ALONE, 0.99 * COUPLER_SILENCE)
    run.stop.receive_coupler(False, run.now)
    assert run.stop.stopped
    assert run.released(ALONE)
    run.stop.receive_coupler(True, run.now)
    assert run.released(ALONE, 1.01 * COUPLER_SILENCE)


def test_a_node_that_has_just_started_is_not_released() -> None:
    run = Run(age=0.0)
    assert not run.stop.is_settled(run.now)
    run.stop.stop()
    assert run.stop.release(run.now, ALONE) == "has just started: ask again in a second"
    assert not run.released(ALONE, 0.9 * LATCHED_SETTLING)
    assert run.released(ALONE, 0.2 * LATCHED_SETTLING)
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


EVENTS: dict[str, Callable[[Run], object]] = {
    "true": lambda run: run.receive(True),
    "false": lambda run: run.receive(False),
    "coupler stopped": lambda run: run.stop.receive_coupler(True, run.now),
    "coupler free": lambda run: run.stop.receive_coupler(False, run.now),
    "request": lambda run: run.stop.stop(),
    "time": lambda run: setattr(run, "now", run.now + LATER),
}


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


@pytest.mark.parametrize("age", [0.0, LATCHED_SETTLING])
def test_a_stop_is_heard_at_any_age(age: float) -> None:
    run = Run(age)
    run.receive(True)
    assert run.stop.stopped
