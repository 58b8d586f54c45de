# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel estop``: the emergency stop from a terminal, and its release."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import click

from haptic_accel.cli.options import arguments, verb
from haptic_accel.cli.output import StoppedError
from haptic_accel.core.parameters import one_line, parameter
from haptic_accel.graph.domain import NEEDS_ROS, has_ros
from haptic_accel.graph.stop_signal import PendingStop, Signalled, age, own_domain, stop_graphs
from haptic_accel.setup.words import NamespaceArguments

TIMEOUT = 2.5
"""Time-out for discovery and confirmation of the devices, s, before the graph is joined again."""

ATTEMPTS = 3
"""Maximum number of attempts to join the graph. A process that joins at the same moment as a
device may not discover it for more than 5 s; one that joins later discovers it at once."""

ANSWERING_TIME = 1.5
"""Time-out for a service to be found, and to answer, s: the coupler waits 1 s for the devices."""

REASON_TIME = 3.0
"""Time for which a refused release is requested again, s: the reason may just have vanished."""


@dataclass(frozen=True)
class StopArguments(NamespaceArguments):
    """Arguments of the emergency stop."""

    release: bool = parameter(False, "allow forces again")


@verb(
    "haptic-accel estop", "haptic-accel estop release:=true", "haptic-accel estop namespace:=left"
)
@arguments(StopArguments)
@click.pass_obj
def estop(signalled: Signalled | None, arguments: StopArguments) -> None:
    """Remove all forces from all devices at once; they refuse new ones until release:=true.

    Without a namespace every graph of the ROS domain is stopped, also one of this machine that
    starts later. The release is that of one graph, and refused while somebody still asks for the
    stop.
    """
    domain, namespace = own_domain(), arguments.namespace
    if arguments.release:
        line, silent = "", f"estop {NEEDS_ROS}"  # LeRobot's fast path does not need ROS
        if has_ros():
            from haptic_accel.nodes.emergency_stop import release

            line, missing = _answer(namespace, release, REASON_TIME)
            silent = f"{_silent(missing)}; is the graph running?" if missing else ""
        was_pending = PendingStop(domain, namespace).withdraw()
        if silent and was_pending:
            line = "released for graphs that start; none answers"
        elif silent:
            raise StoppedError(silent)
        print(f"emergency stop {line}")
        return
    # Stop by signals first: ROS is slow to import and to join the graph.
    done = signalled or stop_graphs(domain, namespace)
    reached = "1 process" if done.processes == 1 else f"{done.processes} processes"
    quick = f"{reached} signalled after {done.after:.2f} s, " if done.processes else ""
    again = f" namespace:={namespace.strip('/')}" if namespace else ""
    held = "no graph of ROS domain {} on this machine takes forces until {}{}".format(
        domain, "haptic-accel estop release:=true", again
    )
    pending = f"the stop is pending: {held}" if done.pending else "is the graph running?"
    if not has_ros():
        raise StoppedError(f"{quick}not confirmed: this {NEEDS_ROS}; {pending}")
    try:
        from haptic_accel.nodes.emergency_stop import stop_devices

        line, missing = _answer(namespace, stop_devices, TIMEOUT)
    except Exception as error:  # report the result whatever fails here
        raise StoppedError(f"{quick}not confirmed: {one_line(error)}; {pending}") from None
    if missing:
        raise StoppedError(f"{quick}not confirmed: {_silent(missing)}; {pending}")
    print(f"emergency stop: {line} ({quick}confirmed after {age():.2f} s)")


def _answer(
    namespace: str, request: Callable[..., Any], timeout: float
) -> tuple[str, Collection[str]]:
    """Join a graph until all devices answer a request; return a line, and silent devices."""
    from haptic_accel.cli.joining import connected

    for _ in range(ATTEMPTS):
        with connected(namespace, ANSWERING_TIME, ANSWERING_TIME) as client:
            line, missing = asyncio.run(request(client, timeout))
        if not missing:
            break
    return str(line), missing


def _silent(missing: Collection[str]) -> str:
    return f"{' and '.join(sorted(missing))} did not answer in {ATTEMPTS} attempts"
