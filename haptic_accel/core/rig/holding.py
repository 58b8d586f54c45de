# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of the moment at which a coupling lets an arm go."""

from __future__ import annotations

import math

PUT_BACK_AFTER = 0.2
"""Time without force and without a command after which an arm is put back to its start, s: longer
than the coupler takes to release both arms when one falls silent."""


class Holding:
    """Follows the commands of an arm's motors until the arm has been let go.

    A coupling whose force is zero commands it over and over, and so holds the arm.

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
        """Note a command; `free` if it leaves the arm without force."""
        self._free = free
        self._silence = 0.0

    def ends(self, seconds: float) -> bool:
        """Advance to a time; return True, once, when the arm has been released."""
        self._silence += seconds
        if not (self._free and PUT_BACK_AFTER < self._silence < math.inf):
            return False
        self._silence = math.inf
        return True
