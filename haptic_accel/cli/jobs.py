# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Independent runs of a verb side by side, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from typing import TypeVar

from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.running import ENDING
from haptic_accel.core.process import INTERRUPTED

Item = TypeVar("Item")
Result = TypeVar("Result")

POLL = 0.1
"""Time between two looks for a signal that ends the verb, s."""


def side_by_side(
    run: Callable[[Item], Result], items: Sequence[Item], jobs: int, stop: Callable[[], bool]
) -> Iterator[Result]:
    """Start runs in processes; return an iterator over their results, in the order of the items.

    Call it before anything starts a thread, which the processes would be copies of.

    Parameters
    ----------
    run : callable
        Function of a module, whose argument and result can be sent to another process.
    items : sequence
        Arguments of the runs.
    jobs : int
        Number of processes.
    stop : callable
        Returns true once the runs have to end.

    Raises
    ------
    StoppedError
        By the iterator: asked to stop.
    """
    pool = ProcessPoolExecutor(min(jobs, max(len(items), 1)), initializer=_leave_signals)
    return _results(pool, [pool.submit(run, item) for item in items], stop)


def _results(
    pool: ProcessPoolExecutor, runs: Sequence[Future[Result]], stop: Callable[[], bool]
) -> Iterator[Result]:
    try:
        for each in runs:
            while not stop() and not wait([each], POLL).done:
                pass
            if stop():
                raise StoppedError(status=INTERRUPTED)
            yield each.result()
    finally:
        for process in multiprocessing.active_children():
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)


def _leave_signals() -> None:
    """Leave the signals of the terminal to the verb, which ends its processes itself."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
