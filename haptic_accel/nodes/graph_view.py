# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""View of a running graph: its signals, parameters, diagnostics, emergency stop and scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message
from rclpy.task import Future

from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXES, NAMES, Axes
from haptic_accel.core.cdr import unpack_stamped_vector
from haptic_accel.core.control.compensation import PLANT
from haptic_accel.core.control.controllers import granted_delay
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ACTUATOR, Vector
from haptic_accel.core.parameters import ParameterError, checked, shown
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import Topic
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.signals import Inbox, Sender
from haptic_accel.nodes.supervised_node import message_type
from haptic_accel.scope.server import FRAME_RATE, SOUND_RATE
from haptic_accel.scope.state import MOST_NODES, SCENE, NodeReport, NodeReports, drawing
from haptic_accel.scope.windows import LARGEST_VALUE, GraphSettings, Windows
from haptic_accel.setup.arguments import POINTER
from haptic_accel.setup.arguments import SCENE as SCENE_FILE
from haptic_accel.setup.files import POSTURE, SURFACE
from haptic_accel.setup.node_parameters import build_parameters, node_schema

SIGNALS = {
    "tool": topics.SLAVE_POSITION,
    "tool_velocity": topics.SLAVE_VELOCITY,
    "handle": topics.MASTER_POSITION,
    "contact_force": topics.CONTACT_FORCE,
}
"""Topics of `haptic_accel.scope.state.VECTORS`."""


class ScopeScene:
    """Positions shown on a page, and set-points for the hand from the page's pointer.

    Parameters
    ----------
    node : GraphNode
    vectors : dict
        Filled with the latest vectors while a page shows them.
    master : callable
        Returns the known parameters of the master's node.
    """

    def __init__(
        self, node: GraphNode, vectors: dict[str, Vector], master: Callable[[], Mapping[str, Any]]
    ) -> None:
        self._node, self._vectors, self._master = node, vectors, master
        self._inboxes: dict[str, Inbox] = {}
        self._sender: Sender | None = None
        self._refusal = ""
        self._looking = node.create_timer(1 / FRAME_RATE, self._poll, autostart=False)

    def show(self, shown: bool) -> None:
        """Receive the positions of tool and handle only while a page shows them."""
        if shown == bool(self._inboxes):
            return
        if shown:
            # Only the newest sample of each signal is needed; samples wake no thread.
            self._inboxes = {name: self._node.inbox(t, depth=1) for name, t in SIGNALS.items()}
            self._looking.reset()
        else:
            self._looking.cancel()
            for inbox in self._inboxes.values():
                inbox.leave()
            self._inboxes = {}
            self._vectors.clear()

    def update(self) -> None:
        """Create the sender of the hand's set-points if the master follows them."""
        if self._sender is None and self._master().get("device") == POINTER:
            try:
                self._sender = self._node.sender(topics.HAND_SET_POINT)
            except ParameterError as error:
                self._refusal = str(error)

    def lead(self, x: float, z: float) -> str:
        """Send a point to the hand, m; return the reason of a refusal, if any."""
        device = self._master().get("device") or "unknown"
        if device != POINTER:
            return f"hand: master = {device}: must be {POINTER} to be led"
        if self._sender is None:
            return f"hand: {self._refusal}"
        self._sender.send(time.time_ns(), (x, 0.0, z))
        return ""

    @property
    def has_pointer(self) -> bool:
        """True if a page can lead the hand."""
        return self._sender is not None and self._master().get("device") == POINTER

    def _poll(self) -> None:
        for name, inbox in self._inboxes.items():
            for _, vector in inbox.drain_vectors():
                self._vectors[name] = vector


LONGEST_TEXT = 1000
"""Maximum length of a text parameter, characters; paths are shorter."""

ANSWERING_TIME = 3.0
"""Time-out for a node's answer, s. A request may go to a killed node: its service stays
discoverable for up to 20 s, even while a new node of the same name exists."""

Reported = Iterable[tuple[str, ParameterValue]]


class RemoteParameters:
    """Current values of some parameters of another node.

    Any node may publish an event under another node's name. An event is therefore shown at once,
    and then verified by a request to the node.

    Parameters
    ----------
    node : GraphNode
        Node that follows the parameters.
    name : str
        Name of the other node, in the same namespace, and of its executable.
    names : tuple of str
        Names of the followed parameters.
    changed : callable
        Called after any value has changed.
    refuse : callable
        Called with a line for each value that the parameter cannot have.
    """

    def __init__(
        self,
        node: GraphNode,
        name: str,
        names: tuple[str, ...],
        changed: Callable[[], None],
        refuse: Callable[[str], None],
    ) -> None:
        self._name = name
        self._names = names
        self._changed = changed
        self._refuse = refuse
        self._client = node.create_client(GetParameters, f"{name}/get_parameters")
        self._found = False
        self._answer: Future | None = None  # to the request for the present values
        self._due = 0.0
        self.path = f"{node.get_namespace().rstrip('/')}/{name}"
        """Full name of the other node."""
        self.values: Mapping[str, Any] = {}

    def refresh(self) -> None:
        """Request parameters of a new, changed or silent node; discard those of a lost node."""
        if not self._client.service_is_ready():
            if self._found:  # otherwise the node is new, and has published its values
                self._found, self._answer = False, None
                self.values = {}
        elif self._answer is None or self._is_overdue(self._answer):
            self._found = True
            self._answer = self._client.call_async(GetParameters.Request(names=list(self._names)))
            self._answer.add_done_callback(lambda answer: self._receive_answer(answer.result()))
            self._due = time.monotonic() + ANSWERING_TIME

    def _is_overdue(self, answer: Future) -> bool:
        """Drop a request without an answer after the time-out; return true if dropped."""
        overdue = not answer.done() and time.monotonic() > self._due
        if overdue:
            self._client.remove_pending_request(answer)
        return overdue

    def forget(self) -> None:
        """Discard all values because the node has ended."""
        self._found, self._answer = False, None
        self._apply(dict.fromkeys(self.values), [])

    def receive(self, event: ParameterEvent) -> None:
        """Read the values that the node publishes at its start and after a change."""
        reported = [(p.name, p.value) for p in (*event.new_parameters, *event.changed_parameters)]
        known, refused = admitted(self._name, self._names, reported)
        if known or refused:
            self._answer = None
            self._apply(known, refused)

    def _receive_answer(self, answer: GetParameters.Response) -> None:
        reported = zip(self._names, answer.values, strict=False)
        known, refused = admitted(self._name, self._names, reported)
        # A node of another version may have values that this version does not know.
        self._apply({**dict.fromkeys(self._names), **known}, refused)

    def _apply(self, known: Mapping[str, Any], refused: list[str]) -> None:
        for reason in refused:
            self._refuse(reason)
        before, self.values = self.values, {**self.values, **known}
        if self.values != before:
            self._changed()


def admitted(
    executable: str, names: Iterable[str], reported: Reported
) -> tuple[dict[str, Any], list[str]]:
    """Return requested parameters with valid values, and reasons to refuse the others.

    Parameters
    ----------
    executable : str
        Name of the node's executable.
    names : iterable of str
        Names of the requested parameters.
    reported : iterable of tuple
        Names and values that the node has reported.

    Returns
    -------
    tuple
        Values by name, and a line for each value that is refused.
    """
    schema = node_schema(executable)
    known: dict[str, Any] = {}
    refused = []
    for name, message in reported:
        if name not in names:
            continue
        try:
            value = parameter_value_to_python(message)
            if value is not None:  # unknown to the node
                known[name] = _checked(name, value, *schema[name])
        except (ParameterError, RuntimeError) as error:  # RuntimeError: the value has no ROS type
            refused.append(f"{executable}: {name}: {shown(str(error))}")
    return known, refused


def _checked(name: str, value: Any, default: Any, specification: Any) -> Any:
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        raise ParameterError(f"{len(value)} characters: at most {LONGEST_TEXT} are allowed")
    return checked(name, value, default, specification)


ASK_PERIOD = 1.0
"""Interval between attempts to get the parameters of nodes that are not known yet, s."""

NEEDED = {
    "compensator": tuple(
        name
        for name in node_schema("compensator")
        if name in ("axes", "controller", "high_pass_frequency", "latency", "rate")
        or name.endswith(".granted_time")
        or name.startswith((f"{ACTUATOR}.", f"{PLANT}."))
    ),
    "slave_device": ("device", f"{SURFACE}name", SCENE_FILE),
    "master_device": ("device", POSTURE),
}
"""Parameters of other nodes that are shown, or needed to show something."""

_Store = Callable[[Windows, int, float, int], None]
"""Function that stores a sample with its stamp and reception time, ns."""


class GraphView(GraphNode):
    """Node that follows a graph, and receives the requested signals.

    Parameters
    ----------
    executable : str

    Attributes
    ----------
    arms : tuple of str
        Arms of this host.
    windows : Windows
        Latest seconds of the received signals.
    reports : NodeReports
        Diagnostics of the nodes.
    emergency_stop : dict
        State of the emergency stop: requested (``asked``), and as reported by each arm; None while
        unknown.
    """

    task = "view of the graph"

    def __init__(self, executable: str) -> None:
        super().__init__(executable)
        side = self.parameters.side
        self.arms: tuple[str, ...] = (side,) if side else topics.ARMS
        self.windows = Windows()
        self.reports = NodeReports()
        self.emergency_stop: dict[str, bool | None] = {"asked": False, **dict.fromkeys(self.arms)}
        self._controller: str | None = None
        refuse = partial(self.refuse, topics.PARAMETER_EVENTS)
        self._remotes = {
            name: RemoteParameters(self, name, parameter_names, self._update_settings, refuse)
            for name, parameter_names in NEEDED.items()
        }
        master = self._remotes["master_device"]
        self._scene = ScopeScene(self, self.windows.vectors, lambda: master.values)
        self._signals: dict[str, tuple[Topic, _Store]] = {
            "desired": (topics.DESIRED_ACCELERATION, _only("desired")),
            "actual": (topics.HANDLE_ACCELERATION, _only("handle")),
            "force": (topics.ACTUATOR_FORCE, _store_force),
            "arm_force": (topics.SLAVE_ARM_FORCE, _only("arm_force")),
            "position": (topics.SLAVE_POSITION, _only("position")),
        }
        self._received: dict[str, Inbox] = {}
        self._follow_messages(topics.DIAGNOSTICS, self._receive_diagnostics)
        self._follow_messages(topics.PARAMETER_EVENTS, self._receive_parameters)
        stop = self.emergency_stop
        self.listen_state(topics.COUPLER_STOPPED, partial(stop.__setitem__, "asked"))
        for arm in self.arms:
            stopped = topics.DEVICES[f"{arm}_device"].stopped
            self.listen_state(stopped, partial(stop.__setitem__, arm))
        self.create_timer(ASK_PERIOD, self._refresh_parameters)
        # A sample does not wake the executor: if samples arrived faster than they are read, the
        # node's timers and diagnostics would wait behind them.
        self._looking = self.create_timer(1 / SOUND_RATE, self._receive_signals, autostart=False)

    def scene(self) -> dict[str, Any]:
        """Return the scene's drawing."""
        return drawing(self._remotes["slave_device"].values)

    def lead(self, x: float, z: float) -> str:
        """Lead the simulated hand to a point, m; return the reason of a refusal."""
        return self._scene.lead(x, z)

    @property
    def has_pointer(self) -> bool:
        """True if a page can lead the hand."""
        return self._scene.has_pointer

    @property
    def known_parameters(self) -> dict[str, dict[str, Any]]:
        """Known parameters of other nodes, by node; see `NEEDED`."""
        return {name: dict(remote.values) for name, remote in self._remotes.items()}

    def forget(self) -> None:
        """Discard all information on a graph that has ended, except samples."""
        self.reports.forget()
        self.emergency_stop.update({"asked": False, **dict.fromkeys(self.arms)})
        for remote in self._remotes.values():
            remote.forget()

    def receive(self, signals: Collection[str]) -> None:
        """Receive only the named signals (names as in `frames`)."""
        self._scene.show(SCENE in signals)
        for name in self._received.keys() - signals:
            self._received.pop(name).leave()
        for name in (self._signals.keys() & signals) - self._received.keys():
            self._received[name] = self.inbox(self._signals[name][0])
        if self._received and self._looking.is_canceled():
            self._looking.reset()
        elif not self._received:
            self._looking.cancel()

    def _receive_signals(self) -> None:
        """Read all waiting samples."""
        by_axis = self.windows.by_axis
        for name, inbox in self._received.items():
            topic, store = self._signals[name]
            for _, received, (stamp, vector) in inbox.drain(unpack_stamped_vector):
                for axis, windows in by_axis.items():
                    value = vector[NAMES.index(axis)]
                    if abs(value) <= LARGEST_VALUE:  # false for NaN
                        store(windows, stamp, value, received)
                    else:
                        self.refuse(topic, f"{value:g}: must be at most {LARGEST_VALUE:g}")

    def _follow_messages(self, topic: Topic, take: Callable[[Any], None]) -> None:
        """Subscribe to messages from any sender; refuse malformed ones."""
        kind = message_type(topic)

        def read(data: bytes) -> None:
            try:
                message = deserialize_message(data, kind)
            except (RuntimeError, ValueError) as error:  # rclpy's errors, and text not in UTF-8
                self.refuse(topic, " ".join(str(error).split()))
            else:
                take(message)

        self.subscribe_raw(topic, read)

    def _receive_diagnostics(self, array: DiagnosticArray) -> None:
        now = time.monotonic()
        for status in array.status:
            # rclpy gives a byte as bytes of length one.
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            values = {pair.key: pair.value for pair in status.values}
            namespace, node = topics.reporter(status.name)
            if namespace != self.get_namespace().rstrip("/"):
                continue
            if not self.reports.receive(node, NodeReport(level, status.message, values, now)):
                self.refuse(topics.DIAGNOSTICS, f"more than {MOST_NODES} nodes report")

    def _receive_parameters(self, event: ParameterEvent) -> None:
        for remote in self._remotes.values():
            if remote.path == event.node:
                remote.receive(event)

    def _refresh_parameters(self) -> None:
        for remote in self._remotes.values():
            remote.refresh()

    def _update_settings(self) -> None:
        """Apply the compensator's description of the actuator, or the defaults without one."""
        self._scene.update()
        values = self._remotes["compensator"].values
        before, self._controller = self._controller, values.get("controller")
        if before not in (None, self._controller):
            for windows in self.windows.by_axis.values():
                windows.restart_comparison()
        known = {name: value for name, value in values.items() if value is not None}
        settings, axes = GraphSettings(), ACTUATOR_AXES
        with suppress(ParameterError):  # a node of another version
            if known:
                axes = Axes.parsed(str(known.get("axes", "z")))
                own, options = build_parameters("compensator", known)
                plant: Plant = options[PLANT]
                settings = GraphSettings(
                    *(own.high_pass_frequency, options[ACTUATOR], own.latency),
                    granted_delay(own.controller, options, own.rate),
                    plant=plant.coupled() if len(axes.names) == 1 else None,
                    assumed=False,
                )
        self.windows.show_axes(axes)
        for windows in self.windows.by_axis.values():
            windows.settings = settings


def _only(name: str) -> _Store:
    """Return a callback that stores a sample without its reception time."""
    return lambda windows, stamp, value, received: getattr(windows, name).put(stamp, value)


def _store_force(windows: Windows, stamp: int, force: float, received: int) -> None:
    windows.force.put(stamp, force)
    windows.age.put(stamp, (received - stamp) / NANOSECONDS)
