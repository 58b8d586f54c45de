# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Client of services: requests to other nodes, and their answers."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

POLLING_PERIOD = 0.01
"""Interval between checks for an answer, s."""


class RequestError(RuntimeError):
    """A node's refusal, as one line for the user."""


@dataclass(frozen=True)
class Request:
    """Request to a service.

    Attributes
    ----------
    kind
        Type of the service.
    service : str
        Name of the service, relative to the graph's namespace.
    content
        Request message of that type.
    """

    kind: Any
    service: str
    content: Any


class Answers:
    """Answers of several nodes to the same request.

    Parameters
    ----------
    futures : mapping of str to Future
        Answers to come, by node.

    Attributes
    ----------
    futures : mapping of str to Future
    """

    def __init__(self, futures: Mapping[str, Future]) -> None:
        self.futures = futures

    @property
    def received(self) -> dict[str, Any]:
        """Responses received so far, by node."""
        return {node: answer.result() for node, answer in self.futures.items() if answer.done()}

    @property
    def silent(self) -> list[str]:
        """Nodes that have not answered yet."""
        return [node for node, answer in self.futures.items() if not answer.done()]

    @property
    def refusals(self) -> list[str]:
        """One line for each node that refuses."""
        return [f"{node}: {it.message}" for node, it in self.received.items() if not it.success]


class Services:
    """Services of other nodes, discovered from their first use on.

    Parameters
    ----------
    node : Node
        Node of the caller, in the graph's namespace.

    Attributes
    ----------
    node : Node
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        self._clients: dict[str, Client] = {}

    def find(self, kind: Any, names: Sequence[str]) -> dict[str, Client]:
        """Return clients of services of one type by node; discovery takes some time."""
        for name in names:
            if name not in self._clients:
                self._clients[name] = self.node.create_client(kind, name)
        return {_node(name): self._clients[name] for name in names}

    def ask(self, kind: Any, names: Sequence[str], content: Any) -> Answers:
        """Send the same request to the services discovered so far."""
        clients = self.find(kind, names).items()
        ready = {node: client for node, client in clients if client.service_is_ready()}
        return Answers({node: client.call_async(content) for node, client in ready.items()})


Pause = Callable[[float], Awaitable[None]]
"""Coroutine function that waits for a time in s."""


class ServiceClient(Services):
    """Client whose coroutines wait for answers.

    Parameters
    ----------
    node : Node
        As for `Services`.
    pause : coroutine function
        Waits for a time in s, and spins the node if no other thread does.
    finding, answering : float
        Time-outs for a service to be found, and for its answer, s.
    """

    def __init__(self, node: Node, pause: Pause, finding: float, answering: float) -> None:
        super().__init__(node)
        self._pause = pause
        self._finding, self._answering = finding, answering

    async def until(self, condition: Callable[[], object], seconds: float) -> bool:
        """Wait for a condition; return whether it was met in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() >= deadline:
                return False
            await self._pause(POLLING_PERIOD)
        return True

    async def answers(self, kind: Any, names: Sequence[str], content: Any) -> Answers:
        """Send the same request to several services; wait for the answers of those found."""
        clients = self.find(kind, names).values()
        await self.until(lambda: all(it.service_is_ready() for it in clients), self._finding)
        answers = self.ask(kind, names, content)
        await self.until(lambda: not answers.silent, self._answering)
        return answers

    async def call(self, kind: Any, name: str, content: Any) -> Any:
        """Return the response of a service to a request of its type.

        Raises
        ------
        RequestError
            The node does not answer.
        """
        for response in (await self.answers(kind, [name], content)).received.values():
            return response
        node = self.node.resolve_service_name(_node(name))
        raise RequestError(f"{node}: does not answer; is the graph running?")

    async def parameters(self, node: str, names: Sequence[str]) -> list[Any]:
        """Return parameter values of a node; None for parameters that the node lacks.

        Raises
        ------
        RequestError
            The node does not answer.
        """
        request = GetParameters.Request(names=list(names))
        answer = await self.call(GetParameters, f"{node}/get_parameters", request)
        return [parameter_value_to_python(value) for value in answer.values]

    async def send(self, request: Request) -> str:
        """Send a request; return the node's message, empty for parameters that were set.

        Raises
        ------
        RequestError
            The node does not answer, or refuses.
        """
        response = await self.call(request.kind, request.service, request.content)
        if isinstance(response, SetParametersAtomically.Response):
            accepted, message = response.result.successful, response.result.reason
        else:
            accepted, message = response.success, response.message
        if not accepted:
            raise RequestError(f"{_node(request.service)}: {message or 'refused'}")
        return str(message)

    async def change(self, request: Request) -> str:
        """Send a request as `send` does; return the change, with old and new value."""
        content, node = request.content, _node(request.service)
        if not isinstance(content, SetParametersAtomically.Request):
            done = f"{request.service.partition('/')[2]} done"
            return f"{node}: {await self.send(request) or done}"
        goals = {each.name: parameter_value_to_python(each.value) for each in content.parameters}
        before = await self.parameters(node, list(goals))
        await self.send(request)
        pairs = zip(goals.items(), before, strict=True)
        changes = [f"{name} {old} -> {new}" for (name, new), old in pairs if old != new]
        return f"{node}: {', '.join(changes) or 'nothing changed: it was so already'}"


def _node(service: str) -> str:
    return service.partition("/")[0]
