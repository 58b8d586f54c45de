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

from __future__ import annotations

import random
from collections import deque
from itertools import pairwise

import pytest

from haptic_accel.links.pacing import Pace


def run(seconds: float, capacity: float, jitter: float = 0.0) -> tuple[list[float], int]:
    """Send 1000 datagrams a second through a queue that lets so many pass.

    Returns the time that each waited in it, s, and how many were sent in the last second.
    """
    pace, chance = Pace(), random.Random(1)
    queue: deque[tuple[int, float]] = deque()
    echoes: list[tuple[float, int]] = []
    waited, credit, sent = [], 0.0, 0
    for tick in range(round(1000 * seconds)):
        now = tick / 1000
        if (number := pace.number(now)) is not None:
            queue.append((number, now))
            sent += now >= seconds - 1
        credit = min(credit + capacity / 1000, 2.0)
        while queue and credit >= 1:
            credit -= 1
            number, begun = queue.popleft()
            waited.append(now - begun)
            echoes.append((now + 0.04 + jitter * chance.random(), number))
        for arrival, number in [each for each in echoes if each[0] <= now]:
            echoes.remove((arrival, number))
            pace.acknowledge(number, now)
    return waited, sent


def test_a_network_that_takes_all_gets_all_in_spite_of_jitter() -> None:
    waited, sent = run(5.0, 2000.0, jitter=0.04)
    assert sent == 1000
    assert max(waited) == 0


@pytest.mark.parametrize("capacity", [150.0, 300.0, 600.0])
def test_a_queue_is_kept_short_where_the_network_takes_less(capacity: float) -> None:
    waited, sent = run(20.0, capacity)
    late = waited[len(waited) // 2 :]
    assert sorted(late)[len(late) // 2] < 0.03
    assert sent >= 0.25 * capacity


def test_a_datagram_is_never_left_out_for_long() -> None:
    pace = Pace()
    pace.stride = 16
    sent = [tick / 200 for tick in range(200) if pace.number(tick / 200)]
    assert max(b - a for a, b in pairwise(sent)) <= 0.0151
