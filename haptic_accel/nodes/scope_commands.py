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

"""Commands of the live scope's page, carried out through ROS."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from std_srvs.srv import SetBool

from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.arguments import RECORDING
from haptic_accel.materials.folders import config_folder
from haptic_accel.nodes import graph_requests as requests
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.scope.server import CommandError

FINDING_TIME = 0.7
"""Time in which a service must be found, s."""

ANSWERING_TIME = 1.2
"""Time in which it must answer, s; together with the time above, a page waits less than 2 s."""

REQUESTS: dict[str, Callable[[str], requests.GraphRequest]] = {
    "controller": requests.set_controller,
    "surface": requests.set_surface,
    "grip": requests.set_grip,
    "record": lambda action: requests.trigger(f"recorder/{action}"),
}
"""Requests by action, made from the page's choice."""

SWITCHES = ("engage", "estop")
"""Actions with a value that is true or false."""


def choices() -> dict[str, list[str]]:
    """Return what can be chosen for each action of `REQUESTS`."""
    surfaces = sorted(path.stem for path in (config_folder() / "surfaces").glob("*.yaml"))
    return {
        "controller": list(CONTROLLERS),
        "surface": [name for name in surfaces if name != RECORDING],
        "grip": list(POSTURES),
        "record": list(requests.RECORDER_ACTIONS),
    }


class Commands:
    """Commands to the graph; called on the server's thread while the node's own thread spins.

    Parameters
    ----------
    node : GraphNode
    stopped : dict
        Emergency stop as each device last reported it, by arm; None before the first report.
        Filled by the node.
    """

    def __init__(self, node: GraphNode, stopped: dict[str, bool | None]) -> None:
        self._stopped = stopped
        self._choices = choices()
        # Created before they are needed, because discovery takes the middleware a while.
        self._graph = requests.GraphClient(node, asyncio.sleep, FINDING_TIME, ANSWERING_TIME)
        for name, kind in requests.SERVICES.items():
            self._graph.service(kind, name)

    async def __call__(self, action: str, value: Any) -> str:
        """Carry out a command; return one line that states what was done.

        Raises
        ------
        CommandError
            The command is wrong, or the graph does not answer or refuses.
        """
        try:
            return await self._carry_out(action, value)
        except (ParameterError, requests.RequestError) as error:
            raise CommandError(str(error)) from None

    async def _carry_out(self, action: str, value: Any) -> str:
        if action in SWITCHES:
            if not isinstance(value, bool):
                raise CommandError(f"{action} = {value!r}: must be true or false", 400)
            if action == "estop":
                return await self._set_stop(value)
            answer = await self._graph.send(requests.engage(value))
            return answer or f"arms: {'engaged' if value else 'disengaged'}"
        if action not in REQUESTS:
            allowed = ", ".join((*REQUESTS, *SWITCHES))
            raise CommandError(f"action = {action!r}: must be one of {allowed}", 400)
        known = self._choices[action]
        if not isinstance(value, str) or value not in known:
            raise CommandError(f"{action} = {value!r}: must be one of {', '.join(known)}", 400)
        return f"{action}: {await self._graph.send(REQUESTS[action](value)) or value}"

    async def _set_stop(self, stop: bool) -> str:
        """Stop by all services, or release by the coupler's, or the devices' own without it."""
        self._stopped.update(dict.fromkeys(self._stopped))
        services = {name: self._graph.service(SetBool, name) for name in requests.STOP_SERVICES}
        ready = [name for name, service in services.items() if service.service_is_ready()]
        if not stop and requests.STOP_SERVICES[0] in ready:
            ready = ready[:1]
        request = SetBool.Request(data=stop)
        asked = {name: services[name].call_async(request) for name in ready}

        def confirmed() -> bool:
            return set(self._stopped.values()) == {stop}

        def refused() -> list[str]:
            return requests.refusals(
                {name: each.result() for name, each in asked.items() if each.done()}
            )

        await self._graph.until(lambda: confirmed() or refused(), ANSWERING_TIME)
        if confirmed():
            who = "both devices confirm" if len(self._stopped) > 1 else "the device confirms"
            return f"{'stopped' if stop else 'released'}: {who}"
        if refused():
            raise CommandError("; ".join(refused()))
        silent = " and ".join(name for name, state in self._stopped.items() if state != stop)
        what = "stop" if stop else "release"
        raise CommandError(f"estop: the {what} is sent; not confirmed by {silent}")
