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

"""Emergency stop of the coupler: what it says for what it hears, without a middleware."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from rclpy.task import Future
from std_srvs.srv import SetBool

from haptic_accel.core.emergency_stop import SETTLING, EmergencyStop
from haptic_accel.core.topics import Topic
from haptic_accel.nodes.stopping import GraphStop


class Coupler:
    """Node of a coupler's stop, whose devices answer at once."""

    def __init__(self) -> None:
        self.words: list[bool] = []
        self.waiting: list[bool] = []
        self.answers: list[bool] = []
        self.told: list[bool] = []
        self.asked_of_devices: list[bool] = []
        self.stop = EmergencyStop(time.monotonic() - SETTLING)
        node: Any = self
        self.graph = GraphStop(node, self.stop)

    def resolve_topic_name(self, name: str) -> str:
        return name

    def inbox(self, topic: Topic) -> Any:
        return SimpleNamespace(take_states=lambda: _taken(self.words))

    def publisher(self, topic: Topic) -> Any:
        return SimpleNamespace(publish=lambda message: self.told.append(message.data))

    def publishers(self, *names: str) -> list[str]:
        return []

    def requests(self, kind: Any, name: str) -> Any:
        def answer(response: SetBool.Response) -> None:
            self.answers.append(response.success)

        return SimpleNamespace(
            take=lambda: ((SetBool.Request(data=each), answer) for each in _taken(self.waiting))
        )

    def create_client(self, kind: Any, name: str) -> Any:
        def ask(request: SetBool.Request) -> Future:
            self.asked_of_devices.append(request.data)
            future: Future = Future()
            future.set_result(SetBool.Response(success=True))
            return future

        return SimpleNamespace(service_is_ready=lambda: True, call_async=ask)


def _taken(waiting: list[bool]) -> list[bool]:
    taken, waiting[:] = waiting.copy(), []
    return taken


def test_a_stop_is_released_once_all_devices_are() -> None:
    coupler = Coupler()
    coupler.waiting = [True]
    assert coupler.graph.follow()
    coupler.waiting = [False]
    assert coupler.graph.follow()
    assert coupler.answers == [True, True]
    assert coupler.told == [True, False]
    assert coupler.asked_of_devices == [False, False]


def test_a_release_that_waits_when_a_stop_comes_does_not_undo_it() -> None:
    for requests in ([False, True], [True, False]):
        coupler = Coupler()
        coupler.waiting = list(requests)
        assert coupler.graph.follow()
        assert coupler.answers == requests
        assert (coupler.told, coupler.asked_of_devices) == ([True], [])


def test_a_release_that_waits_when_a_signal_stops_does_not_undo_it() -> None:
    coupler = Coupler()
    coupler.waiting = [False]
    coupler.stop.stop()
    assert coupler.graph.follow()
    assert coupler.answers == [False]
    assert (coupler.told, coupler.asked_of_devices) == ([True], [])


def test_a_stop_that_is_repeated_before_it_is_followed_is_followed_all_the_same() -> None:
    coupler = Coupler()
    coupler.stop.follow()  # as the peer's packets say
    coupler.graph.tell()  # once a second
    assert coupler.graph.follow()
    assert not coupler.graph.follow()
    assert coupler.told == [True]
