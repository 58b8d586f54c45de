# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The scope as a process: beside a graph, and of a graph."""

from __future__ import annotations

import asyncio
import os
import signal

import aiohttp
import pytest

from browsing import messages
from running import Start, free_port, nodes_of


async def first_frames(address: str) -> int:
    """Look as a page does until samples have come; return how many bytes."""
    async for message in messages(address):
        if message.type is aiohttp.WSMsgType.BINARY and message.data[0] == 1:
            return len(message.data)
    raise AssertionError


@pytest.mark.slow
def test_the_graph_outlives_its_scope_and_another_takes_its_place(
    haptic_accel: Start, domain: int
) -> None:
    graph = haptic_accel("teleop", "rate:=250", "record:=false", "scope:=true", "scope_port:=0")
    graph.wait_for("engaged")
    graph.wait_for(r"\[scope\] http://127\.0\.0\.1:\d+/ \(read-only\)")
    os.kill(nodes_of(domain)["scope"], signal.SIGKILL)
    graph.wait_for("ended with status -9; the graph goes on without it")
    port = free_port()
    looking = haptic_accel("scope", f"port:={port}")
    assert asyncio.run(first_frames(looking.wait_for("http").split()[0])) > 0
    second = haptic_accel("scope", f"port:={port}")
    assert second.end() == 1
    assert [f"port = {port}" in line for line in second.lines if "scope:" in line] == [True]
    assert "Traceback" not in second.text
    assert looking.end(signal.SIGINT) == 0, looking.text
    assert graph.end(signal.SIGINT) == 0, graph.text


@pytest.mark.quiet
def test_an_address_for_others_is_printed_with_its_token(
    haptic_accel: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HAPTIC_ACCEL_SCOPE_TOKEN", "given")
    looking = haptic_accel("scope", "host:=0.0.0.0", "port:=0", "namespace:=/left")
    assert "/?token=given (read-only)" in looking.wait_for("http")
    assert looking.end(signal.SIGINT) == 0, looking.text
