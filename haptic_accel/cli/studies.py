# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Studies of independent conditions, whose results survive an interruption."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.analysis.description import version
from haptic_accel.cli.output import StoppedError
from haptic_accel.cli.running import progress_bar, stop_on_signal
from haptic_accel.cli.workers import Item, Result, Stop, Workers
from haptic_accel.core.files import located, opened
from haptic_accel.core.process import INTERRUPTED, PROGRESS, notify_supervisor

Show = Callable[[float], None]
"""Function that shows the number of completed conditions, which may be fractional."""

LARGEST_RESULTS = 1 << 30
"""Maximum size of a file of results, bytes; a condition takes about 500."""


class Journal:
    """File with the results of an unfinished study, for its continuation.

    A result is stored under the key of its condition, `key_of`.

    Parameters
    ----------
    file : Path
        The file need not exist.
    again : str
        Command that continues the study after an early end.
    """

    def __init__(self, file: Path, again: str = "the same command goes on") -> None:
        self.file, self.again = file, again
        self._known: dict[bytes, bytes] = {}
        with located(file), suppress(FileNotFoundError), opened(file, LARGEST_RESULTS) as lines:
            for line in lines:
                digest, _, result = line.partition(b" ")
                if result.endswith(b"\n"):  # an incomplete line: killed while writing
                    self._known[digest] = result

    def result(self, key: str) -> Any:
        """Return the result for a key; None if there is none."""
        return json.loads(self._known.get(key.encode(), b"null"))

    def add(self, key: str, result: Any) -> None:
        """Append the result for a key; a result must be JSON data and not None."""
        with located(self.file, unreadable=""), self.file.open("a", encoding="utf-8") as end:
            end.write(f"{key} {json.dumps(result)}\n")

    def remove(self) -> None:
        """Delete the file, once the study has ended."""
        self.file.unlink(missing_ok=True)


def journal_of(json_file: Path | None) -> Journal | None:
    """Return the journal of a study whose results go to a JSON file."""
    return Journal(json_file.with_name(f"{json_file.name}.part")) if json_file else None


def run_side_by_side(
    workers: Workers,
    run: Callable[[Item], Result],
    items: Sequence[Item],
    unit: str,
    line: Callable[[Result], str],
    journal: Journal | None = None,
) -> tuple[dict[int, Result], StoppedError | None]:
    """Run the conditions of a study in parallel; see `run_study`."""
    return run_study(
        lambda left, stop, _: workers.completed(run, left, stop), items, unit, line, journal
    )


def run_study(
    start: Callable[[Sequence[Item], Stop, Show], Iterator[tuple[int, Result]]],
    items: Sequence[Item],
    unit: str,
    line: Callable[[Result], str],
    journal: Journal | None = None,
) -> tuple[dict[int, Result], StoppedError | None]:
    """Run the conditions of a study with a progress bar; print a line on each result.

    Parameters
    ----------
    start : callable
        Starts the runs of items, in parallel or live, and returns an iterator over indices and
        results, as `Workers.completed` does.
    items : sequence
        Arguments of the conditions.
    unit : str
        Name of the conditions.
    line : callable
        Returns the line on a result; empty for none.
    journal : Journal, optional
        Results of an earlier, interrupted run of the study, which are not computed again.

    Returns
    -------
    results : dict
        Results of the completed conditions, by index, in the order of the items.
    end : StoppedError or None
        Reason of an early end by a signal or a failed graph; None without one.
    """
    done: dict[int, Result] = {}
    # Before the runs, as results belong to the files' content at the start.
    keys = [key_of(item) for item in items] if journal else []
    if journal:
        known = ((index, journal.result(key)) for index, key in enumerate(keys))
        done = {index: result for index, result in known if result is not None}
        if done:
            print(f"{len(done)} of {len(items)} {unit} are taken from {journal.file}", flush=True)
    left = [index for index in range(len(items)) if index not in done]
    end: StoppedError | None = None
    progress = progress_bar()
    bar = progress.add_task(unit, total=len(items), completed=len(done))

    def show(part: float) -> None:
        progress.update(bar, completed=len(items) - len(left) + part)

    with stop_on_signal() as stop:
        results = start([items[index] for index in left], stop, show)  # before the bar's thread
        try:
            with progress:
                for position, result in results:
                    index = left[position]
                    done[index] = result
                    if journal:
                        journal.add(keys[index], result)
                    if text := line(result):
                        report = f"{len(done)} of {len(items)}: {text}"
                        notify_supervisor(PROGRESS, text=report)
                        print(report, flush=True)
                    progress.update(bar, completed=len(done))
        except StoppedError as error:
            end = error
        if (end or stop()) and len(done) < len(items):
            reason = end if end and not stop() else StoppedError("interrupted", INTERRUPTED)
            again = f"; {journal.again}" if journal else ""
            report = f"{str(reason) or 'failed'} after {len(done)} of {len(items)} {unit}{again}"
            end = StoppedError(report, reason.status)
    if journal and len(done) == len(items):
        journal.remove()
    return dict(sorted(done.items())), end


def key_of(condition: Any) -> str:
    """Return a text that differs between conditions, versions, and files that conditions name."""
    digest = hashlib.blake2b(version().encode(), digest_size=16)
    for part in _parts(condition):
        digest.update(part)
        digest.update(b"\0")
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """Yield a value's content as bytes, with arrays, and with size and time of named files."""
    if is_dataclass(value):
        yield type(value).__name__.encode()
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, Mapping):
        value = [*value.items()]
    if isinstance(value, np.ndarray):
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, (list, tuple)):
        yield f"{len(value)}".encode()
        for inner in value:
            yield from _parts(inner)
    else:
        yield repr(value).encode()
        if isinstance(value, str) and os.path.isfile(value):
            status = os.stat(value)
            yield f"{status.st_size} {status.st_mtime_ns}".encode()
