# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `scope`: a page that shows the graph while it runs."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Collection
from typing import Any

from std_srvs.srv import SetBool

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import DEVICES
from haptic_accel.graph.stop_signal import PRIORITY
from haptic_accel.nodes import graph_requests as requests
from haptic_accel.nodes.emergency_stop import STOP_SERVICES, release
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.graph_view import GraphView
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.service_client import Request, RequestError, ServiceClient
from haptic_accel.scope import state
from haptic_accel.scope.connections import TOKEN_VARIABLE, Access, Rest
from haptic_accel.scope.server import CommandError, ScopeServer, check_choice
from haptic_accel.scope.state import expected_nodes, state_of

FINDING_TIME = 0.7
"""Time-out for a service to be found, s."""

ANSWERING_TIME = 1.2
"""Time-out for a service's answer, s; with `FINDING_TIME`, a page waits less than 2 s."""

REQUESTS: dict[str, Callable[[str], Request]] = {
    **{name: requests.SETTINGS[name] for name in state.choices()},
    "record": lambda action: requests.trigger(f"recorder/{action}"),
}
"""Functions that make a request from the page's choice, by action."""

SWITCHES = ("engage", "estop")
"""Actions with a value that is true or false."""


def choices() -> dict[str, list[str]]:
    """Return the choices for each action of `REQUESTS`."""
    return {**state.choices(), "record": list(requests.RECORDER_ACTIONS)}


class Commands:
    """Commands to the graph, called on the server's thread while the node's own thread spins.

    Parameters
    ----------
    node : GraphNode
    devices : collection of str
        Devices of this host, which confirm an emergency stop.
    """

    def __init__(self, node: GraphNode, devices: Collection[str]) -> None:
        self._devices = devices
        # Created early, because the middleware takes a while to discover the services.
        self._client = ServiceClient(node, asyncio.sleep, FINDING_TIME, ANSWERING_TIME)
        for request in (
            requests.engage(True),
            *(requests.set_parameters(each, {}) for each in ("compensator", *DEVICES)),
            *(requests.trigger(f"recorder/{each}") for each in requests.RECORDER_ACTIONS),
        ):
            self._client.find(request.kind, [request.service])
        self._client.find(SetBool, STOP_SERVICES)

    async def __call__(self, action: str, value: Any) -> str:
        """Execute a command; return one line on its effect.

        Raises
        ------
        CommandError
            The command is invalid, or the graph refuses or does not answer.
        """
        try:
            return await self._carry_out(action, value)
        except (ParameterError, RequestError) as error:
            raise CommandError(str(error)) from None

    async def _carry_out(self, action: str, value: Any) -> str:
        if action in SWITCHES:
            if not isinstance(value, bool):
                raise CommandError(f"{action} = {value!r}: must be true or false", 400)
            if action == "estop":
                return await (self._stop() if value else self._release())
            answer = await self._client.send(requests.engage(value))
            return answer or f"arms: {'engaged' if value else 'disengaged'}"
        check_choice("action", action, (*REQUESTS, *SWITCHES))
        check_choice(action, value, choices()[action])
        return f"{action}: {await self._client.send(REQUESTS[action](value)) or value}"

    async def _stop(self) -> str:
        """Stop by all services found so far, without waiting for others."""
        answers = self._client.ask(SetBool, STOP_SERVICES, SetBool.Request(data=True))
        await self._client.until(lambda: not answers.silent, ANSWERING_TIME)
        if missing := [each for each in self._devices if each not in answers.received]:
            raise CommandError(f"estop: not confirmed by {' and '.join(missing)}")
        return f"stopped: {' and '.join(self._devices)} without force"

    async def _release(self) -> str:
        line, missing = await release(self._client)
        if missing := missing.intersection(self._devices):
            raise CommandError(f"estop: no release by {' and '.join(sorted(missing))}")
        return line


CLIENT_PERIOD = 0.2
"""Interval between checks for connected pages, s."""


class Scope(GraphView):
    """Node that receives the signals while a page is connected, and serves the page.

    Without a connected page it receives only messages that are published once a second, since each
    further subscriber slows the nodes that compute the force.
    """

    task = "page"

    def __init__(self) -> None:
        super().__init__("scope")
        p = self.parameters
        self._expected = expected_nodes(p.side)
        self._reported = (time.monotonic(), 0, 0, 0)
        devices = [f"{arm}_device" for arm in self.arms]
        self._commands = Commands(self, devices) if p.control else None
        self._rest = Rest()
        self.create_timer(CLIENT_PERIOD, lambda: self.receive(self._server.shown))
        try:
            access = Access(p.host, os.environ.get(TOKEN_VARIABLE, ""))
            self._server = ScopeServer(self, access, p.host, p.port, self._commands)
            address = self._server.start()
        except (OSError, ParameterError):
            # No other object refers to the node, and the middleware cannot end while it exists.
            self.destroy_node()
            raise
        print(f"{address} ({'control allowed' if p.control else 'read-only'})", flush=True)

    def work(self) -> float:
        """Sleep if receiving messages takes more time than this process's priority allows."""
        self._rest()
        return super().work()

    def close(self) -> None:
        """Disconnect the pages."""
        self._server.stop()

    def choices(self) -> dict[str, list[str]]:
        """Return the choices of the page."""
        return choices()

    def state(self) -> dict[str, Any]:
        """Return the graph's state for the page; called on the server's thread."""
        return state_of(
            self.reports,
            self._expected,
            self.known_parameters,
            self.windows.settings,
            led=self.has_pointer,
            stop=self.emergency_stop,
        )

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return the number of connected pages, and the traffic to them."""
        traffic, (before, frames, sent, failures) = self._server.traffic, self._reported
        now = time.monotonic()
        self._reported = (now, traffic.frames, traffic.bytes, traffic.failures)
        passed = max(now - before, 1e-3)
        new = traffic.failures - failures
        return f"failures in serving pages: {new}" if new else "", {
            "pages": str(self._server.clients),
            "frames (1/s)": f"{(traffic.frames - frames) / passed:.0f}",
            "sent (kB/s)": f"{(traffic.bytes - sent) / passed / 1e3:.0f}",
            "failures in serving pages": str(traffic.failures),
        }


def main() -> None:
    """Run the node, with the priority of the stop command, as its page can stop a graph, too."""
    run_nodes("scope", Scope, priority=PRIORITY)


if __name__ == "__main__":
    main()
