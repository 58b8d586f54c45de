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
"""Gain of a signal that changes without a jump."""

from __future__ import annotations

LARGEST_GAIN = 4.0
"""Maximum gain: two doublings; beyond, strong textures mainly reach the actuator's limits."""

RAMP = 0.05
"""Duration of a change, s: no click is felt, as its spectrum is below 20 Hz."""


class Gain:
    """Gain that changes along a linear ramp.

    Parameters
    ----------
    value : float
        Initial gain.
    rate : float
        Samples per second.

    Attributes
    ----------
    value : float
        Gain of the last sample.

    Examples
    --------
    >>> gain = Gain(1.0, rate=80.0)
    >>> gain.change(0.0)
    >>> [gain.advance() for _ in range(5)]
    [0.75, 0.5, 0.25, 0.0, 0.0]
    """

    def __init__(self, value: float, rate: float) -> None:
        self._length = max(1, round(RAMP * rate))
        self.value = self._target = value
        self._step, self._left = 0.0, 0

    @property
    def is_changing(self) -> bool:
        """True during a ramp."""
        return self._left > 0

    @property
    def is_silent(self) -> bool:
        """True while the gain is zero and stays so."""
        return self.value == self._target == 0.0

    def change(self, target: float) -> None:
        """Begin a ramp to another gain."""
        self._target, self._left = target, self._length
        self._step = (target - self.value) / self._length

    def settle(self) -> None:
        """End a ramp at once."""
        self.value, self._left = self._target, 0

    def advance(self) -> float:
        """Return the gain of the next sample."""
        if self._left:
            self._left -= 1
            self.value = self._target - self._left * self._step
        return self.value
