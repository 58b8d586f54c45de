# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands of the live scope's page, carried out through ROS."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from std_srvs.srv import SetBool

from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.arguments import RECORDING
from haptic_accel.materials.folders import config_folder
from haptic_accel.nodes import graph_requests as requests
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.scope.server import CommandError

FINDING_TIME = 0.7
"""Time in which a service must be found, s."""

ANSWERING_TIME = 1.2
"""Time in which it must answer, s; together with the time above, a page waits less than 2 s."""

POLLING_PERIOD = 0.02
"""Interval between checks for an answer, s."""

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
        self._node = node
        self._stopped = stopped
        self._choices = choices()
        # Created before they are needed, because discovery takes the middleware a while.
        services = requests.SERVICES.items()
        self._clients = {name: node.create_client(kind, name) for name, kind in services}

    async def __call__(self, action: str, value: Any) -> str:
        """Carry out a command; return one line that states what was done.

        Raises
        ------
        CommandError
            The command is wrong, or the graph does not answer or refuses.
        """
        if action in SWITCHES:
            if not isinstance(value, bool):
                raise CommandError(f"{action} = {value!r}: must be true or false", 400)
            if action == "estop":
                return await self._set_stop(value)
            answer = await self._send(requests.engage(value))
            return answer or f"arms: {'engaged' if value else 'disengaged'}"
        if action not in REQUESTS:
            allowed = ", ".join((*REQUESTS, *SWITCHES))
            raise CommandError(f"action = {action!r}: must be one of {allowed}", 400)
        known = self._choices[action]
        if not isinstance(value, str) or value not in known:
            raise CommandError(f"{action} = {value!r}: must be one of {', '.join(known)}", 400)
        try:
            request = REQUESTS[action](value)
        except ParameterError as error:
            raise CommandError(str(error)) from None
        return f"{action}: {await self._send(request) or value}"

    async def _set_stop(self, stop: bool) -> str:
        """Stop by all services, or release by the coupler's, or the devices' own without it."""
        self._stopped.update(dict.fromkeys(self._stopped))
        ready = [name for name in requests.STOP_SERVICES if self._clients[name].service_is_ready()]
        if not stop and requests.STOP_SERVICES[0] in ready:
            ready = ready[:1]
        request = SetBool.Request(data=stop)
        asked = {name: self._clients[name].call_async(request) for name in ready}

        def confirmed() -> bool:
            return set(self._stopped.values()) == {stop}

        def refusals() -> list[str]:
            answers = [(name, each.result()) for name, each in asked.items() if each.done()]
            return [f"{name}: {answer.message}" for name, answer in answers if not answer.success]

        if await _until(lambda: bool(confirmed() or refusals()), ANSWERING_TIME) and confirmed():
            who = "both devices confirm" if len(self._stopped) > 1 else "the device confirms"
            return f"{'stopped' if stop else 'released'}: {who}"
        if refused := refusals():
            raise CommandError("; ".join(refused))
        silent = " and ".join(name for name, state in self._stopped.items() if state != stop)
        what = "stop" if stop else "release"
        raise CommandError(f"estop: the {what} is sent; not confirmed by {silent}")

    async def _send(self, request: requests.GraphRequest) -> str:
        """Return the node's message."""
        client = self._clients[request.service]
        if not await _until(client.service_is_ready, FINDING_TIME):
            raise CommandError(f"{client.srv_name}: no such service; is {request.node} running?")
        answer = client.call_async(request.content)
        if not await _until(answer.done, ANSWERING_TIME):
            raise CommandError(f"{client.srv_name}: no answer within {ANSWERING_TIME:g} s")
        try:
            return request.confirm(answer.result())
        except requests.RequestError as error:
            raise CommandError(str(error)) from None


async def _until(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait for a condition; return true if it was met in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() >= deadline:
            return False
        await asyncio.sleep(POLLING_PERIOD)
    return True
