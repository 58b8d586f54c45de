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

"""Executable `scope`: a page that shows the graph while it runs."""

from __future__ import annotations

import os
import time
from typing import Any

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.stop_signal import PRIORITY
from haptic_accel.nodes.graph_view import GraphView
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.scope_commands import Commands, choices
from haptic_accel.scope.access import TOKEN_VARIABLE, Access
from haptic_accel.scope.connections import Rest
from haptic_accel.scope.node_reports import expected_nodes
from haptic_accel.scope.server import ScopeServer
from haptic_accel.scope.state import state_of

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
            # Nobody else knows the node yet, and the middleware does not end while it exists.
            self.destroy_node()
            raise
        print(f"{address} ({'control allowed' if p.control else 'read-only'})", flush=True)

    def work(self) -> float:
        """Rest if more messages come than this process may receive with its priority."""
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
            led=self.is_led,
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
    """Run the node, whose page can stop a graph as the command does: with the same priority."""
    run("scope", Scope, priority=PRIORITY)


if __name__ == "__main__":
    main()
