# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Append-only log of a session: a line of JSON for each event, flushed to disk at once.

Each line has the SHA-256 of the previous line, so that changed, removed or inserted lines are
detected. The SHA-256 of the last line, the head, identifies the whole log: a copy of the head
reveals a changed or missing end, and a log that was hashed again. Contents that name conditions
are sealed in base64, to prevent reading by accident, not by intent.
"""

from __future__ import annotations

import base64
import errno
import hashlib
import io
import json
import math
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from haptic_accel import ParameterError
from haptic_accel.core import located, opened, sync_folder
from haptic_accel.kits.study import trials
from haptic_accel.kits.study.protocol import Condition

Entry: TypeAlias = dict[str, Any]
"""Line of a log: its kind and content."""

LOG = "log.jsonl"
"""Name of a session's log in the participant's folder."""

FORMAT = 1
"""Version of the format, stored in the first line of each log."""

LARGEST_LOG = 1 << 28
"""Maximum size of a log, bytes; a trial takes about 2,000."""

PRIVATE = 0o600
"""File mode of a log: readable by its owner only."""

SESSION, CONSENT, SITTING, TRIAL, END = "session", "consent", "sitting", "trial", "end"
"""Kinds of a session's lines: its start, the answer to the consent text, the start of a sitting, a
trial, and the end of a sitting."""

RUNNING = "running"
"""State, in place of an end, of a session that a process is running."""

LOCKING_TIME = 0.5
"""Time-out for locking a log, s; readers lock it only for an instant."""

LOCK_RETRY_PERIOD = 0.01
"""Interval between two attempts to lock a log, s."""

OPEN = ("asked", "answered", "asked_steady", "answered_steady", "attempt")
"""Fields of a trial that are not sealed."""


@dataclass(frozen=True)
class Chain:
    """Complete lines of a log.

    Attributes
    ----------
    entries : list of dict
    heads : list of str
        SHA-256 of each line, in hexadecimal digits. The first one identifies the session, as the
        first line has the time and a random number.
    size : int
        Size of all lines, bytes.
    """

    entries: list[Entry]
    heads: list[str]
    size: int

    @property
    def head(self) -> str:
        """SHA-256 of the last line; empty without one."""
        return self.heads[-1] if self.heads else ""


class Entries:
    """Log in memory, for simulations without a file."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def add(self, kind: str, **content: Any) -> None:
        """Append an entry with the present time; it is stored once the method returns."""
        self.entries.append(self._entry(kind, content))

    @property
    def record(self) -> trials.SessionRecord:
        """Session described by the entries."""
        return session_of(self.entries)

    def dose_since(self, begin: int) -> float:
        """Return the vibration dose since a system time in ns, m^2/s^3."""
        return math.fsum(each.get("dose", 0) for each in self.entries if each["at"] >= begin)

    def _entry(self, kind: str, content: Mapping[str, Any]) -> Entry:
        begin = {} if self.entries else {"format": FORMAT}
        return {"kind": kind, "at": time.time_ns(), **begin, **content}


class Log(Entries):
    """Log in a file, which one process at a time may append to.

    An incomplete last line, after a kill or a power cut, was never acknowledged, and is removed.

    Parameters
    ----------
    file : Path
        File of the log, made with its folders if missing.
    patience : float
        Time-out while another process has the log open, s.

    Raises
    ------
    ParameterError
        The file cannot be read, was changed, is of another version, or is in use by another
        process.
    OSError
        The disk is full; `add` raises this, too.
    """

    def __init__(self, file: Path, patience: float = LOCKING_TIME) -> None:
        super().__init__()
        self.file = file
        file.parent.mkdir(parents=True, exist_ok=True)
        self._end = io.FileIO(file, "ab", opener=partial(os.open, mode=PRIVATE))
        try:
            lock(self._end, file, patience)
            chain = read_chain(file)
            self.entries, self.heads, self._size = chain.entries, chain.heads, chain.size
            self._end.truncate(self._size)
            sync_folder(file.parent)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Log:
        """Return the log."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._end.close()

    def add(self, kind: str, **content: Any) -> None:
        """Append a line and flush it to disk.

        Raises
        ------
        OSError
            The line cannot be written; the file then ends with the previous line.
        """
        entry = self._entry(kind, content)
        before = self.heads[-1] if self.heads else ""
        line = json.dumps({"before": before, **entry}).encode() + b"\n"
        try:
            if (self._end.write(line) or 0) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._end)
        except OSError as error:
            with suppress(OSError):
                self._end.truncate(self._size)
            error.filename = str(self.file)
            raise
        self._size += len(line)
        self.heads.append(hashlib.sha256(line).hexdigest())
        self.entries.append(entry)


def lock(end: io.FileIO, file: Path, patience: float = LOCKING_TIME) -> None:
    """Keep other processes from running the session of an open log, until it is closed.

    Raises
    ------
    ParameterError
        Another process still runs the session after `patience` s.
    """
    import fcntl  # not on Windows, where no session can run

    due = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(end.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() > due:
                raise ParameterError(f"{file}: another process runs this session") from None
        time.sleep(LOCK_RETRY_PERIOD)


def is_running(file: Path) -> bool:
    """Return whether a process runs the session of a log."""
    try:
        import fcntl
    except ModuleNotFoundError:
        return False
    with located(file), opened(file, LARGEST_LOG) as lines:
        try:
            fcntl.flock(lines.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def read_session(folder: Path) -> trials.SessionRecord:
    """Return the contents of the log in a participant's folder, even while the session runs.

    Raises
    ------
    ParameterError
        The log cannot be read, was changed, or is of another version.
    """
    if (found := read_log(folder)) is None:
        raise ParameterError(f"{folder / LOG}: must be a session's log: it has no session")
    return found[1]


def read_log(folder: Path) -> tuple[Chain, trials.SessionRecord] | None:
    """Return the lines of the log in a participant's folder, and the session in them.

    The result is None without a complete line.

    Raises
    ------
    ParameterError
        As for `read_session`.
    """
    file = folder / LOG
    running = is_running(file)  # before the lines are read, as the last may end the session
    chain = read_chain(file)
    if not chain.entries:
        return None
    with located(file, "must be a session's log"):
        try:
            session = session_of(chain.entries)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"{type(error).__name__} {error}") from None
    return chain, replace(session, ended=RUNNING) if running else session


def read_chain(file: Path) -> Chain:
    """Return the complete lines of a log.

    Raises
    ------
    ParameterError
        As for `read_session`.
    """
    entries, heads, size = list[Entry](), list[str](), 0
    with located(file), opened(file, LARGEST_LOG) as lines:
        for number, line in enumerate(lines, 1):
            if not line.endswith(b"\n"):
                break
            entries.append(_entry(line, heads[-1] if heads else "", number))
            heads.append(hashlib.sha256(line).hexdigest())
            size += len(line)
    return Chain(entries, heads, size)


def session_of(entries: list[Entry]) -> trials.SessionRecord:
    """Return the session described by entries."""
    first = next((entry for entry in entries if entry["kind"] == SESSION), None)
    if first is None:
        raise ValueError("no line states a session")
    agreed = (each["version"] for each in entries if each["kind"] == CONSENT and each["agreed"])
    ends = [each.get("reason", "") for each in entries if each["kind"] in (SITTING, END)]
    return trials.SessionRecord(
        **{name: first[name] for name in ("participant", "digest", "seed", "row")},
        consent=next(agreed, ""),
        begun=first["at"],
        records=tuple(trial_of(each) for each in entries if each["kind"] == TRIAL),
        ended=ends[-1] if ends else "",
        exposure=math.fsum(each.get("dose", 0) for each in entries),
        simulated=first.get("simulated") is True,
    )


def trial_entry(record: trials.TrialRecord) -> Entry:
    """Return the content of a trial's line, with sealed conditions, answer and measures."""
    content = asdict(record)
    open_fields = {name: content.pop(name) for name in OPEN}
    return {"number": record.trial.number, **open_fields, "sealed": seal(content)}


def trial_of(entry: Entry) -> trials.TrialRecord:
    """Return the trial of a line."""
    content = unseal(entry["sealed"])
    trial, answer = content["trial"], content["answer"]
    stimuli = tuple(Condition(tuple(map(tuple, each["settings"]))) for each in trial["stimuli"])
    planned = trial | {"stimuli": stimuli, "answers": tuple(trial["answers"])}
    return trials.TrialRecord(
        trial=trials.PlannedTrial(**planned),
        presented=tuple(trials.PresentedStimulus(**each) for each in content["presented"]),
        answer=trials.Answer(**answer) if answer else None,
        flaw=content["flaw"],
        **{name: entry[name] for name in OPEN},
    )


def seal(content: Mapping[str, Any]) -> str:
    """Return content encoded as text, so that nobody reads it by accident."""
    return base64.b64encode(json.dumps(content).encode()).decode()


def unseal(text: str) -> dict[str, Any]:
    """Return the content of a sealed text."""
    content: dict[str, Any] = json.loads(base64.b64decode(text, validate=True))
    return content


def _entry(line: bytes, before: str, number: int) -> Entry:
    try:
        entry = json.loads(line)
        stated, _ = entry.pop("before"), entry["kind"]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise ParameterError(f"line {number} is damaged") from None
    if stated != before:
        raise ParameterError(f"line {number} does not follow the line before it: it was changed")
    if number == 1 and entry.get("format") != FORMAT:
        raise ParameterError(
            f"format = {entry.get('format')}: must be {FORMAT}, of this version of haptic_accel"
        )
    return dict(entry)
