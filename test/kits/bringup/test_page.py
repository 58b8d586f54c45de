# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of a bring-up in a real browser, which takes the answers of a bring-up of two steps."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from browsing import opened, violations
from haptic_accel.devices.observed import Observation
from haptic_accel.kits.bringup.guide import Guide
from haptic_accel.scope.connections import Access
from haptic_accel.scope.server import ScopeServer
from nightly import rest_slow
from running import PATIENCE, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

STEPS = {
    "calibrate": "turn each board over, for its axis, gain and offset",
    "make_safe": "force, polarity, stop, silence and a pulled plug",
}
REQUESTS = (
    "hold the handle with the coil's axis upwards, firm and still, then press Enter",
    "hold the handle with the coil's axis downwards, firm and still, then press Enter",
    "type the current that the meter shows now, A",
    "press Enter to try again, or type s to go on all the same",
)
NEXT = "next: haptic-accel teleop params_file:=rig.yaml controller:=adaptive"


class Humming:
    """Live signal: gravity with a vibration, and a gap."""

    def last(self, seconds: float) -> Observation:
        time = np.arange(round(1000 * seconds)) / 1000
        acceleration = 9.81 + 3 * np.sin(2 * np.pi * 125 * time)
        acceleration[100:130] = np.nan
        place = np.full((len(time), 3), np.nan)
        return Observation(1000.0, acceleration, place, np.zeros(len(time)))


class TwoSteps:
    """Bring-up of two steps, on a thread of its own as on the main thread of the command."""

    def __init__(self) -> None:
        self.guide = Guide(STEPS)
        self.answers: list[str] = []
        access = Access("127.0.0.1")
        self.server = ScopeServer(self.guide, access, "127.0.0.1", 0, self.guide.act, "bring_up")
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.address = self.server.start()
        self.thread.start()

    def _run(self) -> None:
        guide = self.guide
        upwards, downwards, current, again = REQUESTS
        guide.begin(1, "calibrate", STEPS["calibrate"])
        guide.show(Humming())
        self._ask(upwards)
        self._ask(downwards)
        guide.tell("ok: handle: axis z, gain 0.00479 m/s^2 per count within 0.31%")
        guide.show(None)
        guide.begin(2, "make safe", STEPS["make_safe"])
        guide.show(Humming())
        guide.tell("ok: quiet 12 ms after the emergency stop (at most 100)")
        self._ask(current)
        guide.tell("NOT PASSED: current 0.2 A, commanded 0.1 A")
        guide.tell("  is the amplifier's gain that of the parameters?")
        self._ask(again, "go on all the same")
        guide.end(NEXT, done=True)
        self.server.stop()

    def _ask(self, request: str, skip: str = "") -> None:
        self.answers.append(self.guide.ask(request, skip))


@pytest.fixture
def rig() -> Iterator[TwoSteps]:
    made = TwoSteps()
    yield made
    made.server.stop()


@pytest.fixture
def page(browser: Browser, rig: TwoSteps) -> Iterator[Page]:
    with opened(browser, rig.address, viewport={"width": 1280, "height": 900}) as shown:
        yield shown


def ready(page: Page, request: str) -> None:
    """Wait until a page shows a request and takes an answer."""
    text, button = page.locator("#request"), page.locator("#continue")
    wait_until(
        lambda: text.inner_text() == request and button.is_visible() and button.is_enabled(),
        request,
    )


def focused(page: Page) -> str:
    return str(page.evaluate("document.activeElement.id"))


def test_keys_alone_lead_through_all_steps(page: Page, rig: TwoSteps) -> None:
    for request, text in zip(REQUESTS, ("", "", "0.2", "s"), strict=True):
        ready(page, request)
        wait_until(lambda: focused(page) == "answer", "the field of the answer has the focus")
        page.keyboard.type(text)
        page.keyboard.press("Enter")
    ready(page, NEXT)
    assert rig.answers == ["", "", "0.2", "s"]
    chips = page.locator("#steps .chip").all_inner_texts()
    assert chips == ["done", "done"]
    assert page.locator("#request-title").inner_text() == "The rig is brought up"
    wait_until(lambda: focused(page) == "continue", "the last button")
    page.keyboard.press("Enter")
    rig.thread.join(PATIENCE)
    assert not rig.thread.is_alive()
    wait_until(lambda: page.locator("#link").inner_text() == "closed", "it says so")
    assert page.locator("#request").inner_text() == NEXT
    assert page.locator("#alarm").is_hidden()


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_results_and_signal_are_told_in_words_and_no_rule_of_accessibility_is_broken(
    page: Page, rig: TwoSteps, scheme: str
) -> None:
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    for request in REQUESTS[:3]:
        ready(page, request)
        page.keyboard.press("Enter")
    ready(page, REQUESTS[3])
    assert page.locator("#lines [data-kind=failed]").inner_text().startswith("NOT PASSED: ")
    assert page.locator("#lines [data-kind=ok]").inner_text().startswith("ok: ")
    now = page.locator("#steps [aria-current=step]").inner_text()
    assert re.search("make safe.*now", now, re.DOTALL)
    reading = page.locator("#signal-reading").inner_text()
    assert reading == "vibration 3.00 m/s², 1000 Hz, 30 of 500 samples missing"
    assert page.evaluate("document.querySelector('#signal canvas').width") > 0
    assert violations(page) == []
    rig.server.stop()
    wait_until(lambda: page.locator("#alarm").is_visible(), "no connection")
    assert violations(page) == []


def test_a_double_click_and_a_held_key_answer_once(page: Page, rig: TwoSteps) -> None:
    ready(page, REQUESTS[0])
    page.dblclick("#continue")
    ready(page, REQUESTS[1])
    assert rig.answers == [""]
    for _ in range(5):
        page.keyboard.down("Enter")
    ready(page, REQUESTS[2])
    for _ in range(5):
        page.keyboard.down("Enter")
    page.keyboard.up("Enter")
    assert rig.answers == ["", ""]
    assert page.locator("#message").is_hidden()


def test_a_button_goes_on_where_the_request_offers_it(page: Page, rig: TwoSteps) -> None:
    for request in REQUESTS[:3]:
        ready(page, request)
        assert page.locator("#skip").is_hidden()
        page.click("#continue")
    ready(page, REQUESTS[3])
    assert page.locator("#skip").text_content() == "go on all the same"
    page.click("#skip")
    ready(page, NEXT)
    assert rig.answers[-1] == "s"


def test_a_reload_goes_on_at_the_same_request(page: Page, rig: TwoSteps) -> None:
    ready(page, REQUESTS[0])
    page.click("#continue")
    ready(page, REQUESTS[1])
    page.reload()
    ready(page, REQUESTS[1])
    assert rig.answers == [""]
    page.keyboard.press("Enter")
    ready(page, REQUESTS[2])
    assert rig.answers == ["", ""]


def test_a_second_tab_shows_the_same_and_the_first_answer_counts(
    browser: Browser, page: Page, rig: TwoSteps
) -> None:
    for request in REQUESTS[:2]:
        ready(page, request)
        page.click("#continue")
    with opened(browser, rig.address) as second:
        ready(second, REQUESTS[2])
        page.fill("#answer", "0.1")
        page.click("#continue")
        ready(page, REQUESTS[3])
        ready(second, REQUESTS[3])
        assert rig.answers == ["", "", "0.1"]
        second.click("#skip")
        ready(page, NEXT)


def test_without_a_connection_the_page_says_so_and_asks_nothing(page: Page, rig: TwoSteps) -> None:
    ready(page, REQUESTS[0])
    rig.server.stop()
    wait_until(lambda: page.locator("#alarm").is_visible(), "told")
    assert page.locator("#alarm").inner_text().startswith("No connection to the bring-up.")
    assert page.locator("#answering").is_hidden()
    assert page.locator("#link").inner_text() == "no connection"
