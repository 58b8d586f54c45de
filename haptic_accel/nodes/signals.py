# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals that a node sends, also in bundles, and queues of received messages and requests."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription

from haptic_accel.core import cdr
from haptic_accel.core.model import IDENTITY, Quaternion, Vector
from haptic_accel.core.sampling import NANOSECONDS, SequenceCheck, SolePublisher
from haptic_accel.core.topics import BUNDLES, Topic
from haptic_accel.devices import rclpy_internals as internals
from haptic_accel.nodes.supervised_node import CallbackGuard, SupervisedNode

BUNDLES_KEPT = 100
"""Number of bundles kept by a publisher, two seconds' worth, to resend any that is lost."""

FLUSH_PERIOD = 0.1
"""Time after which an incomplete bundle is sent if no further sample follows, s."""

_PERIOD = round(cdr.BUNDLE_PERIOD * NANOSECONDS)

_shared: dict[tuple[Any, str], BundleSender] = {}


def participant(endpoint: Any) -> bytes:
    """Return the globally unique identifier of an endpoint's process."""
    return bytes(endpoint.endpoint_gid)[:12]


def owner(endpoint: Any) -> tuple[bytes, str]:
    """Return an endpoint's process and the full name of its node."""
    return participant(endpoint), f"{endpoint.node_namespace}/{endpoint.node_name}"


def join(node: Node, offer: Callable[[], Publisher]) -> BundleSender:
    """Return the bundles that all nodes of a process and namespace share.

    Parameters
    ----------
    node : Node
    offer : callable
        Creates the publisher of the bundles for their first node.
    """
    key = _key(node)
    if key not in _shared:
        _shared[key] = BundleSender(node, offer())
    return _shared[key]


def _key(node: Node) -> tuple[Any, str]:
    return node.context, node.resolve_topic_name(BUNDLES.name)


class BundleSender:
    """Publisher of the samples of a process's signals in bundles.

    Parameters
    ----------
    node : Node
        Node that publishes the bundles; once it is destroyed, bundling stops.
    publisher : Publisher

    Attributes
    ----------
    listening : callable
        Returns the number of subscribers found.
    period : int
        Number of bundles due so far, with samples or without. Subscribers are counted once per
        period, as counting them for each sample would dominate the cost.
    """

    def __init__(self, node: Node, publisher: Publisher) -> None:
        self._node = node
        self._bundle = cdr.Bundle()
        self._listened = self._since = 0
        self.period = 1
        self.index, self._add = self._bundle.index, self._bundle.put
        self._name = publisher.topic_name
        self._publish = internals.bytes_publisher(publisher)
        self.listening = internals.subscriber_count(publisher)
        node.create_timer(FLUSH_PERIOD, self.flush)

    def listeners(self, node: Node) -> set[tuple[bytes, str]]:
        """Return the `owner` of each subscriber."""
        return set(map(owner, node.get_subscriptions_info_by_topic(self._name)))

    def put(self, index: int, stamp: int, vector: Vector, orientation: Quaternion) -> None:
        """Add a sample of a topic that is sent now."""
        now = time.time_ns()
        is_full = self._listened and self._add(now, index, stamp, *vector, *orientation)
        # The comparison with 0 keeps a clock that is set back from delaying samples.
        if is_full or not 0 <= now - self._since < _PERIOD:
            self.flush()

    def flush(self) -> None:
        """Publish collected samples, and count the subscribers again."""
        if data := self._bundle.flush():
            self._publish(data)
        self._since, self._listened = time.time_ns(), self.listening()
        self.period += 1

    def leave(self, node: Node) -> None:
        """Publish collected samples before a node is destroyed."""
        if node is self._node:
            self.listening = int
            del _shared[_key(node)]
        self.flush()


RIVALS_PERIOD = 0.1
"""Interval between look-ups of a signal's additional publishers for the log, s; samples are
refused at once."""

LISTENERS_PERIOD = 0.2
"""Interval between look-ups of a signal's subscribers while their number is constant, s."""

Value = TypeVar("Value")


class Sender:
    """Sender of a signal to other processes; its own topic is used only if subscribed to.

    The loop passes the signal on to nodes in the same process.

    Parameters
    ----------
    node : SupervisedNode
    topic : Topic
    bundles : BundleSender, optional
        Bundles to which all samples are added.
    """

    def __init__(
        self, node: SupervisedNode, topic: Topic, bundles: BundleSender | None = None
    ) -> None:
        self._node, self._topic, self._bundles = node, topic, bundles
        self._pack = cdr.StampedVector(topic).pack
        self._wire = node.wire(topic)
        self._index = bundles.index(node.resolve_topic_name(topic.name)) if bundles else 0
        self._counts = 0, 0
        self._others = self._counted_period = 0
        self._count_due = 0.0
        self.offer()

    def offer(self) -> None:
        """Become a publisher of the topic, also after `withdraw`."""
        self._publisher = self._node.publisher(self._topic)
        self._publish = internals.bytes_publisher(self._publisher)
        self._subscribed = internals.subscriber_count(self._publisher)
        self._has_subscriber = False
        self._wire.offer()

    def withdraw(self) -> None:
        """Leave the topic to other senders; send nothing until `offer`."""
        self._wire.offer(False)
        self._node.destroy_publisher(self._publisher)

    def send(self, stamp: int, vector: Vector, orientation: Quaternion = IDENTITY) -> None:
        """Send a vector with a stamp, system time in ns; only a pose has an orientation."""
        bundles = self._bundles
        if not bundles or self._counted_period != bundles.period:
            self._counted_period = bundles.period if bundles else 0
            self._has_subscriber = self._subscribed() > 0
        if self._has_subscriber:
            self._publish(self._pack(stamp, vector, orientation))
        if bundles:
            bundles.put(self._index, stamp, vector, orientation)

    @property
    def listeners(self) -> int:
        """Number of receivers: in this process, and subscribers of the signal or its bundles.

        A subscriber to both counts once.
        """
        subscribed = self._subscribed()
        bundled = self._bundles.listening() if self._bundles else 0
        if subscribed and bundled:
            subscribed = self._unbundled(subscribed, bundled)
        return self._wire.listeners + subscribed + bundled

    def _unbundled(self, subscribed: int, bundled: int) -> int:
        """Return the number of subscribers that do not receive bundles, from the last look-up."""
        now = time.monotonic()
        if (subscribed, bundled) != self._counts or now >= self._count_due:
            self._counts, self._count_due = (subscribed, bundled), now + LISTENERS_PERIOD
            found = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
            assert self._bundles
            both = self._bundles.listeners(self._node)
            self._others = min(subscribed, sum(owner(each) not in both for each in found))
        return self._others


class Publishers:
    """Publishers matched with a subscription.

    Attributes
    ----------
    name : str
        Full name of the topic.
    """

    def __init__(self, subscription: Subscription) -> None:
        self.name = subscription.topic_name
        self._count = internals.publisher_count(subscription)

    @property
    def senders(self) -> int:
        """Number of publishers; nodes of equal names count separately.

        The middleware's count takes 0.3 us, a look-up of the nodes' names 45 us.
        """
        return self._count()


class Inbox:
    """Queue of messages of one topic, whose arrival wakes no process.

    If this process sends the signal, no messages of it are read from any publisher.

    Parameters
    ----------
    node : SupervisedNode
    topic : Topic
    depth : int
        Maximum number of waiting messages.

    Attributes
    ----------
    name : str
        Full name of the topic.
    subscription : Subscription or None
        None while the signal is sent in this process.
    sole : bool
        True if the messages of the last drain come from a single publisher.
    contested : int
        Number of messages that `drain_sole` dropped.
    changed : bool
        True if publishers appeared or left between the last two drains.
    contenders : int
        Number of publishers that may have sent the messages of the last drain; 1 if the signal is
        sent in this process.
    """

    def __init__(self, node: SupervisedNode, topic: Topic, depth: int) -> None:
        self._node, self._topic = node, topic
        self._depth = depth
        self.name = node.resolve_topic_name(topic.name)
        self.subscription: Subscription | None = None
        self._count_time, self._senders = -math.inf, 1
        self.sole, self.changed, self.contenders, self.contested = True, False, 1, 0
        self._wire = node.wire(topic)
        self._wire.join(self._connect)

    def leave(self) -> None:
        """Stop receiving messages."""
        self._wire.leave(self._connect)
        self._unsubscribe()

    @property
    def fed(self) -> bool:
        """True while the signal is sent in this process."""
        return self.subscription is None

    @property
    def senders(self) -> int:
        """Number of publishers, as `Publishers` counts them.

        Without a subscription, publishers are counted at intervals only: a count takes 8 us.
        """
        if self.subscription:
            return self._count()
        if (now := time.monotonic()) >= self._count_time + RIVALS_PERIOD:
            self._count_time, self._senders = now, self._node.count_publishers(self.name)
        return self._senders

    def drain(self, unpack: Callable[[bytes], Value]) -> list[tuple[bytes, int, Value]]:
        """Return serialised messages, reception times (system time, ns), and unpacked values.

        Messages that cannot be unpacked are refused.
        """
        return [
            (data, information["received_timestamp"], value)
            for data, information, value in self._unpacked(unpack)
        ]

    def drain_vectors(self) -> list[tuple[int, Vector]]:
        """Return stamps, system time in ns, and vectors of a signal."""
        return [vector for _, _, vector in self._unpacked(cdr.unpack_stamped_vector)]

    def drain_sole(self, unpack: Callable[[bytes], Value]) -> list[Value]:
        """Return unpacked messages; none if several publishers may have sent them."""
        values = self._judged(unpack)
        if self.sole:
            return values
        self.contested += len(values)
        return []

    def drain_states(self) -> list[bool]:
        """Return the values of a state, from any publishers."""
        return self._judged(cdr.unpack_state)

    def _connect(self, here: bool) -> None:
        """Leave the signal to this process's loop if sent here; otherwise subscribe to it."""
        if here:
            self._unsubscribe()
        elif not self.subscription:
            self._subscribe()

    def _subscribe(self) -> None:
        self.subscription = self._node.subscribe_raw(self._topic, ignore, self._depth)
        if internals.TAKES:
            self._node.unserved.add(self.subscription)
        self._take = internals.message_taker(self.subscription)
        self._count = internals.publisher_count(self.subscription)
        matched = internals.MatchedPublishers(self._node, self.subscription)
        self._publisher = SolePublisher(matched.counts)

    def _unsubscribe(self) -> None:
        if self.subscription:
            self._node.unserved.discard(self.subscription)
            self._node.destroy_subscription(self.subscription)
            self.subscription = None
            self.sole, self.changed, self.contenders = True, False, 1

    def _judged(self, unpack: Callable[[bytes], Value]) -> list[Value]:
        """Return unpacked messages, and decide whether all have a single publisher."""
        found = list(self._unpacked(unpack))
        if self.subscription:
            publisher = self._publisher
            if not found and self.sole and publisher.current == (count := self._count()):
                self.changed, self.contenders = False, count
                return []  # the usual case; reading the middleware's events is slower
            # Checked after reading messages, whose publishers are known by now.
            numbers = [info["publication_sequence_number"] for _, info, _ in found]
            self.sole = publisher.sole(numbers)
            self.changed, self.contenders = publisher.changed, publisher.contenders
            if not self.sole:
                found += self._unpacked(unpack)
        return [value for _, _, value in found]

    def _unpacked(
        self, unpack: Callable[[bytes], Value]
    ) -> Iterator[tuple[bytes, dict[str, int], Value]]:
        """Yield data, information and value of waiting messages; refuse malformed ones."""
        while self.subscription and (message := self._take()):
            data, information = message
            try:
                value = unpack(data)
            except ValueError as error:
                self._node.refuse(self._topic, str(error))
            else:
                yield data, information, value


class Requests:
    """Queue of requests to one service, which may be answered later.

    Parameters
    ----------
    service : Service
    guard : CallbackGuard
    """

    def __init__(self, service: Service, guard: CallbackGuard) -> None:
        self._service, self._guard = service, guard
        self._answer = service.send_response
        self._take = internals.request_taker(service)

    def drain(self) -> Iterator[tuple[Any, Callable[[Any], None]]]:
        """Yield each request with the function to call with the response."""
        while (message := self._next())[1] is not None:
            request, header = message
            yield request, partial(self._answer, header=header)

    def _next(self) -> tuple[Any, Any]:
        """Return the next request and its header, or (None, None)."""
        try:
            return self._take()
        except Exception as error:
            self._guard.note(self._service.service_name, error)
            return None, None


class Samples:
    """Samples of one signal that a `SequenceCheck` admits, in order and in time.

    There are no samples while the signal has several publishers (`Inbox.drain_sole`).

    Parameters
    ----------
    inbox : Inbox
    rate : float
        Samples per second.
    jumped : callable
        Called with this object before the first sample after a clock change.

    Attributes
    ----------
    sequence : SequenceCheck
    """

    def __init__(self, inbox: Inbox, rate: float, jumped: Callable[[Samples], None]) -> None:
        self._inbox = inbox
        self._jumped = jumped
        self._first = True
        self.sequence = SequenceCheck(rate)

    @property
    def contested(self) -> int:
        """Number of samples refused because the signal had several publishers."""
        return self._inbox.contested

    def drain(self) -> Iterator[tuple[int, Vector]]:
        """Yield stamps, system time in ns, and vectors."""
        now, steady = time.time_ns(), time.monotonic_ns()
        for stamp, vector in self._inbox.drain_sole(cdr.unpack_stamped_vector):
            if self.sequence.admits(stamp, now, steady):
                if self.sequence.jump:
                    self._jumped(self)
                yield stamp, vector
        if self._first:  # the node's own start delayed these samples, not their sender
            self._first = False
            self.sequence.outdated = 0


def ignore(*received: Any) -> None:
    """Ignore the arrival of a message or request, which the node reads when it has time."""
