# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pages of which a part does not come, or comes late: they say so, load it again, and can stop."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import pytest

from browsing import QuietGraph
from haptic_accel.core.document import read_yaml_document
from haptic_accel.materials.folders import config_folder
from haptic_accel.scope import server as served
from haptic_accel.scope.connections import Access
from haptic_accel.scope.server import ScopeServer
from nightly import rest_slow
from running import Command, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

MISSING = "scripts missing: loading again"
SLOWER = 20
"""Times by which a phone's processor may be slower than this machine's."""


class Touching(QuietGraph):
    """Rig without a graph."""

    def choices(self) -> dict[str, list[str]]:
        return {name: known for name, known in super().choices().items() if name != "record"}


class Session(QuietGraph):
    """Study that asks a question."""

    SCREEN: ClassVar[dict[str, Any]] = {
        **{"id": "1", "kind": "question", "text": "Felt it?", "answers": ["yes", "no"]},
        **{"seconds": 0.0, "elapsed": 0.0, "progress": 0.5, "interval": 1},
    }
    page = ""

    def state(self) -> dict[str, Any]:
        return super().state() | {"page": self.page, "noise": None, "screen": self.SCREEN}


class Steps(QuietGraph):
    """Bring-up that asks for nothing."""

    SHOWN: ClassVar[dict[str, Any]] = {
        **{"steps": [], "lines": [], "request": None, "asks": False, "number": 0, "skip": None},
        **{"ended": None, "signal": None},
    }


KINDS = {
    "scope": (QuietGraph, "scope", "#link", "no signals", ("estop", True)),
    "touch": (Touching, "scope", "#link", "no signals", None),
    "study": (Session, "study", "#heading", "Felt it?", ("stop", "[]")),
    "bring_up": (Steps, "bring_up", "#link", "connected", None),
}
"""Source and template of each page, an element with its text once the page is there, its stop."""


class Served:
    """Page with its server, and the commands that reached it."""

    def __init__(self, kind: str, page: Page) -> None:
        made, self.name, self.place, self.text, self.stop = KINDS[kind]
        self.source, self.page = made(), page
        self.commands: list[tuple[str, Any]] = []
        words = read_yaml_document(config_folder() / "studies" / "languages" / "en.yaml")
        texts = {word: words.at(word).text() for word in words.mapping()}
        self.server = ScopeServer(
            self.source, Access("127.0.0.1"), "127.0.0.1", 0, self.act, self.name, texts
        )
        self.address = self.server.start()

    async def act(self, action: str, value: Any) -> str:
        self.commands.append((action, value))
        if action == "open":  # a study is told which page is the participant's
            self.source.page = value.strip('["]')
        return ""

    def open(self) -> None:
        self.page.goto(self.address, wait_until="commit")

    def comes(self) -> None:
        place = self.page.locator(self.place)
        wait_until(lambda: place.inner_text() == self.text, f"{self.name}: {self.text}")
        wait_until(lambda: self.page.locator("#missing").is_hidden(), "nothing is missing")

    def stops(self) -> None:
        """Press the stop, if the page has one."""
        if self.stop:
            before = self.commands.count(self.stop)
            self.page.click("#stop")
            self.waits(lambda: self.commands.count(self.stop) > before, "the stop is given")

    def waits(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for a condition; the routes of a page are served while it is looked at."""
        wait_until(lambda: self.page.locator("body").count() and condition(), what)


@pytest.fixture(params=rest_slow(KINDS, now=2))
def served_page(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Served]:
    one = Served(request.param, browser.new_page())
    yield one
    one.page.close()
    one.server.stop()


def test_scripts_that_do_not_come_are_missed_and_loaded_again(served_page: Served) -> None:
    missing = served_page.page.locator("#missing")
    refusing = True

    def refuse(route: Route) -> None:
        route.abort("connectionreset") if refusing else route.continue_()

    served_page.page.route("**/*.js*", refuse)
    served_page.open()
    wait_until(lambda: MISSING in missing.inner_text(), MISSING)
    served_page.stops()
    refusing = False
    served_page.comes()
    served_page.stops()


def test_scripts_without_an_answer_are_loaded_again(served_page: Served) -> None:
    held: list[Route] = []  # neither answered nor refused, until another has come
    served_page.page.route(
        "**/*.js*", lambda route: route.continue_() if held else held.append(route)
    )
    served_page.open()
    served_page.stops()
    served_page.comes()
    held[0].continue_()
    served_page.stops()


@pytest.mark.parametrize("part", ["live", "scene", "command"])
def test_a_page_without_another_part_comes_when_it_does(
    served_page: Served, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused: list[Route] = []

    def refuse(route: Route) -> None:
        refused.append(route)
        route.abort("connectionreset") if len(refused) < 3 else route.continue_()

    served_page.page.route(f"**/{part}", refuse)
    monkeypatch.setattr(served, "MOST_CLIENTS", 0 if part == "live" else 8)
    served_page.open()
    served_page.stops()
    monkeypatch.setattr(served, "MOST_CLIENTS", 8)
    served_page.comes()


def test_a_page_that_was_cut_is_loaded_again(served_page: Served) -> None:
    cut: list[Route] = []

    def cut_once(route: Route) -> None:
        if cut:
            route.continue_()
            return
        cut.append(route)
        answer = route.fetch()
        headers = {**answer.headers, "content-length": ""}
        text = answer.text()
        route.fulfill(response=answer, headers=headers, body=text[: text.index("<main")])

    served_page.page.route(served_page.address, cut_once)
    served_page.open()
    served_page.stops()
    served_page.comes()
    assert cut


@pytest.mark.slow
def test_on_a_slow_processor_the_page_comes_and_stops(served_page: Served) -> None:
    devtools = served_page.page.context.new_cdp_session(served_page.page)
    devtools.send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
    served_page.open()
    served_page.stops()
    served_page.comes()
    served_page.stops()


@pytest.mark.quiet
@pytest.mark.slow
def test_a_page_comes_whose_server_stood_still_while_it_loaded(
    browser: Browser, haptic_accel: Callable[..., Command]
) -> None:
    touching = haptic_accel("touch", "--no-open")
    address = touching.wait_for("http").split()[0]
    page = browser.new_page()

    def stand_still(route: Route) -> None:
        os.kill(touching.process.pid, signal.SIGSTOP)
        route.continue_()
        page.unroute("**/*.js*")

    page.route("**/*.js*", stand_still)
    page.goto(address, wait_until="commit")
    page.wait_for_timeout(2000)
    os.kill(touching.process.pid, signal.SIGCONT)
    link = page.locator("#link")
    wait_until(lambda: link.count() == 1 and link.inner_text().startswith("data "), "signals")
    page.close()
    assert touching.end(signal.SIGINT) == 0, touching.text
