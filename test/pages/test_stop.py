# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The emergency stop of the live page in a real browser: requested until it is confirmed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from browsing import QuietGraph, opened
from haptic_accel.scope.connections import Access
from haptic_accel.scope.server import CommandError, ScopeServer
from running import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

STOP = ("estop", True)


class Devices:
    """Devices that confirm a stop only once they are there."""

    def __init__(self) -> None:
        self.ready = True
        self.asked: list[tuple[str, Any]] = []

    async def __call__(self, action: str, value: Any) -> str:
        self.asked.append((action, value))
        if not self.ready:
            raise CommandError("estop: not confirmed by slave_device")
        return "stopped: master_device and slave_device without force"


@pytest.fixture
def devices() -> Devices:
    return Devices()


@pytest.fixture
def server(devices: Devices) -> Iterator[ScopeServer]:
    serving = ScopeServer(QuietGraph(), Access("127.0.0.1"), "127.0.0.1", 0, devices)
    yield serving
    serving.stop()


@pytest.fixture
def page(browser: Browser, server: ScopeServer) -> Iterator[Page]:
    with opened(browser, server.start()) as page:
        connected(page)
        yield page


def connected(page: Page) -> None:
    """Wait until a page has the state of the graph.

    `wait_for_function` evaluates a text in the page, which the page's policy forbids.
    """
    wait_until(lambda: bool(page.evaluate("!!window.hapticScope?.state")), "the page is connected")


def told(page: Page, text: str) -> None:
    wait_until(lambda: text in page.locator("#message").inner_text(), f"the page tells: {text}")


def test_a_stop_that_is_not_confirmed_is_shown_and_repeated(page: Page, devices: Devices) -> None:
    devices.ready = False
    page.click("#stop")
    told(page, "estop: not confirmed by slave_device – asking again until the stop is confirmed")
    assert page.locator("#message").get_attribute("data-state") == "error"
    wait_until(lambda: len(devices.asked) > 2, "repeated")
    page.wait_for_selector("#release")
    devices.ready = True
    told(page, "without force")
    assert not page.evaluate("hapticStop.pending")
    assert set(devices.asked) == {STOP}


def test_a_stop_that_is_not_confirmed_outlives_a_reload(page: Page, devices: Devices) -> None:
    devices.ready = False
    page.click("#stop")
    wait_until(lambda: len(devices.asked) > 0, "asked")
    page.reload()
    devices.ready = True
    told(page, "without force")
    page.reload()
    connected(page)
    assert not page.evaluate("hapticStop.pending")


def test_a_release_ends_the_request(page: Page, devices: Devices) -> None:
    devices.ready = False
    page.click("#stop")
    page.click("#release")
    page.click("#really")
    wait_until(lambda: ("estop", False) in devices.asked, "released")
    assert not page.evaluate("hapticStop.pending")


def test_a_stop_that_reaches_nobody_arrives_when_the_scope_is_back(
    page: Page, server: ScopeServer, devices: Devices
) -> None:
    port = int(page.url.split(":")[2].strip("/"))
    server.stop()
    page.click("#stop")
    told(page, "has not reached the scope")
    again = ScopeServer(QuietGraph(), Access("127.0.0.1"), "127.0.0.1", port, devices)
    again.start()
    try:
        wait_until(lambda: STOP in devices.asked, "the stop arrives")
    finally:
        again.stop()
