# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draws the picture of docs/start.md: ``python docs/moving_picture.py`` writes figures/touch.gif.

The page of ``haptic-accel touch`` is shown in a browser, with each controller in turn, while the
hand strokes by itself. It needs Chromium and playwright.
"""

from __future__ import annotations

import io
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from PIL import Image

from haptic_accel.scope.connections import Access
from haptic_accel.scope.paced_rig import PacedRig
from haptic_accel.scope.server import ScopeServer

FILE = Path(__file__).parent / "figures" / "touch.gif"

SIZE = {"width": 1200, "height": 810}
"""Size of the page, pixels: the first cards."""

WIDTH = 760
"""Width of the picture, pixels: that of a page's text."""

COLOURS = 48
"""Colours of the picture: those of the page, and shades of its letters."""

STAGES = ("adaptive", "none", "dynamic", "adaptive")
"""Controllers in turn; the first learns the surface, and is not drawn."""

STAGE = 4.0
"""Duration of each, s: the last 2 s give its error."""


PAUSE = 50.0
"""Pause between two pictures, ms."""


def shown(page: Any) -> Iterator[Image.Image]:
    """Choose each controller in turn; yield pictures of the page."""
    for number, name in enumerate(STAGES):
        page.locator(f".switch [data-value={name}]").click()
        ends = time.monotonic() + STAGE
        while time.monotonic() < ends:
            page.wait_for_timeout(PAUSE)
            if number:
                shot = Image.open(io.BytesIO(page.screenshot(type="png"))).convert("RGB")
                yield shot.resize((WIDTH, round(WIDTH * shot.height / shot.width)))


def main() -> None:
    """Draw the picture."""
    from playwright.sync_api import sync_playwright

    rig, ended = PacedRig("plywood", "paper"), threading.Event()
    server = ScopeServer(rig, Access("127.0.0.1"), "127.0.0.1", 0, rig.act)
    threading.Thread(target=rig.run, args=(ended.is_set,), daemon=True).start()
    with sync_playwright() as player:
        flags = ["--no-sandbox", "--disable-gpu"]
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        page = browser.new_page(viewport=SIZE)
        page.goto(server.start())
        page.evaluate("document.getElementById('message').style.display = 'none'")
        begun = time.monotonic()
        pictures = list(shown(page))
        each = 1e3 * (time.monotonic() - begun) * (len(STAGES) - 1) / len(STAGES) / len(pictures)
        browser.close()
    ended.set()
    server.stop()
    palette = pictures[-1].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    drawn = [shot.quantize(palette=palette, dither=Image.Dither.NONE) for shot in pictures]
    first, *others = drawn
    first.save(FILE, save_all=True, append_images=others, duration=each, loop=0, optimize=True)
    print(f"{FILE}: {len(drawn)} pictures, {each:.0f} ms each, {FILE.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
