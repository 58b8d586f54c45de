"""What the page of the live scope may ask of the graph, carried out through ROS."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import EMERGENCY_STOP
from haptic_accel.graph.files import config_folder, surface_parameters
from haptic_accel.graph.processes import RECORDING, SIMULATED
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.scope.server import CommandError

FINDING_TIME = 0.7
"""How long a service may take to be found, s."""

ANSWERING_TIME = 1.2
"""How long it may take to answer, s; with the above, a page waits less than 2 s."""

LOOK_PERIOD = 0.02
"""How often it is looked for, s."""

POSTURE = f"{SIMULATED}.grip.posture"
"""Parameter of `master_device`: how the simulated hand holds the handle."""

RECORDER_ACTIONS = ("start", "pause", "split", "stop")
"""Services of the recorder."""


def choices() -> dict[str, list[str]]:
    """Return the controllers, surfaces and grips that there are."""
    surfaces = sorted(path.stem for path in (config_folder() / "surfaces").glob("*.yaml"))
    return {
        "controllers": list(CONTROLLERS),
        "surfaces": [name for name in surfaces if name != RECORDING],
        "grips": list(POSTURES),
        "recorder_actions": list(RECORDER_ACTIONS),
    }


class Commands:
    """Carries out commands; called on the server's thread, while the node's own spins.

    Parameters
    ----------
    node : GraphNode
    stopped : dict
        Filled by the node: what each device last said of the emergency stop, by its arm; None
        while it has said nothing.
    """

    def __init__(self, node: GraphNode, stopped: dict[str, bool | None]) -> None:
        self._node = node
        self._stopped = stopped
        self._choices = choices()
        # Made before they are needed: finding each other takes the middleware a while.
        self._stop_publisher = node.publisher(EMERGENCY_STOP)
        self._latched = False
        self._lock = threading.Lock()
        self._stop = node.create_client(SetBool, EMERGENCY_STOP.name)
        self._engage = node.create_client(SetBool, "coupler/engage")
        self._compensator = node.create_client(SetParameters, "compensator/set_parameters")
        self._master = node.create_client(SetParameters, "master_device/set_parameters")
        self._slave = node.create_client(
            SetParametersAtomically, "slave_device/set_parameters_atomically"
        )
        self._recorder = {
            name: node.create_client(Trigger, f"recorder/{name}") for name in RECORDER_ACTIONS
        }
        self._actions = {
            "controller": self._set_controller,
            "surface": self._set_surface,
            "grip": self._set_grip,
            "engage": self._set_engaged,
            "record": self._record,
            "estop": self._set_stop,
        }

    async def __call__(self, action: str, value: Any) -> str:
        """Carry out a command; return one line that says what was done.

        Raises
        ------
        CommandError
            It is wrong, or the graph does not answer or refuses.
        """
        if action not in self._actions:
            raise CommandError(
                f"action = {action!r}: must be one of {', '.join(self._actions)}", 400
            )
        return await self._actions[action](value)

    def let_go(self) -> None:
        """Forget an own stop that another has released, or nodes that come later would hear it.

        Called where the node spins.
        """
        with self._lock:
            if self._latched:
                self._node.destroy_publisher(self._stop_publisher)
                self._stop_publisher = self._node.publisher(EMERGENCY_STOP)
                self._latched = False

    async def _set_controller(self, value: Any) -> str:
        name = _chosen("controller", value, self._choices["controllers"])
        await self._set(self._compensator, {"controller": name})
        return f"controller: {name}"

    async def _set_surface(self, value: Any) -> str:
        name = _chosen("surface", value, self._choices["surfaces"])
        try:
            values = surface_parameters(name)
        except ParameterError as error:
            raise CommandError(str(error)) from None
        await self._set(self._slave, values)
        return f"surface: {name}"

    async def _set_grip(self, value: Any) -> str:
        name = _chosen("grip", value, self._choices["grips"])
        await self._set(self._master, {POSTURE: name})
        return f"grip: {name}"

    async def _set_engaged(self, value: Any) -> str:
        answer = await self._call(
            self._engage, SetBool.Request(data=_true_or_false("engage", value))
        )
        _check(self._engage, answer)
        return answer.message or ("arms: engaged" if value else "arms: let go")

    async def _record(self, value: Any) -> str:
        client = self._recorder[_chosen("record", value, list(RECORDER_ACTIONS))]
        answer = await self._call(client, Trigger.Request())
        _check(client, answer)
        return f"recorder: {answer.message or 'done'}"

    async def _set_stop(self, value: Any) -> str:
        """Stop, or release, by the topic that the devices hear, and tell the coupler."""
        stop = _true_or_false("estop", value)
        self._stopped.update(dict.fromkeys(self._stopped))
        # First of all, and whether or not the coupler lives.
        with self._lock:
            self._latched = stop
            self._stop_publisher.publish(Bool(data=stop))
        if self._stop.service_is_ready():
            self._stop.call_async(SetBool.Request(data=stop))
        if not await _until(lambda: set(self._stopped.values()) == {stop}, ANSWERING_TIME):
            silent = " and ".join(n for n, state in self._stopped.items() if state != stop)
            what = "stop" if stop else "release"
            raise CommandError(f"estop: the {what} is sent; not confirmed by {silent}")
        return f"{'stopped' if stop else 'released'}: both devices confirm"

    async def _set(self, client: Client, values: dict[str, Any]) -> None:
        """Set parameters of a node, all or, where it offers that, none."""
        parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
        answer = await self._call(client, client.srv_type.Request(parameters=parameters))
        results = answer.results if hasattr(answer, "results") else [answer.result]
        for result in results:
            if not result.successful:
                raise CommandError(f"{_node_of(client)}: {result.reason}")

    async def _call(self, client: Client, request: Any) -> Any:
        if not await _until(client.service_is_ready, FINDING_TIME):
            raise CommandError(f"{client.srv_name}: no such service; is {_node_of(client)} there?")
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Any] = loop.create_future()

        def settle(result: Any) -> None:
            if not answered.done():
                answered.set_result(result)

        # Its callbacks run where the node spins.
        client.call_async(request).add_done_callback(
            lambda future: loop.call_soon_threadsafe(settle, future.result())
        )
        try:
            return await asyncio.wait_for(answered, ANSWERING_TIME)
        except asyncio.TimeoutError:
            raise CommandError(
                f"{client.srv_name}: no answer within {ANSWERING_TIME:g} s"
            ) from None


def _chosen(action: str, value: Any, known: list[str]) -> str:
    if not isinstance(value, str) or value not in known:
        raise CommandError(f"{action} = {value!r}: must be one of {', '.join(known)}", 400)
    return value


def _true_or_false(action: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise CommandError(f"{action} = {value!r}: must be true or false", 400)
    return value


def _check(client: Client, answer: Any) -> None:
    if not answer.success:
        raise CommandError(f"{client.srv_name}: {answer.message or 'refused'}")


def _node_of(client: Client) -> str:
    return str(client.srv_name).strip("/").split("/")[-2]


async def _until(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait for a condition; return whether it came true in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() >= deadline:
            return False
        await asyncio.sleep(LOOK_PERIOD)
    return True
