"""``haptic-accel bench scope``: what the live scope costs the graph that it shows."""

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

from haptic_accel.bags.delivery import AGE_OF, LABELS, durations, read_delivery
from haptic_accel.cli.bench import Figures, Usage
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import Verb, json_option, words
from haptic_accel.cli.output import save
from haptic_accel.cli.running import StopOnSignal, conclude
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, FAILED, INTERRUPTED
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import SCOPE, graph
from haptic_accel.graph.supervisor import Supervisor

SHORTEST = 3.0
"""Length of a run, s: the scope needs some until it is looked at."""

FORGETTING = 5.0
"""How long a page may take to end, s."""

BROWSER_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
)

Stop = Callable[[], bool]


class Spectator:
    """Takes what the scope sends, as a page does, but draws nothing.

    Parameters
    ----------
    address : str
        Of the page.

    Attributes
    ----------
    frames, bytes : int
        What came.
    seconds : float
        In which it came.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self.frames = self.bytes = 0
        self.seconds = 0.0
        self._thread = threading.Thread(target=lambda: asyncio.run(self._look()), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Wait until the scope has said goodbye."""
        self._thread.join(FORGETTING)

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


class BrowserSpectator:
    """A headless browser with the page, which draws it without a graphics card.

    Parameters
    ----------
    program : str
        A Chromium.
    address : str
        Of the page.
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
        self._process.wait(FORGETTING)
        self._folder.cleanup()


@click.command(cls=Verb, name="scope")
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
def watched(
    words: Sequence[str], *, seconds: float, rounds: int, browser: str, json_file: Path | None
) -> int:
    """Measure the cost of the live scope for the graph.

    Runs the graph without and with a scope that shows it, in turns. Prints the age of the
    forces and the CPU of both, and the data rate of the scope.
    """
    arguments = _arguments(words, seconds, rounds)
    looked = replace(arguments, scope=True, scope_port=0)
    runs: dict[str, list[Figures]] = {"without": [], "with": []}
    try:
        with StopOnSignal() as stop:
            for index in range(rounds):
                for name, given in (("without", arguments), ("with", looked)):
                    print(f"round {index + 1} of {rounds}: {name} the scope", file=sys.stderr)
                    runs[name].append(_measured(given, browser, stop))
    except StoppedError as reason:
        return reason.status
    Console().print(_table(runs, seconds))
    save({"seconds": seconds, "browser": browser, **runs}, json_file)
    return DONE


def _arguments(words: Sequence[str], seconds: float, rounds: int) -> GraphArguments:
    for key in ("duration", "bag", "record", "scope", "scope_port", "scope_host"):
        if any(word.startswith(f"{key}:=") for word in words):
            raise ParameterError(f"{key}: set by the benchmark")
    if not seconds >= SHORTEST:
        raise ParameterError(f"seconds = {seconds:g}: must be at least {SHORTEST:g}")
    if rounds < 1:
        raise ParameterError(f"rounds = {rounds}: must be at least 1")
    return replace(parse_arguments(words), duration=seconds)


def _measured(arguments: GraphArguments, browser: str, stop: Stop) -> Figures:
    """Run one graph, with somebody who looks if it has a scope; return its figures."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as leaving:
        given = replace(arguments, bag=str(Path(folder) / "bag"))
        usage, supervisor = Usage(1), Supervisor(graph(given))
        lookers: list[Spectator | BrowserSpectator] = []

        def hear(name: str, line: str) -> None:
            usage.watch(supervisor, line)
            if name == SCOPE and line.startswith("http"):
                address = line.split()[0]
                looker = BrowserSpectator(browser, address) if browser else Spectator(address)
                lookers.append(looker)
                leaving.callback(looker.close)

        supervisor.on_line = hear
        outcome = supervisor.run(stop)
        if not outcome.first:
            raise StoppedError(INTERRUPTED)
        if conclude(outcome) != DONE:
            raise StoppedError(FAILED)
        master = read_delivery(Path(given.bag), given.rate).nodes["master_device"]
    figures: Figures = {
        "age_us": durations(master, f"{AGE_OF} age"),
        "late": int(master[f"{AGE_OF} late"]),
        "cpu_cores": usage.cpu_cores,
    }
    return {**figures, "sent": _sent(lookers[0])} if lookers else figures


def _sent(looker: Spectator | BrowserSpectator) -> dict[str, float]:
    """Return what was sent a second, where it was counted."""
    if isinstance(looker, BrowserSpectator) or not looker.seconds:
        return {}
    return {
        "frames_per_s": looker.frames / looker.seconds,
        "bytes_per_s": looker.bytes / looker.seconds,
    }


def _table(runs: dict[str, list[Figures]], seconds: float) -> Table:
    rounds = len(runs["with"])
    table = Table(title=f"age of the force where it is applied, us; {rounds} x {seconds:g} s each")
    for heading in ("scope", *LABELS, "cores, all", "of the scope"):
        table.add_column(heading, justify="left" if heading == "scope" else "right")
    for name, found in runs.items():
        for index, figures in enumerate(found):
            table.add_row(f"{name}, round {index + 1}", *_cells([figures]))
        table.add_row(f"{name}, mean", *_cells(found), end_section=True)
    sent = [figures["sent"] for figures in runs["with"] if figures.get("sent")]
    if sent:
        frames, size = (fmean(one[key] for one in sent) for key in ("frames_per_s", "bytes_per_s"))
        table.caption = f"sent: {frames:.0f} frames, {size / 1e3:.0f} kB a second"
        table.caption_justify = "left"
    return table


def _cells(runs: Sequence[Figures]) -> list[str]:
    ages = [f"{fmean(run['age_us'][label] for run in runs):.0f}" for label in LABELS]
    cores = [_cores(runs, name) for name in ("total", SCOPE)]
    return [*ages, *cores]


def _cores(runs: Sequence[Figures], name: str) -> str:
    known: list[Any] = [run["cpu_cores"][name] for run in runs if name in run["cpu_cores"]]
    return f"{fmean(known):.3f}" if known else "-"
