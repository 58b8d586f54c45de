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

"""Listening to a handle under a hushed force, for what moves it all the same."""

from __future__ import annotations

HUSHED, HUSHED_FOR = 0.1, 0.3
"""Factor of a reduced force while the handle is listened to, and for how long, s. Of what the
force causes, 1 % remains by power; a mode at 60 Hz with a damping ratio of 0.02 rings 0.1 s."""

HEARING = 0.15
"""Part of that time, its end, in which the noise is measured, s."""

HUSHED_EVERY, HUSHED_RARELY, SETTLED_FOR = 1.5, 12.0, 0.3
"""Shortest and longest time from one listening to the next, and from a fall of the fraction to the
first, s of excitation. The time doubles where the noise is `MINOR`."""

MINOR = 0.25
"""Noise that hardly hides a force, relative to the accepted increase of the error's power."""


class Listening:
    """Times at which a reduced force of no use is hushed, and what is heard then.

    Attributes
    ----------
    heard : float
        Power of what moved the handle at the last listening, (m/s^2)^2; 0 before the first.
    """

    def __init__(self) -> None:
        self.heard = 0.0
        # Time since the last listening began, and from then to the next, s.
        self._since = self._next = HUSHED_EVERY
        self._energy = 0.0  # heard in this one, (m/s^2)^2 s

    @property
    def hushes(self) -> bool:
        """True while the force is hushed."""
        return self._since < HUSHED_FOR

    @property
    def is_due(self) -> bool:
        """True from the time of the next listening on."""
        return self._since >= self._next

    def wait(self, time: float) -> None:
        """Count the time of excitation without listening, s."""
        self._since += time

    def postpone(self) -> None:
        """Wait until what a force that falls has excited no longer rings."""
        self._since = min(self._since, self._next - SETTLED_FOR)

    def begin(self) -> None:
        """Hush the force from now on."""
        self._since = self._energy = 0.0

    def hear(self, power: float, time: float, minor: float) -> None:
        """Take a block of the handle's motion into account.

        Parameters
        ----------
        power : float
            (m/s^2)^2.
        time : float
            Duration of the block, s.
        minor : float
            Power below which the noise hides nothing, (m/s^2)^2.
        """
        if self._since >= HUSHED_FOR - HEARING:
            self._energy += power * time
        self._since += time
        if not self.hushes:
            self.heard = self._energy / HEARING
            is_minor = self.heard < minor
            self._next = min(2.0 * self._next, HUSHED_RARELY) if is_minor else HUSHED_EVERY
