# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands run as by a user, and the processes they start."""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import random
import re
import resource
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from haptic_accel.graph.stop_signal import PENDING

if TYPE_CHECKING:
    import pytest

PATIENCE = 240.0
"""Time limit for an event or a run of a command, even on a busy machine, s: the one for all tests.
It only limits how late a failure is found."""

Value = TypeVar("Value")

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1
"""From linux/prctl.h."""

BAG_PLAYER = Path(__file__).with_name("bag_player.py")
"""Program that publishes a bag as `ros2 bag play` does."""

DOMAINS = range(1, 101)
"""ROS domains with ports below Linux' ephemeral ports."""


def piped(folder: Path, *words: str) -> subprocess.Popen[str]:
    """Start Python with words in a folder, with pipes for its input and for all that it says."""
    return subprocess.Popen(
        [sys.executable, *words],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


class Command:
    """Running command with output that tests can wait for.

    Attributes
    ----------
    process : Popen
    lines : list of str
        Output so far, both streams.
    """

    def __init__(self, words: list[str], folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, *words],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="backslashreplace",
            start_new_session=True,
            preexec_fn=_prepare,
        )
        self.lines: list[str] = []
        self._news = threading.Condition()
        self._ended = False
        self._reads = threading.Event()
        self._reads.set()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def text(self) -> str:
        """Complete output so far."""
        return "\n".join(self.lines)

    def wait_for(self, pattern: str, after: int = 0) -> str:
        """Wait for the first matching line from `after` on, and return it."""

        def found() -> str | None:
            return next((line for line in self.lines[after:] if re.search(pattern, line)), None)

        with self._news:
            self._news.wait_for(lambda: found() or self._ended, PATIENCE)
            line = found()
        assert line, f"no line like {pattern!r} in:\n{self.text}"
        return line

    @contextmanager
    def unread(self) -> Iterator[None]:
        """Stop reading the output meanwhile, and leave no room for a line in its pipe."""
        self._reads.clear()
        pipe = os.open(f"/proc/{self.process.pid}/fd/1", os.O_WRONLY | os.O_NONBLOCK)
        # A waiting reader may still read once, which frees room again.
        while select.select([], [pipe], [], 0.1)[1]:
            with suppress(BlockingIOError):
                os.write(pipe, b"full\n")
        with suppress(BlockingIOError):
            while True:
                os.write(pipe, b"\n")
        os.close(pipe)
        try:
            yield
        finally:
            self._reads.set()

    def end(self, number: signal.Signals | None = None, patience: float = PATIENCE) -> int:
        """Send a signal, if any, and return the exit status; wait for a time in s."""
        if number:
            self.process.send_signal(number)
        try:
            status = self.process.wait(patience)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still runs after {patience:g} s:\n{self.text}") from None
        self._reader.join(PATIENCE)
        return status

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self._reads.wait()
            with self._news:
                self.lines.append(line.rstrip("\n"))
                self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()


Start = Callable[..., Command]
"""Starts a command with words."""

ONE_BY_ONE = """
import json, os, runpy, sys
from importlib import import_module
programs = json.loads(sys.argv[1])
sys.path[:0] = [os.path.dirname(program) for program, *_ in programs]
for program, *_ in programs:
    import_module(os.path.basename(program).removesuffix(".py"))
for program, *words in programs:
    child = os.fork()
    if not child:
        sys.argv = [program, *words]
        (runpy.run_path if os.path.isabs(program) else runpy.run_module)(program, {}, "__main__")
        sys.exit()
    print("ended with", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
"""Runs programs each in a process that has loaded what they import."""


def ended_one_by_one(
    start: Callable[..., Command], programs: Iterable[Sequence[str]]
) -> list[tuple[int, list[str]]]:
    """Return exit status and lines of ``python PROGRAM WORDS`` for modules, or paths, and words.

    What they import is loaded once, which takes longer than a program that ends soon.
    """
    command = start("-W", "ignore", "-c", ONE_BY_ONE, json.dumps([*map(list, programs)]))
    assert command.end() == 0, command.text
    found: list[tuple[int, list[str]]] = []
    lines: list[str] = []
    for line in command.lines:
        if status := re.fullmatch(r"ended with (-?\d+)", line):
            found.append((int(status[1]), lines))
            lines = []
        else:
            lines.append(line)
    return found


def use_domain(environment: pytest.MonkeyPatch, domain: int) -> None:
    """Give this process and its children a ROS domain with the users' defaults."""
    # Imported here, as only tests with a graph need it.
    from haptic_accel.graph.domain import VARIABLES, middleware_defaults

    for variable in VARIABLES:
        environment.delenv(variable, raising=False)
    environment.setenv("ROS_DOMAIN_ID", str(domain))
    for variable, value in middleware_defaults(os.environ).items():
        environment.setenv(variable, value)


def _prepare() -> None:
    """Make a new process behave as at a terminal, and end with the tests."""
    # A suite run in the background ignores Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # A killed suite cannot clean up; nodes end with the command that started them.
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class MachineStoodStillError(Exception):
    """Error: the machine stalled for longer than a graph's deadlines allow."""


class StallWatch:
    """Measurement of how long a sleeping thread is not resumed.

    Attributes
    ----------
    longest : float
        Longest time beyond the requested sleep, s.
    """

    PERIOD = 0.01

    def __init__(self) -> None:
        self.longest = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> StallWatch:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        before, over = time.monotonic(), False
        while not over:
            over = self._over.wait(self.PERIOD)
            now = time.monotonic()
            self.longest = max(self.longest, now - before - self.PERIOD)
            before = now


@contextmanager
def on_thread(loop: Callable[[Callable[[], bool]], object]) -> Iterator[None]:
    """Run a loop on a thread of its own meanwhile; it gets the condition that ends it."""
    ending = threading.Event()
    thread = threading.Thread(target=loop, args=(ending.is_set,))
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


def python(*words: object, **given: Any) -> subprocess.CompletedProcess[str]:
    """Run ``python WORDS`` to its end, and return what it wrote."""
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, **given)


@contextmanager
def reserved_domain() -> Iterator[int]:
    """Yield a ROS domain that no other test or suite on this machine uses.

    The kernel releases a file lock however its owner ends. A domain with processes but no lock, or
    with an open port, is skipped. Nodes that still run at the end are killed.
    """
    folder = Path(tempfile.gettempdir()) / f"haptic_accel-domains-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for number in random.Random(os.urandom(8)).sample(DOMAINS, len(DOMAINS)):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            if any(processes_of(number)) or any(open_ports(number)):
                continue
            _withdraw_stops(number)  # of a test that was killed
            try:
                yield number
            finally:
                _withdraw_stops(number)
                for pid in nodes_of(number).values():
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)
            return
    raise AssertionError("no ROS domain is free")


def _withdraw_stops(domain: int) -> None:
    """Remove the stops that are pending in any namespace of a ROS domain."""
    for form in (f"{PENDING}-*-{domain}", f"{PENDING}-*-{domain}-*"):
        for file in glob(form):
            Path(file).unlink()


def free_port() -> int:
    """Return an unused TCP port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def free_ports() -> str:
    """Return HOST:PORT of this machine with two unused UDP ports in a row."""
    with ExitStack() as stack:
        while True:
            both = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
            one, two = map(stack.enter_context, both)
            one.bind(("127.0.0.1", 0))
            port = one.getsockname()[1]
            try:
                two.bind(("127.0.0.1", port + 1))
            except (OSError, OverflowError):
                continue
            return f"127.0.0.1:{port}"


def open_ports(domain: int) -> Iterator[int]:
    """Yield the UDP ports of a ROS domain that are open on this machine.

    The RTPS standard (9.6.1.1) gives each domain a range of 250 ports from 7400 on.
    """
    ports = range(7400 + 250 * domain, 7400 + 250 * (domain + 1))
    for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
        port = int(line.split()[1].rsplit(":", 1)[1], 16)
        if port in ports:
            yield port


def processes_of(domain: int) -> Iterator[tuple[int, list[str]]]:
    """Yield process id and command line of each process in a test's ROS domain."""
    wanted = f"ROS_DOMAIN_ID={domain}".encode()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environment = (folder / "environ").read_bytes().split(b"\0")
            words = os.fsdecode((folder / "cmdline").read_bytes()).split("\0")
        except OSError:
            continue
        if wanted in environment:
            yield int(folder.name), words


@contextmanager
def called(name: bytes) -> Iterator[None]:
    """Give this process another name meanwhile, as the kernel shows it."""
    own = Path("/proc/self/comm")
    before = own.read_bytes()
    own.write_bytes(name)
    try:
        yield
    finally:
        own.write_bytes(before)


def nodes_of(domain: int) -> dict[str, int]:
    """Return the running nodes of a ROS domain: process id by executable."""
    return {
        word.rsplit(".", 1)[-1]: pid
        for pid, words in processes_of(domain)
        for word in words
        if word.startswith("haptic_accel.nodes.")
    }


@contextmanager
def sending(domain: int, topic: str, prepare: str = "") -> Iterator[subprocess.Popen[bytes]]:
    """Block a signal in another process."""
    text = (
        f"import signal; {prepare}from haptic_accel.graph.domain import lock_signal;"
        f" lock = lock_signal({domain}, {topic!r}); print(flush=True); signal.pause()"
    )
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE) as process:
        assert process.stdout
        process.stdout.readline()
        try:
            yield process
        finally:
            process.kill()


def wait_until(condition: Callable[[], Value], what: str, *without: Command) -> Value:
    """Poll for a state of the machine that sends no event, and return the condition's value.

    Parameters
    ----------
    condition : callable
        Gives a value that is true once the state is reached.
    what : str
        Name of the state.
    *without : Command
        Commands without which it cannot be reached any more.
    """
    deadline = time.monotonic() + PATIENCE
    moment = threading.Event()
    while True:
        ended = [each.text for each in without if each.process.poll() is not None]
        value = condition()  # looked at once more after an end
        if value:
            return value
        assert not ended, f"ended before: {what}; last: {value!r}\n" + "\n".join(ended)
        assert time.monotonic() < deadline, f"still not: {what}; last: {value!r}"
        moment.wait(0.05)


def limit_size(process: int, file: Path) -> None:
    """Limit a process' files to slightly over a file's size."""
    while True:
        size = file.stat().st_size
        limit = (size + 100_000, resource.RLIM_INFINITY)
        resource.prlimit(process, resource.RLIMIT_FSIZE, limit)
        # A chunk written in between may leave no room for an index, unlike on a disk.
        if file.stat().st_size == size:
            return


def realtime_is_allowed() -> bool:
    """Return True where a process of this user may be real-time."""
    ask = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))"
    return python("-c", ask).returncode == 0
