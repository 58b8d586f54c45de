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

"""Managed node (lifecycle node of ROS 2) on this package's base."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.lifecycle import LifecycleNodeMixin

from haptic_accel.core.parameters import shown

UNCONFIGURED, INACTIVE, ACTIVE = "unconfigured", "inactive", "active"
"""Stable states of a managed node, by ROS' names."""

SERVICES = {
    "change_state": ChangeState,
    "get_state": GetState,
    "get_available_states": GetAvailableStates,
    "get_available_transitions": GetAvailableTransitions,
    "get_transition_graph": GetAvailableTransitions,
}
"""Types of a managed node's services by name."""


class Managed(LifecycleNodeMixin):
    """The states and services of ROS 2's lifecycle, for a graph node that has it as a base.

    It makes the services of rclpy's node itself: the queue of rclpy's own is short, and what it
    drops gets no answer.
    """

    def begin_lifecycle(self) -> None:
        """Make the services, once the node is made."""
        LifecycleNodeMixin.__init__(self, enable_communication_interface=False)
        for name, kind in SERVICES.items():
            callback = getattr(self, f"_LifecycleNodeMixin__on_{name}")
            if kind is ChangeState:
                self._unguarded, callback = callback, self._serve_transition
            self.create_service(kind, f"~/{name}", callback)

    @property
    def state(self) -> str:
        """Name of the current state."""
        return str(self._state_machine.current_state[1])

    def destroy_node(self) -> None:
        """Destroy the node and its state machine.

        rclpy would keep the state machine, and thus the middleware, until the process ends: the
        middleware's threads would then use libraries that are being unloaded.
        """
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def _serve_transition(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> Any:
        """Change the state as requested; rclpy would end the node for an impossible transition."""
        # By name or, without a name, by number.
        possible = {name: n for n, name, *_ in self._state_machine.available_transitions}
        requested = request.transition
        if requested.label in possible if requested.label else requested.id in possible.values():
            return self._unguarded(request, response)
        self.get_logger().warning(
            f"transition {shown(requested.label) or requested.id}: refused in state {self.state};"
            f" allowed: {', '.join(possible)}"
        )
        response.success = False
        return response
