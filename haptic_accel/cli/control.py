# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel control`` and ``record``: change a graph that runs, and its recording."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click

from haptic_accel.cli.options import arguments, one_of, verb
from haptic_accel.cli.output import next_command
from haptic_accel.core.axes import LIVE_REDUCTIONS, NO_REDUCTION
from haptic_accel.core.control.compensation import CompensationParameters
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import ParameterError, like, parameter, schema
from haptic_accel.core.topics import DEVICES
from haptic_accel.setup.words import NamespaceArguments

if TYPE_CHECKING:
    from haptic_accel.nodes.service_client import Request, ServiceClient

KEEP = "keep"
"""Value that leaves a setting as it is."""


def _switch(text: str) -> Any:
    """Declare a setting that is switched on or off."""
    return parameter(KEEP, text, choices=(KEEP, "true", "false"))


@dataclass(frozen=True)
class ControlArguments(NamespaceArguments):
    """Settings that can be changed."""

    controller: str = like(CompensationParameters, "controller", KEEP)
    reduction: str = parameter(
        KEEP,
        "reduction of the tool's three axes to one along z, or none for all axes of the handle",
        choices=(KEEP, NO_REDUCTION, *LIVE_REDUCTIONS),
    )
    frozen: str = _switch("freeze the grip estimate of the adaptive controller")
    reset: bool = parameter(False, "restart all controllers, and forget the grip estimate")
    surface: str = parameter(
        KEEP,
        "surface under the tool: plywood, text, vinyl, or a .yaml file; with slave:=virtual a"
        " scene: workshop, or a .yaml file",
    )
    grip: str = parameter(KEEP, "grip of the simulated hand", choices=(KEEP, *POSTURES))
    arm: bool = parameter(False, "allow forces again where a device refuses them until armed")
    engage: str = _switch("couple the arms")


@verb(
    "haptic-accel control controller:=adaptive",
    "haptic-accel control surface:=vinyl grip:=hook",
    "haptic-accel control engage:=false",
)
@arguments(ControlArguments)
def control(arguments: ControlArguments) -> None:
    """Change a graph while it runs; prints what changed, from what to what.

    Switches to another controller or reduction, freezes or resets the adaptation, changes the
    simulated surface or grip, disengages or engages the arms.
    """
    if replace(arguments, namespace="") == ControlArguments():
        settings = [name for name in schema(ControlArguments) if name != "namespace"]
        raise ParameterError(f"control: must be given one of {', '.join(settings)}")
    # ROS is slow to import; wrong arguments are refused without it.
    from haptic_accel.cli.joining import connected

    with connected(arguments.namespace) as client:
        asyncio.run(_apply(client, list(_requests(arguments))))


async def _apply(client: ServiceClient, requests: Sequence[Request]) -> None:
    """Send requests and print their changes until one is refused."""
    from haptic_accel.nodes.service_client import RequestError

    side, refused = "", list[str]()
    if any(_arms(request) for request in requests):
        with suppress(RequestError):  # both devices can be armed without a coupler
            side = next(iter(await client.parameters("coupler", ["side"])), None) or ""
    for request in requests:
        # Arm a device even if the other refuses; skip the peer's device.
        if _arms(request) and not request.service.startswith(side):
            continue
        if refused and not _arms(request):
            break
        try:
            print(await client.change(request))
        except RequestError as error:
            refused.append(str(error))
    if refused:
        raise RequestError("; ".join(refused))


def _arms(request: Request) -> bool:
    return request.service.endswith("/arm")


def _requests(arguments: ControlArguments) -> Iterator[Request]:
    """Yield the requests for the arguments, in their order."""
    from haptic_accel.nodes import graph_requests as make

    compensator: dict[str, Any] = {}
    if arguments.controller != KEEP:
        compensator["controller"] = arguments.controller
    if arguments.reduction != KEEP:
        compensator["reduction"] = arguments.reduction
    if arguments.frozen != KEEP:
        compensator["adaptive.frozen"] = arguments.frozen == "true"
    if compensator:
        yield make.set_parameters("compensator", compensator)
    if arguments.surface != KEEP:
        yield make.set_surface(arguments.surface)
    if arguments.grip != KEEP:
        yield make.set_grip(arguments.grip)
    if arguments.reset:
        yield make.trigger("compensator/reset")
    if arguments.arm:
        yield from (make.trigger(f"{device}/arm") for device in DEVICES)
    if arguments.engage != KEEP:
        yield make.engage(arguments.engage == "true")


ANSWER_TIMEOUT = 30.0
"""Time-out for an answer, s; the recorder flushes a finished file to disk first."""

WHOLE = re.compile(r"(.+): \d+ messages, \d+ dropped")
"""Pattern of the recorder's answer for a complete bag; the ROS service has no field for that."""

ACTIONS = {
    "start": "continue after a pause, or begin another bag after a stop",
    "pause": "leave out messages until start",
    "split": "continue in another file of the bag",
    "stop": "finish the bag; the graph goes on",
    "status": "show the state of the recording",
}
"""Actions on a recording, each a service of the recorder."""


@verb(
    "haptic-accel record status",
    "haptic-accel record pause",
    "haptic-accel record stop namespace:=left",
)
@click.argument("action", type=one_of(ACTIONS), metavar="|".join(ACTIONS))
@arguments(NamespaceArguments)
def record(action: str, arguments: NamespaceArguments) -> None:
    """Control the recording of a running graph."""
    # ROS is slow to import; wrong arguments are refused without it.
    from haptic_accel.cli.joining import connected
    from haptic_accel.nodes.graph_requests import trigger

    with connected(arguments.namespace, answering=ANSWER_TIMEOUT) as client:
        answer = asyncio.run(client.send(trigger(f"recorder/{action}")))
    print(answer)
    if action == "stop" and (whole := WHOLE.fullmatch(answer)):
        print(next_command("analyze", whole[1]))
