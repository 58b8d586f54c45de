# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emergency stop of coupler and device, and requests for its release, without a middleware."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.task import Future
from std_srvs.srv import SetBool

from haptic_accel.core.coupling import engagement
from haptic_accel.core.topics import MASTER_STOPPED, Topic
from haptic_accel.nodes.emergency_stop import CouplerStop, DeviceStop, release
from haptic_accel.nodes.service_client import RequestError
from service_double import Answer, Graph, accept, refuse

NOBODYS_DOMAIN = 9999
"""ROS domain above all possible ones, whose pending stops are no graph's."""


class StoppedNode:
    """Node whose topics and services are lists."""

    def __init__(self) -> None:
        self.words: list[bool] = []
        self.coupler: list[bool] = []
        self.waiting: list[bool] = []
        self.answers: list[bool] = []
        self.told: list[bool] = []

    def resolve_topic_name(self, name: str) -> str:
        return name

    @property
    def context(self) -> Any:
        return SimpleNamespace(get_domain_id=lambda: NOBODYS_DOMAIN)

    def get_namespace(self) -> str:
        return "/"

    def inbox(self, topic: Topic) -> Any:
        return SimpleNamespace(drain_states=lambda: _taken(self.words))

    def publisher(self, topic: Topic) -> Any:
        return SimpleNamespace(publish=lambda message: self._tell(message.data))

    def _tell(self, state: bool) -> None:
        if self.told[-1:] != [state]:  # it may be repeated
            self.told.append(state)

    def publishers(self, *names: str) -> list[str]:
        return []

    def requests(self, kind: Any, name: str) -> Any:
        def answer(response: SetBool.Response) -> None:
            self.answers.append(response.success)

        return SimpleNamespace(
            drain=lambda: ((SetBool.Request(data=each), answer) for each in _taken(self.waiting))
        )

    def states(self, inbox: Any) -> list[bool]:
        return _taken(self.coupler)


class Coupler(StoppedNode):
    """Node of a coupler's stop, whose devices answer at once."""

    def __init__(self) -> None:
        super().__init__()
        self.asked_of_devices: list[bool] = []
        self.refusing = False
        self.engagement = engagement.Engagement(
            engagement.EngagementParameters(), time.monotonic() - engagement.LATCHED_SETTLING
        )
        self.stop = self.engagement.stop
        node: Any = self
        self.graph = CouplerStop(node, self.engagement)

    def create_client(self, kind: Any, name: str) -> Any:
        def ask(request: SetBool.Request) -> Future:
            self.asked_of_devices.append(request.data)
            future: Future = Future()
            future.set_result(SetBool.Response(success=not self.refusing))
            return future

        return SimpleNamespace(service_is_ready=lambda: True, call_async=ask)


class Device(StoppedNode):
    """Node of a device's stop, and what becomes of its forces."""

    def __init__(self) -> None:
        super().__init__()
        self.done: list[str] = []
        node: Any = self
        acts = (partial(self.done.append, word) for word in ("taken off", "released"))
        self.stop = DeviceStop(node, MASTER_STOPPED, *acts)


def _taken(waiting: list[bool]) -> list[bool]:
    taken, waiting[:] = waiting.copy(), []
    return taken


@pytest.mark.parametrize("refusing", [False, True])
def test_a_stop_is_released_once_all_devices_are_and_not_if_one_refuses(refusing: bool) -> None:
    coupler = Coupler()
    coupler.waiting = [True]
    assert coupler.graph.follow()
    coupler.refusing = refusing
    coupler.waiting = [False]
    assert coupler.graph.follow()
    assert coupler.graph.follow() == refusing
    assert coupler.answers == [True, not refusing]
    assert coupler.told == [True, False, True][: 3 if refusing else 2]
    assert refusing or coupler.asked_of_devices == [False, False]
    assert coupler.stop.stopped == refusing


BESIDE = [("", [False, True]), ("", [True, False]), ("stop", [False]), ("followed", [False, True])]


@pytest.mark.parametrize(("before", "requests"), BESIDE)
def test_a_release_beside_a_stop_does_not_undo_it(before: str, requests: list[bool]) -> None:
    coupler = Coupler()
    if before:
        coupler.stop.stop()
    if before == "followed":
        coupler.graph.follow()
    coupler.waiting = list(requests)
    coupler.graph.follow()
    assert coupler.answers == requests
    assert coupler.stop.stopped
    assert (coupler.told, coupler.asked_of_devices) == ([True], [])


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Device:
    monkeypatch.setattr(engagement, "LATCHED_SETTLING", 0.0)
    return Device()


def test_a_device_answers_once_its_forces_are_off(device: Device) -> None:
    device.waiting = [True]
    device.stop.follow()
    assert (device.answers, device.done) == ([True], ["taken off"])
    device.waiting = [False]
    device.stop.follow()
    assert (device.answers, device.done) == ([True, True], ["taken off", "released"])


def test_a_device_takes_its_forces_off_for_each_request_and_once_for_the_coupler(
    device: Device,
) -> None:
    for _ in range(2):
        device.words = [True, False]
        device.stop.follow()
    assert len(device.done) == 2
    device = Device()
    for _ in range(2):
        device.coupler = [True]
        device.stop.follow()
    assert len(device.done) == 1


@pytest.mark.parametrize("stopped_before", [True, False])
def test_a_release_that_waits_in_a_device_does_not_undo_a_stop(
    device: Device, stopped_before: bool
) -> None:
    if stopped_before:
        device.waiting = [True]
        device.stop.follow()
        device.answers.clear()
        device.waiting = [False, True]
    else:
        device.waiting = [False]
        device.stop.stop()
    device.stop.follow()
    assert device.answers[0] is False
    assert set(device.done) == {"taken off"}


def test_a_stop_that_is_repeated_before_it_is_followed_is_followed_all_the_same() -> None:
    coupler = Coupler()
    coupler.stop.follow()  # as the peer's packets say
    coupler.graph.report_state()  # once a second
    assert coupler.graph.follow()
    assert not coupler.graph.follow()
    assert coupler.told == [True]


def test_a_release_is_that_of_the_coupler_where_it_answers() -> None:
    graph = Graph(estop=accept, slave_device__estop=accept, master_device__estop=accept)
    assert asyncio.run(release(graph.client)) == ("done", set())
    assert graph.asked == ["estop"]


@pytest.mark.parametrize("coupler", [{}, {"estop": None}])
def test_devices_are_released_without_a_coupler(coupler: dict[str, Answer]) -> None:
    graph = Graph(**coupler, slave_device__estop=accept)
    line, missing = asyncio.run(release(graph.client))
    assert line == "released: slave_device take forces again; the coupler does not answer"
    assert missing == {"master_device"}


def test_a_release_that_is_refused_is_asked_for_again_for_a_while() -> None:
    graph = Graph(estop=refuse)
    with pytest.raises(RequestError, match="emergency stop is not released: estop: not now"):
        asyncio.run(release(graph.client, timeout=0.05))
    graph.asked.clear()
    answers = iter([refuse, refuse, accept])
    graph.services["estop"] = lambda content: next(answers)(content)
    assert asyncio.run(release(graph.client, timeout=5.0)) == ("done", set())
    assert graph.asked == ["estop"] * 3
