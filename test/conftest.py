"""What all tests share: reproducible properties, and a ROS graph of their own."""

from __future__ import annotations

import itertools
import os

# Before numpy is loaded: threads of BLAS that spin for each other on a busy machine take ten times
# as long as one thread alone.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from running import Command, nodes_of, use_domain

if TYPE_CHECKING:
    from observing import Observer

# The machine's speed is not what a property is about, and the same tree gives the same result.
settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")

_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))

DOMAINS = range(1 + _WORKER, 101, _WORKERS)
"""ROS domains whose ports stay below those that Linux hands out; each worker has its own."""

_DOMAIN = itertools.cycle(DOMAINS)
for _ in range(os.getpid() % len(DOMAINS)):
    next(_DOMAIN)


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """Give a test, and every process it starts, a ROS domain of its own on this machine."""
    number = next(_DOMAIN)
    use_domain(monkeypatch, number)
    return number


@pytest.fixture
def start(tmp_path: Path, domain: int) -> Iterator[Callable[..., Command]]:
    """Start ``python WORDS`` in an empty folder; ended with the test, and with it its nodes."""
    commands: list[Command] = []

    def started(*words: str) -> Command:
        commands.append(Command([str(word) for word in words], tmp_path))
        return commands[-1]

    yield started
    for command in commands:
        if command.process.poll() is None:
            command.process.kill()
        command.end()
    for pid in nodes_of(domain).values():
        os.kill(pid, signal.SIGKILL)


@pytest.fixture
def haptic_accel(start: Callable[..., Command]) -> Callable[..., Command]:
    """Start ``haptic-accel WORDS`` as the console script does."""
    return lambda *words: start("-m", "haptic_accel.cli.main", *words)


@pytest.fixture
def observer(domain: int) -> Iterator[Observer]:
    """Give a test a node of its own in its ROS domain."""
    # ROS takes a while to import: only who talks to it waits for that.
    from observing import Observer

    observer = Observer(domain)
    yield observer
    observer.close()


@pytest.fixture
def ask(domain: int, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Call a verb's function in this process, quicker than a command: ``ask(VERB, *WORDS)``.

    Gives its exit status and what it wrote.
    """

    def asked(verb: Callable[[list[str]], int], *words: str) -> tuple[int, str]:
        capsys.readouterr()
        status = verb(list(words))
        captured = capsys.readouterr()
        return status, (captured.out + captured.err).strip()

    return asked
