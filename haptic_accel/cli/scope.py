"""``haptic-accel scope``: a page that shows a graph that runs already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from haptic_accel.cli.teleop import StopOnSignal
from haptic_accel.core.parameters import parameter
from haptic_accel.core.process import DONE, FAILED
from haptic_accel.graph.arguments import parse_arguments
from haptic_accel.graph.node_parameters import ScopeNodeParameters
from haptic_accel.graph.processes import scope_process
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.scope.access import TOKEN_VARIABLE

__all__ = ["TOKEN_VARIABLE", "ScopeArguments", "scope"]


@dataclass(frozen=True)
class ScopeArguments(ScopeNodeParameters):
    """What a user may say of the page."""

    namespace: str = parameter("", "of the graph")


def scope(words: Sequence[str]) -> int:
    """Serve the page until stopped; return the exit status."""
    arguments = parse_arguments(words, ScopeArguments)
    parameters = {
        "host": arguments.host,
        "port": arguments.port,
        "control": arguments.control,
    }
    name = arguments.namespace.strip("/")
    namespace = f"/{name}" if name else ""
    # Here it is all there is: its end is the end.
    process = replace(scope_process(parameters, namespace=namespace), optional=False)
    with StopOnSignal() as stop:
        outcome = Supervisor([process], on_line=lambda _, line: print(line, flush=True)).run(stop)
    if not outcome.first:
        return DONE
    # What went wrong was printed as it was said.
    return outcome.status if outcome.status >= 0 else FAILED
