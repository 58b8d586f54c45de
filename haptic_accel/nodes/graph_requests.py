# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Requests to the services of a running graph, and their client, for commands and the scope."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import EMERGENCY_STOP
from haptic_accel.graph.arguments import RECORDING, SCENE, SIMULATED
from haptic_accel.graph.files import surface_parameters
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.scenes import read_scene

DEVICES = ("slave_device", "master_device")
"""Nodes that can be armed; the one that the user holds comes last."""

STOP_SERVICES = (EMERGENCY_STOP.name, *(f"{device}/estop" for device in DEVICES))
"""Services of the emergency stop; the coupler's, which passes a release on, comes first."""

POSTURE = f"{SIMULATED}.grip.posture"
"""Parameter of `master_device`: grip of the simulated hand on the handle."""

RECORDER_ACTIONS = ("start", "pause", "split", "stop")
"""Services of the recorder that change the recording."""

SERVICES: Mapping[str, Any] = {
    **{
        f"{node}/set_parameters_atomically": SetParametersAtomically
        for node in ("compensator", *DEVICES)
    },
    **dict.fromkeys(STOP_SERVICES, SetBool),
    "compensator/reset": Trigger,
    **{f"{device}/arm": Trigger for device in DEVICES},
    "coupler/engage": SetBool,
    **{f"recorder/{action}": Trigger for action in (*RECORDER_ACTIONS, "status")},
}
"""Types of the services by name, relative to the graph's namespace."""


POLLING_PERIOD = 0.01
"""Interval between checks for an answer, s."""


class RequestError(RuntimeError):
    """A node refuses; the message is one line for the user."""


@dataclass(frozen=True)
class GraphRequest:
    """Request to one of the `SERVICES`.

    Attributes
    ----------
    service : str
        Name of the service.
    content
        Request message of the service's type.
    """

    service: str
    content: Any

    @property
    def node(self) -> str:
        """Name of the node that is asked."""
        return self.service.partition("/")[0]

    def confirm(self, response: Any) -> str:
        """Return the node's message, empty for parameters that were set.

        Raises
        ------
        RequestError
            The node refused.
        """
        if isinstance(response, SetParametersAtomically.Response):
            accepted, message, reason = response.result.successful, "", response.result.reason
        else:
            accepted, message, reason = response.success, response.message, response.message
        if not accepted:
            raise RequestError(f"{self.node}: {reason or 'refused'}")
        return str(message)


class GraphClient:
    """Client of a graph's services.

    Parameters
    ----------
    node : Node
        Node of the caller, in the graph's namespace.
    pause : coroutine function
        Waits for a time in s; it spins the node where no other thread does.
    finding, answering : float
        Time-outs for a service to be found, and for its answer, s.

    Attributes
    ----------
    node : Node
    """

    def __init__(
        self,
        node: Node,
        pause: Callable[[float], Awaitable[None]],
        finding: float,
        answering: float,
    ) -> None:
        self.node = node
        self._pause = pause
        self._finding = finding
        self._answering = answering
        self._services: dict[str, Client] = {}

    def service(self, kind: Any, name: str) -> Client:
        """Return a service, looked for since it was first asked for."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, name)
        return self._services[name]

    async def until(self, condition: Callable[[], object], seconds: float) -> bool:
        """Wait for a condition; return whether it was met in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() >= deadline:
                return False
            await self._pause(POLLING_PERIOD)
        return True

    async def call(self, kind: Any, name: str, content: Any) -> Any:
        """Return the response of a service to a request of its type.

        Raises
        ------
        RequestError
            The node does not answer.
        """
        service = self.service(kind, name)
        if await self.until(service.service_is_ready, self._finding):
            answer = service.call_async(content)
            if await self.until(answer.done, self._answering):
                return answer.result()
        node = self.node.resolve_service_name(name.partition("/")[0])
        raise RequestError(f"{node}: does not answer; is the graph running?")

    async def parameters(self, node: str, names: Sequence[str]) -> list[Any]:
        """Return the values of parameters of a node; None for those that it does not have.

        Raises
        ------
        RequestError
            The node does not answer.
        """
        request = GetParameters.Request(names=list(names))
        answer = await self.call(GetParameters, f"{node}/get_parameters", request)
        return [parameter_value_to_python(value) for value in answer.values]

    async def send(self, request: GraphRequest) -> str:
        """Send a request; return the message of the node that answers.

        Raises
        ------
        RequestError
            The node does not answer, or refuses.
        """
        kind = SERVICES[request.service]
        return request.confirm(await self.call(kind, request.service, request.content))

    async def change(self, request: GraphRequest) -> str:
        """Send a request as `send` does, and return what has changed, from what to what."""
        content, node = request.content, request.node
        if not isinstance(content, SetParametersAtomically.Request):
            done = f"{request.service.partition('/')[2]} done"
            return f"{node}: {await self.send(request) or done}"
        asked = {each.name: parameter_value_to_python(each.value) for each in content.parameters}
        before = await self.parameters(node, list(asked))
        await self.send(request)
        pairs = zip(asked.items(), before, strict=True)
        changes = [f"{name} {old} -> {new}" for (name, new), old in pairs if old != new]
        return f"{node}: {', '.join(changes) or 'nothing changed: it was so already'}"


def set_parameters(node: str, values: Mapping[str, Any]) -> GraphRequest:
    """Set parameters of a node by dotted name, all or none."""
    parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
    content = SetParametersAtomically.Request(parameters=parameters)
    return GraphRequest(f"{node}/set_parameters_atomically", content)


def set_controller(name: str) -> GraphRequest:
    """Change the controller of the actuator's force."""
    return set_parameters("compensator", {"controller": name})


def set_surface(name: str) -> GraphRequest:
    """Put another surface, by name or file, under the simulated slave's tool.

    Raises
    ------
    ParameterError
        There is no such surface, or it cannot be chosen while the graph runs.
    """
    if name == RECORDING:
        raise ParameterError(f"surface = '{RECORDING}': must be chosen when the graph starts")
    return set_parameters("slave_device", surface_parameters(name))


def set_scene(name: str) -> GraphRequest:
    """Put another scene, by name or file, under the virtual slave's tool.

    Raises
    ------
    ParameterError
        There is no such scene, or its file is wrong.
    """
    file = preset_file("scene", name)
    read_scene(file)
    return set_parameters("slave_device", {SCENE: str(file)})


def set_grip(posture: str) -> GraphRequest:
    """Change the grip of the simulated hand."""
    return set_parameters("master_device", {POSTURE: posture})


def engage(value: bool) -> GraphRequest:
    """Couple the arms, or uncouple them."""
    return GraphRequest("coupler/engage", SetBool.Request(data=value))


def trigger(service: str) -> GraphRequest:
    """Call one of the `SERVICES` that need nothing but their name."""
    return GraphRequest(service, Trigger.Request())


def refusals(answers: Mapping[str, Any]) -> list[str]:
    """Return a line on each service that refuses, from the answers by name; None is silence."""
    return [f"{name}: {it.message}" for name, it in answers.items() if it and not it.success]
