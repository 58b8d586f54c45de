# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Acts on a graph. An act leaves nothing in the way of forces, unless they are stopped."""

from __future__ import annotations

import math
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from random import Random
from typing import Any

from rclpy.serialization import serialize_message
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from chaos.live_graph import Force, LiveGraph
from chaos.traced_node import ACTUATOR, ARM
from haptic_accel.core import topics
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import EMERGENCY_STOP, SIGNALS, Topic
from haptic_accel.graph.claims import stop_senders
from haptic_accel.nodes.interface import message_type, quality
from running import PATIENCE, Command, limit_size

WITHOUT: dict[str, tuple[Force, ...]] = {
    "compensator": (("master_device", ACTUATOR),),
    "coupler": (("master_device", ARM), ("slave_device", ARM)),
    "slave_device": (("master_device", ARM), ("master_device", ACTUATOR)),
    "master_device": (("slave_device", ARM),),
    "recorder": (),
}
"""Per process the forces that end with it."""

RECEIVERS = {
    topics.MASTER_ARM_FORCE: ("master_device", ARM),
    topics.SLAVE_ARM_FORCE: ("slave_device", ARM),
    topics.ACTUATOR_FORCE: ("master_device", ACTUATOR),
}
SAMPLES = tuple(topic for topic in SIGNALS if topic not in RECEIVERS)
STATES = (EMERGENCY_STOP, topics.COUPLER_STOPPED, topics.MASTER_STOPPED, topics.SLAVE_STOPPED)

CUT_OFF = (b"", b"\0", bytes([0, 1, 0, 0]))
MALFORMED = (*CUT_OFF, bytes([0, 1, 0, 0]) + bytes(8) + b"\xff" * 104, bytes([0, 7]) + bytes(126))
HUGE_FRAME = "x" * 60_000
VALUES = (math.nan, -math.inf, 1e308, -1e9, 10.0, 0.3)
LEADS = tuple(sign * lead for sign in (-1, 1) for lead in (0.005, 0.05, 0.15, 1.0, 3600.0))
"""Leads of wrong stamps, s."""

LATEST = 2**31 * 10**9 - 1
"""Latest stamp of a message, ns."""

LONGEST_STEP = 24 * 3600 * 10**9
"""Largest lead of the clock, ns."""

FEW, BURST = 10, 100
"""Messages, and those of a flood, between two looks at the graph, which take up to 20 ms."""

ATTEMPTS = 12
"""Requests that may be needed. A call of the service is lost to a coupler that was killed just
before; a device accepts no release in its first second, and where one came up meanwhile, all may
be stopped again."""

GUEST = """
import signal
import rclpy
from rclpy.signals import SignalHandlerOptions
from haptic_accel.core.topics import SIGNALS
from haptic_accel.nodes.interface import message_type, quality
left = []
signal.signal(signal.SIGINT, lambda *signal: left.append(signal))
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("guest")
for topic in SIGNALS:
    node.create_subscription(message_type(topic), topic.name, lambda message: None, quality(topic))
print("joined", flush=True)
while not left:
    rclpy.spin_once(node, timeout_sec=0.1)
rclpy.shutdown()
"""


class Acts:
    """The acts on one graph, with choices from a seeded source.

    Attributes
    ----------
    kinds : list of callables
        One of each kind.
    """

    def __init__(self, graph: LiveGraph, random: Random, tell: Callable[[str], None]) -> None:
        self._graph = graph
        self._random = random
        self._tell = tell
        self._stopped = False
        self._surprises: list[Callable[[], None]] = [
            *(partial(self._kill, name) for name in WITHOUT),
            *(partial(self._freeze, name) for name in WITHOUT),
            *(partial(self._join, leave) for leave in (signal.SIGINT, signal.SIGKILL)),
            self._send_garbage,
            self._flood,
            *(partial(self._send_rival_force, topic) for topic in RECEIVERS),
            self._set_clock,
        ]
        self.kinds = [
            *self._surprises,
            *(partial(self._stop, way) for way in ("topic", "service", "signal")),
            *(partial(self._fail_recorder, by) for by in (self._remove_bag, self._fill_disk)),
        ]

    def _kill(self, name: str) -> None:
        self._tell(f"SIGKILL to {name}")
        self._graph.end(name, signal.SIGKILL, -signal.SIGKILL)
        self._wait_without(name)
        self._graph.pause(self._random.uniform(0.0, 0.5))
        self._graph.start(name)

    def _freeze(self, name: str) -> None:
        seconds = self._random.choice((0.0, 0.02, 0.1, 0.5, 1.5))
        self._tell(f"SIGSTOP to {name} for {seconds:g} s")
        process = self._graph.nodes[name].process
        process.send_signal(signal.SIGSTOP)
        if seconds:
            self._wait_without(name)
            self._graph.pause(seconds)
        process.send_signal(signal.SIGCONT)

    def _wait_without(self, name: str) -> None:
        """Wait until the forces that need a process have ended, all others going on."""
        self._graph.wait_without(WITHOUT[name])
        if not WITHOUT[name] and not self._stopped:
            self._graph.wait_for(self._graph.flow(), "forces go on")

    def _join(self, leave: signal.Signals) -> None:
        seconds = self._random.uniform(0.3, 1.5)
        self._tell(f"a process joins, {leave.name} after {seconds:.1f} s")
        guest = Command(["-c", GUEST], self._graph.folder)
        if leave != signal.SIGKILL:
            guest.wait_for("joined")
        self._graph.pause(seconds)
        guest.end(leave)

    def _send_garbage(self) -> None:
        disturbed = (*self._random.sample(SAMPLES, 3), *STATES)
        self._tell(f"garbage on {', '.join(topic.name for topic in disturbed)}")
        with self._publishing(*disturbed) as senders:
            for _ in range(30):
                for topic, send in self._random.choices(senders, k=FEW):
                    cut = topic in STATES
                    send(self._random.choice(CUT_OFF) if cut else self._garbage(topic))
                self._graph.look()

    def _send_rival_force(self, topic: Topic) -> None:
        self._tell(f"a second publisher of {topic.name}")
        device, _ = RECEIVERS[topic]
        lines = self._graph.nodes[device].lines
        so_far = len(lines)
        strong = StampedVector(topic)
        with self._publishing(topic) as ((_, send),):

            def refused() -> bool:
                for _ in range(FEW):
                    bad = self._garbage(topic)
                    send(
                        self._random.choice((bad, strong.pack(self._graph.now, (10.0, 0.0, 10.0))))
                    )
                return any("no force while" in line for line in lines[so_far:])

            self._graph.wait_for(refused, "its refusal")
            since = time.monotonic()
            self._graph.within(0.5, lambda: not refused())
            self._graph.expect_no_force(since, [RECEIVERS[topic]])

    def _flood(self) -> None:
        topic = self._random.choice((*SIGNALS, topics.DIAGNOSTICS))
        seconds = self._random.uniform(0.5, 1.5)
        self._tell(f"a flood on {topic.name} for {seconds:.1f} s")
        good = StampedVector(topic) if topic in SIGNALS else None
        with self._publishing(topic) as ((_, send),):

            def sent() -> bool:
                for _ in range(BURST):
                    send(good.pack(self._graph.now, (0.0, 0.0, 0.1)) if good else b"\0")
                return False

            self._graph.within(seconds, sent)

    def _set_clock(self) -> None:
        lead = self._random.randint(-LONGEST_STEP, LONGEST_STEP)
        self._tell(f"the clock is set by {(lead - self._graph.lead) / 1e9:.1f} s")
        self._graph.set_clock(lead)

    def _stop(self, way: str) -> None:
        self._tell(f"emergency stop by {way}")
        self._graph.stopped.clear()
        self._request(way, True, self._both_stopped, ATTEMPTS if way == "service" else 1)
        since, self._stopped = time.monotonic(), True
        for surprise in self._random.sample(self._surprises, 2):
            surprise()
        self._graph.pause(self._random.uniform(0.0, 1.0))
        self._graph.wait_for(self._both_stopped, "both are stopped")
        self._graph.expect_no_force(since)
        self._stopped = False
        self._tell("release")
        self._request("service", False, self._graph.flow(), ATTEMPTS)

    def _both_stopped(self) -> bool:
        return list(self._graph.stopped.values()) == [True, True]

    def _request(self, way: str, stop: bool, done: Callable[[], bool], attempts: int) -> None:
        """Ask for an emergency stop or its release until that has its effect."""
        for _ in range(attempts):
            with self._asking(way, stop):
                if self._graph.within(PATIENCE / attempts, done):
                    return
        raise AssertionError(f"no effect of {attempts} requests by {way}: stop = {stop}")

    @contextmanager
    def _asking(self, way: str, stop: bool) -> Iterator[None]:
        """Ask for an emergency stop or its release, and be gone afterwards."""
        if way == "signal":
            stop_senders(self._graph.observer.context.get_domain_id(), "")
            yield
        elif way == "service":
            client = self._graph.observer.node.create_client(SetBool, EMERGENCY_STOP.name)
            self._graph.wait_for(client.service_is_ready, "the service of the coupler")
            client.call_async(SetBool.Request(data=stop))
            yield
            self._graph.observer.node.destroy_client(client)
        else:
            with self._publishing(EMERGENCY_STOP) as ((_, send),):
                send(serialize_message(Bool(data=True)))
                yield

    def _fail_recorder(self, damage: Callable[[], str]) -> None:
        """Let the recorder fail, which no force needs to know, and start it anew."""
        recorder = self._graph.nodes["recorder"]
        recorder.wait_for("recording to")
        reason = damage()
        self._tell(f"the recorder fails: {reason}")
        self._graph.wait_for(lambda: reason in recorder.text, f"the recorder says: {reason}")
        self._graph.wait_for(self._graph.flow(), "forces go on")
        self._graph.end("recorder", signal.SIGINT, 1)
        self._graph.start("recorder")

    def _remove_bag(self) -> str:
        shutil.rmtree(self._graph.bag.parent, ignore_errors=True)
        return "was removed while it was recorded"

    def _fill_disk(self) -> str:
        limit_size(self._graph.nodes["recorder"].process.pid, self._graph.bag)
        return "File too large"

    @contextmanager
    def _publishing(self, *of: Topic) -> Iterator[list[tuple[Topic, Callable[[bytes], Any]]]]:
        """Give functions that publish on topics, once they have subscribers."""
        node = self._graph.observer.node
        publishers = [
            node.create_publisher(message_type(topic), topic.name, quality(topic, depth=10))
            for topic in of
        ]
        self._graph.wait_for(
            lambda: all(each.get_subscription_count() for each in publishers), "subscribers"
        )
        senders = [each.handle.publish_raw for each in publishers]
        yield list(zip(of, senders, strict=True))
        for publisher in publishers:
            node.destroy_publisher(publisher)

    def _garbage(self, topic: Topic) -> bytes:
        """Return a message that is malformed or has a huge frame, a wrong stamp or value."""
        choice, now, vector = self._random.choice, self._graph.now, (0.0, 0.0, 0.1)
        pack = StampedVector(topic).pack
        messages = (
            lambda: choice(MALFORMED),
            lambda: StampedVector(replace(topic, frame=HUGE_FRAME)).pack(now, vector),
            lambda: pack(now, (choice(VALUES), choice(VALUES), choice(VALUES))),
            lambda: pack(choice((0, LATEST, now + round(choice(LEADS) * 1e9))), vector),
        )
        return choice(messages)()
