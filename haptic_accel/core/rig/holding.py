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

"""Detection of an arm's release by a coupling."""

from __future__ import annotations

import math

PUT_BACK_AFTER = 0.2
"""Time without force and without commands after which an arm returns to its start, s. It is longer
than the coupler takes to release both arms when one stops sending."""


class Holding:
    """Detect the release of an arm from the commands of its motors.

    A coupling with zero force repeats its commands, and thus holds the arm.

    Examples
    --------
    >>> holding = Holding()
    >>> holding.command(free=True)
    >>> holding.ends(0.15), holding.ends(0.15), holding.ends(0.15)
    (False, True, False)
    """

    def __init__(self) -> None:
        self._free = True
        self._silence = math.inf  # not held yet

    def command(self, *, free: bool) -> None:
        """Record a command; `free` if its force is zero."""
        self._free = free
        self._silence = 0.0

    def ends(self, seconds: float) -> bool:
        """Advance to a time; return True, once, when the arm has been released."""
        self._silence += seconds
        if not (self._free and PUT_BACK_AFTER < self._silence < math.inf):
            return False
        self._silence = math.inf
        return True
