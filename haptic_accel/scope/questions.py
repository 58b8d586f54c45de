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

"""Questions to the pages of a server, each answered once, however often an answer is sent."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable, Collection
from concurrent.futures import Future
from threading import Condition
from typing import Generic, TypeVar

from haptic_accel.core.parameters import shown
from haptic_accel.scope.server import CommandError, check_choice

A = TypeVar("A")

HANDLING_TIME = 3.0
"""Longest time from an answer until the next question, s; then the page has to send it again."""

EVENT_POLL_PERIOD = 0.2
"""Interval between two looks at other events while a question waits for its answer, s."""


class Questions(Generic[A]):
    """Questions one after the other; the first answer of each counts.

    One thread asks, the server's thread takes answers. An answer is acknowledged when the next
    question comes, hence after it has been handled and stored; a page that hears nothing sends it
    again, also after the server was restarted.

    Attributes
    ----------
    changed : Condition
        Held for access to the present question; notified of answers.
    answer : A or None
        Answer of the present question.
    """

    def __init__(self) -> None:
        self.changed = Condition()
        self.answer: A | None = None
        self._run, self._count = secrets.token_hex(4), 0
        self._choices: Collection[str] = ()
        self._handled: Future[None] = Future()
        self._answered: set[str] = set()

    @property
    def id(self) -> str:
        """Name of the present question, different for each question of each server."""
        return f"{self._run}-{self._count}"

    def put(self, choices: Collection[str]) -> None:
        """Begin the next question, with its answers; the answer before it has been handled."""
        with self.changed:
            if not self._handled.done():
                self._handled.set_result(None)
            self._handled = Future()
            self._count += 1
            self.answer, self._choices = None, choices

    def wait(self, reached: Callable[[], bool]) -> None:
        """Wait until a condition is met."""
        with self.changed:
            while not reached():
                self.changed.wait(EVENT_POLL_PERIOD)

    async def take(self, question: str, choice: str, answer: A) -> None:
        """Take the answer of a page, and return when it is handled.

        Raises
        ------
        CommandError
            The question is not asked, the choice is none of its own, or it is not handled in time.
        """
        with self.changed:
            handled = self._handled
            current = question == self.id
            if question not in self._answered:
                if not current:
                    raise CommandError(f"question {shown(question)}: is not asked now", 400)
                check_choice("answer", choice, self._choices)
                self.answer = answer
                self._answered.add(question)
                self.changed.notify_all()
        if not current:
            return
        try:
            # Another attempt waits for the same.
            waiting = asyncio.shield(asyncio.wrap_future(handled))
            await asyncio.wait_for(waiting, HANDLING_TIME)
        except asyncio.TimeoutError:
            raise CommandError(f"answer {shown(choice)}: is not handled yet") from None
