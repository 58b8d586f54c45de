# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Parameters of other nodes that the live scope shows."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import ParameterEvent, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from haptic_accel.core.parameters import ParameterError, checked, shown
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.setup.node_parameters import node_schema

LONGEST_TEXT = 1000
"""Maximum length of a parameter's text, characters; no path is as long."""

ANSWERING_TIME = 3.0
"""Time in which a node answers, s. A request may have gone to a node that was killed: its service
is found for up to 20 s, also while a new node of its name is there."""

Given = Iterable[tuple[str, ParameterValue]]


class RemoteParameters:
    """Current values of some parameters of another node.

    Anyone may publish an event in the name of a node. An event is therefore shown at once, but
    the node itself is asked afterwards.

    Parameters
    ----------
    node : GraphNode
        Node that follows the parameters.
    name : str
        Name of the other node, in the same namespace, and of its executable.
    asked : tuple of str
        Names of its parameters.
    changed : callable
        Called after any value has changed.
    refuse : callable
        Called with a line for each value that the parameter cannot have.
    """

    def __init__(
        self,
        node: GraphNode,
        name: str,
        asked: tuple[str, ...],
        changed: Callable[[], None],
        refuse: Callable[[str], None],
    ) -> None:
        self._name = name
        self._asked = asked
        self._changed = changed
        self._refuse = refuse
        self._client = node.create_client(GetParameters, f"{name}/get_parameters")
        self._found = False
        self._answer: Future | None = None  # to the request of the present values
        self._due = 0.0
        self.path = f"{node.get_namespace().rstrip('/')}/{name}"
        """Full name of the other node."""
        self.values: Mapping[str, Any] = {}

    def refresh(self) -> None:
        """Request parameters of a new, changed or silent node; discard those of a lost node."""
        if not self._client.service_is_ready():
            if self._found:  # otherwise the node is new, and told its values
                self._found, self._answer = False, None
                self.values = {}
        elif self._answer is None or self._is_overdue(self._answer):
            self._found = True
            self._answer = self._client.call_async(GetParameters.Request(names=list(self._asked)))
            self._answer.add_done_callback(lambda answer: self._receive_answer(answer.result()))
            self._due = time.monotonic() + ANSWERING_TIME

    def _is_overdue(self, answer: Future) -> bool:
        """Drop a request that has been without an answer for too long, and return true."""
        overdue = not answer.done() and time.monotonic() > self._due
        if overdue:
            self._client.remove_pending_request(answer)
        return overdue

    def forget(self) -> None:
        """Discard all values, of a node that has ended."""
        self._found, self._answer = False, None
        self._apply(dict.fromkeys(self.values), [])

    def receive(self, event: ParameterEvent) -> None:
        """Read the values that the node publishes at its start and after a change."""
        given = [(p.name, p.value) for p in (*event.new_parameters, *event.changed_parameters)]
        known, refused = admitted(self._name, self._asked, given)
        if known or refused:
            self._answer = None
            self._apply(known, refused)

    def _receive_answer(self, answer: GetParameters.Response) -> None:
        given = zip(self._asked, answer.values, strict=False)
        known, refused = admitted(self._name, self._asked, given)
        # A node of another version may have values that mean nothing here.
        self._apply({**dict.fromkeys(self._asked), **known}, refused)

    def _apply(self, known: Mapping[str, Any], refused: list[str]) -> None:
        for reason in refused:
            self._refuse(reason)
        before, self.values = self.values, {**self.values, **known}
        if self.values != before:
            self._changed()


def admitted(
    executable: str, asked: Iterable[str], given: Given
) -> tuple[dict[str, Any], list[str]]:
    """Return requested parameters with valid values, and reasons to refuse the others.

    Parameters
    ----------
    executable : str
        Name of the node's executable.
    asked : iterable of str
        Names of the parameters that are looked at.
    given : iterable of tuple
        Names and values from outside.

    Returns
    -------
    tuple
        Values by name, and a line for each value that is refused.
    """
    schema = node_schema(executable)
    known: dict[str, Any] = {}
    refused = []
    for name, message in given:
        if name not in asked:
            continue
        try:
            value = parameter_value_to_python(message)
            if value is not None:  # unknown to the node
                known[name] = _checked(name, value, *schema[name])
        except (ParameterError, RuntimeError) as error:  # the latter for no type of ROS
            refused.append(f"{executable}: {name}: {shown(str(error))}")
    return known, refused


def _checked(name: str, value: Any, default: Any, specification: Any) -> Any:
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        raise ParameterError(f"{len(value)} characters: at most {LONGEST_TEXT} are allowed")
    return checked(name, value, default, specification)
