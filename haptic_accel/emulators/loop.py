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
    def terminal(self) -> PseudoTerminal | None:
        """Port whose bytes make a step due at once; None for none."""

    def step(self, now: float) -> None:
        """Do all that is due at a time; also called earlier."""


def run(parts: Sequence[Part], ended: Callable[[], bool]) -> None:
    """Step all parts whenever one is due or has received bytes, until `ended`."""
    start = monotonic()
    while not ended():
        terminals = [part.terminal for part in parts if part.terminal]
        due = min(part.due for part in parts)
        select.select(terminals, [], [], max(0.0, due - (monotonic() - start)))
        now = monotonic() - start
        for part in parts:
            part.step(now)
