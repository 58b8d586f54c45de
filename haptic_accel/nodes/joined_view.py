# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""View of a running graph from another process, on a separate thread."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_srvs.srv import Trigger

from haptic_accel.core.topics import DEVICES
from haptic_accel.devices.rclpy_internals import EventsExecutor
from haptic_accel.graph.domain import check_middleware, middleware_defaults
from haptic_accel.nodes import graph_requests
from haptic_accel.nodes.graph_view import GraphView
from haptic_accel.nodes.scheduling import POLL_PERIOD
from haptic_accel.nodes.service_client import Request, RequestError, ServiceClient

FINDING_TIME, ANSWERING_TIME = 5.0, 5.0
"""Time-outs for a service to be found, and for its answer, s."""

T = TypeVar("T")


class JoinedView:
    """View of a graph, with blocking requests to its nodes.

    Parameters
    ----------
    node : GraphView
        Node that another thread spins.

    Attributes
    ----------
    node : GraphView
    """

    def __init__(self, node: GraphView) -> None:
        self.node = node
        self._client = ServiceClient(node, asyncio.sleep, FINDING_TIME, ANSWERING_TIME)
        # Created early, because the middleware takes a while to discover the services.
        for name in ("compensator", *DEVICES):
            self._client.find(GetParameters, [f"{name}/get_parameters"])
            self._client.find(SetParametersAtomically, [f"{name}/set_parameters_atomically"])
        for device in DEVICES:
            self._client.find(Trigger, [f"{device}/report"])

    def send(self, *requests: Request) -> None:
        """Send all requests at once, and wait for their answers.

        Raises
        ------
        RequestError
            A node does not answer or refuses.
        """
        self._together(self._client.send(each) for each in requests)

    def check(self, requests: Sequence[Request]) -> None:
        """Check that the nodes have the parameters that requests have set.

        Raises
        ------
        RequestError
            A node does not answer, or has another value.
        """
        requested = [(each.service.partition("/")[0], dict(_assigned(each))) for each in requests]
        found = self._together(self._client.parameters(node, list(v)) for node, v in requested)
        for (node, values), now in zip(requested, found, strict=True):
            for (name, value), has in zip(values.items(), now, strict=True):
                if has != value:
                    raise RequestError(f"{node}: {name} = {has}: must be {value}, as requested")

    def change(self, requests: Sequence[Request]) -> None:
        """Send requests that set parameters, and `check` them."""
        self.send(*requests)
        self.check(requests)

    def force_counts(self, device: str) -> Mapping[str, str]:
        """Return a device's counts of forces up to now.

        Raises
        ------
        RequestError
            The device does not answer.
        """
        report = graph_requests.trigger(f"{device}/report")
        (message,) = self._together([self._client.send(report)])
        return dict(json.loads(message))

    def _together(self, calls: Iterable[Coroutine[Any, Any, T]]) -> list[T]:
        async def together() -> list[T]:
            return list(await asyncio.gather(*calls))

        return asyncio.run(together())


def _assigned(request: Request) -> Iterator[tuple[str, Any]]:
    """Yield the parameters that a request sets."""
    if isinstance(request.content, SetParametersAtomically.Request):
        for each in request.content.parameters:
            yield each.name, parameter_value_to_python(each.value)


@contextmanager
def open_joined_view(
    namespace: str, name: str, begin: Callable[[GraphView], None]
) -> Iterator[JoinedView]:
    """Join the graph of a namespace, running or not, while the context is entered.

    Parameters
    ----------
    namespace : str
        With a slash before; empty for the root.
    name : str
        Name of the node.
    begin : callable
        Called with the node before it is spun.
    """
    check_middleware(os.environ)
    os.environ.update(middleware_defaults(os.environ))
    arguments = ["--ros-args", "-r", f"__node:={name}", "-r", f"__ns:={namespace or '/'}"]
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = GraphView("scope")
        begin(node)
        joined = JoinedView(node)
        ended = Future()
        thread = threading.Thread(target=_spin, args=(node, ended), daemon=True)
        thread.start()
        try:
            yield joined
        finally:
            ended.set_result(None)
            thread.join()
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _spin(node: GraphView, ended: Future) -> None:
    """Spin a node until a future is done."""
    executor = EventsExecutor()
    executor.add_node(node)
    while not ended.done():
        try:
            executor.spin_until_future_complete(ended, timeout_sec=POLL_PERIOD)
        except Exception as error:  # no received message may end the view
            node.callback_failed(error)
    executor.shutdown()
