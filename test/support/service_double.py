# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Services of a graph that answer, refuse, stay silent, or are missing; without middleware."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from rclpy.task import Future
from std_srvs.srv import SetBool

from haptic_accel.nodes.service_client import ServiceClient

Answer = Callable[[Any], Any] | None


class Service:
    """Client of a service that exists if it has an answer, and is silent if None."""

    def __init__(self, graph: Graph, name: str) -> None:
        self._graph, self._name = graph, name

    def service_is_ready(self) -> bool:
        return self._name in self._graph.services

    def call_async(self, content: Any) -> Future:
        self._graph.asked.append(self._name)
        future: Future = Future()
        if answer := self._graph.services[self._name]:
            future.set_result(answer(content))
        return future


class Graph:
    """Node of a graph with services by name."""

    def __init__(self, **services: Answer) -> None:
        self.services = {name.replace("__", "/"): each for name, each in services.items()}
        self.asked: list[str] = []
        node: Any = self
        self.client = ServiceClient(node, asyncio.sleep, finding=0.02, answering=0.02)

    def create_client(self, kind: Any, name: str) -> Service:
        return Service(self, name)

    def resolve_service_name(self, name: str) -> str:
        return f"/left/{name}"


def accept(content: Any) -> SetBool.Response:
    return SetBool.Response(success=True, message="done")


def refuse(content: Any) -> SetBool.Response:
    return SetBool.Response(success=False, message="not now")
