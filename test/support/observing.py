# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node of the tests that observes the graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

from haptic_accel.core.topics import DIAGNOSTICS, Topic, reporter
from haptic_accel.nodes.supervised_node import message_type, quality
from running import PATIENCE


class Observer:
    """Client of topics and services in a ROS domain."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("observer", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def collect(self, topics: tuple[Topic, ...], count: int) -> dict[str, list[Any]]:
        """Return messages of topics, at least `count` of each."""
        messages: dict[str, list[Any]] = {topic.name: [] for topic in topics}
        enough: Future = Future()

        def keep(name: str, message: Any) -> None:
            messages[name].append(message)
            if min(map(len, messages.values())) >= count and not enough.done():
                enough.set_result(True)

        subscribe = self.node.create_subscription
        subscriptions = [
            subscribe(message_type(each), each.name, partial(keep, each.name), quality(each, 1000))
            for each in topics
        ]
        self.executor.spin_until_future_complete(enough, PATIENCE)
        for subscription in subscriptions:
            self.node.destroy_subscription(subscription)
        assert enough.done(), {name: len(found) for name, found in messages.items()}
        return messages

    def wait_for_state(self, topic: Topic, state: bool) -> None:
        """Wait until a latched state has a value."""
        with self.watching(topic) as wait_for:
            wait_for(lambda message: message.data is state)

    def status(
        self, node: str, said: str = "", least: Mapping[str, int] | None = None, **values: str
    ) -> dict[str, str]:
        """Return the values of a node's next diagnostics whose message contains a text.

        These are the first with counters of at least `least`, and with the given values.
        """
        found: dict[str, str] = {}
        last = ""

        def wanted(message: Any) -> bool:
            nonlocal last
            for status in message.status:
                if reporter(status.name)[1] == node:
                    last = status.message
                    if said in last:
                        found.update((pair.key, pair.value) for pair in status.values)
            reached = (int(found.get(key, 0)) >= count for key, count in (least or {}).items())
            return bool(found) and all(reached) and values.items() <= found.items()

        with self.watching(DIAGNOSTICS) as wait_for:
            wait_for(wanted, lambda: f"{node}: not {said} {least} {values}; last: {last} {found}")
        return found

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return a service's response."""
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(PATIENCE), service
        future = client.call_async(request)
        self.executor.spin_until_future_complete(future, PATIENCE)
        assert future.done(), service
        return future.result()

    @contextmanager
    def watching(self, topic: Topic) -> Iterator[Callable[..., None]]:
        """Subscribe meanwhile; yield a function that waits for a message.

        Its parameters are what a message must fulfil, and perhaps what is told of the last one.
        """
        arrived: list[Any] = []
        subscription = self.node.create_subscription(
            message_type(topic), topic.name, arrived.append, quality(topic)
        )

        def wait_for(
            wanted: Callable[[Any], bool], told: Callable[[], object] = lambda: arrived[-1:]
        ) -> None:
            deadline = time.monotonic() + PATIENCE
            looked = 0
            while True:
                for message in arrived[looked:]:
                    if wanted(message):
                        return
                looked = len(arrived)
                assert time.monotonic() < deadline, told()
                self.executor.spin_once(timeout_sec=1.0)

        yield wait_for
        self.node.destroy_subscription(subscription)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
