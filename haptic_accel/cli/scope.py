# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel scope``: a page that shows a running graph."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.cli.options import arguments, verb
from haptic_accel.cli.output import StoppedError
from haptic_accel.cli.running import print_line, stop_on_signal
from haptic_accel.core.parameters import schema
from haptic_accel.core.process import FAILED
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup.node_parameters import ScopeNodeParameters
from haptic_accel.setup.processes import Process
from haptic_accel.setup.setup import SCOPE
from haptic_accel.setup.words import NamespaceArguments


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
