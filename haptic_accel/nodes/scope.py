"""Executable `scope`: a page that shows the graph while it runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.subscription import Subscription

from haptic_accel.core import topics
from haptic_accel.core.model import ACTUATOR, Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, Topic
from haptic_accel.graph.files import SURFACE
from haptic_accel.graph.node_parameters import node_parameters, node_schema
from haptic_accel.nodes.interface import DEPTH, GraphNode, quality
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.scope_commands import POSTURE, Commands, choices
from haptic_accel.scope.access import TOKEN_VARIABLE, Access
from haptic_accel.scope.board import Board, Report
from haptic_accel.scope.server import ScopeServer
from haptic_accel.scope.windows import Setting, Windows

SIGNAL_DEPTH = 1000
"""Messages of one signal that the middleware keeps while Python is busy."""

NICENESS = 10
"""How much less the scope asks for a core than the nodes that make the force."""

LOOK_PERIOD = 0.2
"""How often it is looked whether a page is there, s."""

ASK_PERIOD = 1.0
"""How often nodes are looked for whose parameters are not known, s."""

WANTED = {
    "compensator": tuple(
        name
        for name in node_schema("compensator")
        if name in ("controller", "high_pass_frequency") or name.startswith(f"{ACTUATOR}.")
    ),
    "slave_device": ("device", f"{SURFACE}name"),
    "master_device": ("device", POSTURE),
}
"""Parameters of other nodes that are shown, or needed to show something."""


class Remote:
    """Some parameters of another node, as they are now.

    Parameters
    ----------
    node : GraphNode
        That wants to know.
    name : str
        Of the other node, in the same namespace.
    wanted : tuple of str
        Its parameters.
    changed : callable
        Called when any is known anew.
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

    def look(self) -> None:
        """Ask a node that has come; forget one that has gone."""
        if not self._client.service_is_ready():
            self._asked = False
            self.values = {}
        elif not self._asked:
            self._asked = True
            asked = self._client.call_async(GetParameters.Request(names=list(self._wanted)))
            asked.add_done_callback(lambda future: self._take_answer(future.result()))

    def take(self, event: ParameterEvent) -> None:
        """Take what the node says when it comes, and when a parameter changes."""
        self._know({p.name: p.value for p in (*event.new_parameters, *event.changed_parameters)})

    def _take_answer(self, answer: GetParameters.Response | None) -> None:
        if answer is not None:
            self._know(dict(zip(self._wanted, answer.values, strict=False)))

    def _know(self, found: Mapping[str, Any]) -> None:
        known = {
            name: parameter_value_to_python(value)
            for name, value in found.items()
            if name in self._wanted
        }
        if known:
            self.values = {**self.values, **known}
            self._changed()


class Scope(GraphNode):
    """Listens while a page looks, and shows it what it hears.

    While no page is there, only what comes once a second is listened to: a subscriber more costs
    the nodes that make the force a little with each message.
    """

    def __init__(self) -> None:
        super().__init__("scope")
        p = self.parameters
        self.windows = Windows()
        self._board = Board()
        self._stop_asked = False
        self._stopped: dict[str, bool | None] = {"master": None, "slave": None}
        self._remotes = {
            name: Remote(self, name, wanted, self._set) for name, wanted in WANTED.items()
        }
        self._heard: list[Subscription] = []
        self._told = (time.monotonic(), 0, 0)
        self._commands = Commands(self, self._stopped) if p.control else None
        self.create_subscription(
            DiagnosticArray,
            topics.DIAGNOSTICS.name,
            self._take_diagnostics,
            quality(topics.DIAGNOSTICS, DEPTH * len(self._remotes)),
        )
        self.create_subscription(
            ParameterEvent, "/parameter_events", self._take_parameters, SIGNAL_DEPTH
        )
        self.listen_state(topics.EMERGENCY_STOP, self._take_stop)
        self.listen_state(topics.MASTER_STOPPED, lambda stop: self._confirm("master", stop))
        self.listen_state(topics.SLAVE_STOPPED, lambda stop: self._confirm("slave", stop))
        self.create_timer(LOOK_PERIOD, self._attend)
        self.create_timer(ASK_PERIOD, self._look)
        access = Access(p.host, os.environ.get(TOKEN_VARIABLE, ""))
        self._server = ScopeServer(self, access, p.host, p.port, self._commands)
        try:
            address = self._server.start()
        except OSError:
            # Nobody else knows the node yet, and the middleware does not end while it is there.
            self.destroy_node()
            raise
        print(f"{address} ({'control allowed' if p.control else 'read-only'})", flush=True)

    def close(self) -> None:
        """Say goodbye to the pages."""
        self._server.stop()
        super().close()

    def choices(self) -> dict[str, list[str]]:
        """Return what the page can choose from."""
        return choices()

    def state(self) -> dict[str, Any]:
        """Return the graph's state for the page; called on the server's thread."""
        now = time.monotonic()
        values = {name: remote.values for name, remote in self._remotes.items()}
        setting = self.windows.setting
        coupler = self._board.values("coupler", now)
        return {
            "nodes": self._board.rows(now),
            "recorder": dict(self._board.values("recorder", now)),
            "controller": values["compensator"].get("controller"),
            "surface": values["slave_device"].get(f"{SURFACE}name"),
            "grip": values["master_device"].get(POSTURE),
            "engaged": {"true": True, "false": False}.get(coupler.get("engaged", "")),
            "stop": {"asked": self._stop_asked, **self._stopped},
            "age_at_actuator": {
                label: self._board.values("master_device", now).get(
                    f"actuator force age {label} (us)"
                )
                for label in ("p50", "p99")
            },
            "limits": {
                "force": setting.actuator.peak_force,
                "travel": setting.actuator.travel,
                "assumed": setting.assumed,
                "high_pass": setting.high_pass_frequency,
            },
        }

    def status(self) -> tuple[str, dict[str, str]]:
        """Return how many pages look, and what they are sent."""
        traffic, (before, frames, sent) = self._server.traffic, self._told
        now = time.monotonic()
        self._told = (now, traffic.frames, traffic.bytes)
        passed = max(now - before, 1e-3)
        return "", {
            "pages": str(self._server.clients),
            "frames (1/s)": f"{(traffic.frames - frames) / passed:.0f}",
            "sent (kB/s)": f"{(traffic.bytes - sent) / passed / 1e3:.0f}",
        }

    def _attend(self) -> None:
        """Listen to the signals while a page looks."""
        windows = self.windows
        if self._server.clients and not self._heard:
            self._heard = [
                self._follow(topics.DESIRED_ACCELERATION, windows.desired.put),
                self._follow(topics.HANDLE_ACCELERATION, windows.handle.put),
                self._follow(topics.ACTUATOR_FORCE, self._take_force),
            ]
        elif not self._server.clients and self._heard:
            for subscription in self._heard:
                self.destroy_subscription(subscription)
            self._heard = []

    def _follow(self, topic: Topic, take: Callable[[int, float], None]) -> Subscription:
        """Subscribe to a signal; the callback gets stamps and what acts along the axis."""

        def put(stamp: int, vector: Vector) -> None:
            take(stamp, vector[ACTUATOR_AXIS])

        return self.listen(topic, put, SIGNAL_DEPTH)

    def _take_force(self, stamp: int, force: float) -> None:
        self.windows.force.put(stamp, force)
        self.windows.age.put(stamp, (time.time_ns() - stamp) / NANOSECONDS)

    def _take_diagnostics(self, array: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in array.status:
            # rclpy gives a byte as bytes of length one.
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            values = {pair.key: pair.value for pair in status.values}
            self._board.take(status.name, Report(level, status.message, values, now))

    def _take_parameters(self, event: ParameterEvent) -> None:
        for remote in self._remotes.values():
            if remote.path == event.node:
                remote.take(event)

    def _look(self) -> None:
        for remote in self._remotes.values():
            remote.look()

    def _set(self) -> None:
        """Take from the compensator what it knows of the actuator."""
        self.windows.know(_setting(self._remotes["compensator"].values))

    def _take_stop(self, stop: bool) -> None:
        if not stop and self._commands:
            self._commands.let_go()
        self._stop_asked = stop

    def _confirm(self, arm: str, stop: bool) -> None:
        self._stopped[arm] = stop


def _setting(values: Mapping[str, Any]) -> Setting:
    """Return what a compensator's parameters say; the defaults while it has said nothing."""
    known = {name: value for name, value in values.items() if value is not None}
    if not known:
        return Setting()
    try:
        own, options = node_parameters("compensator", known)
    except ParameterError:  # of another version
        return Setting()
    return Setting(own.high_pass_frequency, options[ACTUATOR], assumed=False)


def main() -> None:
    """Run the node."""
    # The force that is felt does not wait for its being shown. Said before the middleware
    # starts its threads, which inherit it.
    os.nice(NICENESS)
    run("scope", Scope, realtime=False)


if __name__ == "__main__":
    main()
