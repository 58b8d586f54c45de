# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Service requests to a running graph: for the command line and for the scope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
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


def set_parameters(node: str, values: Mapping[str, Any]) -> GraphRequest:
    """Set parameters of a node by dotted name, all or none."""
    parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
    content = SetParametersAtomically.Request(parameters=parameters)
    return GraphRequest(f"{node}/set_parameters_atomically", content)


def set_controller(name: str) -> GraphRequest:
    """Let another controller compute the actuator's force."""
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
    """Let the simulated hand hold the handle with another grip."""
    return set_parameters("master_device", {POSTURE: posture})


def engage(value: bool) -> GraphRequest:
    """Couple the arms, or uncouple them."""
    return GraphRequest("coupler/engage", SetBool.Request(data=value))


def trigger(service: str) -> GraphRequest:
    """Call one of the `SERVICES` that need nothing but their name."""
    return GraphRequest(service, Trigger.Request())
