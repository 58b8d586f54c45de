"""``haptic-accel control``: change the compensation of a graph that runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from haptic_accel.core.controllers import CONTROLLERS
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.startup.arguments import parse_arguments
from haptic_accel.startup.process import DONE, FAILED

PATIENCE = 5.0
"""How long a compensator may take to be found, and to answer, s."""

KEEP = "keep"
"""What leaves a setting as it is."""


@dataclass(frozen=True)
class ControlArguments(Checked):
    """What can be changed."""

    controller: str = parameter(KEEP, "controller that takes over", choices=(KEEP, *CONTROLLERS))
    frozen: str = parameter(
        KEEP, "whether the adaptive controller's grip stays", choices=(KEEP, "true", "false")
    )
    reset: bool = parameter(False, "start all controllers anew, and forget the grip")
    namespace: str = parameter("", "of the graph")


def control(words: Sequence[str]) -> int:
    """Change what ``key:=value`` words say; return the exit status."""
    arguments = parse_arguments(words, ControlArguments)
    values: dict[str, Any] = {}
    if arguments.controller != KEEP:
        values["controller"] = arguments.controller
    if arguments.frozen != KEEP:
        values["adaptive.frozen"] = arguments.frozen == "true"
    if not values and not arguments.reset:
        raise ParameterError("control: must be given controller:=, frozen:= or reset:=true")
    refusal = _applied(f"{arguments.namespace.rstrip('/')}/compensator", values, arguments.reset)
    if refusal:
        print(f"haptic-accel: {refusal}", file=sys.stderr)
        return FAILED
    return DONE


def _applied(name: str, values: dict[str, Any], reset: bool) -> str:
    """Ask a compensator; return why it did not, empty if it did."""
    # ROS takes a while to import: only who talks to it waits for that.
    import rclpy
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter
    from std_srvs.srv import Trigger

    from haptic_accel.nodes.scheduling import MIDDLEWARE

    for variable, value in MIDDLEWARE.items():
        os.environ.setdefault(variable, value)
    rclpy.init(args=[])
    node = rclpy.create_node("haptic_accel_control")

    def answer(kind: Any, service: str, request: Any) -> Any:
        client = node.create_client(kind, f"{name}/{service}")
        if not client.wait_for_service(PATIENCE):
            return None
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
        return future.result()

    try:
        if values:
            parameters = [
                Parameter(key, value=value).to_parameter_msg() for key, value in values.items()
            ]
            response = answer(
                SetParameters, "set_parameters", SetParameters.Request(parameters=parameters)
            )
            if response is None:
                return f"{name}: does not answer; is the graph running?"
            reasons = [result.reason for result in response.results if not result.successful]
            if reasons:
                return f"{name}: {reasons[0]}"
        if reset and answer(Trigger, "reset", Trigger.Request()) is None:
            return f"{name}: does not answer; is the graph running?"
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return ""
