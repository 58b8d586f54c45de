"""Requests to the nodes of a running graph, from a process of its own.

Imports ROS, which takes a while: load it where it is used.
"""

from __future__ import annotations

from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

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
    kind = SERVICES[request.service]
    try:
        return request.confirm(_call(node, kind, request.service, request.content, patience))
    except RequestError as error:
        raise CallError(str(error)) from None


def own_side(node: Node) -> str:
    """Return the arm that this host has, as the coupler knows; empty for both.

    Raises
    ------
    CallError
        The coupler does not answer.
    """
    asked = GetParameters.Request(names=["side"])
    found = _call(node, GetParameters, "coupler/get_parameters", asked, PATIENCE).values
    return str(found[0].string_value) if found else ""


def change(node: Node, request: GraphRequest) -> str:
    """Send a request as `send` does, and return what has changed, from what to what."""
    content = request.content
    if not isinstance(content, SetParametersAtomically.Request):
        action = request.service.partition("/")[2]
        return f"{request.node}: {send(node, request) or f'{action} done'}"
    names = [parameter.name for parameter in content.parameters]
    asked = GetParameters.Request(names=names)
    before = _call(node, GetParameters, f"{request.node}/get_parameters", asked, PATIENCE).values
    send(node, request)
    pairs = zip(names, before, (each.value for each in content.parameters), strict=True)
    values = ((name, *map(parameter_value_to_python, pair)) for name, *pair in pairs)
    changes = [f"{name} {old} -> {new}" for name, old, new in values if old != new]
    return f"{request.node}: {', '.join(changes) or 'nothing changed: it was so already'}"


def _call(node: Node, kind: Any, service: str, content: Any, patience: float) -> Any:
    """Return the response of a service."""
    client = node.create_client(kind, service)
    try:
        if client.wait_for_service(PATIENCE):
            future = client.call_async(content)
            rclpy.spin_until_future_complete(node, future, timeout_sec=patience)
            if future.done():
                return future.result()
    finally:
        node.destroy_client(client)
    name = node.resolve_service_name(service.partition("/")[0])
    raise CallError(f"{name}: does not answer; is the graph running?")
