# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Undocumented names of rclpy; imports ROS, so import this module late.

Undocumented names are faster than documented ones, or wake no thread. No other module uses them. A
name is looked up once, when a node, publisher, subscription or service is made. If the name does
not exist, the documented way is used.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import rclpy.logging
from rclpy.event_handler import EventHandler, QoSSubscriptionEventType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription

from haptic_accel.core.parameters import printable
from haptic_accel.core.sampling import Matched


def _named(name: str, *modules: str) -> Any:
    """Return an attribute of the first of rclpy's modules that has it; None without one."""
    for module in modules:
        with suppress(ImportError, AttributeError):
            return getattr(import_module(f"rclpy.{module}"), name)
    return None


def _direct(entity: Any, name: str, documented: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method of the C library's object of an entity, or the documented method."""
    return getattr(getattr(entity, "handle", None), name, documented)


_LIBRARY = _named("rclpy_implementation", "impl.implementation_singleton")

EventsExecutor = _named("EventsExecutor", "executors", "experimental")
"""Executor of the nodes; in the module `executors` from Lyrical on."""

TAKES = all(
    hasattr(getattr(_LIBRARY, kind, None), name)
    for kind, name in (("Subscription", "take_message"), ("Service", "service_take_request"))
)
"""True if messages and requests can be taken without an executor."""

Received = tuple[Any, dict[str, Any]]
"""Message and its metadata."""


def bytes_publisher(publisher: Publisher) -> Callable[[bytes], object]:
    """Return `publish` for serialised messages, without type checks."""
    return _direct(publisher, "publish_raw", publisher.publish)


def subscriber_count(publisher: Publisher) -> Callable[[], int]:
    """Return a function that counts the subscribers of a publisher."""
    return _direct(publisher, "get_subscription_count", publisher.get_subscription_count)


def publisher_count(subscription: Subscription) -> Callable[[], int]:
    """Return a function that counts the publishers of a subscription."""
    return _direct(subscription, "get_publisher_count", subscription.get_publisher_count)


def message_taker(
    subscription: Subscription, serve: Callable[[], object] = int
) -> Callable[[], Received | None]:
    """Return a function that takes the next message; None if there is none.

    Parameters
    ----------
    subscription : Subscription
    serve : callable
        Function that serves the subscription if an executor is required (`TAKES`) and the node has
        none.
    """
    if TAKES:
        take = subscription.handle.take_message
        return partial(take, subscription.msg_type, subscription.raw)
    waiting: deque[Received] = deque(maxlen=subscription.qos_profile.depth)

    def receive(message: Any) -> None:
        # Jazzy's executor fails for a callback with the metadata as an argument.
        information = {"received_timestamp": time.time_ns(), "publication_sequence_number": None}
        waiting.append((message, information))

    def next_message() -> Received | None:
        serve()
        return waiting.popleft() if waiting else None

    subscription.callback = receive
    return next_message


def server(node: Node) -> Callable[[], object]:
    """Return a function that serves a node without executor, if required (`TAKES`)."""
    if TAKES:
        return int
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    return partial(executor.spin_once, timeout_sec=0.0)


def request_taker(service: Service) -> Callable[[], tuple[Any, Any]]:
    """Return a function that takes the next request and header; both None if none is waiting.

    The response may be sent later, by the service's `send_response` from before this call.
    """
    if TAKES:
        return partial(service.handle.service_take_request, service.srv_type.Request)
    waiting: deque[tuple[Any, Any]] = deque()
    # An executor passes the callback's result to `send_response`, with the header.
    service.callback = lambda request, response: request
    service.send_response = lambda request, header: waiting.append((request, header))
    return lambda: waiting.popleft() if waiting else (None, None)


_READY = SimpleNamespace(is_ready=lambda kind, index: True)
"""Wait set in which everything is ready."""


class MatchedPublishers(EventHandler):  # type: ignore[misc]  # rclpy leaves it untyped
    """Event of a subscription that provides counts of publishers without an executor.

    Node and subscription own the event, which ends with the subscription.

    Parameters
    ----------
    node : Node
    subscription : Subscription

    Attributes
    ----------
    counts : callable
        Function that returns the present and the total number of publishers, or None, in 0.5 us.
    """

    counts: Callable[[], Matched | None]

    def __init__(self, node: Node, subscription: Subscription) -> None:
        super().__init__(
            callback_group=node.default_callback_group,
            callback=lambda event: None,
            event_type=QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
            parent_impl=subscription.handle,
        )
        subscription.event_handlers.append(self)
        node.add_waitable(self)
        self.add_to_wait_set(SimpleNamespace(add_event=self._keep))

    def _keep(self, event: Any) -> int:
        """Get the counts from an event of the C library, and return its index."""
        self.counts = getattr(event, "take_event", self._ready_counts)
        return 0

    def _ready_counts(self) -> Any:
        self.is_ready(_READY)
        return self.take_data()


def lifecycle_callbacks(node: Any, services: Iterable[str]) -> dict[str, Callable[..., Any]]:
    """Return the callbacks of a managed node's services by name; empty if any is missing."""
    found = {name: getattr(node, f"_LifecycleNodeMixin__on_{name}", None) for name in services}
    return {name: each for name, each in found.items() if each} if all(found.values()) else {}


def state_machine(node: Any) -> Any:
    """Return the state machine of a managed node, which has no documented access."""
    return node._state_machine


_log = getattr(_LIBRARY, "rclpy_logging_rcutils_log", None)

_RclpyLogger: Any = type(rclpy.logging.get_logger("rclpy"))


class NodeLogger(_RclpyLogger):  # type: ignore[misc]
    """Logger that determines the caller from the stack only, and escapes control characters.

    rclpy's logger uses `inspect`, which resolves the paths of all loaded modules at the first
    line, 25 to 120 ms, and reads each caller's source file. rclpy's filters (``once``) are
    missing.
    """

    def log(self, message: str, severity: Any) -> bool:
        """Log a message of sufficient severity; return whether it was logged."""
        if not self.is_enabled_for(severity):
            return False
        text = printable(message)
        if not _log:  # a new logger: one refuses a line with another severity
            return bool(rclpy.logging.get_logger(self.name).log(text, severity))
        frame: Any = sys._getframe(1)
        while frame.f_globals["__name__"] == _RclpyLogger.__module__:
            frame = frame.f_back
        code = frame.f_code
        _log(severity, self.name, text, code.co_name, code.co_filename, frame.f_lineno)
        return True


def prepare_logging() -> None:
    """Resolve the paths of all modules now instead of at the first line that rclpy logs."""
    if caller := _named("CallerId", "impl.rcutils_logger"):
        caller()
