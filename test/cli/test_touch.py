# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel touch``: the page of a simulated rig, without ROS."""

from __future__ import annotations

import asyncio
import json
import signal
from pathlib import Path

import aiohttp
import pytest

from browsing import messages
from running import Start, wait_until

WITHOUT_ROS = """
import sys
sys.modules |= dict.fromkeys(["rclpy", "launch", "ament_index_python", "std_msgs"])
from haptic_accel.cli.main import main
main(["touch", "--no-open", "--surface", "text"])
"""
"""Command on a machine that has no ROS 2."""


async def shown(address: str, name: str = "nrmse_percent") -> dict[str, object]:
    """Look as a page does until the rig's signals have a metric; return the state."""
    async for message in messages(address):
        if message.type is aiohttp.WSMsgType.TEXT:
            state: dict[str, object] = json.loads(message.data)
            if name in state["metrics"]:  # type: ignore[operator]
                return state
    raise AssertionError


@pytest.mark.quiet
def test_a_surface_is_touched_without_ros(start: Start) -> None:
    touching = start("-c", WITHOUT_ROS)
    state = asyncio.run(shown(touching.wait_for("http").split()[0]))
    assert (state["surface"], state["controller"], state["led"]) == ("text", "adaptive", True)
    assert touching.end(signal.SIGINT) == 0, touching.text
    assert "Traceback" not in touching.text


@pytest.mark.quiet
@pytest.mark.parametrize("screen", ["", ":7"])
def test_the_page_is_opened_where_there_is_a_screen(
    haptic_accel: Start, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, screen: str
) -> None:
    browser = tmp_path / "browser"
    browser.write_text(f"#!/bin/sh\necho $1 > {tmp_path}/opened\n")
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(browser))
    monkeypatch.setenv("DISPLAY", screen)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    touching = haptic_accel("touch")
    address = touching.wait_for("http").split()[0]
    asyncio.run(shown(address, "rate"))
    opened = tmp_path / "opened"
    if screen:
        wait_until(lambda: opened.exists() and opened.read_text().strip() == address, "a browser")
    assert touching.end(signal.SIGINT) == 0, touching.text
    assert opened.exists() == bool(screen)
