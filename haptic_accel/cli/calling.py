"""Client of the services and parameters of a running graph.

Imports ROS, which takes a while: load it where it is used.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.validate_namespace import validate_namespace

from haptic_accel.cli.ending import StoppedError
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import FAILED
from haptic_accel.nodes.middleware import middleware_defaults

PATIENCE = 5.0
"""Time-out for a node to be found, and to answer, s."""


class CallError(StoppedError):
    """A node does not answer, or refuses; the message is one line fit to be shown."""

    def __init__(self, line: str) -> None:
        super().__init__(FAILED, line)


class Caller:
    """Calls services of a graph.

    Parameters
    ----------
    node : Node
        Node of the caller, in the graph's namespace.
    """

    def __init__(self, node: Node) -> None:
        self.node = node

    def call(self, kind: Any, service: str, request: Any, patience: float = PATIENCE) -> Any:
        """Return a service's response.

        Parameters
        ----------
        kind : type
            Service type.
        service : str
            Name relative to the graph's namespace.
        request
            Request of that type.
        patience : float
            Time-out for the answer, s.

        Raises
        ------
        CallError
            The service does not exist, or does not answer.
        """
        client = self.node.create_client(kind, service)
        try:
            if client.wait_for_service(PATIENCE):
                future = client.call_async(request)
                rclpy.spin_until_future_complete(self.node, future, timeout_sec=patience)
                if future.done():
                    return future.result()
        finally:
            self.node.destroy_client(client)
        name = self.node.resolve_service_name(service).rpartition("/")[0] or f"/{service}"
        raise CallError(f"{name}: does not answer; is the graph running?")

    def set_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        """Set parameters of a node by dotted name, all of them or none.

        Raises
        ------
        CallError
            The node does not answer, or refuses a value.
        """
        parameters = [Parameter(key, value=values[key]).to_parameter_msg() for key in values]
        request = SetParametersAtomically.Request(parameters=parameters)
        response = self.call(SetParametersAtomically, f"{node}/set_parameters_atomically", request)
        if not response.result.successful:
            name = self.node.resolve_service_name(node)
            raise CallError(f"{name}: {response.result.reason}")


@contextmanager
def connected(namespace: str) -> Iterator[Caller]:
    """Join the graph of a namespace while the context is entered.

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
        yield Caller(node)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
