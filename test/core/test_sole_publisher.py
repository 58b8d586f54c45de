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

"""Publishers that come, go and send in any order, and what may be taken from them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.sequence_check import CONFIRMING_LOOKS, SolePublisher

COMES, GOES, SENDS, LOOK = "comes", "goes", "sends", "look"

events = st.lists(
    st.one_of(
        st.tuples(st.sampled_from((COMES, GOES, SENDS)), st.integers(0, 2)), st.just((LOOK, 0))
    ),
    max_size=60,
)


class Queue:
    """A subscription's queue, with the middleware's counts."""

    def __init__(self) -> None:
        self.counts = SimpleNamespace(total_count=0, current_count=0)
        self.publisher = SolePublisher(lambda: self.counts)
        self.waiting: list[tuple[int, int]] = []
        self.numbers: dict[int, int] = {}

    def comes(self, name: int, *, counted: bool = True) -> None:
        self.numbers[name] = 0
        if counted:
            self.count(name)

    def count(self, name: int) -> None:
        self.counts.total_count += 1
        self.counts.current_count += 1

    def goes(self, name: int) -> None:
        del self.numbers[name]
        self.counts.current_count -= 1

    def sends(self, name: int, messages: int = 1) -> None:
        for _ in range(messages):
            self.numbers[name] += 1
            self.waiting.append((name, self.numbers[name]))

    def confirm(self) -> None:
        """Look as often as a publisher whose numbers start again is doubted."""
        for _ in range(CONFIRMING_LOOKS):
            assert self.look() == []

    def look(self) -> list[int]:
        """Return the publishers of the messages that are taken."""
        taken, self.waiting = self.waiting, []
        if not self.publisher.sole([number for _, number in taken]):
            self.waiting = []
            return []
        return [name for name, _ in taken]


@given(events)
def test_nothing_is_taken_of_a_time_with_two_publishers_and_all_of_a_sole_one(
    events: list[tuple[str, int]],
) -> None:
    queue, possible, sent, contended = Queue(), 0, 0, False
    for event, name in events:
        if event == COMES and name not in queue.numbers:
            queue.comes(name)
            possible += 1
        elif event == GOES and name in queue.numbers:
            queue.goes(name)
        elif event == SENDS and name in queue.numbers:
            queue.sends(name)
            sent += 1
        elif event == LOOK:
            taken = queue.look()
            contended = contended or possible > 1
            # After that, who remains is taken once it is confirmed.
            assert len(taken) in ((0 if contended else sent), (sent if possible <= 1 else 0))
            possible, sent = len(queue.numbers), 0
    if len(queue.numbers) == 1:
        (name,) = queue.numbers
        for _ in range(CONFIRMING_LOOKS + 2):
            queue.sends(name)
            taken = queue.look()
        assert taken == [name]


@pytest.fixture
def queue() -> Queue:
    """Return the queue of a publisher whose first messages are taken."""
    queue = Queue()
    queue.comes(0)
    queue.sends(0, 5)
    assert queue.look() == [0] * 5
    return queue


def test_a_publisher_that_comes_and_goes_between_two_looks_is_noticed(queue: Queue) -> None:
    queue.comes(1)
    queue.sends(1, 3)
    queue.goes(1)
    assert queue.look() == []
    queue.sends(0)
    assert queue.look() == [0]


def test_messages_that_precede_the_count_of_their_publisher_are_known_by_their_numbers(
    queue: Queue,
) -> None:
    queue.comes(1, counted=False)
    queue.sends(0)
    queue.sends(1, 3)
    assert queue.look() == []
    queue.sends(1)
    assert queue.look() == []
    queue.sends(0)
    queue.count(1)
    assert queue.look() == []


def test_numbers_are_remembered_while_a_rival_comes_and_goes(queue: Queue) -> None:
    queue.comes(1)
    assert queue.look() == []
    queue.goes(1)
    assert queue.look() == []
    queue.comes(1, counted=False)
    queue.sends(1)
    assert queue.look() == []
    queue.sends(1)
    assert queue.look() == []
    queue.count(1)
    assert queue.look() == []
    queue.goes(1)
    queue.sends(0)
    assert queue.look() == []
    queue.confirm()
    queue.sends(0)
    assert queue.look() == [0]


def test_who_replaces_another_beside_a_rival_is_taken_once_it_is_confirmed(queue: Queue) -> None:
    queue.comes(1)
    queue.goes(0)
    assert queue.look() == []
    queue.sends(1)
    queue.confirm()
    queue.sends(1)
    assert queue.look() == [1]


def test_a_successor_counts_its_messages_anew(queue: Queue) -> None:
    queue.goes(0)
    assert queue.look() == []
    queue.comes(1)
    queue.sends(1, 2)
    assert queue.look() == [1, 1]
    assert queue.publisher.changed
    assert queue.publisher.contenders == 1
    queue.sends(1)
    assert queue.look() == [1]
    assert not queue.publisher.changed


def test_a_middleware_without_numbers_or_news_is_enough_for_one_publisher() -> None:
    counts = iter((SimpleNamespace(total_count=1, current_count=1), None))
    publisher = SolePublisher(lambda: next(counts))
    assert publisher.sole([None, None])
    assert publisher.sole([None])
