# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `recorder`: records every topic of the graph into a bag.

Signals come in bundles, or by topic from senders that do not bundle.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags import interfaces as rosbag2
from std_srvs.srv import Trigger

from haptic_accel.bags.metadata import UndefinedTypeError
from haptic_accel.bags.trial_metadata import PARAMETERS, custom_data, read_description
from haptic_accel.bags.writing import Answer, MessageWriter, RecordingSession
from haptic_accel.core import cdr, topics
from haptic_accel.core.cdr import DUPLICATE_MEMORY, BothWays, InOrder, believed, unpack_bundle
from haptic_accel.core.process import RECORDED, notify_supervisor
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.signals import Inbox, participant
from haptic_accel.nodes.supervised_node import message_type, offered_quality, quality
from haptic_accel.nodes.timing import RECORDING_PRIORITY
from haptic_accel.setup.node_parameters import NODES

SENDERS_PERIOD = 0.1
"""Interval between checks for new publishers, s."""

LOOKUP_PERIOD = 1.0
"""Interval between look-ups of the publishers' identities while their number is constant, s."""


class _Signal:
    """Signal received in bundles and, if necessary, by its own topic.

    Parameters
    ----------
    name : str
        Full name.
    topic : Topic

    Attributes
    ----------
    join : callable
        Function that makes a message from a sample of a bundle.
    inbox : Inbox or None
        Inbox of the signal's own topic; None while all messages come in bundles.
    senders : list of bytes
        Process of each publisher.
    bundled : bool
        Messages from the present publishers have come in bundles.
    both_ways : BothWays or None
        Received messages, while some may arrive both in bundles and separately.
    """

    def __init__(self, name: str, topic: topics.Topic) -> None:
        self.name, self.topic = name, topic
        self.join = cdr.StampedVector(topic).join
        self.inbox: Inbox | None = None
        self.senders: list[bytes] = []
        self.bundled = False
        self.both_ways: BothWays | None = None
        self._until = math.inf

    def subscribe(self, node: GraphNode) -> None:
        """Subscribe to the signal's own topic."""
        self.inbox = node.inbox(self.topic)
        self.both_ways = self.both_ways or BothWays()
        self._until = math.inf

    def leave(self, now: float) -> None:
        """Receive messages in bundles only, from the steady time `now`, s."""
        if self.inbox:
            self.inbox.leave()
            self.inbox = None
            self._until = now + DUPLICATE_MEMORY

    def forget(self, now: float) -> None:
        """Stop comparing messages once all separate ones have also come in bundles."""
        if now >= self._until:
            self.both_ways = None

    def repeats(self, message: bytes, *, bundled: bool, now: float) -> bool:
        """Return whether the same message has arrived the other way (bundled or separate)."""
        return bool(self.both_ways and self.both_ways.repeats(message, bundled=bundled, now=now))


class SignalReceiver:
    """Receiver that gets each message of some signals once, in bundles where possible.

    A publisher also sends its messages in bundles if its process publishes bundles in the same
    namespace. The receiver subscribes to a signal's own topic if any publisher does not bundle, or
    no publisher exists.

    Parameters
    ----------
    node : GraphNode
    signals : mapping
        Topics of the signals by their full names.
    """

    def __init__(self, node: GraphNode, signals: Mapping[str, topics.Topic]) -> None:
        self._node = node
        self._bundles = node.inbox(topics.BUNDLES)
        self._signals = {name: _Signal(name, topic) for name, topic in signals.items()}
        self._left: list[tuple[int, str, bytes]] = []
        self._counts: list[int] = []
        self._lookup_due = 0.0
        for signal in self._signals.values():
            signal.subscribe(node)
        node.create_timer(SENDERS_PERIOD, self.poll)

    def drain(self) -> list[tuple[int, str, bytes]]:
        """Return system times in ns, full topic names, and received messages."""
        new, self._left = self._left, []
        for signal in self._signals.values():
            new += self._by_itself(signal)
        new += self._in_bundles()
        return new

    def poll(self) -> None:
        """Update the subscriptions to the signals' own topics for the present publishers."""
        now = time.monotonic()
        names = self._bundles.name, *self._signals
        counts = [self._node.count_publishers(name) for name in names]
        pending = any(signal.inbox and signal.bundled for signal in self._signals.values())
        if counts == self._counts and not pending and now < self._lookup_due:
            return
        self._counts, self._lookup_due = counts, now + LOOKUP_PERIOD
        bundling = set(self._senders(names[0]))
        for signal in self._signals.values():
            senders = self._senders(signal.name)
            if senders != signal.senders:
                signal.senders, signal.bundled = senders, False
            signal.forget(now)
            # The bundles lack the samples of a second publisher in the same process.
            known = bool(senders) and len(bundling.intersection(senders)) == len(senders)
            if not known and not signal.inbox:
                signal.subscribe(self._node)
            elif known and signal.inbox and signal.bundled:
                self._left += self._by_itself(signal)
                signal.leave(now)

    def _senders(self, name: str) -> list[bytes]:
        return sorted(map(participant, self._node.get_publishers_info_by_topic(name)))

    def _by_itself(self, signal: _Signal) -> Iterator[tuple[int, str, bytes]]:
        now = time.monotonic()
        for data, received, _ in (
            signal.inbox.drain(cdr.unpack_stamped_vector) if signal.inbox else ()
        ):
            if not signal.repeats(data, bundled=False, now=now):
                yield received, signal.name, data

    def _in_bundles(self) -> Iterator[tuple[int, str, bytes]]:
        now = time.monotonic()
        for _, received, bundle in self._bundles.drain(unpack_bundle):
            for name, sent, stamp, numbers in bundle:
                if signal := self._signals.get(name):
                    signal.bundled = True
                    message = signal.join(stamp, numbers)
                    if not signal.repeats(message, bundled=True, now=now):
                        yield believed(sent, received), name, message


TAKING_PERIOD = 0.02
"""Interval at which waiting messages of the signals are read, s: waking for each message would
take a fifth of a core, and a queue of `DEPTH` holds ten times as many at 5 kHz."""

ROUNDS = 3
"""Number of `TAKING_PERIOD` that a message waits for earlier messages, which come in bundles."""

NICENESS = 10
"""Niceness of the recorder without real-time priority, to yield to nodes that compute forces."""

DISCOVERY_PERIOD = 1.0
"""Interval between searches for topics specified by name or expression, s."""

MUCH_WAITING = 0.5
"""Fraction of the queue in use above which a warning is given."""

LITTLE_SPACE = 1 << 30
"""Free space below which a warning is given, bytes: ten minutes of the graph at 1 kHz."""

LOGS = topics.Topic("/rosout", "rcl_interfaces/msg/Log", "", "", reliable=True, latched=True)
"""Log of all nodes."""

TRANSITIONS = tuple(
    topics.Topic(
        f"{device}/transition_event", "lifecycle_msgs/msg/TransitionEvent", "", "", reliable=True
    )
    for device in topics.DEVICES
)
"""Transitions of the managed nodes."""


def _reporter(diagnostics: bytes) -> str:
    """Return the node of a diagnostic message, "left/node"; empty without a status."""
    frame = cdr.unpack_text(diagnostics, cdr.STAMP_BYTES.stop)
    # After the frame, aligned to 4 bytes: number of statuses, then level and name of the first.
    number = cdr.STAMP_BYTES.stop + 4 + (len(frame.encode()) + 4) // 4 * 4
    if diagnostics[number : number + 4] == bytes(4):
        return ""
    return "/".join(topics.reporter(cdr.unpack_text(diagnostics, number + 8))).lstrip("/")


SENDERS: dict[topics.Topic, Callable[[bytes], str]] = {
    topics.DIAGNOSTICS: _reporter,
    topics.PARAMETER_EVENTS: lambda data: cdr.unpack_text(data, cdr.STAMP_BYTES.stop).lstrip("/"),
    LOGS: lambda data: cdr.unpack_text(data, cdr.STAMP_BYTES.stop + 4).replace(".", "/"),
}
"""Functions that return the node that a message concerns, "left/node", for topics of all
graphs."""


def _described(message: bytes) -> tuple[str, ...]:
    """Return the nodes that a description concerns."""
    return tuple(read_description(cdr.unpack_text(message, cdr.STAMP_BYTES.start))[PARAMETERS])


UNPACKED: dict[str, Callable[[bytes], object]] = {
    **dict.fromkeys(topics.VECTORS, cdr.unpack_stamped_vector),
    topics.EMERGENCY_STOP.type: cdr.unpack_state,
    topics.DESCRIPTION.type: _described,
    **{topic.type: sender for topic, sender in SENDERS.items()},
}
"""Functions that unpack messages, by type; messages that they refuse are not recorded, as they
would make a bag hard to read."""

MICROSECONDS = 1e6


class Recorder(GraphNode):
    """Node that passes serialised messages to the writer of a bag."""

    task = "recording"

    def __init__(self) -> None:
        super().__init__("recorder")
        p = self.parameters
        self._session = RecordingSession(p.bag, p.queue, p, custom_data(p.facts))
        self._reported = ""
        self._settled: set[str] = set()
        self._sources: list[tuple[Inbox, MessageWriter, Callable[[bytes], object]]] = []
        self._drained = 0.0
        self._in_order: InOrder[tuple[MessageWriter, bytes]] = InOrder(ROUNDS)
        signals = {self.resolve_topic_name(topic.name): topic for topic in topics.SIGNALS}
        self._receiver = SignalReceiver(self, signals)
        self._writers: dict[str, MessageWriter] = {}
        self._descriptions: dict[tuple[str, ...], Callable[[], object]] = {}
        named = (topic for topic in topics.ON_DEMAND if topic.name in p.named_topics)
        for topic in (*topics.TOPICS, *named, topics.PARAMETER_EVENTS, LOGS, *TRANSITIONS):
            self._record_own(topic)
        session = self._session
        for action in (session.start, session.pause, session.split, session.stop):
            self._serve(action.__name__, action)
        self._serve("status", self._describe)
        if p.topics or p.regex:
            self.create_timer(DISCOVERY_PERIOD, self._discover_topics)
        self.get_logger().info(f"{session.state} to {session.path}")

    def work(self) -> float:
        """Read the received messages of the signals."""
        now = time.monotonic()
        if now >= self._drained + TAKING_PERIOD:
            self._drained = now
            self._drain()
        return self._drained + TAKING_PERIOD

    def close(self) -> None:
        """Finish the bag and print its summary."""
        self._drain_all()
        done, line = self._session.stop()
        if done:
            print(line, flush=True)
            notify_supervisor(RECORDED, path=str(self._session.path))
        if self._session.failures:
            raise OSError("; ".join(self._session.failures))

    def publish_final_diagnostics(self) -> None:
        """Publish nothing, as the other nodes have ended."""

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return counts of messages written, waiting and lost, and the state of the disk."""
        writer = self._session.writer
        files, load = writer.files, writer.pop_load()
        waiting, free = load.highest, files.free_space
        warnings = (
            (writer.dropped, f"{writer.dropped} messages dropped"),
            (files.trouble, files.trouble),
            (waiting > MUCH_WAITING * writer.capacity, f"{waiting} messages wait for the disk"),
            (free < LITTLE_SPACE, f"{free / 1e6:.0f} MB are left on the disk"),
        )
        # Report only a failure: after it, other warnings would change with every message.
        warning = files.failure or "; ".join(text for is_present, text in warnings if is_present)
        if warning and warning != self._reported:
            self.get_logger().warning(warning)
        self._reported = warning
        return warning, {
            "bag": str(self._session.path),
            "state": self._session.state,
            "files": str(len(files.file_names)),
            "written": str(files.written),
            "written (bytes)": str(files.bytes),
            "waiting": str(load.waiting),
            "highest waiting": str(load.highest),
            "dropped": str(writer.dropped),
            "missing by stamps": str(writer.missing),
            "flush max (us)": f"{load.flush_time * MICROSECONDS:.0f}",
            "free space (bytes)": str(free),
        }

    def _record_own(self, topic: topics.Topic) -> None:
        """Subscribe to one of the graph's topics, whose type and quality of service are known."""
        name = self.resolve_topic_name(topic.name)
        self._settled.add(name)
        live = rosbag2.QosLiveliness.AUTOMATIC
        offered = _stored(offered_quality(topic))._replace(liveliness=live)
        write = self._session.connect(name, topic.type, [offered], sampled=topic in topics.SIGNALS)
        if topic in SENDERS:
            write = self._own_only(write, SENDERS[topic])
        if topic is topics.DESCRIPTION:
            write = self._kept(write)
        if topic in topics.SIGNALS:
            self._writers[name] = write
        else:
            self._sources.append((self.inbox(topic), write, UNPACKED.get(topic.type, bytes)))

    def _own_only(self, write: MessageWriter, sender: Callable[[bytes], str]) -> MessageWriter:
        """Ignore the messages of graphs in other namespaces."""
        own = self.get_namespace().strip("/")

        def write_own(message: bytes, received: int | None = None) -> None:
            namespace, _, node = sender(message).rpartition("/")
            below = f"{namespace}/".startswith(f"{own}/" if own else "")
            if namespace == own or (below and node not in NODES):
                write(message, received)

        return write_own

    def _kept(self, write: MessageWriter) -> MessageWriter:
        """Keep the last description of each node for the bags that follow."""

        def write_and_keep(message: bytes, received: int | None = None) -> None:
            self._descriptions[_described(message)] = partial(write, message)
            write(message, received)

        return write_and_keep

    def _drain(self) -> None:
        """Read the received messages, and write earlier messages in time order."""
        new = [
            (received, (write, data))
            for inbox, write, unpack in self._sources
            for data, received, _ in inbox.drain(unpack)
        ]
        new += [(sent, (self._writers[name], data)) for sent, name, data in self._receiver.drain()]
        for received, (write, data) in self._in_order.round(new):
            write(data, received)

    def _drain_all(self) -> None:
        """Write all received messages."""
        self._drain()
        for received, (write, data) in self._in_order.rest():
            write(data, received)

    def _subscribe(self, kind: Any, name: str, write: MessageWriter, profile: QoSProfile) -> None:
        # Lost messages are found by their stamps. The middleware's event (message lost) is no
        # help: when only 95 of 5000 messages arrived, Fast DDS reported 5 losses, and with the
        # wheels' events executor, reading the event can hang forever.
        self.create_subscription(kind, name, lambda data: write(data), profile, raw=True)

    def _discover_topics(self) -> None:
        """Record the topics specified by name or expression that exist by now."""
        named = {self.resolve_topic_name(name) for name in self.parameters.named_topics}
        for name, kinds in self.get_topic_names_and_types():
            if name in self._settled or not (name in named or self._is_found(name)):
                continue
            publishers = self.get_publishers_info_by_topic(name)
            if not publishers:
                continue  # its quality of service is not known yet
            self._settled.add(name)
            problem = self._record_found(name, kinds, [p.qos_profile for p in publishers])
            if problem:
                self.get_logger().warning(f"{name}: is not recorded: {problem}")

    def _is_found(self, name: str) -> bool:
        """Return whether the expressions select a topic; hidden topics are excluded."""
        hidden = any(word.startswith("_") for word in name.split("/"))
        return not hidden and bool(self.parameters.finds(name))

    def _record_found(self, name: str, kinds: Sequence[str], offered: Sequence[QoSProfile]) -> str:
        """Subscribe to a topic with the offered quality of service; return any problem."""
        if len(kinds) > 1:
            return f"it has {len(kinds)} types: {', '.join(kinds)}"
        (kind,) = kinds
        try:
            message = message_type(topics.Topic(name, kind, "", ""))
            write = self._session.connect(name, kind, [_stored(profile) for profile in offered])
        except (ImportError, AttributeError) as error:
            return f"{kind} is not installed: {error}"
        except UndefinedTypeError as error:
            return str(error)
        self._subscribe(message, name, write, _requested(offered))
        self.get_logger().info(f"{name}: recorded too")
        return ""

    def _serve(self, name: str, action: Callable[[], Answer]) -> None:
        """Offer an action on the recording as a service."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self._drain_all()
            response.success, response.message = action()
            if response.success and action == self._session.start:
                for describe in self._descriptions.values():
                    describe()
            if action != self._describe:
                self.get_logger().info(response.message)
                self.report()
            return response

        self.create_service(Trigger, f"~/{name}", answer)

    def _describe(self) -> Answer:
        """Describe the state of the recording."""
        session, files = self._session, self._session.writer.files
        return not files.failure, (
            f"{session.path}: {session.state}, {files.written} messages in"
            f" {len(files.file_names)} file(s), {session.writer.dropped} dropped"
        )


def _stored(profile: QoSProfile) -> rosbag2.Qos:
    """Return a quality of service in rosbag2's stored form."""
    return rosbag2.Qos(
        rosbag2.QosHistory(int(profile.history)),
        profile.depth,
        rosbag2.QosReliability(int(profile.reliability)),
        rosbag2.QosDurability(int(profile.durability)),
        _time(profile.deadline.nanoseconds),
        _time(profile.lifespan.nanoseconds),
        rosbag2.QosLiveliness(int(profile.liveliness)),
        _time(profile.liveliness_lease_duration.nanoseconds),
        bool(profile.avoid_ros_namespace_conventions),
    )


def _time(nanoseconds: int) -> rosbag2.QosTime:
    return rosbag2.QosTime(*divmod(nanoseconds, NANOSECONDS))


def _requested(offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strictest quality that all publishers of a topic offer (as `ros2 bag record`)."""
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
    return quality(topics.Topic("", "", "", "", reliable, latched))


def main() -> None:
    """Run the node."""
    run_nodes("recorder", Recorder, niceness=NICENESS, priority=RECORDING_PRIORITY)


if __name__ == "__main__":
    main()
