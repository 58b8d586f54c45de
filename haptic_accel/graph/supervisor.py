# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Supervisor that starts the graph's processes, monitors them, and ends them all."""

# This module replaces the library honcho, whose forked intermediate processes survive if honcho is
# killed. Honcho also reports no last lines, and raises an exception for a signal at its start.

from __future__ import annotations

import os
import queue
import signal
import subprocess
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from haptic_accel.core.outside import node_module
from haptic_accel.core.process import (
    EMERGENCY,
    SUPERVISOR,
    WELL,
    module_command,
    read_event,
    signals,
)
from haptic_accel.graph.domain import check_ros
from haptic_accel.graph.stop_signal import DOMAIN
from haptic_accel.setup.processes import RESPAWN_DELAY, Process

LAST_LINES = 20
"""Number of last lines shown for a dead process."""

WAITING_LINES = 1000
"""Maximum number of lines that wait for a blocked terminal; more are dropped."""

OUTPUT_TIME = 1.0
"""Longest time that the end of a graph waits for lines to be shown, s."""

KILL = 9
"""Number of SIGKILL, which not every system has."""

QUIET_END, LATE_END, LAST_END, KILLING = 3.0, 7.0, 60.0, 5.0
"""Time-outs for the end of a process, s: before its lateness is logged; then before it is killed;
the same for the process that ends last, which may write to a slow disk; and after the kill."""

_STOPPED = {*WELL, *(-number for number in signals("SIGTERM", "SIGALRM"))}
"""Exit statuses of a stopped process that count as no failure: after SIGTERM, and if its
middleware hung (SIGALRM)."""

END_CHECK_PERIOD = 0.1
"""Interval between checks for the end of a process and a request to stop, s."""


@dataclass(frozen=True)
class Outcome:
    """End of a graph.

    Attributes
    ----------
    first : str
        Process that ended first by itself; empty when the graph was stopped from outside.
    status : int
        Exit status of the first process, negative for a signal; 0 if stopped from outside.
    statuses : dict
        Exit status of each process by `Process.name`. Excluded are optional processes, and those
        killed after the processes that end last had saved everything.
    last_lines : dict
        Last lines of output of each process.
    unread : OSError, SystemExit or None
        Error that prevented further output, for which the graph was stopped.
    """

    first: str
    status: int
    statuses: dict[str, int]
    last_lines: dict[str, list[str]]
    unread: OSError | SystemExit | None = None

    @property
    def failed(self) -> dict[str, int]:
        """Processes that failed by themselves, with their exit status.

        After a failure, the status of stopped processes is ignored, unless a process had to be
        killed. A process that did not yet handle the stop signal did not fail, nor did a process
        whose middleware was aborted.
        """
        statuses = self.statuses.items()
        if self.status in WELL:
            return {name: status for name, status in statuses if status not in _STOPPED}
        return {n: s for n, s in statuses if n == self.first or s == -KILL}


OnLine = Callable[[str, str], None]
"""Function of the name of a process and a line of its output."""

OnEvent = Callable[[str, dict[str, Any]], None]
"""Function of the name of a process and an event; see `core.process.notify_supervisor`."""


class Lines:
    """Queue of output lines, shown by a thread that may block.

    Callers never wait: beyond `WAITING_LINES` queued lines, lines are dropped, and their number is
    shown instead.

    Parameters
    ----------
    on_line : callable
        Called for each line. After an OSError no more lines are shown.

    Attributes
    ----------
    error : OSError, SystemExit or None
        Error with which `on_line` ended; rich exits if a pipe has no reader.
    """

    def __init__(self, on_line: OnLine) -> None:
        self._on_line = on_line
        self._waiting: list[tuple[str, str]] = []
        self._dropped: Counter[str] = Counter()
        self._news = threading.Condition()
        self._ended = False
        self.error: OSError | SystemExit | None = None
        self._thread = threading.Thread(target=self._show, daemon=True)

    def start(self) -> None:
        """Start showing lines."""
        self._thread.start()

    def say(self, name: str, line: str) -> None:
        """Queue a line to be shown; drop lines, but no events, if the queue is full."""
        with self._news:
            if len(self._waiting) < WAITING_LINES or read_event(line):
                self._waiting.append((name, line))
            else:
                self._dropped[name] += 1
            self._news.notify()

    def end(self) -> None:
        """Wait a little until all has been shown."""
        with self._news:
            self._ended = True
            self._news.notify()
        self._thread.join(OUTPUT_TIME)

    def _show(self) -> None:
        while lines := self._drain():
            try:
                for name, line in lines:
                    self._on_line(name, line)
            except (OSError, SystemExit) as error:
                self.error = error
                return

    def _drain(self) -> list[tuple[str, str]]:
        """Wait for lines and return them; none at the end."""
        with self._news:
            self._news.wait_for(lambda: self._waiting or self._ended)
            lines, self._waiting = self._waiting, []
            dropped, self._dropped = self._dropped, Counter()
        return lines + [(n, f"{k} lines dropped: nobody read them") for n, k in dropped.items()]


@dataclass
class Supervisor:
    """Supervisor that runs processes until one ends or a stop is requested, then ends the others.

    Parameters
    ----------
    processes : sequence of Process
    on_line : callable, optional
        Called with name and line for each line of output, on a separate thread. Lines are dropped
        while it is too slow. If it raises an OSError, as for a pipe without a reader, the graph is
        stopped.
    environment : dict, optional
        Variables added to the environment.
    on_event : callable, optional
        Called with name and event for each event, in the order of the lines. Events are not passed
        to `on_line`.
    """

    processes: Sequence[Process]
    on_line: OnLine = lambda name, line: None
    environment: dict[str, str] = field(default_factory=dict)
    on_event: OnEvent = lambda name, event: None

    def __post_init__(self) -> None:
        """Prepare the supervisor without starting a process."""
        self._named = {process.name: process for process in self.processes}
        self._due: dict[str, float] = {}
        self._running: dict[str, subprocess.Popen[str]] = {}
        self._stopped = False
        self._killed: set[str] = set()
        self._readers: list[threading.Thread] = []
        self._last_lines: dict[str, deque[str]] = {}
        # Not SimpleQueue: in CPython up to 3.11 at least, a signal at the instant of the time-out
        # makes it wait forever.
        self._ended: queue.Queue[str] = queue.Queue()
        self._lines = Lines(self._show)

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name of the process."""
        return {name: child.pid for name, child in self._running.items()}

    def run(self, stop: Callable[[], bool] = lambda: False) -> Outcome:
        """Run the graph to its end.

        Parameters
        ----------
        stop : callable
            Called every 0.1 s; returns true to stop.

        Raises
        ------
        ModuleNotFoundError
            ROS 2 is not installed.
        """
        check_ros()
        first = ""
        self._lines.start()
        with TemporaryDirectory(prefix="haptic_accel-") as folder:
            try:
                for process in self.processes:
                    self._start(process, Path(folder))
                    if self._stopped:
                        self._running[process.name].send_signal(EMERGENCY)
                while not (first or stop() or self._lines.error):
                    with suppress(queue.Empty):
                        ended = self._ended.get(timeout=END_CHECK_PERIOD)
                        first = "" if self._goes_on_after(ended) else ended
                    self._start_again(Path(folder))
            finally:
                self._stop_all()
                self._lines.end()
        statuses = {name: child.returncode for name, child in self._running.items()}
        last = [statuses[process.name] for process in self.processes if process.last]
        spared = self._killed if last and WELL.issuperset(last) else set()
        for name in spared | {process.name for process in self.processes if process.optional}:
            statuses.pop(name)
        lines = {name: list(last) for name, last in self._last_lines.items()}
        return Outcome(first, statuses.get(first, 0), statuses, lines, self._lines.error)

    def say(self, line: str) -> None:
        """Queue the supervisor's line for `on_line`, without waiting."""
        self._lines.say("", line)

    def stop_forces(self) -> None:
        """Make every node remove its forces at once, or as it starts; from any thread."""
        self._stopped = True
        for child in list(self._running.values()):
            child.send_signal(EMERGENCY)

    def _goes_on_after(self, name: str) -> bool:
        """Return and log whether the graph continues after the end of a process."""
        process, status = self._named[name], self._running[name].returncode
        if process.comes_back(status):
            self._due[name] = time.monotonic() + RESPAWN_DELAY
            self._lines.say(name, f"ended with status {status}; it is started again")
        elif process.optional:
            self._lines.say(name, f"ended with status {status}; the graph goes on without it")
        else:
            return False
        return True

    def _start_again(self, folder: Path) -> None:
        """Start the processes whose start is due."""
        for name in [name for name, due in self._due.items() if due <= time.monotonic()]:
            del self._due[name]
            self._start(self._named[name], folder)

    def _start(self, process: Process, folder: Path) -> None:
        name = process.name
        own = {"PYTHONUNBUFFERED": "1", SUPERVISOR: str(os.getpid())}
        if process.domain is not None:
            own[DOMAIN] = str(process.domain)
        # The signal would end a process without a handler; blocked, it waits for the handler.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {EMERGENCY})
        child = subprocess.Popen(
            command(process, folder),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env={**os.environ, **own, **self.environment},
            # Ctrl-C must reach only the supervisor, which stops the graph in order.
            start_new_session=True,
        )
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        self._running[name] = child
        self._last_lines[name] = deque(maxlen=LAST_LINES)
        reader = threading.Thread(target=self._read, args=(name, child), daemon=True)
        reader.start()
        self._readers.append(reader)

    def _read(self, name: str, child: subprocess.Popen[str]) -> None:
        assert child.stdout is not None
        try:
            for line in child.stdout:
                text = line.rstrip("\n")
                if not read_event(text):
                    self._last_lines[name].append(text)
                self._lines.say(name, text)
        finally:
            # The end of a process must be noticed even if its lines are lost.
            child.wait()
            self._ended.put(name)

    def _show(self, name: str, line: str) -> None:
        """Pass on a line, or the event that it encodes."""
        if event := read_event(line):
            self.on_event(name, event)
        else:
            self.on_line(name, line)

    def _stop_all(self) -> None:
        last = {process.name for process in self.processes if process.last}
        self._stop(self._running.keys() - last, LATE_END)
        self._stop(self._running.keys() & last, LAST_END)
        for reader in self._readers:
            reader.join(timeout=1.0)

    def _stop(self, names: Collection[str], patience: float) -> None:
        """End processes; log late ones, and kill them after a further time (`patience`), s."""
        steps = (
            # SIGTERM, not SIGINT: a process that still imports would print a traceback for the
            # latter.
            (signal.SIGTERM, QUIET_END, ""),
            (0, patience, "has not ended yet, and is waited for"),
            (KILL, KILLING, "does not end, and is killed"),
        )
        for number, timeout, said in steps:
            late = [name for name in names if self._running[name].poll() is None]
            deadline = time.monotonic() + timeout
            for name in late:
                self._running[name].send_signal(number)
                if said:
                    self._lines.say(name, said)
            for name in late:
                with suppress(subprocess.TimeoutExpired):
                    self._running[name].wait(timeout=max(0.0, deadline - time.monotonic()))
        self._killed.update(late)


class BackgroundGraph:
    """Graph on a separate thread, until it ends or is closed.

    Parameters
    ----------
    processes : sequence of Process
    log : Path
        File to which the graph's output is appended.
    """

    def __init__(self, processes: Sequence[Process], log: Path) -> None:
        self._log = log.open("a", encoding="utf-8")
        self._supervisor = Supervisor(processes, on_line=self._write)
        self._stop = threading.Event()
        self._outcome: Outcome | Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def ended(self) -> str:
        """Reason why the graph has ended; empty while it runs."""
        outcome = self._outcome
        if isinstance(outcome, Outcome):
            return f"graph: {outcome.first or 'it'} ended with status {outcome.status}"
        return f"graph: {outcome}" if outcome else ""

    def stop_forces(self) -> None:
        """Remove all forces; they stay off until the graph is closed."""
        self._supervisor.stop_forces()

    def close(self) -> None:
        """End all processes."""
        self._stop.set()
        self._thread.join()
        self._log.close()

    def _run(self) -> None:
        try:
            self._outcome = self._supervisor.run(self._stop.is_set)
        except Exception as error:
            self._outcome = error

    def _write(self, name: str, line: str) -> None:
        print(f"[{name}] {line}", file=self._log, flush=True)


def command(process: Process, folder: Path) -> list[str]:
    """Return the command line that runs a process of the graph with parameters from a folder."""
    module = module_command(node_module(process.executable))
    return [*module, *process.ros_arguments(folder), "-r", f"__ns:={process.namespace or '/'}"]
