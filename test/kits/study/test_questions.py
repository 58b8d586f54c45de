# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Questions to pages: each is answered once, and acknowledged when it has been handled."""

from __future__ import annotations

import asyncio

import pytest

from haptic_accel.kits.study import participant_page
from haptic_accel.kits.study.participant_page import Questions
from haptic_accel.scope.server import CommandError


def test_an_answer_is_acknowledged_when_the_next_question_comes() -> None:
    async def run() -> None:
        asked = Questions[str]()
        asked.put(("a", "b"))
        takes = [asked.take(asked.id, choice, choice) for choice in ("a", "b")]
        attempts = [asyncio.create_task(take) for take in takes]
        await asyncio.sleep(0.1)
        assert not any(each.done() for each in attempts)
        assert asked.answer == "a", "the first counts"
        first = asked.id
        asked.put(())
        await asyncio.gather(*attempts)
        await asked.take(first, "a", "a")  # another attempt, which comes late
        assert asked.answer is None

    asyncio.run(run())


def test_an_attempt_that_was_given_up_does_not_harm_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(participant_page, "HANDLING_TIME", 0.05)

    async def run() -> None:
        asked = Questions[str]()
        asked.put(("a",))
        with pytest.raises(CommandError, match="answer a: is not handled yet") as told:
            await asked.take(asked.id, "a", "a")
        assert told.value.status == 503, "the page sends it again"
        again = asyncio.create_task(asked.take(asked.id, "a", "a"))
        await asyncio.sleep(0.01)
        asked.put(())
        await again

    asyncio.run(run())


@pytest.mark.parametrize(
    ("choice", "problem"),
    [("c", "answer = 'c': must be one of a, b"), (3, "answer = 3: must be one of a, b")],
)
def test_an_answer_that_is_no_choice_is_refused_and_the_question_stays(
    choice: str, problem: str
) -> None:
    async def run() -> None:
        asked = Questions[str]()
        asked.put(("a", "b"))
        with pytest.raises(CommandError) as told:
            await asked.take(asked.id, choice, choice)
        assert (str(told.value), told.value.status) == (problem, 400)
        assert asked.answer is None

    asyncio.run(run())


def test_a_question_of_another_server_is_none_of_this() -> None:
    async def run() -> None:
        before, asked = Questions[str](), Questions[str]()
        for each in (before, asked):
            each.put(("a",))
        with pytest.raises(CommandError, match="is not asked now"):
            await asked.take(before.id, "a", "a")

    asyncio.run(run())
