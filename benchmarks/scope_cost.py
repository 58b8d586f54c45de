# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cost of the live scope for the graph that it shows: ``python benchmarks/scope_cost.py``."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

import aiohttp
import click
from rich.console import Console
from rich.table import Table

from haptic_accel import GraphArguments, ParameterError
from haptic_accel.bags import AGE_OF
from haptic_accel.bags.delivery import LABELS, durations, read_delivery
from haptic_accel.cli.bench import Usage
from haptic_accel.cli.running import run_to_end
from haptic_accel.commands import DONE, Row, Verb, json_option, run, save, stop_on_signal, words
from haptic_accel.graph.supervisor import Supervisor
from haptic_accel.setup import graph
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.setup import SCOPE

SHORTEST = 3.0
"""Shortest length of a run, s: the page needs some time to connect."""

CLOSING_TIME = 5.0
"""Time that a page may take to close, s."""

BROWSER_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
)

Stop = Callable[[], bool]


class Client:
    """Client that receives what a page receives, but draws nothing.

    Parameters
    ----------
    address : str
        Address of the page.

    Attributes
    ----------
    frames, bytes : int
        Received so far.
    seconds : float
        Duration of receiving, s.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self.frames = self.bytes = 0
        self.seconds = 0.0
        self._thread = threading.Thread(target=lambda: asyncio.run(self._look()), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait until the scope has closed the connection."""
        self._thread.join(CLOSING_TIME)

    async def _look(self) -> None:
        headers = {"Origin": self._address.rstrip("/")}
        with suppress(aiohttp.ClientError):
            async with (
                aiohttp.ClientSession(headers=headers) as session,
                session.ws_connect(f"{self._address}live") as live,
            ):
                begun = time.monotonic()
                async for message in live:
                    self.frames += message.type is aiohttp.WSMsgType.BINARY
                    self.bytes += len(message.data)
                    self.seconds = time.monotonic() - begun


class Browser:
    """Headless browser that draws the page without a graphics card.

    Parameters
    ----------
    program : str
        Path of a Chromium.
    address : str
        Address of the page.
    """

    def __init__(self, program: str, address: str) -> None:
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._process = subprocess.Popen(
            [program, *BROWSER_FLAGS, f"--user-data-dir={self._folder.name}", address],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait(CLOSING_TIME)
        self._folder.cleanup()


@click.command(cls=Verb)
@words(GraphArguments)
@click.option("--seconds", type=float, default=20.0, help="Length of each run, s.")
@click.option("--rounds", type=int, default=2, help="Number of runs without and with a scope.")
@click.option(
    "--browser",
    default="",
    metavar="PROGRAM",
    help="Chromium that shows the page; without one the frames are received and not drawn.",
)
@json_option
def scope_cost(
    words: Sequence[str], *, seconds: float, rounds: int, browser: str, json_file: Path | None
) -> int:
    """Measure the cost of the live scope for the graph.

    Runs the graph without and with a scope that shows it, in turns. Prints the age of the
    forces and the CPU of both, and the data rate of the scope.
    """
    arguments = _arguments(words, seconds, rounds)
    shown = replace(arguments, scope=True, scope_port=0)
    runs: dict[str, list[Row]] = {"without": [], "with": []}
    with stop_on_signal() as stop:
        for index in range(rounds):
            for name, given in (("without", arguments), ("with", shown)):
                print(f"round {index + 1} of {rounds}: {name} the scope", file=sys.stderr)
                runs[name].append(_measured(given, browser, stop))
    Console().print(_table(runs, seconds))
    save({"seconds": seconds, "browser": browser, **runs}, json_file)
    return DONE


def _arguments(words: Sequence[str], seconds: float, rounds: int) -> GraphArguments:
    for key in ("duration", "bag", "record", "scope", "scope_port"):
        if any(word.startswith(f"{key}:=") for word in words):
            raise ParameterError(f"{key}: set by the benchmark")
    if not seconds >= SHORTEST:
        raise ParameterError(f"seconds = {seconds:g}: must be at least {SHORTEST:g}")
    if rounds < 1:
        raise ParameterError(f"rounds = {rounds}: must be at least 1")
    return replace(parse_arguments(words), duration=seconds)


def _measured(arguments: GraphArguments, browser: str, stop: Stop) -> Row:
    """Run one graph, with a client if it has a scope; return its metrics."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as closing:
        given = replace(arguments, bag=str(Path(folder) / "bag"))
        usage, supervisor = Usage(1), Supervisor(graph(given))
        clients: list[Client | Browser] = []

        def take_line(name: str, line: str) -> None:
            if name == SCOPE and line.startswith("http"):
                address = line.split()[0]
                client = Browser(browser, address) if browser else Client(address)
                clients.append(client)
                closing.callback(client.close)

        supervisor.on_line = take_line
        supervisor.on_event = lambda _, event: usage.watch(supervisor, event)
        run_to_end(supervisor, stop)
        master = read_delivery(Path(given.bag), given.rate).nodes["master_device"]
    metrics: Row = {
        "age_us": durations(master, f"{AGE_OF} age"),
        "deadlines_missed": int(master[f"{AGE_OF} deadlines missed"]),
        "cpu_cores": usage.cpu_cores,
    }
    return {**metrics, "sent": _sent(clients[0])} if clients else metrics


def _sent(client: Client | Browser) -> dict[str, float]:
    """Return the data rate, if it was counted."""
    if isinstance(client, Browser) or not client.seconds:
        return {}
    return {
        "frames_per_s": client.frames / client.seconds,
        "bytes_per_s": client.bytes / client.seconds,
    }


def _table(runs: dict[str, list[Row]], seconds: float) -> Table:
    rounds = len(runs["with"])
    table = Table(title=f"age of the force where it is applied, us; {rounds} x {seconds:g} s each")
    for heading in ("scope", *LABELS, "cores, all", "scope alone"):
        table.add_column(heading, justify="left" if heading == "scope" else "right")
    for name, found in runs.items():
        for index, metrics in enumerate(found):
            table.add_row(f"{name}, round {index + 1}", *_cells([metrics]))
        table.add_row(f"{name}, mean", *_cells(found), end_section=True)
    sent = [metrics["sent"] for metrics in runs["with"] if metrics.get("sent")]
    if sent:
        frames, size = (fmean(one[key] for one in sent) for key in ("frames_per_s", "bytes_per_s"))
        table.caption = f"sent: {frames:.0f} frames, {size / 1e3:.0f} kB a second"
        table.caption_justify = "left"
    return table


def _cells(runs: Sequence[Row]) -> list[str]:
    ages = [f"{fmean(run['age_us'][label] for run in runs):.0f}" for label in LABELS]
    cores = [_cores(runs, name) for name in ("total", SCOPE)]
    return [*ages, *cores]


def _cores(runs: Sequence[Row], name: str) -> str:
    known: list[Any] = [run["cpu_cores"][name] for run in runs if name in run["cpu_cores"]]
    return f"{fmean(known):.3f}" if known else "-"


if __name__ == "__main__":
    run(scope_cost, "scope_cost.py")
