"""Requests to the nodes of a running graph, from a process of its own.

Imports ROS, which takes a while: load it where it is used.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node
from rclpy.validate_namespace import validate_namespace

from haptic_accel.cli.ending import StoppedError
from haptic_accel.core.parameters import ParameterError
from haptic_accel.nodes.graph_requests import SERVICES, GraphRequest, RequestError
from haptic_accel.nodes.middleware import middleware_defaults

PATIENCE = 5.0
"""Time-out for a node to be found, and to answer, s."""


class CallError(StoppedError):
    """A node does not answer, or refuses; the message is one line fit to be shown."""


def send(node: Node, request: GraphRequest, patience: float = PATIENCE) -> str:
    """Send a request to a graph and return the message of the node that answers.

    Parameters
    ----------
    node : Node
        Node of the caller, in the graph's namespace.
    request : GraphRequest
    patience : float
        Time-out for the answer, s.

    Raises
    ------
    CallError
        The node does not answer, or refuses.
    """
    client = node.create_client(SERVICES[request.service], request.service)
    try:
        if client.wait_for_service(PATIENCE):
            future = client.call_async(request.content)
            rclpy.spin_until_future_complete(node, future, timeout_sec=patience)
            if future.done():
                return request.confirm(future.result())
    except RequestError as error:
        raise CallError(str(error)) from None
    finally:
        node.destroy_client(client)
    name = node.resolve_service_name(request.node)
    raise CallError(f"{name}: does not answer; is the graph running?")


@contextmanager
def connected(namespace: str) -> Iterator[Node]:
    """Join the graph of a namespace with a node while the context is entered.

    Raises
    ------
    ParameterError
        The namespace is not a valid ROS namespace.
    """
    absolute = "/" + namespace.strip("/")
    try:
        validate_namespace(absolute)
    except InvalidNamespaceException:
        raise ParameterError(
            f"namespace = {namespace!r}: must be letters, digits and _, with / between"
        ) from None
    os.environ.update(middleware_defaults(os.environ))
    rclpy.init(args=[])
    node = rclpy.create_node(f"haptic_accel_caller_{os.getpid()}", namespace=absolute)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
