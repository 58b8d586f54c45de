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

"""Follower arm whose observation has the vibration of its gripper."""

from __future__ import annotations

from typing import Any

import numpy as np

from haptic_accel.core.axes import VIBRATION
from haptic_accel.core.model import FloatArray
from haptic_accel.kits.lerobot.fast_path import samples_per_frame, tool_axes
from haptic_accel.kits.lerobot.wrapping import WrappedRobot, Wrapping

VALID = f"{VIBRATION}.valid"
"""Key of an observation: 1 if the vibration was measured, 0 if the fast path has failed."""


class VibrationRobot(Wrapping, WrappedRobot):
    """Robot of LeRobot that also observes vibration, to be joined with LeRobot's base class.

    LeRobot's programs take numbers, which become ``observation.state``, and images, but no other
    arrays. So each sample of the window has a key of its own; `vibration` is the same as an array.

    Parameters
    ----------
    wrapped
        Robot of LeRobot.
    arguments : str
        See `Wrapping`; the same as the leader's.
    fps : int
        Frames per second of LeRobot's loop or dataset.

    Raises
    ------
    ParameterError
        An argument is not allowed, or the rate is no whole multiple of `fps`.
    """

    def __init__(self, wrapped: Any, arguments: str, fps: int) -> None:
        super().__init__(wrapped, arguments)
        self._size = samples_per_frame(self._arguments.rate, fps)
        self._axes = tool_axes(self._arguments)
        self._keys = self._axes.sample_names(self._size)

    @property
    def cameras(self) -> Any:
        """Cameras of the follower; empty if it has none."""
        return getattr(self.wrapped, "cameras", {})

    @property
    def observation_features(self) -> dict[str, Any]:
        """Keys and types of the follower's observation, and of the vibration, oldest first."""
        return {**self.wrapped.observation_features, **dict.fromkeys([*self._keys, VALID], float)}

    def vibration(self) -> FloatArray:
        """Return the gripper's acceleration in the frame before now.

        Returns
        -------
        ndarray, shape (n, axes)
            Acceleration, m/s^2, the newest last, at the fast path's rate; zero if that has failed,
            which is logged once: not a number would move an arm whose policy reads it.
        """
        return self._measured()[0]

    def _measured(self) -> tuple[FloatArray, bool]:
        """Return the vibration, and whether it is one."""
        self.tell_problem()
        found = self._path.window(self._size) if self._path else None
        samples = np.zeros((self._size, 3)) if found is None else found
        return samples[:, self._axes.indices], found is not None

    def get_observation(self) -> dict[str, Any]:
        """Return the follower's observation, and the vibration of the frame before the call."""
        felt, is_valid = self._measured()  # first, as cameras may be waited for
        observed = self.wrapped.get_observation()
        values = [*felt.T.ravel().tolist(), float(is_valid)]
        return {**observed, **dict(zip([*self._keys, VALID], values, strict=True))}
