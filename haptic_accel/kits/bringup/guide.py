# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Page that guides a person through the bring-up of a rig."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from haptic_accel import FloatArray, ParameterError
from haptic_accel.core.parameters import shown
from haptic_accel.kits.bringup.bench import NOT_PASSED, PASSED, Watched
from haptic_accel.scope import CommandError, Windows, check_choice

KEPT_LINES = 200
"""Maximum number of lines of a step on a page."""

SHOWN = 0.5
"""Duration of the signal on the page, s."""

MOST_POINTS = 250
"""Maximum number of points of the signal: a plot half a screen wide has hardly more pixels."""

ANSWER = "answer"
"""Action by which a page answers a request."""


class Guide:
    """Person who brings up a rig at a page, and source of the page's content.

    The bring-up calls it on one thread, the page's server on another. Any number of pages show the
    same content; the first answer to a request counts.

    Parameters
    ----------
    steps : mapping
        Purposes of the steps by their names.

    Attributes
    ----------
    windows : Windows
        Signals of a graph; always empty.
    """

    def __init__(self, steps: Mapping[str, str]) -> None:
        self.windows = Windows()
        self._steps = {name.replace("_", " "): purpose for name, purpose in steps.items()}
        self._changed = threading.Condition()
        self._now = 0
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._request: str | None = None
        self._skip = ""
        self._asks = False
        self._number = 0
        self._answer: str | None = None
        self._watched: Watched | None = None
        self._ended: str | None = None

    # Interface of the person, for the bring-up

    def begin(self, number: int, step: str, purpose: str) -> None:
        """Show that a step begins, and remove the lines of the previous step."""
        with self._changed:
            self._now = number
            self._lines.clear()
            self._request = None

    def tell(self, line: str) -> None:
        """Show a line, and end the previous request."""
        with self._changed:
            self._lines.append(line)
            self._request = None

    def show(self, watched: Watched | None) -> None:
        """Show a live signal from now on; None for none."""
        with self._changed:
            self._watched = watched

    def ask(self, request: str, skip: str = "") -> str:
        """Wait for the answer of a page without a time-out, and return it."""
        with self._changed:
            self._number += 1
            self._skip = skip
            self._request, self._asks, self._answer = request, True, None
            self._changed.wait_for(lambda: not self._asks)
            assert self._answer is not None
            return self._answer

    def request(self, line: str) -> None:
        """Ask for an action that is noticed by itself."""
        with self._changed:
            self._request = line

    def end(self, line: str, *, done: bool) -> None:
        """Show the next command, or the reason for a failure, until a page closes the bring-up."""
        with self._changed:
            self._ended = line
            self._watched = None
            if done:
                self._now = len(self._steps) + 1
        self.ask(line)

    # Interface of the source, for the page's server

    def choices(self) -> dict[str, list[str]]:
        """Return the actions of the page; an answer is any text."""
        return {ANSWER: []}

    def state(self) -> dict[str, Any]:
        """Return the state for a page; called on the server's thread."""
        with self._changed:
            watched = self._watched
            state = {
                "steps": [
                    {"name": name, "purpose": purpose, "state": self._state_of(number)}
                    for number, (name, purpose) in enumerate(self._steps.items(), start=1)
                ],
                "lines": [{"kind": _kind(line), "text": line} for line in self._lines],
                "request": self._request,
                "asks": self._asks,
                "number": self._number,
                "skip": self._skip if self._asks and self._skip else None,
                "ended": self._ended,
            }
        return state | {"signal": _signal(watched) if watched else None}

    def scene(self) -> dict[str, Any]:
        """Refuse to return a scene: a bring-up has none.

        Raises
        ------
        ParameterError
        """
        raise ParameterError("scene: a bring-up has none")

    def lead(self, x: float, z: float) -> str:
        """Refuse to lead a hand: a bring-up has no simulated hand."""
        return "hand: a bring-up leads none"

    async def act(self, action: str, value: Any) -> str:
        """Take a page's answer, ``NUMBER:TEXT`` with the number of the request; return nothing.

        Raises
        ------
        CommandError
            The action is unknown, or the request is not pending.
        """
        check_choice("action", action, self.choices())
        number, colon, text = value.partition(":") if isinstance(value, str) else ("", "", "")
        if not colon:
            raise CommandError(f"{ANSWER} = {shown(str(value))}: must be NUMBER:TEXT", 400)
        with self._changed:
            if not self._asks or number != str(self._number):
                raise CommandError(f"request {shown(number)}: is answered, or was never made")
            self._answer = text
            self._request, self._asks = None, False
            self._changed.notify_all()
        return ""

    def _state_of(self, number: int) -> str:
        if number == self._now:
            return "now"
        return "done" if number < self._now else "waiting"


def _kind(line: str) -> str:
    """Return the kind of a line: ok, failed or plain."""
    if line.startswith(PASSED):
        return "ok"
    return "failed" if line.startswith(NOT_PASSED) else "plain"


def _signal(watched: Watched) -> dict[str, Any]:
    """Return the newest part of a signal, ready for JSON."""
    seen = watched.last(SHOWN)
    return {
        "rate": seen.rate,
        "acceleration": _thinned(seen.acceleration).tolist(),
        "missing": int(np.isnan(seen.acceleration).sum()),
    }


def _thinned(signal: FloatArray) -> FloatArray:
    """Return at most `MOST_POINTS` of a signal, with the minimum and maximum of each part."""
    if len(signal) <= MOST_POINTS:
        return signal
    size = -(-len(signal) // (MOST_POINTS // 2))
    rows = np.pad(signal, (0, -len(signal) % size), constant_values=np.nan).reshape(-1, size)
    return np.column_stack([np.fmin.reduce(rows, 1), np.fmax.reduce(rows, 1)]).ravel()
