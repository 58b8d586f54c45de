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

"""Real-time loop of emulators."""

from __future__ import annotations

import select
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Protocol

from haptic_accel.emulators.pseudo_terminal import PseudoTerminal


class Part(Protocol):
    """Part of an emulator; times are s since its start."""

    due: float
    """Time of the next step."""

    @property
    def terminals(self) -> Sequence[PseudoTerminal]:
        """Ports whose received bytes make a step due at once."""

    def step(self, now: float) -> None:
        """Execute everything due at a time; may also be called earlier."""


def run(parts: Sequence[Part], ended: Callable[[], bool]) -> None:
    """Step all parts whenever one is due or has received bytes, until `ended`."""
    start = monotonic()
    while not ended():
        terminals = [terminal for part in parts for terminal in part.terminals]
        due = min(part.due for part in parts)
        select.select(terminals, [], [], max(0.0, due - (monotonic() - start)))
        now = monotonic() - start
        for part in parts:
            part.step(now)
