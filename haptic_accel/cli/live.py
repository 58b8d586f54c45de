# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel teleop``, ``scope`` and ``touch``: what runs until Ctrl-C.

These are the graph as supervised processes, without ros2 launch; a page that shows a running
graph; and a page to touch surfaces through the simulated rig, without ROS.
"""

from __future__ import annotations

from dataclasses import dataclass

import click

from haptic_accel.cli.options import arguments, verb
from haptic_accel.cli.output import StoppedError
from haptic_accel.cli.running import print_line, run_shown, show_page, stop_on_signal
from haptic_accel.core.parameters import schema
from haptic_accel.core.process import FAILED
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.node_parameters import ScopeNodeParameters
from haptic_accel.setup.processes import Process, graph
from haptic_accel.setup.setup import SCOPE
from haptic_accel.setup.words import NamespaceArguments


@verb(
    "haptic-accel teleop controller:=inverse surface:=vinyl duration:=10",
    "haptic-accel teleop master:=serial slave:=serial params_file:=mine.yaml",
    "haptic-accel teleop scope:=true side:=master peer:=ROBOT keys:=keys",
)
@arguments(GraphArguments)
def teleop(arguments: GraphArguments) -> None:
    """Run the graph until Ctrl-C: both arms, or one of them with a peer host."""
    run_shown(graph(arguments), endless=arguments.duration == 0)


@dataclass(frozen=True)
class ScopeArguments(ScopeNodeParameters, NamespaceArguments):
    """Page of a running graph."""


@verb(
    "haptic-accel scope",
    "haptic-accel scope port:=9000 control:=true",
    "haptic-accel scope host:=0.0.0.0",
)
@arguments(ScopeArguments)
def scope(arguments: ScopeArguments) -> None:
    """Serve a page with signals, spectra, errors and states of a running graph until Ctrl-C.

    With control:=true the page has controls. An address other than this machine's own needs a
    token, which is printed with the address; HAPTIC_ACCEL_SCOPE_TOKEN in the environment sets
    it.
    """
    parameters = {name: getattr(arguments, name) for name in schema(ScopeNodeParameters)}
    # The command runs only this process, and ends with it.
    process = Process(SCOPE, {SCOPE: parameters}, arguments.namespace)
    with stop_on_signal() as stop:
        outcome = Supervisor([process], on_line=lambda _, line: print_line(line)).run(stop)
    if outcome.first:  # the process has printed the reason
        raise StoppedError(status=outcome.status if outcome.status >= 0 else FAILED)


@verb("haptic-accel touch", "haptic-accel touch --surface text --rig ideal")
@click.option("--surface", default="plywood", metavar="NAME|FILE", help="Surface at the start.")
@click.option("--rig", default="paper", metavar="NAME|FILE", help="Virtual rig.")
@click.option(
    "--port", default=0, metavar="PORT", type=click.IntRange(0, 65535), help="TCP port; 0 for any."
)
@click.option("--open/--no-open", "opened", default=True, help="Open the page in a browser.")
def touch(surface: str, rig: str, port: int, opened: bool) -> None:
    """Touch a surface on a page with mouse, finger or arrow keys until Ctrl-C.

    The page shows and plays what the handle does without compensation, with the paper's and with
    this package's. The rig is simulated in this process, by the loop of the live graph, and needs
    no ROS.
    """
    # The server is slow to import; a graph starts without it.
    from haptic_accel.scope.connections import LOCAL_HOST, Access
    from haptic_accel.scope.paced_rig import PacedRig
    from haptic_accel.scope.server import ScopeServer

    touched = PacedRig(surface, rig)
    server = ScopeServer(touched, Access(LOCAL_HOST, ""), LOCAL_HOST, port, touched.act)
    with stop_on_signal() as stop:
        show_page(server.start(), opened=opened)
        touched.run(stop)
    server.stop()
