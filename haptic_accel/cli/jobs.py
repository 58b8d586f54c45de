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
from haptic_accel.cli.running import progress_bar, stop_on_signal
from haptic_accel.core.process import ENDING, INTERRUPTED

Item = TypeVar("Item")
Result = TypeVar("Result")

Stop = Callable[[], bool]
"""Returns true once the runs have to end."""

Show = Callable[[float], None]
"""Shows how many conditions are done, where parts of one count."""

POLL = 0.1
"""Time between two looks for a signal that ends the verb, s."""


def side_by_side(
    run: Callable[[Item], Result], items: Sequence[Item], jobs: int, stop: Stop
) -> Iterator[Result]:
    """Start runs in processes; return an iterator over their results, in the order of the items.

    It ends early once the runs have to.

    Call it before anything starts a thread, which the processes would be copies of.

    Parameters
    ----------
    run : callable
        Function of a module, whose argument and result can be sent to another process.
    items : sequence
        Arguments of the runs.
    jobs : int
        Number of processes.
    stop : Stop
    """
    pool = ProcessPoolExecutor(min(jobs, max(len(items), 1)), initializer=_leave_signals)
    return _results(pool, [pool.submit(run, item) for item in items], stop)


def run_study(
    start: Callable[[Stop, Show], Iterator[Result]],
    count: int,
    unit: str,
    line: Callable[[Result], str],
) -> tuple[list[Result], StoppedError | None]:
    """Run the conditions of a study with a progress bar; print a line on each as it ends.

    Parameters
    ----------
    start : callable
        Starts the runs, side by side or live, and returns an iterator over their results.
    count : int
        Number of conditions.
    unit : str
        Name of the conditions.
    line : callable
        Returns the line on a result; empty for none.

    Returns
    -------
    results : list
        Those of the conditions that were run.
    end : StoppedError or None
        Early end, by a signal or a graph that failed.
    """
    done: list[Result] = []
    end: StoppedError | None = None
    progress = progress_bar()
    bar = progress.add_task(unit, total=count)

    def show(part: float) -> None:
        progress.update(bar, completed=part)

    with stop_on_signal() as stop:
        results = start(stop, show)  # before the bar has a thread
        try:
            with progress:
                for result in results:
                    done.append(result)
                    if text := line(result):
                        print(f"{len(done)} of {count}: {text}", flush=True)
                    show(len(done))
        except StoppedError as error:
            end = error
        if stop() and len(done) < count:
            end = StoppedError(f"interrupted after {len(done)} of {count} {unit}", INTERRUPTED)
    return done, end


def _results(
    pool: ProcessPoolExecutor, runs: Sequence[Future[Result]], stop: Stop
) -> Iterator[Result]:
    try:
        for each in runs:
            while not stop() and not wait([each], POLL).done:
                pass
            if stop():
                return
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
