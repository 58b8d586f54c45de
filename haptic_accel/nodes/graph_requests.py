# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests that change a running graph, for commands and the scope."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import is_recording, preset_file
from haptic_accel.materials.scenes import is_scene, read_scene
from haptic_accel.nodes.service_client import Request
from haptic_accel.setup.arguments import SCENE
from haptic_accel.setup.files import POSTURE, surface_parameters

RECORDER_ACTIONS = ("start", "pause", "split", "stop")
"""Services of the recorder that change the recording."""


def set_parameters(node: str, values: Mapping[str, Any]) -> Request:
    """Set parameters of a node by dotted name, all or none."""
    parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
    content = SetParametersAtomically.Request(parameters=parameters)
    return Request(SetParametersAtomically, f"{node}/set_parameters_atomically", content)


def set_controller(name: str) -> Request:
    """Change the controller of the actuator's force."""
    return set_parameters("compensator", {"controller": name})


def set_gain(gain: float) -> Request:
    """Change the factor of the desired acceleration."""
    return set_parameters("compensator", {"gain": float(gain)})


def set_reduction(name: str) -> Request:
    """Change the reduction of the tool's three axes to one."""
    return set_parameters("compensator", {"reduction": name})


def set_surface(name: str) -> Request:
    """Put another surface or scene, by name or file, under the slave's tool.

    Raises
    ------
    ParameterError
        The surface is unknown, its file is wrong, or a running graph cannot take it.
    """
    if is_recording(name):
        raise ParameterError(f"surface = {name!r}: must be chosen when the graph starts")
    if not is_scene(name):
        return set_parameters("slave_device", surface_parameters(name))
    file = preset_file("scene", name)
    read_scene(file)
    return set_parameters("slave_device", {SCENE: str(file)})


def set_grip(posture: str) -> Request:
    """Change the grip of the simulated hand."""
    return set_parameters("master_device", {POSTURE: posture})


SETTINGS: Mapping[str, Callable[[Any], Request]] = {
    "controller": set_controller,
    "surface": set_surface,
    "grip": set_grip,
    "reduction": set_reduction,
}
"""Requests that change a running graph, by the name of the graph's argument."""


def engage(value: bool) -> Request:
    """Couple the arms, or uncouple them."""
    return Request(SetBool, "coupler/engage", SetBool.Request(data=value))


def trigger(service: str) -> Request:
    """Call a service whose request has no fields."""
    return Request(Trigger, service, Trigger.Request())
