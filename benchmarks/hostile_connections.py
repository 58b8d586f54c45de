# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time of a stop beside whoever would hold it up: ``python benchmarks/hostile_connections.py``."""

from __future__ import annotations

import asyncio
import http.client
import multiprocessing
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from haptic_accel.commands import DONE, FAILED, Row, Verb, json_option, run, save
from haptic_accel.scope import Access, ScopeServer, Windows

HOST = "127.0.0.1"
TOKEN = "a-token-of-the-benchmark"

LONGEST = 0.3
"""Time in which a stop must be confirmed, or signalled by the command, on an idle machine, s."""

STALL = 2.0
"""Time for which the page's process is stopped while a stop waits, s."""

DOMAIN = 101
"""ROS domain of the command's trials, in which nothing else runs."""

STOP_TIME = 10.0
"""Time after which a stop has failed, s."""

SETTLING_TIME = 2.0
"""Time from the start of the hostile connections to the first stop, s."""

PAUSE = 0.02
"""Pause between two stops, s."""

WRITING_PAUSE = 0.1
"""Pause between two bytes of a slow body, s."""


class Nothing:
    """Signals and scene of a page on which nothing happens."""

    windows = Windows()

    def choices(self) -> dict[str, list[str]]:
        """Return the choices of a graph's page."""
        return {"controller": [], "surface": [], "grip": [], "record": []}

    def state(self) -> dict[str, Any]:
        """Return no state."""
        return {}

    def scene(self) -> dict[str, Any]:
        """Return no scene."""
        return {}

    def lead(self, x: float, z: float) -> str:
        """Lead no hand."""
        return ""


async def confirm(action: str, value: Any) -> str:
    """Confirm any command at once."""
    return f"{action}: {value}"


Hostile = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


def request(line: str, *headers: str) -> bytes:
    """Return a request of no body, with the fields that a browser would send."""
    fields = (f"Host: {HOST}", f"Origin: http://{HOST}", *headers)
    return "\r\n".join((line, *fields, "", "")).encode()


UPGRADE = (
    "Connection: Upgrade",
    "Upgrade: websocket",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
)
BODY = ("Content-Type: application/json", "Content-Length: 4000")


async def half_header(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send half a header, and wait."""
    writer.write(b"GET / HTTP/1.1\r\nHost: loc")
    await reader.read()


async def slow_body(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send a command byte by byte."""
    writer.write(request("POST /command HTTP/1.1", *BODY))
    while not reader.at_eof() and not writer.is_closing():
        writer.write(b"{")
        await writer.drain()
        await asyncio.sleep(WRITING_PAUSE)


async def whole_command(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Send commands that do nothing, as often as they are answered."""
    asked = request("POST /command HTTP/1.1", BODY[0], "Content-Length: 2") + b"{}"
    while not reader.at_eof() and not writer.is_closing():
        writer.write(asked)
        if not await reader.read(2**16):
            return


async def slow_reader(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Ask for a script many times, and read hardly anything of it."""
    for _ in range(50):
        writer.write(request("GET /scope.js HTTP/1.1"))
    await writer.drain()
    while await reader.read(1):
        await asyncio.sleep(WRITING_PAUSE)


async def silent_websocket(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Ask for the signals, and wait."""
    writer.write(request("GET /live HTTP/1.1", *UPGRADE))
    while await reader.read(2**16):
        pass


async def idler(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Ask for the page once, and keep the connection."""
    writer.write(request("GET / HTTP/1.1"))
    while await reader.read(2**16):
        pass


async def flood(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Close a connection as soon as it is there."""


KINDS: dict[str, Hostile] = {
    each.__name__: each
    for each in (
        half_header,
        slow_body,
        whole_command,
        slow_reader,
        silent_websocket,
        idler,
        flood,
    )
}
"""Hostile uses of a connection, by name; each connection is renewed when it ends."""


async def _renew(port: int, use: Hostile) -> None:
    while True:
        with suppress(OSError):
            reader, writer = await asyncio.open_connection(HOST, port)
            with suppress(OSError):
                await use(reader, writer)
            writer.close()
        await asyncio.sleep(0)


async def _attack(port: int, kinds: list[str], connections: int) -> None:
    uses = [KINDS[kinds[index % len(kinds)]] for index in range(connections)]
    await asyncio.gather(*(_renew(port, use) for use in uses))


def _run_attack(port: int, kinds: list[str], connections: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, 4 * connections), hard), hard))
    asyncio.run(_attack(port, kinds, connections))


def _run_server(token: str, sending: Connection) -> None:
    server = ScopeServer(Nothing(), Access(HOST, token), HOST, 0, confirm)
    sending.send(server.start())
    time.sleep(1e9)


@contextmanager
def process(target: Callable[..., None], *arguments: Any) -> Iterator[int]:
    """Run a function in a process of its own, which is killed at the end; yield its number."""
    running = multiprocessing.get_context("spawn").Process(target=target, args=arguments)
    running.start()
    try:
        yield running.pid or 0
    finally:
        running.kill()
        running.join()


@contextmanager
def served(token: str) -> Iterator[tuple[int, int]]:
    """Serve a page in a process of its own; yield its port and the process' number."""
    receiving, sending = multiprocessing.get_context("spawn").Pipe(duplex=False)
    with process(_run_server, token, sending) as number:
        yield int(receiving.recv().split(":")[2].split("/")[0]), number


def stop(port: int, token: str) -> float:
    """Give the stop by a new connection; return the time until it is confirmed, s.

    Raises
    ------
    OSError, http.client.HTTPException
        It is not confirmed.
    """
    begun = time.monotonic()
    connection = http.client.HTTPConnection(HOST, port, timeout=STOP_TIME)
    try:
        headers = {"Content-Type": "application/json", "Origin": f"http://{HOST}:{port}"}
        if token:
            headers["Authorization"] = f"Bearer {token}"
        connection.request("POST", "/command", '{"action": "estop", "value": true}', headers)
        if (answer := connection.getresponse()).status != 200:
            raise ConnectionError(f"{answer.status} {answer.read().decode()}")
    finally:
        connection.close()
    return time.monotonic() - begun


def times(trials: int, give: Callable[[], float]) -> list[float]:
    """Return the time of each stop, s; infinity for one that failed."""
    found = []
    for _ in range(trials):
        try:
            found.append(give())
        except (OSError, http.client.HTTPException, subprocess.SubprocessError) as error:
            print(f"stop: {error or type(error).__name__}", file=sys.stderr)
            found.append(float("inf"))
        time.sleep(PAUSE)
    return found


def stop_in_a_stall(port: int, token: str, server: int) -> float:
    """Give the stop while a server is stopped; return the time from there, s, as `stop` does."""
    os.kill(server, signal.SIGSTOP)
    ending = threading.Timer(STALL, os.kill, (server, signal.SIGCONT))
    ending.start()
    try:
        return stop(port, token) - STALL
    finally:
        ending.join()


def _run_node(sending: Connection) -> None:
    """Send a signal of a graph, and tell when the stop is signalled."""
    from haptic_accel.core.process import EMERGENCY
    from haptic_accel.graph.domain import lock_signal

    signal.signal(EMERGENCY, lambda *_: sending.send(time.monotonic()))
    with lock_signal(DOMAIN, "/master/servo_cf"):
        sending.send(0.0)
        while True:
            signal.pause()


@contextmanager
def signalled(odd: int) -> Iterator[Callable[[], float]]:
    """Yield a function that stops a node by the command and returns the time until its signal, s.

    Beside the node there are a FIFO where the pending stop is left, and sockets with odd names.
    """
    from haptic_accel.graph.stop_signal import PENDING

    place = f"{PENDING}-{os.stat('/proc/self/ns/net').st_ino}-{DOMAIN}"
    receiving, sending = multiprocessing.get_context("spawn").Pipe(duplex=False)
    command = [sys.executable, "-m", "haptic_accel.cli.main", "estop"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}

    def give() -> float:
        begun = time.monotonic()
        with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as giving:
            try:
                if not receiving.poll(STOP_TIME):
                    raise subprocess.TimeoutExpired(command, STOP_TIME)
                return float(receiving.recv()) - begun
            finally:
                giving.kill()

    with ExitStack() as closing:
        os.mkfifo(place)
        closing.callback(os.unlink, place)
        for number in range(odd):
            stranger = closing.enter_context(socket.socket(socket.AF_UNIX))
            kind = (b"evil\n\nname", b"haptic_accel/%d/sender/" % DOMAIN)[number % 2]
            stranger.bind(b"\0%s%d" % (kind, number))
            stranger.listen()
        closing.enter_context(process(_run_node, sending))
        receiving.recv()
        yield give


@click.command(cls=Verb)
@click.option("--connections", type=click.IntRange(1, 10000), default=1000, help="At a time.")
@click.option("--trials", type=click.IntRange(1), default=100, help="Stops beside each kind.")
@click.option("--token/--no-token", "guarded", default=True, help="Page with a token, or without.")
@json_option
def hostile_connections(
    *, connections: int, trials: int, guarded: bool, json_file: Path | None
) -> int:
    """Measure the time of a stop from a page and from the command beside whoever would hold it up.

    Connections without the token send half headers, slow bodies and whole commands, read slowly,
    ask for signals, stay idle, or come and go. Each is renewed when the page closes it. Each stop
    uses a connection of its own. The page's process is stopped for 2 s while a stop waits. The
    command signals a node beside sockets with odd names and a FIFO. Exit status 1: a stop took
    longer than 0.3 s.
    """
    token = TOKEN if guarded else ""
    rows: list[Row] = []

    def note(name: str, give: Callable[[], float]) -> None:
        found = times(trials, give)
        late = sum(each > LONGEST for each in found)
        typical, longest = median(found), max(found)
        rows.append({"hostile": name, "median_s": typical, "max_s": longest, "late": late})

    for name, kinds in {"none": [], **{kind: [kind] for kind in KINDS}, "all": [*KINDS]}.items():
        count = connections if kinds else 0
        with served(token) as (port, _), process(_run_attack, port, kinds, count):
            time.sleep(SETTLING_TIME)
            note(name, partial(stop, port, token))
    with served(token) as (port, server):
        note("stall", partial(stop_in_a_stall, port, token, server))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, 2 * connections), hard), hard))
    with signalled(connections) as give:
        note("command", give)
    table = Table("hostile", "median, ms", "longest, ms", f"beyond {LONGEST} s")
    for row in rows:
        milliseconds = (f"{1e3 * float(row[key]):.1f}" for key in ("median_s", "max_s"))
        table.add_row(str(row["hostile"]), *milliseconds, f"{row['late']} of {trials}")
    Console().print(table)
    save({"connections": connections, "trials": trials, "token": guarded, "rows": rows}, json_file)
    return FAILED if any(row["late"] for row in rows) else DONE


if __name__ == "__main__":
    run(hostile_connections, "hostile_connections.py")
