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

"""Latest samples of a cause and its measured effect, with gaps."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from haptic_accel.core.model import FloatArray

MOST_MISSING = 0.02
"""Maximum fraction of missing samples in a window; they repeat the previous value."""


class PairedWindow:
    """Buffer of cause and effect that reports when a window can be evaluated.

    Parameters
    ----------
    length : int
        Number of samples.
    hop : int
        Number of samples from one evaluation to the next.
    """

    def __init__(self, length: int, hop: int) -> None:
        self._length, self._hop = length, hop
        # Filled from its end to its beginning, as in `SampleWindow`.
        self._pairs = np.zeros((2, 2 * length))
        self._cause, self._effect = self._pairs
        self._newest = length
        # Missing samples in the present part of the window, and in the parts before.
        self._missing: deque[int] = deque(maxlen=math.ceil(length / hop))
        self.reset()

    def push(self, cause: float, effect: float) -> bool:
        """Add a sample of both; return True if the window is due and complete enough.

        Parameters
        ----------
        cause : float
            Finite.
        effect : float
            NaN or infinite if unknown.
        """
        newest = self._newest - 1
        if newest < 0:
            newest = self._moved()
        if not math.isfinite(effect):
            self._missing[-1] += 1
            effect = self._effect[newest + 1]
        self._newest = newest
        self._cause[newest] = cause
        self._effect[newest] = effect
        self._samples += 1
        if self._samples % self._hop:
            return False
        few = sum(self._missing) <= MOST_MISSING * self._length
        self._missing.append(0)
        return self._samples >= self._length and few

    def latest(self) -> tuple[FloatArray, FloatArray]:
        """Return cause and effect, newest first; views until the next sample."""
        latest = slice(self._newest, self._newest + self._length)
        return self._cause[latest], self._effect[latest]

    def reset(self) -> None:
        """Discard all samples."""
        self._samples = 0
        self._missing.clear()
        self._missing.append(0)
        self._pairs[:] = 0.0
        self._newest = self._length

    def _moved(self) -> int:
        """Move the samples still needed to the end; return the index before them."""
        kept = self._length - 1
        place = self._pairs.shape[1] - kept
        self._pairs[:, place:] = self._pairs[:, :kept]
        return place - 1
