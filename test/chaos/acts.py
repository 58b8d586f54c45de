# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Acts on a graph. An act leaves nothing in the way of forces, unless they are stopped."""

from __future__ import annotations

import json
import math
import shutil
import signal
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from random import Random
from typing import Any

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameterTypes, SetParameters, SetParametersAtomically
from rclpy.serialization import serialize_message
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from chaos.live_graph import FORCES, Force, LiveGraph
from chaos.traced_node import ACTUATOR, ARM, TELEOP
from haptic_accel.core import topics
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import DEVICES, EMERGENCY_STOP, SIGNALS, Topic
from haptic_accel.graph.stop_signal import stop_senders
from haptic_accel.nodes.supervised_node import message_type, quality
from haptic_accel.setup.processes import COMPOSED
from haptic_accel.setup.setup import RECORDER, SCOPE
from running import PATIENCE, Command, limit_size

WITHOUT: dict[str, tuple[Force, ...]] = {
    "compensator": (("master_device", ACTUATOR),),
    "coupler": (("master_device", ARM), ("slave_device", ARM)),
    "slave_device": (("master_device", ARM), ("master_device", ACTUATOR)),
    "master_device": (("slave_device", ARM),),
    RECORDER: (),
    SCOPE: (),
}
"""Per node with a process of its own the forces that end with it."""

WHOLE: dict[str, tuple[Force, ...]] = {COMPOSED: (), TELEOP: FORCES}
"""Per process with all nodes in it, or below it, the forces that end in order where it is killed.
Nobody is left then who knows of an emergency stop."""

ALONG = (RECORDER, SCOPE, TELEOP)
"""Processes that no force needs while they stand still."""

RECEIVERS = {
    topics.MASTER_ARM_FORCE: ("master_device", ARM),
    topics.SLAVE_ARM_FORCE: ("slave_device", ARM),
    topics.ACTUATOR_FORCE: ("master_device", ACTUATOR),
}
SENDERS = {
    topics.MASTER_ARM_FORCE: "coupler",
    topics.SLAVE_ARM_FORCE: "coupler",
    topics.ACTUATOR_FORCE: "compensator",
    topics.MASTER.position: "master_device",
    topics.SLAVE.position: "slave_device",
    topics.TOOL_ACCELERATION: "slave_device",
}
"""Per signal the node that sends it."""

ARMS: tuple[Force, ...] = (("master_device", ARM), ("slave_device", ARM))
FOLLOWERS: dict[Topic, tuple[str, tuple[Force, ...]]] = {
    topics.MASTER.position: ("coupler", ARMS),
    topics.SLAVE.position: ("coupler", ARMS),
    topics.TOOL_ACCELERATION: ("compensator", (("master_device", ACTUATOR),)),
}
"""Per sample who follows it, and the forces that end without it."""

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

FORGETTING = 1.0
"""Time in which nodes say that a signal has one sender again, s: they look ten times a second."""

ATTEMPTS = 12
"""Requests that may be needed. A call is lost to a node that was killed just before, whose service
is known until its lease ends; a device accepts no release in its first second, and where one came
up meanwhile, all may be stopped again."""

WAYS, ASKED = ("topic", "service", "signal", "page"), ("service", "page")
"""Ways to stop, and those that may need several requests."""

PAGE_TIME = 2.0
"""Time for the page to answer, s."""

RECORDING = "recording to"
"""Begin of the recorder's line once there is a bag."""

GUEST = """
import signal
import rclpy
from rclpy.signals import SignalHandlerOptions
from haptic_accel.core.topics import SIGNALS
from haptic_accel.nodes.supervised_node import message_type, quality
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
        self._domain = graph.observer.context.get_domain_id()
        self._surprises: list[Callable[[], None]] = [
            *(partial(self._kill, name) for name in graph.nodes if name in WITHOUT),
            *(partial(self._freeze, name) for name in graph.nodes),
            *(partial(self._join, leave) for leave in (signal.SIGINT, signal.SIGKILL)),
            self._send_garbage,
            self._flood,
            *(partial(self._send_rival_force, topic) for topic in RECEIVERS),
            *(partial(self._send_rival_samples, topic) for topic in FOLLOWERS),
            self._ask_for_nonsense,
            *(partial(self._deactivate, device) for device in DEVICES),
            self._set_clock,
        ]
        self.kinds = [
            *self._surprises,
            *(partial(self._kill, name) for name in graph.nodes if name in WHOLE),
            *(partial(self._stop, way) for way in WAYS),
            self._leave_log_unread,
        ]
        if RECORDER in graph.nodes:
            damages = (self._remove_bag, self._fill_disk)
            self.kinds += [partial(self._fail_recorder, damage) for damage in damages]

    def _kill(self, name: str) -> None:
        self._tell(f"SIGKILL to {name}")
        self._graph.end(name, signal.SIGKILL, -signal.SIGKILL)
        self._graph.wait_without((WITHOUT | WHOLE)[name])
        if name in (RECORDER, SCOPE):
            self._expect_forces()
        if name == TELEOP:
            self._graph.wait_for(lambda: not self._graph.left(self._domain), "no process is left")
        self._graph.pause(self._random.uniform(0.0, 0.5))
        self._graph.start(name)

    def _freeze(self, name: str) -> None:
        seconds = self._random.choice((0.0, 0.02, 0.1, 0.5, 1.5))
        self._tell(f"SIGSTOP to {name} for {seconds:g} s")
        process = self._graph.nodes[name].process
        process.send_signal(signal.SIGSTOP)
        if seconds:
            self._graph.wait_without(WITHOUT.get(name, ()))
            if name in ALONG:
                self._expect_forces()
            if name == TELEOP and not self._stopped:
                self._stop_and_release(self._random.choice(("topic", "signal")))
            self._graph.pause(seconds)
        process.send_signal(signal.SIGCONT)

    def _expect_forces(self) -> None:
        """Wait for forces, unless they are stopped."""
        if not self._stopped:
            self._graph.wait_for(self._graph.flow(), "forces go on")

    def _stop_and_release(self, way: str) -> None:
        self._graph.stopped.clear()
        self._request(way, True, self._both_stopped, 1)
        self._request("service", False, self._graph.flow(), ATTEMPTS)

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
        strong = StampedVector(topic)

        def message() -> bytes:
            bad = self._garbage(topic)
            return self._random.choice((bad, strong.pack(self._graph.now, (10.0, 0.0, 10.0))))

        device, _ = RECEIVERS[topic]
        self._rival(topic, device, "no force while", message, [RECEIVERS[topic]])

    def _send_rival_samples(self, topic: Topic) -> None:
        sample = StampedVector(topic)
        follower, forces = FOLLOWERS[topic]

        def message() -> bytes:
            return sample.pack(self._graph.now, (0.01, 0.0, self._random.uniform(-0.02, 0.02)))

        self._rival(topic, follower, "no sample taken while", message, forces)

    def _rival(
        self,
        topic: Topic,
        receiver: str,
        refusal: str,
        message: Callable[[], bytes],
        forces: Collection[Force],
    ) -> None:
        """Publish what only one node may, maybe under its name; from the refusal on no force."""
        name = self._random.choice((SENDERS[topic], "rival"))
        # What an act before published has to be forgotten: the log tells once of the same.
        count = self._graph.observer.node.count_publishers
        self._graph.wait_for(lambda: count(topic.name) <= 1, "the former publishers are gone")
        self._graph.pause(FORGETTING)
        self._tell(f"a second publisher of {topic.name}, called {name}")
        lines = self._graph.lines(receiver)
        so_far = len(lines)
        rival = rclpy.create_node(name, context=self._graph.observer.context)
        with self._publishing(topic, node=rival) as ((_, send),):

            def refused() -> bool:
                for _ in range(FEW):
                    send(message())
                return any(refusal in line for line in lines[so_far:])

            self._graph.wait_for(refused, "its refusal")
            self._graph.wait_without(forces)
            since = time.monotonic()
            self._graph.within(0.5, lambda: not refused())
            self._graph.expect_no_force(since, forces)
        rival.destroy_node()

    def _ask_for_nonsense(self) -> None:
        node = self._random.choice(("compensator", "coupler", *DEVICES))
        self._tell(f"requests to {node} for what there is not")
        nonsense = [Parameter(name="none", value=ParameterValue(type=99))]
        for kind, service, fields in (
            (GetParameterTypes, "get_parameter_types", {"names": ["none", ""]}),
            (SetParameters, "set_parameters", {"parameters": nonsense}),
            (SetParametersAtomically, "set_parameters_atomically", {"parameters": nonsense}),
        ):
            self._call(kind, f"{node}/{service}", **fields)

    def _deactivate(self, device: str) -> None:
        self._tell(f"{device} is deactivated")
        for label in ("deactivate", "no such transition", "activate"):
            transition = Transition(label=label)
            self._call(ChangeState, f"{device}/change_state", transition=transition)
            if label == "deactivate":
                self._graph.wait_without([force for force in FORCES if force[0] == device])

    def _call(self, kind: Any, service: str, **fields: Any) -> None:
        """Call a service, which has to answer; again where a call may be lost (see ATTEMPTS)."""
        client = self._graph.observer.node.create_client(kind, service)
        answers: list[Any] = []
        for _ in range(ATTEMPTS):
            self._graph.wait_for(client.service_is_ready, service)
            answers.append(client.call_async(kind.Request(**fields)))
            if self._graph.within(
                PATIENCE / ATTEMPTS, lambda: any(answer.done() for answer in answers)
            ):
                break
        else:
            raise AssertionError(f"no answer to {ATTEMPTS} requests of {service}")
        self._graph.observer.node.destroy_client(client)

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
        self._request(way, True, self._both_stopped, ATTEMPTS if way in ASKED else 1)
        since, self._stopped = time.monotonic(), True
        for surprise in self._random.sample(self._surprises, 2):
            surprise()
        self._graph.pause(self._random.uniform(0.0, 1.0))
        self._graph.wait_for(self._both_stopped, "both are stopped")
        self._graph.expect_no_force(since)
        self._stopped = False
        self._tell("release")
        self._request("service", False, self._graph.flow(), ATTEMPTS)

    def _leave_log_unread(self) -> None:
        """Let every node log, by a stop and its release, while nobody reads and pipes are full."""
        self._tell("nobody reads a log")
        if recorder := self._graph.nodes.get(RECORDER):
            recorder.wait_for(RECORDING)  # which another act waits for, must not be lost
        with ExitStack() as unread:
            for node in self._graph.nodes.values():
                unread.enter_context(node.unread())
            self._stop_and_release("topic")

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
            stop_senders(self._domain, "")
            yield
        elif way == "service":
            client = self._graph.observer.node.create_client(SetBool, EMERGENCY_STOP.name)
            self._graph.wait_for(client.service_is_ready, "the service of the coupler")
            client.call_async(SetBool.Request(data=stop))
            yield
            self._graph.observer.node.destroy_client(client)
        elif way == "page":
            self._command_by_page({"action": "estop", "value": stop})
            yield
        else:
            with self._publishing(EMERGENCY_STOP) as ((_, send),):
                send(serialize_message(Bool(data=True)))
                yield

    def _command_by_page(self, command: dict[str, Any]) -> None:
        """Send a command as the live page does, once the page is there."""
        request = urllib.request.Request(
            f"{self._graph.page}/command",
            data=json.dumps(command).encode(),
            headers={"Content-Type": "application/json", "Origin": self._graph.page},
        )

        def arrives() -> bool:
            try:
                urllib.request.urlopen(request, timeout=PAGE_TIME).close()
            except urllib.error.HTTPError as refusal:  # the page is there
                return refusal.code != HTTPStatus.SERVICE_UNAVAILABLE
            except OSError:
                return False
            return True

        self._graph.wait_for(arrives, "the page answers")

    def _fail_recorder(self, damage: Callable[[], str]) -> None:
        """Let the recorder fail, which no force needs to know, and start it again."""
        recorder = self._graph.nodes[RECORDER]
        recorder.wait_for(RECORDING)
        reason = damage()
        self._tell(f"the recorder fails: {reason}")
        self._graph.wait_for(lambda: reason in recorder.text, f"the recorder says: {reason}")
        self._expect_forces()
        self._graph.end(RECORDER, signal.SIGINT, 1)
        self._graph.start(RECORDER)

    def _remove_bag(self) -> str:
        shutil.rmtree(self._graph.bag.parent, ignore_errors=True)
        return "was removed while it was recorded"

    def _fill_disk(self) -> str:
        limit_size(self._graph.nodes[RECORDER].process.pid, self._graph.bag)
        return "File too large"

    @contextmanager
    def _publishing(
        self, *of: Topic, node: Any = None
    ) -> Iterator[list[tuple[Topic, Callable[[bytes], Any]]]]:
        """Give functions that publish on topics, once they have subscribers."""
        node = node or self._graph.observer.node
        publishers = [
            node.create_publisher(message_type(topic), topic.name, quality(topic, depth=10))
            for topic in of
        ]
        self._graph.wait_for(
            lambda: all(each.get_subscription_count() for each in publishers), "subscribers"
        )
        senders = [each.publish for each in publishers]
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
