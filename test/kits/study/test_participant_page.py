# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A participant's page as the session and the browser use it; in a browser: test_page.py."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path
from typing import Any

import pytest
from kits.study.participating import ENGLISH, PageRig

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.participant_page import ParticipantPage, read_texts
from haptic_accel.kits.study.trials import Screen, StoppedError
from haptic_accel.scope.server import CommandError

SURFACES = Screen("q", "question", "Which?", ("surface=text", "surface=wood gain=0.5"))


@pytest.fixture
def page() -> ParticipantPage:
    return ParticipantPage(ENGLISH, PageRig())


def send(page: ParticipantPage, action: str, *value: Any) -> None:
    asyncio.run(page._act(action, json.dumps(value)))


@pytest.mark.parametrize("value", ["no JSON", "3", "[]", '["a", "b", "c"]', "null", None, True])
def test_what_is_no_answer_is_refused_in_one_line(page: ParticipantPage, value: Any) -> None:
    page.show(Screen("", "question", "", ("1", "2")))
    with pytest.raises(CommandError) as told:
        asyncio.run(page._act("answer", value))
    assert told.value.status == 400
    assert "\n" not in str(told.value)


TIMES = ["NaN", "Infinity", "-Infinity", "-0.001", "1e999", "1" + "0" * 400, "60", "true"]


@pytest.mark.parametrize("seconds", TIMES)
def test_a_response_time_that_cannot_be_is_refused(page: ParticipantPage, seconds: str) -> None:
    page.show(Screen("", "question", "", ("1", "2")))
    identity = page.state()["screen"]["id"]
    with pytest.raises(CommandError, match="must be") as told:
        asyncio.run(page._act("answer", f'["{identity}", "1", {seconds}]'))
    assert told.value.status == 400
    assert "\n" not in str(told.value)
    assert page._questions.answer is None


def test_a_stop_reaches_the_session_and_the_rig_once_and_for_all() -> None:
    rig = PageRig()
    page = ParticipantPage(ENGLISH, rig)
    found: list[str] = []

    def session() -> None:
        try:
            page.ask(SURFACES)
        except StoppedError as stopped:
            found.append(str(stopped))

    thread = threading.Thread(target=session)
    thread.start()
    send(page, "stop")
    thread.join(10.0)
    assert found == ["stopped by the participant"]
    assert rig.stops == 1
    with pytest.raises(StoppedError):
        page.show(Screen("", "wait"))
    page.show(Screen("", "stopped"))
    assert page.state()["screen"]["kind"] == "stopped"


def test_a_sign_without_the_noise_does_not_count() -> None:
    page = ParticipantPage(ENGLISH, PageRig(), noise=-20.0)
    shown = threading.Event()
    stimulus = Screen("", "stimulus", interval=1)
    thread = threading.Thread(target=lambda: (page.show(stimulus), shown.set()))
    thread.start()
    while (identity := page.state()["screen"])["kind"] != "stimulus":
        pass
    send(page, "seen", identity["id"], None)
    assert not shown.wait(0.3)
    send(page, "seen", identity["id"], -20.0)
    assert shown.wait(10.0)
    thread.join()
    assert page.noise == -20.0


def written(folder: Path, words: dict[str, str]) -> Path:
    path = folder / "own.yaml"
    path.write_text(json.dumps(words))
    return path


def test_a_language_of_ones_own_is_read_beside_the_protocol(tmp_path: Path) -> None:
    written(tmp_path, ENGLISH)
    assert read_texts("own.yaml", tmp_path) == ENGLISH


@pytest.mark.parametrize("language", ["de", "en", "es", "fr"])
def test_a_language_of_the_package_has_all_words(language: str) -> None:
    texts = read_texts(language)
    assert texts["language"] == language
    assert all(texts.values())


def test_a_word_that_is_missing_or_unknown_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, {word: word for word in ENGLISH if word != "begin"})
    with pytest.raises(ParameterError, match="begin = nothing: must be given"):
        read_texts("own.yaml", tmp_path)
    written(tmp_path, {**ENGLISH, "begun": "Begun"})
    with pytest.raises(ParameterError, match="begun: unknown") as told:
        read_texts(str(path))
    assert "\n" not in str(told.value)
