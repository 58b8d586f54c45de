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

"""Lowest error that any filter could have for the input of the latest seconds."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress

from haptic_accel.core.parameters import ParameterError

PERIOD = 2.0
"""Shortest time to the first computation and between two, s: the length of the inputs."""

SHARE = 0.05
"""Part of a core that the computations may take: one takes 0.15 s at 1 kHz, and longer at a higher
rate."""

LOWEST_CORNER = 0.1
"""Corner of a high-pass that removes nothing of the desired acceleration, Hz: it has passed the
compensator's already."""

_beside = ThreadPoolExecutor(1, "lowest error")  # the page's server must not wait


class LowestError:
    """Lowest error for one input that goes on, computed now and then on a thread of its own."""

    def __init__(self) -> None:
        self._computed: Future[tuple[float | None, float]] | None = None
        self._value: float | None = None
        self._due = time.monotonic() + PERIOD

    def follow(self, bound: Callable[[], float]) -> float | None:
        """Return the last result; if it is time, have that of the latest input computed.

        Parameters
        ----------
        bound : callable
            Returns `limited_bound` of the latest input, %, or raises ValueError.

        Returns
        -------
        float or None
            Percent, as `Evaluation.nrmse_percent`; None if there is none yet.
        """
        if self._computed and self._computed.done():
            self._value, taken = self._computed.result()
            self._due = time.monotonic() + max(PERIOD, taken / SHARE)
            self._computed = None
        if self._computed is None and time.monotonic() >= self._due:
            self._computed = _beside.submit(_timed, bound)
        return self._value


def _timed(bound: Callable[[], float]) -> tuple[float | None, float]:
    """Return the bound, percent, and the CPU time that it took, s."""
    begun = time.thread_time()
    found = None
    with suppress(ParameterError, ValueError):  # an input that is not finite, or too short
        found = bound()
    return found, time.thread_time() - begun
