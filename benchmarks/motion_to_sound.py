# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure the time from a motion on the scope's page to sound and picture, in a real browser.

Run as ``python benchmarks/motion_to_sound.py``. A mouse taps the surface of
``haptic-accel touch``, or with arguments that of a graph with ``master:=pointer``. The stages end
with the first sample of the handle's acceleration above a threshold, with its arrival at the page,
and when the browser's output plays it. The picture is the first that shows the handle a pixel from
where it was; it is on the screen when the browser asks for the next one. With ``--output NAME``
the sound is that on channels 3 and 4 of an output of this computer's sound server.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from haptic_accel.core.process import REALTIME

STAGES = ("motion to acceleration", "acceleration to page", "page to sound")
"""Stages of a sound, whose sum is the time from the motion."""

TIMES = (*STAGES, "motion to sound", "motion to picture")
"""Measured times."""

ABOVE, BELOW = 1e-3, 3e-3
"""Distances from the surface between which the hand taps, m."""

STEP = 5e-4
"""Step in which the surface is looked for, m."""

TOUCH = 0.2
"""Contact force at which the surface is found, N."""

REST = 700
"""Time between two motions, ms: the tool comes to rest."""

WATCH = """(scale) => {
  window.tap = null; // set to {} before the mouse moves
  const THRESHOLD = 2; // m/s²; in the air, the handle has 0.2
  const PIXEL = 1 / scale; // m
  const now = () => performance.timeOrigin + performance.now();
  const height = () => hapticScene.here.handle[1];
  document.getElementById("scene").addEventListener("pointermove", () => {
    if (tap && !tap.moved) Object.assign(tap, { moved: now(), height: height() });
  });
  const draw = hapticScene.draw;
  hapticScene.draw = () => {
    draw();
    const shown = tap;
    if (!shown?.moved || shown.drawn || Math.abs(height() - shown.height) < PIXEL) return;
    shown.drawn = true;
    requestAnimationFrame(() => (shown.picture = now() - shown.moved));
  };
  const take = hapticSound.take;
  hapticSound.take = (name, origin, offsets, values, rate) => {
    take(name, origin, offsets, values, rate);
    if (name !== "actual" || !tap?.moved || tap.sound) return;
    const stamp = (index) => 1e3 * (origin + offsets.at(index));
    const felt = (value, index) => Math.abs(value) > THRESHOLD && stamp(index) > tap.moved;
    const first = values.findIndex(felt);
    if (first < 0) return;
    const { stream, context } = hapticSound;
    const arrived = now();
    const ahead = stamp(-1) - stamp(first); // the delay is that of the newest sample
    const played = arrived + 1e3 * (stream.delay + context.outputLatency) - ahead;
    const moments = [tap.moved, stamp(first), arrived, played];
    tap.sound = [...moments.slice(1).map((moment, i) => moment - moments[i]), played - tap.moved];
  };
}"""

SCALE = """async () => {
  const [[left, right], [low, high]] = (await (await fetch("/scene")).json()).view;
  const { clientWidth, clientHeight } = document.getElementById("scene");
  return Math.min(clientWidth / (right - left), clientHeight / (high - low));
}"""


@contextmanager
def scope(words: Sequence[str]) -> Iterator[str]:
    """Start a rig, or with arguments a graph, with a page; return its address."""
    graph = ["teleop", "master:=pointer", "scope:=true", "scope_port:=0", "scope_control:=true"]
    given = [*graph, *words] if words else ["touch", "--no-open"]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "haptic_accel.cli.main", *given]
        # Real-time nodes would starve a browser that draws without a graphics card.
        environment = {**os.environ, REALTIME: "no"}
        with subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout
            try:
                # The address has a line of its own, and comes when all else has started.
                lines = (line.split() for line in process.stdout)
                yield next(word for line in lines for word in line if word.startswith("http"))
            finally:
                process.send_signal(signal.SIGINT)
                process.stdout.read()


def wait(page: Any, expression: str) -> None:
    """Wait until an expression of the page is true."""
    while not page.evaluate(expression):  # the page's policy forbids what waits by itself
        page.wait_for_timeout(50)


def choose_grips(page: Any, output: str) -> None:
    """Choose channels 3 and 4 of an output by its name."""
    page.locator("#sound-outputs").click()
    page.select_option("#sound-output", label=output)
    page.select_option("#sound-channels", "2,3")


def measured(page: Any, taps: int, output: str) -> list[list[float]]:
    """Return the times of each tap that is heard and seen, ms, in the order of `TIMES`."""
    wait(page, "hapticScope.state?.led && hapticScope.state.engaged")
    if output:
        choose_grips(page, output)
    page.locator("#sound-on").click()
    page.locator("#scene").hover()
    wait(page, "hapticSound.stream?.rate")
    scale = page.evaluate(SCALE)
    page.evaluate(WATCH, scale)
    box = page.locator("#scene").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    while page.evaluate("Math.hypot(...hapticScene.here.force)") < TOUCH:
        y += STEP * scale
        page.mouse.move(x, y)
        page.wait_for_timeout(100)
    found = []
    for _ in range(taps):
        page.mouse.move(x, y - ABOVE * scale)
        page.wait_for_timeout(REST)
        page.evaluate("tap = {}")
        page.mouse.move(x, y + BELOW * scale)
        page.wait_for_timeout(REST)
        if page.evaluate("Boolean(tap.sound && tap.picture)"):
            found.append(page.evaluate("[...tap.sound, tap.picture]"))
    page.mouse.up()
    print(page.locator("#sound-delay").inner_text(), file=sys.stderr)
    return found


def main() -> None:
    """Measure, and print medians and 90 % quantiles."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("words", nargs="*", help="arguments of a graph: slave:=virtual")
    parser.add_argument("--taps", type=int, default=20)
    parser.add_argument("--output", default="", help="output with grips, by its name")
    parser.add_argument("--json", action="store_true", help="print one object of times")
    given = parser.parse_args()
    with scope(given.words) as address, sync_playwright() as player:
        browser = player.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=["--no-sandbox", "--disable-gpu"],
            ignore_default_args=["--mute-audio"] if given.output else None,
        )
        page = browser.new_page(
            viewport={"width": 1280, "height": 900}, permissions=["microphone"]
        )
        page.goto(address)
        taps = measured(page, given.taps, given.output)
        found = np.quantile(taps, [0.5, 0.9], axis=0).T
        browser.close()
    if given.json:
        print(json.dumps({name: list(pair) for name, pair in zip(TIMES, found, strict=True)}))
        return
    print(f"{given.taps} taps, ms{'median':>20}{'90 %':>8}")
    for name, (median, high) in zip(TIMES, found, strict=True):
        print(f"{name:22}{median:>8.1f}{high:>8.1f}")


if __name__ == "__main__":
    main()
