# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Page of a participant, which shows the screens of a session and receives the answers.

The session calls the page on one thread, the page's server on another.
"""

from __future__ import annotations

import asyncio
import json
import math
import secrets
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Future
from dataclasses import asdict
from pathlib import Path
from threading import Condition
from typing import Any, Generic, Protocol, TypeVar

from haptic_accel.core.document import read_yaml_document
from haptic_accel.core.parameters import shown
from haptic_accel.kits.study import trials
from haptic_accel.kits.study.trials import Answer, Screen, StoppedError, UndeliveredError
from haptic_accel.materials import config_folder
from haptic_accel.scope import LOCAL_HOST, Access, CommandError, ScopeServer, Touched, check_choice

A = TypeVar("A")

HANDLING_TIME = 3.0
"""Longest time from an answer until the next question, s; after that the page must send the answer
again."""

EVENT_POLL_PERIOD = 0.2
"""Interval between checks for other events while a question waits for its answer, s."""


class Questions(Generic[A]):
    """Successive questions; the first answer to each counts.

    One thread asks; the server's thread receives answers. An answer is acknowledged with the next
    question, hence after it has been processed and stored. Without an acknowledgement the page
    sends it again, even after a restart of the server.

    Attributes
    ----------
    changed : Condition
        Held for access to the present question; notified of answers.
    answer : A or None
        Answer to the present question.
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
        """Start the next question with its choices, which acknowledges the previous answer."""
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
        """Accept the answer of a page; return once it is processed.

        Raises
        ------
        CommandError
            The question is not pending, the choice is not allowed, or processing takes too long.
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
            # Repeated attempts wait for the same future.
            waiting = asyncio.shield(asyncio.wrap_future(handled))
            await asyncio.wait_for(waiting, HANDLING_TIME)
        except asyncio.TimeoutError:
            raise CommandError(f"answer {shown(choice)}: is not handled yet") from None


STIMULUS, OVER = "stimulus", ("stopped", "end")
"""Kinds of screens: the one that must be seen, and those that may follow a stop."""

UNSEEN = 1.5
"""Longest time without a sign of life from the page during a stimulus, s; pages send four per
second, or one per second if the browser saves power."""

CLOCKS, PACES = 1.0, 0.01
"""Time, s, and fraction by which a response time by the page's clock may exceed the question's
duration by this machine's clock."""

ACTIONS: dict[str, list[str]] = {"open": [], "seen": [], "answer": [], "stop": []}
"""Actions of the page; their values are JSON lists."""


class PageSource(Touched, Protocol):
    """Interface of the rig for the page; its methods are called on the server's thread."""

    @property
    def has_pointer(self) -> bool:
        """True if the page leads a simulated hand, and plays the handle's vibration."""

    def stop(self) -> None:
        """Set all forces to zero."""


def read_texts(language: str, beside: Path = Path()) -> dict[str, str]:
    """Return the texts of the page in a language.

    Parameters
    ----------
    language : str
        Name of a file in ``config/studies/languages``, or a path ending in ``.yaml``.
    beside : Path
        Folder for relative paths.

    Raises
    ------
    ParameterError
        The file does not exist, lacks a text or has an unknown one.
    """
    folder = config_folder() / "studies" / "languages"
    own = language.endswith(".yaml")
    document = read_yaml_document(beside / language if own else folder / f"{language}.yaml")
    words = read_yaml_document(folder / "en.yaml").mapping()
    document.check_keys(*words)
    return {word: document.at(word).text() for word in words}


class ParticipantPage:
    """Participant at a page, and source of the page's content.

    The page opened last is the participant's; others are silent. An answer is acknowledged when
    the session shows its next screen, because it must be logged before.

    Parameters
    ----------
    texts : mapping
        Texts of the page, from `read_texts`.
    source : PageSource
    port : int
        Port of the page; 0 for any free port.
    noise : float
        Level of the masking noise, dB of full scale; -100 for none.

    Attributes
    ----------
    windows : Windows
        Signals of the rig.
    noise : float or None
        Level of the noise that the page reported at its last sign of life during a stimulus.
    """

    def __init__(
        self, texts: Mapping[str, str], source: PageSource, port: int = 0, noise: float = -100.0
    ) -> None:
        self.windows = source.windows
        self.noise: float | None = None
        self._source, self._noise = source, noise if noise > -100.0 else None
        self._server = ScopeServer(
            self, Access(LOCAL_HOST), LOCAL_HOST, port, self._act, "study", texts
        )
        self._questions = Questions[Answer]()
        self._screen, self._begun = Screen("", "wait"), time.monotonic()
        self._page = self._stopped = ""
        self._sign: float | None = None
        self._missed = False

    def start(self) -> str:
        """Serve the page; return its address. See `ScopeServer.start`."""
        return self._server.start()

    def close(self) -> None:
        """Release the address of the page."""
        self._server.stop()

    def stop(self, reason: str) -> None:
        """Stop the session, from any thread or from a signal's handler."""
        self._stopped = self._stopped or reason

    # Interface of the participant, for the session

    def show(self, screen: Screen) -> None:
        """Show a screen; return at once or, for a stimulus, once a page shows it.

        Raises
        ------
        StoppedError
            The participant has pressed stop, or `stop` was called.
        UndeliveredError
            The page was lost during the previous stimulus.
        """
        self._put(screen)
        if screen.kind == STIMULUS:
            self._questions.wait(lambda: bool(self._sign or self._stopped))
            self._check_stop()

    def ask(self, screen: Screen, trial: trials.PlannedTrial | None = None) -> Answer:
        """Show a screen, and return one of its answers; raise as `show` does."""
        self._put(screen)
        self._questions.wait(lambda: bool(self._questions.answer or self._stopped))
        self._check_stop()
        assert self._questions.answer is not None
        return self._questions.answer

    def _put(self, screen: Screen) -> None:
        if screen.kind not in OVER:
            self._check_stop()
        with self._questions.changed:
            missed = screen.kind not in OVER and self._misses()
            self._screen = Screen("", "wait", progress=screen.progress) if missed else screen
            self._questions.put(self._screen.answers)
            self._begun = time.monotonic()
            self._sign, self._missed = None, False
        if missed:
            raise UndeliveredError("the participant's page was lost during a stimulus")

    def _check_stop(self) -> None:
        if self._stopped:
            raise StoppedError(self._stopped)

    def _misses(self) -> bool:
        """Return True if the page's signs of life have stopped."""
        late = self._sign is not None and time.monotonic() - self._sign > UNSEEN
        self._missed = self._missed or late
        return self._missed

    # Interface of the source, for the page's server

    def choices(self) -> dict[str, list[str]]:
        """Return the actions of the page."""
        return ACTIONS

    def state(self) -> dict[str, Any]:
        """Return the screen, without information on conditions."""
        with self._questions.changed:
            screen, identity = asdict(self._screen), self._questions.id
            elapsed = time.monotonic() - self._begun
        screen |= {"id": identity, "elapsed": elapsed}
        led = self._source.has_pointer
        return {"page": self._page, "noise": self._noise, "led": led, "screen": screen}

    def scene(self) -> dict[str, Any]:
        """Return the scene without names and textures of its objects."""
        scene = self._source.scene()
        lines = [line for outline in scene["outlines"].values() for line in outline]
        return {**scene, "outlines": {"": lines}, "nodes": {}}

    def lead(self, x: float, z: float) -> str:
        """Lead the hand to a point, m; return the reason if refused."""
        return self._source.lead(x, z)

    async def _act(self, action: str, value: Any) -> str:
        """Execute an action of the page; return an empty text.

        Raises
        ------
        CommandError
            The action, its value or the answer is not allowed.
        """
        check_choice("action", action, ACTIONS)
        if action == "stop":
            self.stop("stopped by the participant")
            await asyncio.to_thread(self._source.stop)
            return ""
        try:
            await getattr(self, f"_{action}")(*json.loads(value))
        except (TypeError, ValueError, OverflowError, RecursionError):
            raise CommandError(f"{action} = {shown(str(value))}: must be its list", 400) from None
        return ""

    async def _open(self, page: str) -> None:
        self._page = str(page)

    async def _seen(self, screen: str, noise: float | None) -> None:
        """Record a sign that the page shows a stimulus, with the level of its noise, dB."""
        with self._questions.changed:
            if screen == self._questions.id and noise == self._noise:
                self._misses()
                self._sign, self.noise = time.monotonic(), noise
                self._questions.changed.notify_all()

    async def _answer(self, screen: str, value: str, seconds: float) -> None:
        """Accept an answer with its response time, s, at most the question's duration."""
        with self._questions.changed:
            asked = screen == self._questions.id
            longest = (time.monotonic() - self._begun) * (1 + PACES) + CLOCKS
        if isinstance(seconds, bool) or not 0 <= seconds < (longest if asked else math.inf):
            allowed = f"must be from 0 to {longest:.3g} s, as long as the question is there"
            raise CommandError(f"response time = {shown(str(seconds))}: {allowed}", 400)
        await self._questions.take(screen, value, Answer(value, float(seconds)))
