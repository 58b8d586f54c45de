"""``haptic-accel control``: change a graph that runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from haptic_accel.cli.options import Verb, words
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import Checked, ParameterError, parameter, schema
from haptic_accel.core.process import DONE
from haptic_accel.graph.files import surface_parameters
from haptic_accel.graph.processes import RECORDING
from haptic_accel.graph.words import parse_words

if TYPE_CHECKING:
    from haptic_accel.cli.calling import Caller

DEVICES = ("slave_device", "master_device")
"""Nodes that can be armed; the one that the user holds last."""

KEEP = "keep"
"""Value that leaves a setting as it is."""


def _switch(text: str) -> Any:
    """Declare a setting that can be switched on or off."""
    return parameter(KEEP, text, choices=(KEEP, "true", "false"))


@dataclass(frozen=True)
class ControlArguments(Checked):
    """Settings that can be changed."""

    controller: str = parameter(KEEP, "controller that takes over", choices=(KEEP, *CONTROLLERS))
    frozen: str = _switch("freeze the grip estimate of the adaptive controller")
    reset: bool = parameter(False, "restart all controllers, and forget the grip estimate")
    surface: str = parameter(
        KEEP, "surface under the simulated tool: plywood, text, vinyl, or a .yaml file"
    )
    grip: str = parameter(KEEP, "grip of the simulated hand", choices=(KEEP, *POSTURES))
    arm: bool = parameter(False, "allow forces again where a device refuses them until armed")
    engage: str = _switch("couple the arms")
    namespace: str = parameter("", "namespace of the graph")


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel control controller:=adaptive",
        "haptic-accel control surface:=vinyl grip:=hook",
        "haptic-accel control engage:=false",
    ],
)
@words(ControlArguments)
def control(words: Sequence[str]) -> int:
    """Change a graph while it runs.

    Switches to another controller, freezes or resets the adaptation, changes the simulated
    surface or grip, disengages or engages the arms.
    """
    arguments = parse_words(words, ControlArguments)
    values = _values(arguments)
    asked = arguments.reset or arguments.arm or arguments.engage != KEEP
    if not (any(values.values()) or asked):
        settings = [name for name in schema(ControlArguments) if name != "namespace"]
        raise ParameterError(f"control: must be given one of {', '.join(settings)}")
    # ROS takes a while to import: wrong words are refused without it.
    from std_srvs.srv import SetBool, Trigger

    from haptic_accel.cli.calling import CallError, connected

    with connected(arguments.namespace) as graph:
        for node, given in values.items():
            if given:
                graph.set_parameters(node, given)
        if arguments.reset:
            graph.call(Trigger, "compensator/reset", Trigger.Request())
        if arguments.arm:
            _arm(graph)
        if arguments.engage != KEEP:
            engage = SetBool.Request(data=arguments.engage == "true")
            response = graph.call(SetBool, "coupler/engage", engage)
            if not response.success:
                raise CallError(f"coupler: {response.message}")
    return DONE


def _arm(graph: Caller) -> None:
    """Let both devices accept forces again, or name those that refuse."""
    from std_srvs.srv import Trigger

    from haptic_accel.cli.calling import CallError

    refused = []
    for device in DEVICES:
        try:
            response = graph.call(Trigger, f"{device}/arm", Trigger.Request())
        except CallError as error:  # the other is armed all the same
            refused.append(str(error))
            continue
        if not response.success:
            refused.append(f"{device}: {response.message}")
    if refused:
        raise CallError("; ".join(refused))


def _values(arguments: ControlArguments) -> dict[str, dict[str, Any]]:
    """Return the parameters to set, by node and dotted name."""
    compensator: dict[str, Any] = {}
    if arguments.controller != KEEP:
        compensator["controller"] = arguments.controller
    if arguments.frozen != KEEP:
        compensator["adaptive.frozen"] = arguments.frozen == "true"
    if arguments.surface == RECORDING:
        raise ParameterError(f"surface = '{RECORDING}': must be chosen when the graph starts")
    slave = {} if arguments.surface == KEEP else surface_parameters(arguments.surface)
    master = {} if arguments.grip == KEEP else {"simulated.grip.posture": arguments.grip}
    return {"compensator": compensator, "slave_device": slave, "master_device": master}
