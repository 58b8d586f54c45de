# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `scope`: a page that shows the graph while it runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.subscription import Subscription

from haptic_accel.core import topics
from haptic_accel.core.model import ACTUATOR
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, Topic
from haptic_accel.graph.arguments import SCENE as SCENE_FILE
from haptic_accel.graph.files import SURFACE
from haptic_accel.graph.node_parameters import node_parameters, node_schema
from haptic_accel.nodes.graph_requests import POSTURE
from haptic_accel.nodes.interface import DEPTH, GraphNode, quality
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.scope_commands import Commands, choices
from haptic_accel.nodes.scope_scene import ScopeScene, drawing, scene_of
from haptic_accel.scope.access import TOKEN_VARIABLE, Access
from haptic_accel.scope.frames import SCENE
from haptic_accel.scope.node_reports import NodeReport, NodeReports, expected_nodes
from haptic_accel.scope.server import ScopeServer
from haptic_accel.scope.windows import GraphSettings, Windows

NICENESS = 10
"""Niceness of the scope's process: lower priority than the nodes that compute the force."""

CLIENT_PERIOD = 0.2
"""Interval between checks for connected pages, s."""

ASK_PERIOD = 1.0
"""Interval between attempts to get the parameters of nodes that are not known yet, s."""

WANTED = {
    "compensator": tuple(
        name
        for name in node_schema("compensator")
        if name in ("controller", "high_pass_frequency", "latency")
        or name.startswith(f"{ACTUATOR}.")
    ),
    "slave_device": ("device", f"{SURFACE}name", SCENE_FILE),
    "master_device": ("device", POSTURE),
}
"""Parameters of other nodes that are shown, or needed to show something."""


class RemoteParameters:
    """Current values of some parameters of another node.

    Parameters
    ----------
    node : GraphNode
        Node that follows the parameters.
    name : str
        Name of the other node, in the same namespace.
    wanted : tuple of str
        Names of its parameters.
    changed : callable
        Called after any value has changed.
    """

    def __init__(
        self, node: GraphNode, name: str, wanted: tuple[str, ...], changed: Callable[[], None]
    ) -> None:
        self._wanted = wanted
        self._changed = changed
        self._client = node.create_client(GetParameters, f"{name}/get_parameters")
        self._asked = False
        self.path = f"{node.get_namespace().rstrip('/')}/{name}"
        """Full name of the other node."""
        self.values: Mapping[str, Any] = {}

    def refresh(self) -> None:
        """Ask a node that has appeared; forget one that has disappeared."""
        if not self._client.service_is_ready():
            if self._asked:  # otherwise it has only just come, and told its values
                self._asked, self.values = False, {}
        elif not self._asked:
            self._asked = True
            asked = self._client.call_async(GetParameters.Request(names=list(self._wanted)))
            asked.add_done_callback(
                lambda answer: self._take(zip(self._wanted, answer.result().values, strict=False))
            )

    def take(self, event: ParameterEvent) -> None:
        """Take the values that the node publishes at its start and after a change."""
        self._take((p.name, p.value) for p in (*event.new_parameters, *event.changed_parameters))

    def _take(self, given: Iterable[tuple[str, ParameterValue]]) -> None:
        found = dict(pair for pair in given if pair[0] in self._wanted)
        if found:
            known = {name: parameter_value_to_python(value) for name, value in found.items()}
            self.values = {**self.values, **known}
            self._changed()


class Scope(GraphNode):
    """Node that receives the signals while a page is connected, and serves the page.

    While no page is connected it receives only what is published once a second: each further
    subscriber costs the nodes that compute the force a little with every message.
    """

    task = "page"

    def __init__(self) -> None:
        super().__init__("scope")
        p = self.parameters
        self.windows = Windows()
        self._reports = NodeReports()
        self._stop_asked = False
        self._expected = expected_nodes(p.side)
        self._stopped: dict[str, bool | None] = dict.fromkeys((p.side,) if p.side else topics.ARMS)
        self._remotes = {
            name: RemoteParameters(self, name, wanted, self._update_settings)
            for name, wanted in WANTED.items()
        }
        self._scene = ScopeScene(
            self,
            self.windows.places,
            lambda: self._remotes["master_device"].values,
        )
        self._signals: dict[str, Subscription] = {}
        self._reported = (time.monotonic(), 0, 0)
        self._commands = Commands(self, self._stopped) if p.control else None
        reports, take = topics.DIAGNOSTICS, self._take_diagnostics
        profile = quality(reports, DEPTH)
        self.create_subscription(DiagnosticArray, reports.name, take, profile)
        changed = self._take_parameters
        self.create_subscription(ParameterEvent, "/parameter_events", changed, DEPTH)
        self.listen_state(topics.COUPLER_STOPPED, self._take_stop)
        for arm, topic in zip(
            topics.ARMS, (topics.MASTER_STOPPED, topics.SLAVE_STOPPED), strict=True
        ):
            if arm in self._stopped:
                self.listen_state(topic, partial(self._stopped.__setitem__, arm))
        self.create_timer(CLIENT_PERIOD, self._subscribe_for_clients)
        self.create_timer(ASK_PERIOD, self._refresh_parameters)
        try:
            access = Access(p.host, os.environ.get(TOKEN_VARIABLE, ""))
            self._server = ScopeServer(self, access, p.host, p.port, self._commands)
            address = self._server.start()
        except (OSError, ParameterError):
            # Nobody else knows the node yet, and the middleware does not end while it exists.
            self.destroy_node()
            raise
        print(f"{address} ({'control allowed' if p.control else 'read-only'})", flush=True)

    def close(self) -> None:
        """Disconnect the pages."""
        self._server.stop()

    def choices(self) -> dict[str, list[str]]:
        """Return what the page can choose from."""
        return choices()

    def scene(self) -> dict[str, Any]:
        """Return what the tool can touch."""
        return drawing(self._remotes["slave_device"].values)

    def lead(self, x: float, z: float) -> str:
        """Lead the simulated hand to a point, m; return why not, in one line, or nothing."""
        return self._scene.lead(x, z)

    def state(self) -> dict[str, Any]:
        """Return the graph's state for the page; called on the server's thread."""
        now = time.monotonic()
        values = {name: remote.values for name, remote in self._remotes.items()}
        touched = scene_of(values["slave_device"])
        settings = self.windows.settings
        coupler = self._reports.values("coupler", now)
        master = self._reports.values("master_device", now)
        return {
            "nodes": self._reports.rows(now, self._expected),
            "recorder": dict(self._reports.values("recorder", now)),
            "controller": values["compensator"].get("controller"),
            "surface": Path(touched).stem if touched else None,
            "grip": values["master_device"].get(POSTURE),
            "scene": touched,
            "led": self._scene.is_led,
            "engaged": {"true": True, "false": False}.get(coupler.get("engaged", "")),
            "stop": {"asked": self._stop_asked, **self._stopped},
            "actuator": {
                "age_us": master.get("actuator force age p50 (us)"),
                "due": master.get("actuator force due"),
                "missed": master.get("actuator force deadlines missed"),
            },
            "limits": {
                "force": settings.actuator.peak_force,
                "travel": settings.actuator.travel,
                "assumed": settings.assumed,
            },
        }

    def status(self) -> tuple[str, dict[str, str]]:
        """Return the number of connected pages, and what is sent to them."""
        traffic, (before, frames, sent) = self._server.traffic, self._reported
        now = time.monotonic()
        self._reported = (now, traffic.frames, traffic.bytes)
        passed = max(now - before, 1e-3)
        return "", {
            "pages": str(self._server.clients),
            "frames (1/s)": f"{(traffic.frames - frames) / passed:.0f}",
            "sent (kB/s)": f"{(traffic.bytes - sent) / passed / 1e3:.0f}",
        }

    def _subscribe_for_clients(self) -> None:
        """Receive the signals that connected pages show."""
        windows, shown = self.windows, self._server.shown
        sources: dict[str, tuple[Topic, Callable[[int, float], None]]] = {
            "desired": (topics.DESIRED_ACCELERATION, windows.desired.put),
            "actual": (topics.HANDLE_ACCELERATION, windows.handle.put),
            "force": (topics.ACTUATOR_FORCE, self._take_force),
            "arm_force": (topics.SLAVE_ARM_FORCE, windows.arm_force.put),
            "position": (topics.SLAVE_POSITION, windows.position.put),
        }
        self._scene.show(SCENE in shown)
        for name in self._signals.keys() - shown:
            self.destroy_subscription(self._signals.pop(name))
        for name in (sources.keys() & shown) - self._signals.keys():
            self._signals[name] = self._follow(*sources[name])

    def _follow(self, topic: Topic, take: Callable[[int, float], None]) -> Subscription:
        """Subscribe to a signal; the callback gets stamps and the component along the axis."""
        return self.listen(topic, lambda stamp, vector: take(stamp, vector[ACTUATOR_AXIS]))

    def _take_force(self, stamp: int, force: float) -> None:
        self.windows.force.put(stamp, force)
        self.windows.age.put(stamp, (time.time_ns() - stamp) / NANOSECONDS)

    def _take_diagnostics(self, array: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in array.status:
            # rclpy gives a byte as bytes of length one.
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            values = {pair.key: pair.value for pair in status.values}
            namespace, node = topics.reporter(status.name)
            if namespace == self.get_namespace().rstrip("/"):
                self._reports.take(node, NodeReport(level, status.message, values, now))

    def _take_parameters(self, event: ParameterEvent) -> None:
        for remote in self._remotes.values():
            if remote.path == event.node:
                remote.take(event)

    def _refresh_parameters(self) -> None:
        for remote in self._remotes.values():
            remote.refresh()

    def _update_settings(self) -> None:
        """Take the compensator's description of the actuator; the defaults while there is none."""
        self._scene.update()
        values = self._remotes["compensator"].values
        known = {name: value for name, value in values.items() if value is not None}
        settings = GraphSettings()
        with suppress(ParameterError):  # a node of another version
            if known:
                own, options = node_parameters("compensator", known)
                settings = GraphSettings(
                    own.high_pass_frequency, options[ACTUATOR], own.latency, assumed=False
                )
        self.windows.settings = settings

    def _take_stop(self, stop: bool) -> None:
        self._stop_asked = stop


def main() -> None:
    """Run the node."""
    run("scope", Scope, niceness=NICENESS, priority=0)


if __name__ == "__main__":
    main()
