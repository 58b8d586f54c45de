# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both hosts of a coupling live over a bad network: ``python benchmarks/two_hosts.py`` as root.

Each host is a network namespace of its own; the wire between them delays and loses frames.
"""

from __future__ import annotations

import ctypes
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from haptic_accel import Bag, ChannelParameters, GraphArguments, ParameterError, read_bag
from haptic_accel.analysis.loading import analyse
from haptic_accel.bags.delivery import count
from haptic_accel.commands import DONE, FAILED, Verb, json_option, run, save, words
from haptic_accel.core import TRANSPORTS, topics
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.kits.link.keys import FOLDERS
from haptic_accel.setup.arguments import parse_arguments

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "support"))

from wires import ADDRESSES, Wire, reason_against

HAPTIC_ACCEL = (sys.executable, "-m", "haptic_accel.cli.main")

OPERATOR, ROBOT = 0, 1
"""Ends of the wire."""

ENGAGED = "coupler]: engaged"
"""End of a coupler's line when its arms are coupled."""

SIDES = {OPERATOR: ("master", topics.MASTER), ROBOT: ("slave", topics.SLAVE)}

START_TIME = 60.0
"""Time that both graphs have to engage, s."""

QUIET = 3.0
"""Time without losses before and after they are counted, s: nodes report once a second."""

OUTAGE = 2.0
"""Time for which the cable is out, s."""

AFTER = 5.0
"""Time for which the graphs go on after they engaged again, s."""

SHORTEST = 5.0

_STAMP = re.compile(r"\] \[(\d+\.\d{9})\] \[")
"""System time in a line of a node's log, s."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


class Graph:
    """One host's graph.

    Parameters
    ----------
    wire : Wire
    end : int
        End of the wire.
    bag : Path
        Bag to record.
    words : sequence of str
        Arguments beside side, peer and bag.

    Attributes
    ----------
    lines : list of (float, str)
        What it printed, and when, s of system time: as a line says it, or else as it was read.
    """

    def __init__(self, wire: Wire, end: int, bag: Path, words: Sequence[str]) -> None:
        side, _ = SIDES[end]
        command = [*HAPTIC_ACCEL, "teleop", f"side:={side}", f"bag:={bag}"]
        self.lines: list[tuple[float, str]] = []
        self.begun = time.time()
        self._process = subprocess.Popen(
            wire.inside(end, [*command, f"peer:={ADDRESSES[1 - end]}", *words]),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=lambda: _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL),
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def engagements(self) -> list[float]:
        """Times at which it engaged."""
        return [moment for moment, line in list(self.lines) if line.endswith(ENGAGED)]

    @property
    def text(self) -> str:
        """All that it printed."""
        return "\n".join(line for _, line in list(self.lines))

    def engaged_since(self, moment: float) -> float:
        """Wait until it engages after a moment; return how long after it that is, s."""
        while not (later := [each for each in self.engagements if each > moment]):
            if self._process.poll() is not None or time.time() > moment + START_TIME:
                raise BenchmarkError(f"does not engage:\n{self.text}")
            time.sleep(0.02)
        return later[0] - moment

    def kill(self) -> None:
        """Kill all its processes at once."""
        parent = psutil.Process(self._process.pid)
        for process in [*parent.children(recursive=True), parent]:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self._process.wait()

    def end(self) -> None:
        """End it as with Ctrl-C."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(START_TIME)
            except subprocess.TimeoutExpired:
                self.kill()
        self._reader.join(START_TIME)

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            # On a busy machine a line is read long after it was written.
            stamp = _STAMP.search(line)
            self.lines.append((float(stamp[1]) if stamp else time.time(), line.rstrip("\n")))


class BenchmarkError(Exception):
    """A run that cannot go on."""


@dataclass
class Moments:
    """System times of what happened, ns."""

    begin: int = 0
    end: int = 0
    cut: int = 0
    killed: int = 0


@click.command(cls=Verb)
@words(GraphArguments)
@click.option("--seconds", type=float, default=60.0, help="Time in which losses are counted, s.")
@click.option("--delay", type=float, default=20.0, help="Mean one-way delay, ms.")
@click.option("--jitter", type=float, default=10.0, help="Largest deviation from it, ms.")
@click.option("--loss", type=float, default=0.05, help="Fraction of frames that are lost.")
@click.option(
    "--transport",
    "transports",
    type=click.Choice(TRANSPORTS),
    multiple=True,
    default=TRANSPORTS,
    help="Transport to measure; may come twice.",
)
@click.option("--keep", type=click.Path(path_type=Path), help="Folder for the bags and logs.")
@json_option
def two_hosts(
    words: Sequence[str],
    *,
    seconds: float,
    delay: float,
    jitter: float,
    loss: float,
    transports: Sequence[str],
    keep: Path | None,
    json_file: Path | None,
) -> int:
    """Run the graphs of two hosts over a bad network, pull the cable, and kill one of them.

    Takes arguments of the graph for both hosts, such as rate:=500.

    Prints how long the arms were coupled, what was lost and why, missed deadlines, the delay and
    the error of the acceleration, and the time to come back.
    """
    if reason := reason_against():
        raise ParameterError(f"no network between two hosts here: {reason}")
    if not seconds >= SHORTEST:
        raise ParameterError(f"seconds = {seconds:g}: must be at least {SHORTEST:g}")
    parse_arguments(words)
    network = ChannelParameters(delay / 1e3, jitter / 1e3, loss)
    results: dict[str, Any] = {}
    with ExitStack() as stack:
        folder = keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for transport in transports:
            place = folder / transport
            place.mkdir(parents=True)
            print(f"{transport}: about {seconds + 60:.0f} s", file=sys.stderr, flush=True)
            results[transport] = _measured(transport, words, seconds, network, place)
    Console().print(_table(results))
    for transport, found in results.items():
        if problem := found.get("failed"):
            print(f"{transport}: {problem}")
    given = {"seconds": seconds, "delay_ms": delay, "jitter_ms": jitter, "loss": loss}
    save({**given, "transports": results}, json_file)
    return FAILED if any("failed" in found for found in results.values()) else DONE


def _measured(
    transport: str,
    arguments: Sequence[str],
    seconds: float,
    network: ChannelParameters,
    folder: Path,
) -> dict[str, Any]:
    """Run both graphs; return the figures, as far as the run came."""
    words = [*arguments, "record:=true", f"transport:={transport}"]
    found: dict[str, Any] = {}
    moments = Moments()
    # Without jitter no packet is on its way while the next has come, and counts as lost.
    quiet = ChannelParameters(network.delay)
    with ExitStack() as stack:
        wire = stack.enter_context(Wire(quiet))
        keys = folder / "keys"
        made = [*HAPTIC_ACCEL, "keys", *ADDRESSES[::-1], "--out", str(keys)]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        own = [f"keys:={keys / name}" for name in reversed(FOLDERS)]
        if "insecure:=true" in arguments:
            own = ["keys:="] * 2

        def start(end: int, name: str) -> Graph:
            graph = Graph(wire, end, folder / name, [*words, own[end]])
            stack.callback(lambda: (folder / f"{name}.log").write_text(graph.text + "\n"))
            stack.callback(graph.end)
            return graph

        try:
            robot, operator = start(ROBOT, "robot"), start(OPERATOR, "operator")
            found["engaged_after_s"] = operator.engaged_since(operator.begun)
            robot.engaged_since(robot.begun)
            found |= _losing(wire, network, quiet, seconds, moments)
            found |= _cable_out(wire, operator, robot, moments)
            found |= _killed(operator, robot, lambda: start(ROBOT, "robot_again"), moments)
        except BenchmarkError as error:
            found["failed"] = str(error)
    return found | _figures(folder, moments, found)


def _losing(
    wire: Wire, network: ChannelParameters, quiet: ChannelParameters, seconds: float, at: Moments
) -> dict[str, Any]:
    """Lose frames for some time; return what the wire lost from either end."""
    time.sleep(QUIET)
    before, at.begin = wire.counts(), time.time_ns()
    wire.change(network)
    time.sleep(seconds)
    wire.change(quiet)
    at.end = time.time_ns()
    time.sleep(QUIET)
    after = wire.counts()
    lost = {}
    for end, (first, last) in enumerate(zip(before, after, strict=True)):
        kind = "packet" if last["sent"].get("packet") else "large"
        lost[SIDES[1 - end][0]] = last["lost"].get(kind, 0) - first["lost"].get(kind, 0)
    return {"lost_on_the_wire": lost}


def _cable_out(wire: Wire, operator: Graph, robot: Graph, at: Moments) -> dict[str, Any]:
    """Pull the cable and put it back."""
    at.cut = wire.cut()
    time.sleep(OUTAGE)
    mended = wire.mend() / NANOSECONDS
    back = max(graph.engaged_since(mended) for graph in (operator, robot))
    time.sleep(AFTER)
    return {"cable_out_s": OUTAGE, "engaged_after_cable_s": back}


def _killed(
    operator: Graph, robot: Graph, restart: Callable[[], Graph], at: Moments
) -> dict[str, Any]:
    """Kill the robot's graph and start another."""
    at.killed = time.time_ns()
    robot.kill()
    time.sleep(OUTAGE)
    again = restart()
    back = operator.engaged_since(again.begun)
    again.engaged_since(again.begun)
    linked = next((moment for moment, line in again.lines if line.startswith("[link]")), np.nan)
    time.sleep(AFTER)
    return {
        "engaged_after_restart_s": back,
        "engaged_after_restarted_link_s": again.begun + back - linked,
    }


def _figures(folder: Path, at: Moments, found: dict[str, Any]) -> dict[str, Any]:
    """Return what the bags show."""
    bags = {OPERATOR: folder / "operator", ROBOT: folder / "robot"}
    figures: dict[str, Any] = {}
    for end, path in bags.items():
        side, arm = SIDES[end]
        try:
            bag = read_bag(path)
        except ParameterError as error:
            return {"failed": found.get("failed", str(error))}
        stretches = bag.coupled(arm)
        own: dict[str, Any] = {"engaged_share": _share(stretches, at.begin, at.end)}
        own |= _counted(bag, at)
        own["reports"] = _last_report(bag, at.end)
        for name, moment in (("cable", at.cut), ("kill", at.killed)):
            if moment and (end == OPERATOR or name == "cable"):
                own[f"zero_force_after_{name}_s"] = _released(stretches, moment)
        own["lost_on_the_wire"] = found.get("lost_on_the_wire", {}).get(side, 0)
        # With zenoh also what the link left out, as the network took less.
        own["lost_unexplained"] = own["packets_lost"] - own["lost_on_the_wire"]
        figures[side] = own
    analysis = analyse([*bags.values()])
    figures["across"] = [vars(each) for each in analysis.across[:1]]
    figures["trial"] = [trial.metrics for trial in analysis.trials[:1]]
    figures["problems"] = analysis.problems
    return figures


def _share(stretches: Sequence[tuple[int, int]], begin: int, end: int) -> float:
    """Return the part of a time in which the arm was coupled."""
    inside = (min(last, end) - max(first, begin) for first, last in stretches)
    return sum(max(0, length) for length in inside) / max(1, end - begin)


def _released(stretches: Sequence[tuple[int, int]], moment: int) -> float | None:
    """Return how long after a moment the last force came that is not zero, s."""
    ends = [last for first, last in stretches if first <= moment <= last]
    return (ends[0] - moment) / NANOSECONDS if ends else None


def _counted(bag: Bag, at: Moments) -> dict[str, int]:
    """Return what the nodes counted from shortly before the losses until shortly after."""
    found: dict[str, int] = {"packets_lost": 0, "packets_received": 0}
    for node in dict.fromkeys(report.node for report in bag.diagnostics):
        reports = [report for report in bag.diagnostics if report.node == node]
        before = [r.values for r in reports if r.received <= at.begin][-1:]
        until = at.end + round((QUIET - 0.2) * NANOSECONDS)
        after = [r.values for r in reports if r.received <= until][-1:]
        for first, last in zip(before, after, strict=False):
            for name in last:
                if name.startswith("packets ") or name.endswith((" due", "deadlines missed")):
                    key = name.replace(" ", "_")
                    found[key] = found.get(key, 0) + count(last, name) - count(first, name)
    return found


def _last_report(bag: Bag, moment: int) -> dict[str, str]:
    """Return what the coupler reported last before a moment."""
    reports = [r for r in bag.diagnostics if r.node == "coupler" and r.received <= moment]
    return reports[-1].values if reports else {}


def _table(results: dict[str, Any]) -> Table:
    table = Table(title="two hosts")
    table.add_column("")
    rows: dict[str, list[str]] = {}
    for transport, found in results.items():
        table.add_column(transport, justify="right")
        for name, value in _flat(found):
            rows.setdefault(name, [""] * len(results))[list(results).index(transport)] = value
    for name, values in rows.items():
        table.add_row(name, *values)
    return table


def _flat(found: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return names and texts of all figures, those in parts with the part's name before."""
    if isinstance(found, dict):
        parts = [(f"{prefix} {name}".strip(), value) for name, value in found.items()]
        return [row for name, value in parts if name != "problems" for row in _flat(value, name)]
    if isinstance(found, list):
        return [row for value in found[:1] for row in _flat(value, prefix)]
    if isinstance(found, float | np.floating):
        return [(prefix, f"{found:.4g}")]
    return [(prefix, str(found))] if prefix != "failed" else []


if __name__ == "__main__":
    run(two_hosts, "two_hosts.py")
