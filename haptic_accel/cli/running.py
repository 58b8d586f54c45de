# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs of graphs by a command: signals, keys, progress, and the end of a graph."""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from haptic_accel.cli.output import GONE, StoppedError, drop_output, next_command
from haptic_accel.core import process
from haptic_accel.core.parameters import printable
from haptic_accel.graph.domain import sole_graph
from haptic_accel.graph.stop_signal import hurry
from haptic_accel.graph.supervisor import Outcome, Supervisor
from haptic_accel.setup.processes import Process, arrangement
from haptic_accel.setup.setup import LINK, SCOPE


def show_page(address: str, *, opened: bool = True) -> None:
    """Print the address of a page, and open it in a browser if there is a screen."""
    print_line(f"{address} (Ctrl-C ends)")
    # Without a screen, a text browser would open in this terminal.
    screens = map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    if opened and (sys.platform in ("darwin", "win32") or any(screens)):
        webbrowser.open(address)


STOP_KEY = b" "
"""Key that stops a graph at once."""

STOPPED_BY_KEY = (
    "space: emergency stop, no force until you type in another terminal:"
    " haptic-accel estop release:=true"
)


NOTHING = "nothing to analyse, as the graph failed before the arms were coupled"
"""Message on the bag of a failed start."""


@contextmanager
def stop_on_signal(act: Callable[[], None] = lambda: None) -> Iterator[Callable[[], bool]]:
    """Handle the signals that end a command; yield a function that is true after a signal.

    Parameters
    ----------
    act : callable, optional
        Called at each signal.
    """
    signalled = threading.Event()

    def handle(*_: object) -> None:
        signalled.set()
        act()

    before = {
        number: signal.signal(number, handle)
        for number in process.ENDING
        # After nohup, ignore a closed terminal.
        if number.name != "SIGHUP" or signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield signalled.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interrupted_by_signals() -> AbstractContextManager[object]:
    """Let all signals that end a command interrupt it as Ctrl-C does, so that it cleans up."""
    return stop_on_signal(partial(signal.default_int_handler, signal.SIGINT, None))


def print_line(line: str) -> None:
    """Print a line at once and in one piece, from any thread.

    Raises
    ------
    OSError
        The output has no reader, or a disk is full. Further output is dropped without an error.
    """
    text = f"{printable(line)}\n"
    try:
        if sys.__stdout__ is None or sys.stdout is not sys.__stdout__:
            print(text, end="", flush=True)
        else:
            # Bypass Python's buffer: without a reader, the write would hold its lock, which Python
            # needs at exit.
            _write(text.encode(sys.__stdout__.encoding, "backslashreplace"))
    except OSError:
        _lose_output()
        raise


def _write(data: bytes) -> None:
    while data:
        try:
            data = data[os.write(1, data) :]
        except BlockingIOError:  # another program has set the shared terminal's flag
            select.select([], [1], [])


def _lose_output() -> None:
    """Redirect standard output to the null device, and standard error if it has no reader."""
    poller = select.poll()
    poller.register(2, 0)
    for descriptor in (1, 2) if poller.poll(0) else (1,):
        drop_output(descriptor)


def run_to_end(supervisor: Supervisor, stop: Callable[[], bool], interrupted: str = "") -> None:
    """Run a graph that ends by itself.

    Parameters
    ----------
    supervisor : Supervisor
    stop : callable
        Returns true once the graph has to stop.
    interrupted : str
        Line for the user if the graph was stopped.

    Raises
    ------
    StoppedError
        The graph was interrupted or failed; the reason was shown.
    """
    outcome = supervisor.run(stop)
    if not outcome.first:
        raise StoppedError(interrupted, process.INTERRUPTED)
    _conclude(outcome)


def run_shown(
    processes: Sequence[Process], *, endless: bool = False, expected: float = 0.0
) -> None:
    """Run a graph until its end or a signal, and print its output.

    Parameters
    ----------
    processes : sequence of Process
    endless : bool
        True if the graph should not end by itself.
    expected : float
        Time from engaging to the end, s, for a progress bar in a terminal; 0 for none.

    Raises
    ------
    ParameterError
        Another graph runs in the namespace and ROS domain.
    StoppedError
        The graph failed, with the reason shown, or its output cannot be written.
    """
    (namespace,) = {each.namespace for each in processes}
    progress = progress_bar(sys.stdout)
    progress.disable |= not expected
    bar = progress.add_task("waiting for the arms", total=expected)
    engaged: list[float] = []
    bags: list[str] = []

    def show(name: str, line: str) -> None:
        print_line(f"[{name}] {line}" if name else line)

    def follow(_: str, event: Mapping[str, Any]) -> None:
        if event["event"] == process.RECORDED:
            bags.append(event["path"])
        elif event["event"] == process.ENGAGED and not engaged:
            engaged.append(time.monotonic())
            progress.update(bar, description="replaying")

    supervisor = Supervisor(processes, on_line=show, on_event=follow)

    def stop_forces() -> None:
        supervisor.stop_forces()
        supervisor.say(STOPPED_BY_KEY + (f" namespace:={namespace}" if namespace else ""))

    def stopped() -> bool:
        if engaged:
            progress.update(bar, completed=min(time.monotonic() - engaged[0], expected))
        return stop()

    with on_keys({STOP_KEY: stop_forces}) as keys, sole_graph(namespace), stop_on_signal() as stop:
        for hint in filter(None, (arrangement(processes), *_hints(processes, keys))):
            supervisor.say(hint)
        with progress:
            outcome = supervisor.run(stopped)
    peers = ["PEERS_BAG"] * any(each.executable == LINK for each in processes)
    for bag in bags:
        started = engaged or not outcome.failed
        with suppress(OSError):
            print_line(next_command("analyze", bag, *peers) if started else f"{NOTHING}: {bag}")
    _conclude(outcome)
    if endless and outcome.first:
        print(f"{outcome.first} ended", file=sys.stderr)


def _hints(processes: Sequence[Process], keys: bool) -> Iterator[str]:
    """Yield hints on viewing, stopping and ending a graph."""
    stop = "space" if keys else "haptic-accel estop in another terminal"
    yield f"emergency stop: {stop}; end: Ctrl-C"
    if any(each.executable == SCOPE for each in processes):
        yield "page: open the address that [scope] prints below"


def _conclude(outcome: Outcome) -> None:
    """Show the last lines of failed processes, and end the command with the exit status."""
    for name, status in outcome.failed.items():
        print(f"{name} ended with status {status}; its last lines:", file=sys.stderr)
        for line in outcome.last_lines[name] or ["(none)"]:
            print(f"  {line}", file=sys.stderr)
    if outcome.failed:
        wrong = outcome.status == process.WRONG_ARGUMENTS
        raise StoppedError(status=process.WRONG_ARGUMENTS if wrong else process.FAILED)
    if isinstance(outcome.unread, OSError) and outcome.unread.errno not in GONE:
        raise StoppedError(f"no output: {outcome.unread.strerror}")


def progress_bar(stream: TextIO | None = None) -> Progress:
    """Return a progress bar on stderr, or another stream, with percentage and remaining time.

    The bar is drawn in a terminal only.
    """
    stream = stream or sys.stderr
    # This attribute has the stream without the escapes of `printable_output`.
    console = Console(file=getattr(stream, "rich_proxied_file", stream))
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console,
        refresh_per_second=2.0,  # drawing takes CPU from the graph
        disable=not console.is_terminal,
    )


@contextmanager
def shown_stages(stages: Sequence[str]) -> Iterator[Callable[[str], None]]:
    """Show the stages of a run in a progress bar, or without a terminal as a line each.

    Yields
    ------
    callable
        Function to call with the name of each stage at its start.
    """
    with progress_bar() as progress:
        task = progress.add_task(stages[0], total=len(stages))

        def begin(stage: str) -> None:
            progress.update(task, description=stage, completed=stages.index(stage))
            process.notify_supervisor(process.PROGRESS, text=stage)
            if not progress.console.is_terminal:
                print(stage, flush=True)

        yield begin
        progress.update(task, completed=len(stages))


PRIORITY = 42
"""Real-time priority of the thread that waits for a key, above those of the nodes."""

BACKGROUND_PERIOD = 0.5
"""Interval between checks while the terminal belongs to another program, s."""


@contextmanager
def on_keys(acts: Mapping[bytes, Callable[[], None]]) -> Iterator[bool]:
    """Call a key's function on a separate thread whenever it is pressed, without Enter.

    Keys pressed earlier count if this program already had the terminal. No keys are read if the
    standard input is no terminal, or another program's. Ctrl-C and similar keys remain signals.
    The terminal is restored when the context is left.

    Yields
    ------
    bool
        True while keys are read.
    """
    if not (sys.stdin and sys.stdin.isatty() and is_ours(sys.stdin.fileno())):
        yield False
        return
    import termios  # on POSIX only
    import tty

    terminal = sys.stdin.fileno()
    settings = termios.tcgetattr(terminal)
    over, end = os.pipe()
    thread = threading.Thread(target=_follow, args=(terminal, over, acts), daemon=True)
    thread.start()
    try:
        # The default, TCSAFLUSH, would drop keys pressed during the imports.
        tty.setcbreak(terminal, termios.TCSANOW)
        yield True
    finally:
        os.close(end)
        thread.join()
        os.close(over)
        with suppress(termios.error):  # the terminal has hung up
            termios.tcsetattr(terminal, termios.TCSADRAIN, settings)


def _follow(terminal: int, over: int, acts: Mapping[bytes, Callable[[], None]]) -> None:
    """Read keys until the other end of the pipe `over` is closed, or the terminal is gone."""
    hurry(PRIORITY)
    while over not in select.select([terminal, over], [], [])[0]:
        if not is_ours(terminal):  # reading would suspend this process
            select.select([over], [], [], BACKGROUND_PERIOD)
            continue
        try:
            pressed = os.read(terminal, 1024)
        except OSError:
            return
        if not pressed:
            return
        for key, act in acts.items():
            if key in pressed:
                act()


def is_ours(terminal: int) -> bool:
    """Return whether keys pressed in a terminal are for this program."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
