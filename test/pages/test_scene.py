# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's scene in a real browser, without a graph: what is drawn, and who leads the hand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest

from browsing import QuietGraph, done, shown
from nightly import rest_slow
from running import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

BENCH = [[[-0.1, 0.0], [0.1, 0.0]]]
BALL = [[[0.04, 0.01], [0.03, 0.02], [0.02, 0.01], [0.03, 0.0], [0.04, 0.01]]]


class Bench(QuietGraph):
    """A scene without a graph, whose tool goes where the hand is led."""

    SHOWN: ClassVar = {"scene": "bench", "led": True}

    def __init__(self) -> None:
        super().__init__()
        self.refusal = ""
        self.led: list[tuple[float, float]] = []
        self.place(0.0, 0.01)

    def place(self, x: float, z: float) -> None:
        self.windows.vectors = {
            "tool": (x, 0.0, max(z, 0.0)),
            "tool_velocity": (0.1, 0.0, 0.0),
            "handle": (x, 0.0, z),
            "contact_force": (-0.3, 0.0, 1.0) if z < 0 else (0.0, 0.0, 0.0),
        }

    def scene(self) -> dict[str, Any]:
        return {
            "view": [[-0.1, 0.1], [-0.02, 0.08]],
            "outlines": {"bench": BENCH, "ball": BALL},
            "nodes": {"bench": [[0.1, 1.0]]},
            "offset": [0, 0],
        }

    def lead(self, x: float, z: float) -> str:
        if not self.refusal:
            self.led.append((x, z))
            self.place(x, z)
        return self.refusal


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def page(browser: Browser, bench: Bench) -> Iterator[Page]:
    with shown(browser, bench, done, viewport={"width": 900, "height": 900}) as opened:
        drawn = "hapticScene.counters.drawn > 0"
        wait_until(lambda: bool(opened.evaluate(drawn)), "the scene is drawn")
        yield opened


def middle(page: Page) -> tuple[float, float, float]:
    """Return the middle of the side view and its scale: pixels, pixels per metre."""
    box = page.locator("#scene").bounding_box()
    assert box
    scale = min(box["width"] / 0.2, box["height"] / 0.1)
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, scale


def test_the_hand_is_where_the_mouse_is_pressed(page: Page, bench: Bench) -> None:
    x, y, scale = middle(page)  # 30 mm above the surface, the hand 10 mm
    page.mouse.move(x - 0.03 * scale, y + 0.033 * scale)
    assert not bench.led, "a mouse that is not pressed leads nothing"
    page.mouse.down()
    wait_until(
        lambda: len(bench.led) > 0 and np.allclose(bench.led[-1], (-0.03, -0.003), atol=2 / scale),
        "a press below the surface is in contact",
    )
    page.mouse.move(x + 0.02 * scale, y + 0.033 * scale, steps=5)
    wait_until(
        lambda: np.allclose(bench.led[-1], (0.02, -0.003), atol=2 / scale), "the hand is there"
    )
    assert all(z < 0 for _, z in bench.led), "a stroke sideways stays in contact"
    # A point for each picture, also while the mouse rests, and none beyond its reach.
    count = len(bench.led)
    wait_until(lambda: len(bench.led) > count + 5, "more points")
    page.mouse.move(x + 5000, y + 5000)
    wait_until(lambda: np.allclose(bench.led[-1], (0.1, -0.02)), "at the end of its reach")
    page.mouse.up()
    wait_until(lambda: bool(page.evaluate("hapticScene.letGo() === undefined")), "let go")
    count = len(bench.led)
    page.mouse.move(x, y)
    assert len(bench.led) <= count + 1


def test_the_pressure_of_a_pen_lowers_the_hand(page: Page, bench: Bench) -> None:
    x, y, scale = middle(page)
    press = """([x, y, pressure]) => {
      const view = document.querySelector('#scene');
      view.setPointerCapture = () => {};
      const said = { clientX: x, clientY: y, pressure, pointerType: 'pen', pointerId: 7 };
      const kind = pressure ? 'pointerdown' : 'pointerup';
      view.dispatchEvent(new PointerEvent(kind, said));
    }"""
    page.evaluate(press, [x, y, 0.5])
    wait_until(lambda: bool(bench.led), "points come")
    assert bench.led[0] == pytest.approx((0.0, 0.03 - 0.005), abs=1 / scale)
    page.evaluate(press, [x, y, 0.0])


def test_arrow_keys_move_the_hand_too(page: Page, bench: Bench) -> None:
    assert page.evaluate("document.activeElement.id") == "scene", "the keys work at once"
    page.keyboard.press("ArrowDown")
    wait_until(lambda: bool(bench.led), "a point comes")
    # The same point for each picture, so that the hand arrives, and then no more.
    wait_until(lambda: not page.evaluate("hapticScene.isGripped()"), "the key lets go")
    points = list(bench.led)
    assert points == [pytest.approx((0.0, 0.008), abs=1e-6)] * len(points)


def test_the_scene_is_the_first_in_the_page_for_keys_and_eyes(page: Page, bench: Bench) -> None:
    first = """() => [...document.querySelectorAll('main [tabindex="0"], main button, main input')]
      .find((one) => one.checkVisibility()).id"""
    assert page.evaluate(first) == "scene"
    page.focus("#hold")
    bench.SHOWN = {**bench.SHOWN, "scene": "another"}  # type: ignore[misc]
    drawn = page.evaluate("hapticScope.counters.states")
    wait_until(lambda: page.evaluate("hapticScope.counters.states") > drawn + 1, "another scene")
    assert page.evaluate("document.activeElement.id") == "hold", "the keyboard stays with the user"
    bench.SHOWN = {"scene": None}  # type: ignore[misc]
    wait_until(lambda: page.evaluate(first) != "scene", "the signals are first")


def test_a_hand_that_may_not_be_led_is_let_go_with_the_reason(page: Page, bench: Bench) -> None:
    bench.refusal = "hand: another page leads it"
    x, y, _ = middle(page)
    page.mouse.move(x, y)
    page.mouse.down()
    message = page.locator("#message")
    wait_until(lambda: message.is_visible(), "the reason is said")
    assert message.inner_text() == bench.refusal
    sent = page.evaluate("hapticScene.counters.points")
    page.mouse.move(x + 9, y)
    assert page.evaluate("hapticScene.counters.points") <= sent + 1
    page.mouse.up()


def test_what_is_out_of_sight_is_not_sent_and_not_believed(page: Page) -> None:
    is_known = "Number.isFinite(hapticScene.here.handle[0])"
    wait_until(lambda: bool(page.evaluate(is_known)), "the handle's place comes")
    page.set_viewport_size({"width": 900, "height": 300})
    page.evaluate("scrollTo(0, 1e6)")
    wait_until(lambda: not page.evaluate(is_known), "it is forgotten")
    page.evaluate("scrollTo(0, 0)")
    wait_until(lambda: bool(page.evaluate(is_known)), "it comes again")


INK = """([id, colour]) => {
  const canvas = document.querySelector(`#${id} > canvas`);
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const paint = new OffscreenCanvas(1, 1).getContext('2d');
  paint.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(colour);
  paint.fillRect(0, 0, 1, 1);
  const wanted = paint.getImageData(0, 0, 1, 1).data;
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const differs = (c) => Math.abs(data[i + c] - wanted[c]) > 8;
    if (data[i + 3] > 200 && ![0, 1, 2].some(differs)) count++;
  }
  return count;
}"""


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_tool_handle_and_contact_are_drawn(page: Page, bench: Bench, scheme: str) -> None:
    page.emulate_media(color_scheme=scheme)

    def ink(place: str, colour: str) -> int:
        return int(page.evaluate(INK, [place, colour]))

    wait_until(lambda: ink("scene", "--desired") > 300, "the tool")
    wait_until(lambda: ink("scene", "--actual") > 30, "the handle")
    wait_until(lambda: ink("scene", "--still-fill") > 3000, "bench and ball")
    assert ink("scene", "--force") == ink("plane", "--force") == 0, "no contact"
    bench.place(0.0, -0.004)
    wait_until(lambda: ink("scene", "--force") > 30, "the contact's force")
    wait_until(lambda: ink("plane", "--force") > 30, "its place in the speed-force plane")
