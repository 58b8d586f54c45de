# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parallel execution of a command's independent runs, on this machine or a cluster."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import platform
import re
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol, TypeVar

from haptic_accel.cli.output import StoppedError
from haptic_accel.core.files import located
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import ENDING, report_unraisable

Item = TypeVar("Item")
Result = TypeVar("Result")
Runs = dict[int, "Future[Any]"]
"""Unfinished runs, by the index of their item."""

Stop = Callable[[], bool]
"""Function that returns true once the runs must end."""

POLL = 0.1
"""Interval between checks for a signal that ends the command, s."""

ADDRESS = r"(tcp|tls)://[^/\s]+:\d+"
"""Pattern of a scheduler's address."""

CONNECTING = 10.0
"""Time-out for the answer of a cluster's scheduler, s."""

MOST_LOST = 3
"""Number of processes lost in succession, without a completed run, after which the runs are
abandoned: the default of dask.distributed (``allowed-failures``)."""

PR_SET_PDEATHSIG = 1
"""Option of prctl that requests a signal at the parent's end (linux/prctl.h)."""

COMPUTING = ("haptic_accel", "numpy", "scipy")
"""Packages whose versions affect the digits of results."""


@dataclass(frozen=True)
class Workers:
    """Processes that run conditions in parallel, without effect on the results.

    Parameters
    ----------
    count : int
        Number of processes on this machine.
    address : str
        Address of a scheduler of dask.distributed, ``tcp://host:8786``, whose workers run the
        conditions in place of processes of this machine; empty for none.
    """

    count: int
    address: str = ""

    def completed(
        self, run: Callable[[Item], Result], items: Sequence[Item], stop: Stop
    ) -> Iterator[tuple[int, Result]]:
        """Start the runs; return an iterator over indices and results, as the runs end.

        The iterator ends early on a stop. A lost process's run is started again.
        Call it before starting threads, which the new processes would copy.

        Parameters
        ----------
        run : callable
            Module-level function whose argument and result can be pickled.
        items : sequence
            Arguments of the runs.
        stop : Stop

        Raises
        ------
        ParameterError
            The scheduler does not answer, or a worker has other software.
        StoppedError
            Processes were lost `MOST_LOST` times without a completed run.
        """
        engine = _Cluster(self.address, run) if self.address else _Processes(self.count, run)
        try:
            runs = engine.start(dict(enumerate(items)))
        except BaseException:
            engine.close()
            raise
        return _completed(engine, runs, items, stop)

    def map(
        self, run: Callable[[Item], Result], items: Sequence[Item], stop: Stop
    ) -> Iterator[Result]:
        """Start the runs; return an iterator over their results, in the order of the items."""
        return _in_order(self.completed(run, items, stop))


class _Engine(Protocol):
    """Executor of the runs."""

    TOGETHER: bool
    """True if the loss of a process ends all runs."""

    @property
    def LOST(self) -> tuple[type[BaseException], ...]: ...

    def start(self, items: dict[int, Any]) -> Runs: ...

    def close(self) -> None: ...


def _completed(
    engine: _Engine, runs: Runs, items: Sequence[Any], stop: Stop
) -> Iterator[tuple[int, Any]]:
    lost = 0
    try:
        while runs and not stop():
            wait(runs.values(), POLL, FIRST_COMPLETED)
            ended = {index: each for index, each in runs.items() if each.done()}
            errors = {index: _error(each, engine.LOST) for index, each in ended.items()}
            failed = {index: error for index, error in errors.items() if error}
            for index in ended.keys() - failed.keys():
                lost = 0
                yield index, runs.pop(index).result()
            if failed:
                lost += 1
                if lost == MOST_LOST:
                    raise StoppedError(
                        f"processes were lost {lost} times without a result:"
                        f" {next(iter(failed.values()))}"
                    )
                again = runs if engine.TOGETHER else failed
                runs |= engine.start({index: items[index] for index in again})
    finally:
        engine.close()


def _error(run: Future[Any], kinds: tuple[type[BaseException], ...]) -> BaseException | None:
    """Return the error of a finished run if it is of these kinds, else None."""
    if run.cancelled():
        return CancelledError("cancelled") if CancelledError in kinds else None
    error = run.exception()
    return error if isinstance(error, kinds) else None


def _in_order(found: Iterable[tuple[int, Result]]) -> Iterator[Result]:
    early: dict[int, Result] = {}
    due = 0
    for index, result in found:
        early[index] = result
        while due in early:
            yield early.pop(due)
            due += 1


class _Processes:
    """Executor with processes of this machine."""

    TOGETHER = True
    LOST = (BrokenProcessPool,)

    def __init__(self, count: int, run: Callable[[Any], Any]) -> None:
        self._count = count
        self._run = run
        self._others = set(multiprocessing.active_children())
        self._pool: ProcessPoolExecutor | None = None

    def start(self, items: dict[int, Any]) -> Runs:
        """Start runs in new processes."""
        count = min(self._count, max(len(items), 1))
        pool = self._pool = ProcessPoolExecutor(count, initializer=_belong_to_command)
        return {index: pool.submit(self._run, item) for index, item in items.items()}

    def close(self) -> None:
        """End the processes, even busy ones.

        At exit, Python must not meet a thread of the pool that is closing its pipes: it would
        write to a closed pipe, and print a traceback.
        """
        for process in set(multiprocessing.active_children()) - self._others:
            process.kill()
        if self._pool:
            self._pool.shutdown(cancel_futures=True)


def _belong_to_command() -> None:
    """Set up a worker process: ignore the terminal's signals, and end with the command."""
    sys.unraisablehook = report_unraisable
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform == "linux":
        # A killed command cannot end its processes. A thread that waits for the command's end
        # would take memory, and could not run while a library computes.
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


class _Cluster:
    """Executor with workers of a dask.distributed scheduler, which restarts lost workers' runs."""

    TOGETHER = False

    def __init__(self, address: str, run: Callable[[Any], Any]) -> None:
        location = f"executor = {address!r}"
        if not re.fullmatch(ADDRESS, address):
            raise ParameterError(f"{location}: must be tcp://HOST:PORT or tls://HOST:PORT")
        from distributed import Client, KilledWorker

        try:
            self._client = Client(address, timeout=CONNECTING, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error).partition("\n")[0] or type(error).__name__
            raise ParameterError(f"{location}: the scheduler does not answer: {reason}") from None
        self.LOST = (KilledWorker, CancelledError)
        self._run = partial(_run_alike, run, software(), Path.cwd())

    def start(self, items: dict[int, Any]) -> Runs:
        """Send runs to the scheduler."""
        pool = self._client.get_executor(pure=False)
        return {index: pool.submit(self._run, item) for index, item in items.items()}

    def close(self) -> None:
        """Leave the cluster, which drops the runs that have not started."""
        self._client.close()


def software() -> dict[str, str]:
    """Return the versions of Python and of the packages on which results depend."""
    found = {name: metadata.version(name) for name in COMPUTING}
    return {"python": platform.python_version(), "processor": platform.machine(), **found}


def _run_alike(
    run: Callable[[Item], Result], expected: dict[str, str], folder: Path, item: Item
) -> Result:
    """Run an item in a folder; refuse other software versions, which may change digits."""
    found = software()
    for name, version in expected.items():
        if found[name] != version:
            raise ParameterError(
                f"executor: {name} {found[name]} on {platform.node()}, must be {version} as here"
            )
    with located(f"executor: '{folder}' on {platform.node()}", unreadable=""):
        os.chdir(folder)  # file names are relative to this folder
    return run(item)
