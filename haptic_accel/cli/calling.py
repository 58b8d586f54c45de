"""Requests to the nodes of a running graph, from a process of its own.

Imports ROS, which takes a while: load it where it is used.
"""

from __future__ import annotations

import rclpy
from rclpy.node import Node

from haptic_accel.cli.joining import CallError
from haptic_accel.nodes.graph_requests import SERVICES, GraphRequest, RequestError

PATIENCE = 5.0
"""Time-out for a node to be found, and to answer, s."""


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
