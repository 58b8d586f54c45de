# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording by bundles, beside somebody who subscribes to all that is recorded."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest
import rclpy
from std_msgs.msg import UInt8MultiArray

from haptic_accel.core.cdr import BUNDLE_PERIOD, StampedVector, unpack_stamped_vector
from haptic_accel.core.topics import (
    BUNDLES,
    DESIRED_ACCELERATION,
    SIGNALS,
    SLAVE,
    SLAVE_SIGNALS,
    SLAVE_VELOCITY,
    TOPICS,
)
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.supervised_node import message_type, quality
from haptic_accel.nodes.timing import CATCH_UP
from nightly import rest_slow
from observing import Observer
from reading import with_rosbags
from running import Start, nodes_of, wait_until

RATE = 250
MARK = 12345.0
"""Value of samples that are sent by the tests."""

SOON = 0.25
"""Time from the first sample of a signal that others subscribe to as well to that of one that
nobody else wants, s."""

Heard = dict[str, list[bytes]]


def recorded(bag: Path) -> Heard:
    """Return the messages of the signals in a bag, in order, and check their order of time."""
    found: Heard = {f"/{topic.name}": [] for topic in SIGNALS}
    rows = with_rosbags(bag)
    for topic, _, data in rows:
        if topic in found:
            found[topic].append(data)
    times = [received for _, received, _ in rows]
    assert times == sorted(times)
    return found


@contextmanager
def hearing(observer: Observer) -> Iterator[Heard]:
    """Subscribe to all signals, and keep what comes."""
    heard: Heard = {f"/{topic.name}": [] for topic in SIGNALS}
    subscribe = partial(observer.node.create_subscription, qos_profile=10_000, raw=True)
    subscriptions = [
        subscribe(message_type(topic), topic.name, heard[f"/{topic.name}"].append)
        for topic in SIGNALS
    ]
    over = threading.Event()

    def spin() -> None:
        while not over.is_set():
            observer.executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield heard
    finally:
        over.set()
        thread.join()
        for subscription in subscriptions:
            observer.node.destroy_subscription(subscription)


def assert_holds(bag: list[bytes], heard: list[bytes], name: str) -> None:
    """Check that a bag has from the first message heard to the last all of them, in order."""
    assert heard, name
    assert not [data for data, count in Counter(bag).items() if count > 1], name
    assert set(heard) <= set(bag), f"{name}: {len(set(heard) - set(bag))} are missing"
    wanted = set(heard)
    assert [data for data in bag if data in wanted] == heard, name


def stamps(messages: list[bytes]) -> list[int]:
    """Return the stamps of messages of a signal, ns."""
    return [unpack_stamped_vector(data)[0] for data in messages]


def assert_complete(signals: list[list[bytes]]) -> None:
    """Check that signals that a device sends with each sample have the same samples."""
    found = [stamps(each) for each in signals]
    first, last = max(each[0] for each in found), min(each[-1] for each in found)
    within = [[stamp for stamp in each if first <= stamp <= last] for each in found]
    assert all(each == within[0] for each in within), [len(each) for each in within]


def saved(bag: list[bytes], heard: list[bytes]) -> list[bytes]:
    """Return what was heard of a killed process, but for its last bundle, which may be lost."""
    there = set(bag)
    missing = [data for data in heard if data not in there]
    # After a stall, samples of up to CATCH_UP are sent together.
    assert len(missing) <= (BUNDLE_PERIOD + CATCH_UP) * RATE
    assert missing == heard[len(heard) - len(missing) :]
    return heard[: len(heard) - len(missing)]


@pytest.mark.parametrize("killed", rest_slow(["slave_device", ""]))
def test_a_bag_has_what_a_subscriber_of_everything_gets_and_more_by_nobody(
    haptic_accel: Start, observer: Observer, domain: int, tmp_path: Path, killed: str
) -> None:
    composed = "false" if killed else "true"
    words = f"rate:={RATE}", "rig:=ideal", "bag:=bag", f"composed:={composed}"
    graph = haptic_accel("teleop", *words)
    graph.wait_for("engaged")
    unwanted = (DESIRED_ACCELERATION.name, SLAVE_VELOCITY.name)
    count = observer.node.count_subscribers
    wait_until(lambda: not any(map(count, unwanted)), "only bundles for the recorder")
    names = {name for name, _ in observer.node.get_topic_names_and_types()}
    assert {f"/{topic.name.lstrip('/')}" for topic in TOPICS} <= names
    with hearing(observer) as heard:
        wait_until(lambda: min(map(len, heard.values())) > 2 * RATE, "two seconds", graph)
        for name in unwanted:
            first, *_ = stamps(heard[f"/{name}"])
            before = sum(stamp < first for stamp in stamps(heard[f"/{SLAVE.position.name}"]))
            assert before < SOON * RATE, name
        node = observer.node
        nonsense = node.create_publisher(UInt8MultiArray, BUNDLES.name, 10)
        wait_until(lambda: nonsense.get_subscription_count() == 1, "the recorder")
        nonsense.publish(UInt8MultiArray(data=b"garbage"))
        graph.wait_for(f"{BUNDLES.name}: malformed message refused: ")
        # Else this process would pass for one whose signals are all in its bundles.
        node.destroy_publisher(nonsense)
        desired = DESIRED_ACCELERATION
        rival = node.create_publisher(message_type(desired), desired.name, 100)
        wait_until(lambda: rival.get_subscription_count() == 2, "the recorder and the test")
        sent = []
        for index in range(200):
            stamp = time.time_ns()
            sent.append(StampedVector(DESIRED_ACCELERATION).pack(stamp, (MARK, 0.0, float(index))))
            rival.publish(sent[-1])
            time.sleep(0.002)
        node.destroy_publisher(rival)
        wait_until(lambda: count(desired.name) == 1, "the recorder needs bundles alone")
        if killed:
            os.kill(nodes_of(domain)[killed], signal.SIGKILL)
        assert graph.end(None if killed else signal.SIGINT) == bool(killed), graph.text
    bag = recorded(tmp_path / "bag")
    if killed:
        for name in (f"/{topic.name}" for topic in SLAVE_SIGNALS):
            heard[name] = saved(bag[name], heard[name])
    for name, messages in heard.items():
        if name != f"/{DESIRED_ACCELERATION.name}":
            assert_holds(bag[name], messages, name)
    # A sender of its own is in no order with the graph's, beyond that of time.
    both = bag[f"/{DESIRED_ACCELERATION.name}"]
    others = set(sent)
    own = [data for data in both if data not in others]
    assert [data for data in both if data in others] == sent
    found = heard[f"/{DESIRED_ACCELERATION.name}"]
    assert_holds(own, [data for data in found if data not in others], "own")
    assert_complete([bag[f"/{topic.name}"] for topic in SLAVE_SIGNALS])


def test_who_subscribes_to_a_signal_and_its_bundles_is_one_listener(observer: Observer) -> None:
    rclpy.init()
    node = GraphNode("coupler")
    node.task = "testing"
    try:
        sender = node.sender(SLAVE_VELOCITY)
        assert sender.listeners == 0
        other = observer.node
        for number, topic in enumerate((BUNDLES, SLAVE_VELOCITY)):
            kind, keeping = message_type(topic), quality(topic)
            other.create_subscription(kind, topic.name, lambda _: None, keeping)
            found = SLAVE_VELOCITY.name, BUNDLES.name
            wait_until(
                lambda number=number, found=found: (
                    sum(map(node.count_subscribers, found)) == number + 1
                ),
                "the subscriber",
            )
            wait_until(lambda: sender.listeners == 1, "one listener")
        second = rclpy.create_node("second", context=observer.context)
        kind = message_type(SLAVE_VELOCITY)
        second.create_subscription(kind, SLAVE_VELOCITY.name, lambda _: None, 10)
        wait_until(lambda: sender.listeners == 2, "two listeners")
        second.destroy_node()
    finally:
        node.destroy_node()
        rclpy.shutdown()
