# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Browser for the tests of pages."""

from __future__ import annotations

import os
import shutil
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, ClassVar

import aiohttp
import numpy as np
import pytest

from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.scope.connections import Access
from haptic_accel.scope.server import Act, ScopeServer
from haptic_accel.scope.windows import Windows
from running import PATIENCE

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, ViewportSize

BROWSER = "HAPTIC_ACCEL_BROWSER"
"""Environment variable that makes a missing browser a failure: required."""

FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # Unlike localhost, this host name makes a page an insecure context.
    f"--host-resolver-rules=MAP {socket.gethostname()} 127.0.0.1",
)


async def messages(address: str) -> AsyncIterator[aiohttp.WSMessage]:
    """Look as a page does; yield what comes, without end."""
    async with (
        aiohttp.ClientSession(headers={"Origin": address.rstrip("/")}) as session,
        session.ws_connect(f"{address}live") as live,
    ):
        while True:
            yield await received(live)


async def received(live: aiohttp.ClientWebSocketResponse) -> aiohttp.WSMessage:
    """Return the next message to a page, whose connection must go on."""
    message = await live.receive(PATIENCE)
    assert message.type in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT), message
    return message


LISTEN = """() => {
  const { context, output } = hapticSound;
  const analyser = new AnalyserNode(context, { fftSize: 8192, smoothingTimeConstant: 0 });
  output.connect(analyser);
  const levels = new Float32Array(analyser.frequencyBinCount);
  window.heard = () => {
    analyser.getFloatFrequencyData(levels);
    const peak = levels.indexOf(Math.max(...levels));
    return [(peak * context.sampleRate) / analyser.fftSize, levels[peak]];
  };
}"""
"""Script that defines ``heard()``: frequency (Hz) and level (dB) of the loudest line in a page's
sound."""


PHONE: ViewportSize = {"width": 390, "height": 844}
"""Size of a page on a phone, pixels."""


class QuietGraph:
    """Graph double without processes, whose state never changes, for the page's server."""

    SHOWN: ClassVar[dict[str, Any]] = {}
    """Part of the state that differs from a graph without a scene."""

    def __init__(self) -> None:
        self.windows = Windows()

    def choices(self) -> dict[str, list[str]]:
        return {"controller": ["none"], "surface": ["text"], "grip": ["hook"], "record": ["start"]}

    def state(self) -> dict[str, Any]:
        return {
            "nodes": [{"name": "recorder", "state": "OK", "message": ""}],
            "recorder": {},
            "controller": None,
            "surface": None,
            "grip": None,
            "scene": None,
            "led": False,
            "engaged": None,
            "stop": {"asked": False},
            "actuator": {"age_us": None, "due": None, "missed": None, "latest_us": None},
            "limits": {"force": 1.0, "travel": 1e-3, "assumed": True},
            **self.SHOWN,
        }


TONES_RATE = 1000
"""Samples per second of `Tones`, Hz."""


class Tones(QuietGraph):
    """Signals without a graph: a tone of desired acceleration, and another of the actual."""

    def __init__(self) -> None:
        super().__init__()
        self.amplitude = 3.0
        self.playing = True
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _play(self) -> None:
        start = time.time_ns()
        count = 0
        while self.playing:
            while count < (time.time_ns() - start) * TONES_RATE // NANOSECONDS:
                stamp = start + count * NANOSECONDS // TONES_RATE
                for ring, frequency in ((self.windows.desired, 80), (self.windows.handle, 200)):
                    phase = 2 * np.pi * frequency * count / TONES_RATE
                    ring.put(stamp, self.amplitude * np.sin(phase))
                count += 1
            time.sleep(0.005)


async def done(action: str, value: Any) -> str:
    """Carry out nothing, for pages whose commands do not matter."""
    return f"{action}: {value}"


@contextmanager
def chromium(sound: dict[str, str] | None = None) -> Iterator[Browser]:
    """Start Chromium; skip the test where it or its driver is missing.

    Parameters
    ----------
    sound : dict, optional
        Environment in which it finds a sound server, to which it plays; otherwise it is mute.
    """
    program = shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        program = None
    if program is None:
        reason = "no Chromium or no playwright"
        if os.environ.get(BROWSER) == "required":
            pytest.fail(reason)
        pytest.skip(reason)
    with sync_playwright() as player:
        browser = player.chromium.launch(
            executable_path=program,
            args=list(FLAGS),
            env={**sound} if sound else None,
            ignore_default_args=["--mute-audio"] if sound else None,
        )
        new_page = browser.new_page

        def patient_page(**options: Any) -> Page:
            page = new_page(**options)
            page.set_default_timeout(1e3 * PATIENCE)
            return page

        setattr(browser, "new_page", patient_page)  # noqa: B010
        yield browser
        browser.close()


@contextmanager
def opened(browser: Browser, address: str, script: str = "", **options: Any) -> Iterator[Page]:
    """Open a page; an error of its scripts fails the test.

    Parameters
    ----------
    script : str
        Script that runs before those of the page.
    """
    page = browser.new_page(**options)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.add_init_script(script)
    try:
        page.goto(address)
        yield page
    finally:
        page.close()
    assert complaints == []


@contextmanager
def shown(browser: Browser, source: Any, act: Act | None = None, **options: Any) -> Iterator[Page]:
    """Serve the live page, and open it as `opened` does."""
    server = ScopeServer(source, Access("127.0.0.1"), "127.0.0.1", 0, act)
    try:
        with opened(browser, server.start(), **options) as page:
            yield page
    finally:
        server.stop()


def violations(page: Page) -> list[str]:
    """Return what axe-core objects to on a page, also on a phone; skip the test without axe."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    wide = page.viewport_size
    assert wide
    found = []
    for size in (PHONE, wide):
        page.set_viewport_size(size)
        found += axe.run(page).response["violations"]
    return [
        f"{rule['help']}: {node['html']}: {node['failureSummary']}"
        for rule in found
        for node in rule["nodes"]
    ]
