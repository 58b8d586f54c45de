# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of a participant in a real browser: a session by keys, and all that may go wrong."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from kits.study.participating import ENGLISH, TRIALS, Visit

from browsing import LISTEN, opened, violations
from haptic_accel.kits.study.participant_page import UNSEEN, ParticipantPage
from haptic_accel.kits.study.trials import Screen
from haptic_accel.scope.paced_rig import PacedRig
from nightly import rest_slow
from running import on_thread, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

QUESTION = "Were they the same?"

LEVEL = """async () => {
  const { context, noise } = hapticSound;
  const analyser = new AnalyserNode(context, { fftSize: 32768 });
  noise.connect(analyser);
  const samples = new Float32Array(analyser.fftSize);
  await new Promise((resolve) => setTimeout(resolve, 1500));
  analyser.getFloatTimeDomainData(samples);
  return 10 * Math.log10(samples.reduce((sum, each) => sum + each * each, 0) / samples.length);
}"""
"""Script that returns the level of the noise, dB of full scale."""


@pytest.fixture
def visit(tmp_path: Path) -> Iterator[Visit]:
    made = Visit(tmp_path / "study")
    yield made
    made.close()


@pytest.fixture
def page(browser: Browser, visit: Visit) -> Iterator[Page]:
    with opened(browser, visit.address, viewport={"width": 1280, "height": 900}) as shown:
        yield shown


def shows(page: Page, text: str) -> None:
    """Wait until a page shows a screen with a heading."""
    wait_until(lambda: page.locator("#heading").inner_text() == text, text)


def asked(page: Page, question: str = QUESTION) -> None:
    """Wait until a page asks a question that is not answered yet, and takes an answer."""
    shows(page, question)
    page.wait_for_selector("#screen:not(.answered)")
    shows(page, question)
    page.wait_for_timeout(500)  # until another press is no double click


def agree(page: Page) -> None:
    """Agree, read the instructions and begin."""
    screens = {"I agree to take part.": "1", "Stroke the surface.": "Enter", "begin": "Enter"}
    for heading, key in screens.items():
        asked(page, heading)
        page.keyboard.press(key)


def first_question(page: Page, visit: Visit) -> None:
    """Begin a session, and wait until its first question is asked."""
    visit.begin()
    agree(page)
    asked(page)


def answer(page: Page, visit: Visit, key: str) -> None:
    """Press a key, and wait until it has answered one question."""
    before = len(visit.answers)
    page.keyboard.press(key)
    wait_until(lambda: len(visit.answers) == before + 1, "the answer")


def values(visit: Visit) -> list[tuple[int, str]]:
    return [(number, answer.value) for number, answer in visit.answers]


def numbers(visit: Visit) -> list[int]:
    return [number for number, _ in visit.answers]


def test_a_session_by_keys_alone_to_which_no_condition_comes(page: Page, visit: Visit) -> None:
    texts: list[str] = []
    hear = ("framereceived", lambda data: texts.append(str(data)))
    page.on("websocket", lambda socket: socket.on(*hear))
    page.reload()
    first_question(page, visit)
    for key in ("3", "a", "Enter", "Tab", "F2"):
        page.keyboard.press(key)
    page.wait_for_timeout(300)
    assert visit.answers == [], "none of them is an answer"
    page.focus("#heading")
    ways: list[tuple[tuple[str, ...], str]] = [
        (("1",), "same"),
        (("2",), "different"),
        (("ArrowRight", "Enter"), "same"),
        (("ArrowRight", "ArrowRight", "Enter"), "different"),
        (("ArrowLeft", "Space"), "different"),
    ]
    wanted = []
    for number in range(TRIALS):
        asked(page)
        assert page.evaluate("document.activeElement.id") == "heading", "it is read out"
        keys, value = ways[number % len(ways)]
        for key in keys:
            page.keyboard.press(key)
        wanted.append(value)
        wait_until(lambda n=number: len(visit.answers) == n + 1, "the answer")  # type: ignore[misc]
    shows(page, "end")
    assert visit.ended == "complete"
    assert [answer.value for _, answer in visit.answers] == wanted
    assert numbers(visit) == list(range(TRIALS))
    assert all(0.0 < answer.response_time < 30.0 for _, answer in visit.answers)
    assert len(texts) > 10
    for word in ("controller", "adaptive", "nrmse", "spectra", "desired"):
        assert word not in "".join(texts)


def test_a_reload_loses_and_doubles_nothing(page: Page, visit: Visit) -> None:
    visit.begin()
    agree(page)
    for number in range(2):
        asked(page)
        if not number:
            page.wait_for_timeout(1500)
        page.reload()
        asked(page)
        page.keyboard.press("2")
        if number % 2:
            page.reload()  # at once, perhaps before the answer has arrived
            page.wait_for_timeout(300)
            if len(visit.answers) == number:
                asked(page)
                page.keyboard.press("2")
        wait_until(lambda n=number: len(visit.answers) == n + 1, "the answer")  # type: ignore[misc]
    assert numbers(visit) == [0, 1]
    assert visit.answers[0][1].response_time > 2.0, "the time goes on over a reload"


def test_going_back_and_forward_loses_and_doubles_nothing(page: Page, visit: Visit) -> None:
    first_question(page, visit)
    page.goto("about:blank")
    page.go_back()
    asked(page)
    answer(page, visit, "1")
    asked(page)
    page.go_back()
    page.go_forward()
    page.goto(visit.address)
    asked(page)
    answer(page, visit, "2")
    assert numbers(visit) == [0, 1]


def test_a_session_that_was_killed_goes_on_at_the_same_page(page: Page, visit: Visit) -> None:
    first_question(page, visit)
    answer(page, visit, "1")
    asked(page)
    visit.restart()
    for heading in ("Stroke the surface.", "begin"):
        asked(page, heading)
        page.keyboard.press("Enter")
    asked(page)
    answer(page, visit, "2")
    assert values(visit) == [(0, "same"), (1, "different")]


def test_a_double_click_answers_once(page: Page, visit: Visit) -> None:
    visit.seconds = 0.0
    visit.begin()
    agree(page)
    for number in range(2):
        asked(page)
        page.dblclick("#answers button >> nth=0")
        wait_until(lambda n=number: len(visit.answers) > n, "the answer")  # type: ignore[misc]
        asked(page)
        assert numbers(visit) == list(range(number + 1))


def test_an_answer_without_connection_arrives_when_it_is_back(page: Page, visit: Visit) -> None:
    first_question(page, visit)
    page.context.set_offline(True)
    page.route("**/command", lambda route: route.abort())
    page.keyboard.press("2")
    page.wait_for_timeout(1000)
    assert visit.answers == []
    page.unroute("**/command")
    page.context.set_offline(False)
    wait_until(lambda: len(visit.answers) == 1, "the answer")
    asked(page)
    assert values(visit) == [(0, "different")]


def test_an_answer_whose_acknowledgement_is_lost_counts_once(page: Page, visit: Visit) -> None:
    first_question(page, visit)

    lost: list[str] = []

    def lose_first(route: Any) -> None:
        # By what arrived: the browser may not tell the body of a request.
        acknowledgement = route.fetch()
        if visit.answers and not lost:
            lost.append(acknowledgement.text())
            route.abort()
        else:
            route.fulfill(response=acknowledgement)

    page.route("**/command", lose_first)
    page.keyboard.press("1")
    # Asking the page serves the route as well.
    wait_until(lambda: page.locator("#heading").is_visible() and len(lost) == 1, "it is lost")
    asked(page)
    page.unroute("**/command")
    assert numbers(visit) == [0]
    answer(page, visit, "2")
    assert values(visit) == [(0, "same"), (1, "different")]


def test_of_two_pages_the_one_opened_last_is_the_participants(
    browser: Browser, page: Page, visit: Visit
) -> None:
    first_question(page, visit)
    with opened(browser, visit.address) as second:
        shows(page, "other page")
        asked(second)
        answer(second, visit, "1")
    page.keyboard.press("Enter")  # the only answer: use this page
    asked(page)
    answer(page, visit, "2")
    assert values(visit) == [(0, "same"), (1, "different")]


def test_a_stimulus_waits_for_a_page_that_shows_it(browser: Browser, visit: Visit) -> None:
    shown = threading.Event()

    def script() -> None:
        visit.page.show(Screen("s", "stimulus", interval=1))
        shown.set()

    visit.begin(script)
    assert not shown.wait(0.5)
    with opened(browser, visit.address):
        wait_until(shown.is_set, "the stimulus")


def test_a_stimulus_during_which_the_page_is_lost_is_undelivered(page: Page, visit: Visit) -> None:
    visit.over.clear()
    visit.begin()
    agree(page)
    shows(page, "interval 1")
    page.goto("about:blank")
    threading.Event().wait(UNSEEN + 0.5)
    visit.over.set()
    wait_until(lambda: visit.undelivered == 1, "the loss is noticed")
    page.goto(visit.address)
    asked(page, "begin")
    page.keyboard.press("Enter")
    asked(page)
    answer(page, visit, "1")
    assert numbers(visit) == [0], "the trial is repeated"


def test_escape_stops_at_once_and_without_force(page: Page, visit: Visit) -> None:
    first_question(page, visit)
    page.keyboard.press("Escape")
    shows(page, "stopped")
    assert visit.rig.stops == 1
    assert visit.ended == "stopped by the participant"
    assert visit.answers == []
    assert not page.locator("#stop").is_visible()


def test_a_break_cannot_be_left_before_its_end(page: Page, visit: Visit) -> None:
    visit.begin(lambda: visit.page.ask(Screen("b", "break", "", ("continue",), 0.5, 0, 2.0)))
    shows(page, "break")
    page.keyboard.press("Enter")
    page.keyboard.press("1")
    assert page.locator("#left").is_visible()
    page.reload()
    shows(page, "break")
    assert visit.ended == ""
    wait_until(lambda: page.locator("#answers button").is_enabled(), "the end of the break")
    page.keyboard.press("Enter")
    wait_until(lambda: visit.ended == "complete", "the session goes on")


def test_a_rating_needs_a_move(page: Page, visit: Visit) -> None:
    given: list[str] = []
    scale = tuple(map(str, range(101)))

    def script() -> None:
        given.append(visit.page.ask(Screen("r", "question", "How real?", scale)).value)

    visit.begin(script)
    asked(page, "How real?")
    page.keyboard.press("ArrowRight")  # from the question to the scale
    page.keyboard.press("Enter")
    page.wait_for_timeout(200)
    assert given == []
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    wait_until(lambda: given == ["51"], "the rating")


def test_the_level_of_the_noise_is_that_of_the_protocol(browser: Browser, tmp_path: Path) -> None:
    visit = Visit(tmp_path / "study", noise=-30.0)
    visit.begin()
    with closing(visit), opened(browser, visit.address) as page:
        shows(page, "title")
        page.keyboard.press("Enter")
        shows(page, "noise on")
        assert page.evaluate(LEVEL) == pytest.approx(-30.0, abs=1.5)
        page.keyboard.press("Enter")
        agree(page)
        asked(page)
        assert visit.page.noise == -30.0
        assert page.locator("#noise").is_visible()
        page.reload()
        shows(page, "title")  # a browser gives no sound before a press


LABELS = {
    ("1", "2", "3"): ["1 first", "2 second", "3 third"],
    ("1", "2", "3", "4"): ["1", "2", "3", "4"],
    ("A", "B"): ["A", "B"],
    ("surface=text", "surface=wood gain=0.5"): ["1 text", "2 wood 0.5"],
    ("constructor", "same"): ["1 constructor", "2 same"],
}
"""Labels of the buttons, by the answers."""


def test_buttons_have_words_of_the_language_values_or_intervals(page: Page, visit: Visit) -> None:
    given: list[str] = []

    def script() -> None:
        for number, answers in enumerate(LABELS):
            screen = Screen(f"q{number}", "question", f"Which of {number}?", answers)
            given.append(visit.page.ask(screen).value)

    visit.begin(script)
    for number, (answers, labels) in enumerate(LABELS.items()):
        asked(page, f"Which of {number}?")
        shown = page.locator("#answers button").all_inner_texts()
        assert [" ".join(each.split()) for each in shown] == labels
        page.keyboard.press("b" if "B" in answers else "2")
    wait_until(lambda: given == [answers[1] for answers in LABELS], "each second answer")


class LedRig(PacedRig):
    """The rig of ``touch``, which strokes by itself."""

    has_pointer = True

    def stop(self) -> None:
        """Leave the forces as they are."""


def test_the_handle_is_heard_during_a_stimulus_and_not_after(browser: Browser) -> None:
    rig = LedRig("plywood", "paper")
    study = ParticipantPage(ENGLISH, rig)
    with on_thread(rig.run), closing(study), opened(browser, study.start()) as page:
        study.show(Screen("w", "wait"))
        asked(page, "title")
        page.keyboard.press("Enter")
        shows(page, "wait")
        page.evaluate(LISTEN)
        assert page.evaluate("heard()")[1] < -90.0
        study.show(Screen("s", "stimulus", interval=1))
        wait_until(lambda: page.evaluate("heard()")[1] > -60.0, "the handle's vibration")
        study.show(Screen("w", "wait"))
        wait_until(lambda: page.evaluate("heard()")[1] < -90.0, "silence")


def test_the_pad_leads_the_hand_and_shows_no_tool(page: Page, visit: Visit) -> None:
    visit.rig.has_pointer = True
    visit.seconds = 3.0
    visit.begin()
    shows(page, "title")
    page.keyboard.press("Enter")
    agree(page)
    shows(page, "interval 1")
    wait_until(lambda: page.evaluate("document.activeElement.id") == "scene", "the pad")
    page.keyboard.press("ArrowRight")
    wait_until(lambda: bool(visit.rig.led), "the hand is led")
    assert "plywood" not in page.evaluate("fetch('/scene').then((answer) => answer.text())")


SCREENS = [
    Screen("a", "consent", "I take part.\nI may stop.", ("agree", "disagree")),
    Screen("b", "question", "Which?", ("1", "2", "3"), 0.5),
    Screen("c", "break", "", ("continue",), 0.5, 0, 60.0),
    Screen("d", "question", "How real?", tuple(map(str, range(101))), 0.5),
]


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_no_rule_of_accessibility_is_broken(page: Page, visit: Visit, scheme: str) -> None:
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    shown = page.locator("#screen")
    for screen in SCREENS:
        visit.page.show(screen)
        wait_until(lambda k=screen.kind: shown.get_attribute("data-kind") == k, screen.kind)  # type: ignore[misc]
        assert violations(page) == [], screen


def test_no_rule_of_accessibility_is_broken_during_a_stimulus(page: Page, visit: Visit) -> None:
    visit.rig.has_pointer = True
    visit.begin(lambda: visit.page.ask(Screen("s", "stimulus", interval=2, progress=0.5)))
    shows(page, "title")
    page.keyboard.press("Enter")
    shows(page, "interval 2")
    assert violations(page) == []
