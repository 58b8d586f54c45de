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

"""Leader arm in whose handle the follower's gripper is felt."""

from __future__ import annotations

from typing import Any

from haptic_accel.kits.lerobot.wrapping import WrappedTeleoperator, Wrapping


class FeltTeleoperator(Wrapping, WrappedTeleoperator):
    """Teleoperator of LeRobot with a coil in its handle, to be joined with LeRobot's base class.

    The coil moves while actions are asked for. If the fast path ends meanwhile, the arm goes on.
    Parameters as for `Wrapping`.
    """

    def get_action(self) -> dict[str, Any]:
        """Return the leader's action, and let the coil move until the next."""
        self.tell_problem()
        if self._path:
            self._path.feel()
        action: dict[str, Any] = self.wrapped.get_action()
        return action
