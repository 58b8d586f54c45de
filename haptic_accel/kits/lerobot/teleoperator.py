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

"""Leader arm whose handle lets feel the follower's gripper."""

from __future__ import annotations

from typing import Any

from haptic_accel.kits.lerobot.fast_path import FastPath
from haptic_accel.kits.lerobot.interface import Leader
from haptic_accel.kits.lerobot.wrapping import Wrapping


class FeltTeleoperator(Wrapping[Leader]):
    """Teleoperator of LeRobot with a coil in its handle; to be joined with LeRobot's base class.

    The coil moves while it is connected, and is silent before and after. If the fast path ends
    meanwhile, the arm goes on.

    Parameters
    ----------
    wrapped : Leader
    arguments : str
        See `Wrapping`.
    """

    @property
    def feedback_features(self) -> dict[str, Any]:
        """Keys and types of the leader's feedback."""
        return self.wrapped.feedback_features

    def connect(self, calibrate: bool = True) -> None:
        """Connect, see `Wrapping.connect`; then let the coil move."""
        super().connect(calibrate)
        assert self._path
        self._path.feel(True)

    def get_action(self) -> dict[str, Any]:
        """Return the leader's action."""
        self._tell_problem()
        return self.wrapped.get_action()

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Pass feedback on to the leader."""
        self.wrapped.send_feedback(feedback)

    def _silence(self, path: FastPath) -> None:
        path.feel(False)
