# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of ``haptic-accel touch`` in a real browser: what a visitor sees, hears and presses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from browsing import shown, violations
from haptic_accel.scope.paced_rig import PacedRig
from nightly import rest_slow
from running import on_thread, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ERROR = "document.querySelector('.error b').textContent"


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """Open the page of a rig that runs."""
    rig = PacedRig("plywood", "paper")
    size = {"width": 1280, "height": 900}
    with on_thread(rig.run), shown(browser, rig, rig.act, viewport=size) as opened:
        yield opened


def error(page: Page) -> float:
    """Return the error that the page shows, %; NaN for none."""
    return float(page.evaluate(ERROR).replace("–", "nan"))


def test_before_and_after_are_seen_by_one_press(page: Page) -> None:
    wait_until(lambda: error(page) < 40.0, "the rig strokes by itself, compensated")
    page.click(".switch [data-value=none]")
    wait_until(lambda: error(page) > 90.0, "nothing drives the motor")
    page.click(".switch [data-value=adaptive]")
    wait_until(lambda: error(page) < 40.0, "compensated again")
    lowest = page.locator(".result [data-metric=lowest_percent]")
    wait_until(lambda: lowest.inner_text().isdecimal(), "the lowest error possible is told")
    told = page.locator("#touch-said")
    wait_until(lambda: told.inner_text().startswith("adaptive: error "), "told to screen readers")


def test_keys_alone_touch_choose_and_lift(page: Page) -> None:
    wait_until(lambda: page.evaluate("Number.isFinite(hapticScene.here.tool[1])"), "the tool")
    page.focus("#scene")
    for _ in range(12):
        page.keyboard.press("ArrowUp")
    wait_until(lambda: page.evaluate("hapticScene.here.tool[1] > 0.01"), "the tool is lifted")
    page.focus(".switch [data-value=dynamic]")
    page.keyboard.press("Enter")
    pressed = ".switch [data-value=dynamic][aria-pressed=true]"
    wait_until(lambda: page.locator(pressed).count() == 1, "the paper's controller")


def test_the_first_touch_turns_the_sound_on(page: Page) -> None:
    wait_until(lambda: page.evaluate("Number.isFinite(hapticScene.here.handle[0])"), "the handle")
    assert page.evaluate("hapticSound.context") is None
    page.locator("#scene").click()
    wait_until(lambda: page.evaluate("hapticSound.context?.state === 'running'"), "sound")


def test_there_is_nothing_of_a_graph(page: Page) -> None:
    assert page.locator("#stop, #recorder, #stop-state, [data-action=engage]").count() == 0
    wait_until(lambda: page.locator("#arms").inner_text().endswith("engaged"), "the arms' state")


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_no_rule_of_accessibility_is_broken(page: Page, scheme: str) -> None:
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    wait_until(lambda: error(page) < 100.0, "the page shows all")
    assert violations(page) == []
