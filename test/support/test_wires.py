# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the bad wire by echoed datagrams."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from haptic_accel.core.network import ChannelParameters
from running import wait_until
from wires import ADDRESSES, Wire, reason_against

NEEDS_NETWORK = pytest.mark.skipif(bool(reason_against()), reason=reason_against() or "")

PORT = 7700

ECHO = f"""
import socket
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as echo:
    echo.bind(("0.0.0.0", {PORT}))
    print("ready", flush=True)
    while True:
        echo.sendto(*echo.recvfrom(2048))
"""

PING = f"""
import json, select, socket, sys, time
count, period, rest = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
found, start = [], time.monotonic()
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ping:
    ping.connect(("{ADDRESSES[1]}", {PORT}))
    for number in range(count + 1):
        until = start + (number + 1) * period + (rest if number == count else 0)
        if number < count:
            ping.send(b"%d %f" % (number, time.monotonic()))
        while (left := until - time.monotonic()) > 0:
            if select.select([ping], [], [], left)[0]:
                place, sent = ping.recv(2048).split()
                found.append((int(place), time.monotonic() - float(sent)))
print(json.dumps(found))
"""
"""Program that sends datagrams at a period, and prints number and round trip of echoes."""


@pytest.fixture
def wire() -> Iterator[Wire]:
    if reason := reason_against():
        pytest.skip(reason)
    with Wire(seed=3) as wire:
        words = wire.inside(1, [sys.executable, "-c", ECHO])
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as echo:
            assert echo.stdout
            echo.stdout.readline()
            yield wire
            echo.kill()


def pinged(wire: Wire, count: int, period: float = 2e-3, rest: float = 0.3) -> list[list[float]]:
    """Return number and round trip, s, of each returned datagram, in order."""
    words = [sys.executable, "-c", PING, str(count), str(period), str(rest)]
    run = subprocess.run(wire.inside(0, words), capture_output=True, text=True, check=True)
    found: list[list[float]] = json.loads(run.stdout)
    return found


def test_a_wire_that_adds_nothing_carries_every_datagram_in_its_order(wire: Wire) -> None:
    assert [number for number, _ in pinged(wire, 300)] == [*range(300)]
    assert [counts["sent"] for counts in wire.counts()] == [{"small": 300}] * 2


def test_each_direction_adds_its_own_delay(wire: Wire) -> None:
    wire.change(ChannelParameters(delay=0.02), ChannelParameters(delay=0.05))
    trips = [trip for _, trip in pinged(wire, 100)]
    assert len(trips) == 100
    assert 0.07 <= min(trips) < 0.09


def test_losses_are_as_many_as_asked_for_and_are_counted(wire: Wire) -> None:
    wire.change(ChannelParameters(loss=0.2), ChannelParameters(duplication=0.5))
    numbers = [number for number, _ in pinged(wire, 1000, 1e-3)]
    arrived = len(set(numbers))
    assert arrived == pytest.approx(800, abs=4 * np.sqrt(1000 * 0.16))
    assert len(numbers) == pytest.approx(1.5 * arrived, rel=0.15)
    there = wire.counts()[0]
    assert there["sent"]["small"] - there["lost"]["small"] == arrived


def test_a_cut_wire_carries_nothing_until_it_is_mended(wire: Wire) -> None:
    wire.change(ChannelParameters(delay=0.01))
    wire.cut()
    assert pinged(wire, 20) == []
    wire.mend()
    found = pinged(wire, 20)
    assert len(found) == 20
    assert min(trip for _, trip in found) >= 0.02


def test_the_hosts_reach_each_other_and_nobody_else(wire: Wire) -> None:
    for end in (0, 1):
        words = wire.inside(end, ["ip", "-json", "route"])
        routes = subprocess.run(words, capture_output=True, text=True, check=True)
        assert [route["dst"] for route in json.loads(routes.stdout)] == ["10.77.0.0/24"]


@NEEDS_NETWORK
def test_nothing_is_left_of_a_wire_whose_owner_is_killed() -> None:
    program = "import time, wires; wire = wires.Wire(); print(wire.process.pid); time.sleep(99)"
    owner = subprocess.Popen(
        [sys.executable, "-u", "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    with owner:
        assert owner.stdout
        process = int(owner.stdout.readline())
        owner.send_signal(signal.SIGKILL)
    wait_until(lambda: not Path(f"/proc/{process}").exists(), "the wire has ended")
