# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writer of bags on a separate thread, so that nodes never wait for the disk; sessions.

`BagFiles` splits files, writes metadata and handles errors. A `RecordingSession` starts, pauses,
splits and stops recordings, with one bag after another. `write_trial` writes a lockstep trial
like a live bag.
"""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from rosbags.interfaces import Connection, Qos

from haptic_accel.bags.chunked_writer import ChunkedWriter, MisplacedError
from haptic_accel.bags.folder import MCAP, free_name, listed_name
from haptic_accel.bags.mcap import Tally
from haptic_accel.bags.metadata import Metadata, connection, file_entry, topic_entry
from haptic_accel.bags.recording_options import ZSTD_FAST, RecordingOptions
from haptic_accel.bags.trial_metadata import PARAMETERS, description, read_custom_data
from haptic_accel.core import topics
from haptic_accel.core.cdr import STAMP_BYTES, StampedVector, pack_text, unpack_stamps
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, missing_samples
from haptic_accel.core.topics import Topic

if TYPE_CHECKING:
    from haptic_accel.core.trial import Trial


class BagFiles:
    """Folder of a bag with its files; the last one is being written.

    Recording raises no exceptions. The first OSError ends the recording; earlier messages remain
    readable, later messages are counted.

    Parameters
    ----------
    path : Path
        Folder to create.
    options : RecordingOptions
    custom : mapping
        Custom data of the bag, text by name.

    Attributes
    ----------
    lost : int
        Number of messages missing in the bag.
    bytes : int
        Total size of the written messages.
    failure : str
        Error that ended the recording; empty while it continues.
    trouble : str
        Error despite which the recording continues; empty if none.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be created.
    """

    def __init__(self, path: Path, options: RecordingOptions, custom: Mapping[str, str]) -> None:
        self.path = path
        self.lost = self.bytes = 0
        self.failure = self.trouble = ""
        self._options = options
        self._custom = custom
        self._connections: list[Connection] = []
        self._finished: dict[str, Tally] = {}
        self._messages = 0  # messages in the file being written
        self._start = 0  # recording time of the file's first message
        self._is_misplaced = False
        self._moved_to: Path | None = None  # new location of misplaced files
        self._known: dict[str, os.stat_result] = {}  # finished files, to detect replaced ones
        try:
            path.mkdir(parents=True)
            self._file: ChunkedWriter | None = self._open(0)
            self._metadata().write(path)
        except OSError as error:
            reason = _reason(error)
            raise ParameterError(f"bag = '{path}': must be a folder to make: {reason}") from None

    @property
    def written(self) -> int:
        """Number of messages in the bag, including pending ones."""
        return sum(tally.messages for tally in self._finished.values()) + self._messages

    @property
    def file_names(self) -> list[str]:
        """Names of the bag's files; the last file is open until the bag is closed."""
        return list(self._tallies)

    @property
    def free_space(self) -> int:
        """Free space on the disk, bytes; 0 if the folder no longer exists."""
        try:
            return shutil.disk_usage(self.path).free
        except OSError:
            return 0

    def add(self, added: Connection) -> None:
        """Add a topic."""
        self._connections.append(added)
        self._attempt(ChunkedWriter.add, added)

    def write(self, topic: Connection, received: int, data: bytes) -> None:
        """Add a message of a known topic, recorded at a system time in ns."""
        if self._is_full(received):
            self.split()
        if not self._file or self.failure:
            self.lost += 1
            return
        try:
            self._file.write(topic, received, data)
        except OSError as error:
            self.lost += 1
            self._fail(error)
            return
        self._start = self._start or received
        self._messages += 1
        self.bytes += len(data)

    def flush(self) -> None:
        """Write everything to the disk."""
        self._attempt(ChunkedWriter.flush)

    def split(self) -> None:
        """Continue in a new file, or in the same file if none can be created."""
        self.flush()
        if self.failure:
            return
        try:
            following = self._open(len(self._finished) + 1)
        except OSError as error:
            self._start = 0  # no new attempt at each message
            self.trouble = f"{self.path}: cannot be split: {_reason(error)}"
            return
        self._attempt(self._close_file)
        if self.failure:
            following.path.unlink(missing_ok=True)
            return
        self._file = following
        for known in self._connections:
            self._attempt(ChunkedWriter.add, known)
        self._renew_metadata()

    def close(self) -> None:
        """Finish the last file and write the metadata."""
        self._attempt(self._close_file)
        self._forget_lost_files()
        if not self._renew_metadata() and not self.failure:
            self.failure, self.trouble = self.trouble, ""

    def summary(self, dropped: int) -> str:
        """Return a line on the numbers of saved and lost messages.

        Parameters
        ----------
        dropped : int
            Number of messages missing in the bag.
        """
        if not self.failure:
            return f"{self.path}: {self.written} messages, {dropped} dropped"
        end = max(tally.end for tally in self._tallies.values()) if self.written else 0
        until = f" up to {datetime.fromtimestamp(end / NANOSECONDS):%H:%M:%S}" if end else ""
        trouble = f"; {self.trouble}" if self.trouble else ""
        where = f" in {self._moved_to}" if self._moved_to and self.written else ""
        return (
            f"{self.path}: {self.failure}: {self.written} messages{until} are saved{where} and can"
            f" be read, {dropped} are not{trouble}"
        )

    def _attempt(self, action: Callable[..., None], *args: object) -> None:
        """Apply an action to the current file, unless the recording has failed."""
        if not self._file or self.failure:
            return
        try:
            action(self._file, *args)
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        """End the recording and keep the saved messages."""
        assert self._file
        self.failure = _reason(error)
        try:
            self._file.give_up(self._metadata().text)
        except OSError:
            self.trouble = f"{self._file.path.name} has no index: haptic-accel bag repair makes it"
        written, self._messages = self.written, self._file.kept.messages
        if isinstance(error, MisplacedError):
            self._is_misplaced = True
            if error.is_removed:
                self._messages = 0
            elif error.location:
                is_renamed = error.location.name != self._file.path.name
                self._moved_to = error.location if is_renamed else error.location.parent
        self.lost += written - self.written
        self._forget_lost_files()
        self._renew_metadata()

    def _forget_lost_files(self) -> None:
        """Count the messages of finished files that are no longer there as lost."""
        lost = [name for name in self._finished if not self._is_there(name)]
        for name in lost:
            self.lost += self._finished.pop(name).messages
        if lost and not self.failure:
            self.failure = f"{lost[0]} was removed or replaced after it was recorded"

    def _is_there(self, name: str) -> bool:
        """Return whether a finished file still exists under its name."""
        for folder in (self.path, self._moved_to):
            with suppress(OSError):
                if folder and os.path.samestat((folder / name).stat(), self._known[name]):
                    return True
        return False

    def _is_full(self, received: int) -> bool:
        if not (self._start and self._file):
            return False
        size, duration = self._options.max_bag_size, self._options.max_bag_duration
        is_long = received - self._start >= duration * NANOSECONDS
        return bool(size and self._file.size >= size) or bool(duration and is_long)

    def _open(self, number: int) -> ChunkedWriter:
        compressed = self._options.storage_preset_profile == ZSTD_FAST
        name = f"{listed_name(self.path.name)}_{number}{MCAP}"
        return ChunkedWriter(self.path / name, compressed=compressed)

    def _close_file(self, file: ChunkedWriter) -> None:
        """Finish the file and add it to the list of finished files."""
        file.flush()
        self._known[file.path.name] = file.path.stat()
        file.finish(self._metadata().text)
        self._finished[file.path.name] = file.kept
        self._file = None
        self._messages = self._start = 0

    def _renew_metadata(self) -> bool:
        """Write the metadata; return whether this succeeded."""
        if self._is_misplaced:
            return True  # do not touch a folder that replaced the bag's
        try:
            self._metadata().write(self.path)
        except OSError as error:
            self.trouble = f"metadata.yaml cannot be written: {_reason(error)}"
            return False
        return True

    @property
    def _tallies(self) -> dict[str, Tally]:
        """Counts of the saved messages by file name."""
        file = self._file
        return self._finished | ({file.path.name: file.kept} if file else {})

    def _metadata(self) -> Metadata:
        """Return the metadata of the saved messages."""
        tallies = self._tallies
        counts = sum((tally.counts for tally in tallies.values()), Counter[int]())
        topics = tuple(topic_entry(known, counts[known.id]) for known in self._connections)
        files = tuple(file_entry(name, tally) for name, tally in tallies.items())
        return Metadata(files, topics, self._custom)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


FLUSH_PERIOD = 0.5
"""Interval between flushes, s; a power cut loses no more than this."""

DRAIN_PERIOD = 0.02
"""Interval for emptying the queue, s; a wake-up for each message would cost more."""

ENOUGH = 20
"""Number of stamps that determine a topic's period."""

Message = tuple[Connection, int, bytes]
Command = Callable[[], None]


class MessageWriter(Protocol):
    """Receiver of the messages of one topic."""

    def __call__(self, message: bytes, received: int | None = None) -> None:
        """Add a serialised message, received at a system time in ns; default: now."""


@dataclass(frozen=True)
class Load:
    """Load of the writer.

    Attributes
    ----------
    waiting, highest : int
        Number of messages in the queue at present, and maximum since the last request.
    flush_time : float
        Longest duration of a flush since the last request, s.
    """

    waiting: int
    highest: int
    flush_time: float


class BagWriter:
    """Writer of messages to a bag, on a separate thread with a bounded queue.

    Parameters
    ----------
    path : Path
        Folder to create.
    capacity : int
        Maximum number of messages in the queue.
    options : RecordingOptions
    custom : mapping
        Custom data of the bag, text by name.

    Attributes
    ----------
    files : BagFiles
        Written files, for reading only.
    capacity : int
        Maximum number of messages in the queue.
    paused : bool
        True while messages are skipped.
    missing : int
        Number of samples missing according to gaps between stamps.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be created.
    """

    def __init__(
        self, path: Path, capacity: int, options: RecordingOptions, custom: Mapping[str, str]
    ) -> None:
        self.files = BagFiles(path, options, custom)
        self.paused = options.start_paused
        self.capacity = capacity
        self._overflow = 0
        self._topics = 0
        self.missing = 0
        self._stamps: dict[int, list[bytes]] = {}
        self._highest = 0
        self._flush_time = 0.0
        # One thread appends, another removes from the other end, which needs no lock.
        self._queue: deque[Message | Command] = deque()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def connect(
        self, topic: str, kind: str, offered: Sequence[Qos], *, sampled: bool = False
    ) -> MessageWriter:
        """Add a topic; return a function to call with each serialised message.

        Parameters
        ----------
        topic, kind : str
            Full name and message type.
        offered : sequence of Qos
            Quality of service offered by its publishers.
        sampled : bool
            True if the stamps lie on a sampling grid, so that gaps can be counted.

        Raises
        ------
        UndefinedTypeError
            The type has no definition.
        """
        added = connection(self._topics + 1, topic, kind, offered)
        self._topics = added.id
        if sampled:
            self._stamps[added.id] = []
        self._queue.append(lambda: self.files.add(added))
        queue, capacity, now = self._queue, self.capacity, time.time_ns

        def write(message: bytes, received: int | None = None) -> None:
            if self.paused:
                return
            if len(queue) < capacity:
                queue.append((added, received or now(), bytes(message)))
            else:
                self._overflow += 1

        return write

    @property
    def dropped(self) -> int:
        """Number of messages lost for lack of space in the queue or on the disk."""
        return self._overflow + self.files.lost

    def pop_load(self) -> Load:
        """Return the load since the last call."""
        waiting = len(self._queue)
        highest, self._highest = max(self._highest, waiting), 0
        flush_time, self._flush_time = self._flush_time, 0.0
        return Load(waiting, highest, flush_time)

    def pause(self) -> None:
        """Skip messages from now on."""
        self.paused = True
        self._queue.append(self._forget_stamps)

    def resume(self) -> None:
        """Record messages again."""
        self.paused = False

    def split(self) -> None:
        """Continue in another file."""
        self._queue.append(self.files.split)

    def close(self) -> str:
        """Write the queue, finish the bag, return `BagFiles.summary`; discard later messages."""
        self.paused = True
        self._closing.set()
        self._thread.join()
        return self.files.summary(self.dropped)

    def _run(self) -> None:
        try:
            self._record()
        except Exception as error:
            # After a failure here, the recording must not seem to continue.
            self.files.failure = f"{type(error).__name__}: {error}"
            raise

    def _record(self) -> None:
        due = time.monotonic() + FLUSH_PERIOD
        while not self._closing.wait(DRAIN_PERIOD):
            self._drain()
            if time.monotonic() >= due:
                self._flush()
                due = time.monotonic() + FLUSH_PERIOD
        self._drain()
        self._flush()
        self.files.close()

    def _drain(self) -> None:
        """Write the messages in the queue; later messages wait for the next call."""
        queue, write, stamps = self._queue, self.files.write, self._stamps
        waiting = len(queue)
        self._highest = max(self._highest, waiting)
        for _ in range(waiting):
            item = queue.popleft()
            if not isinstance(item, tuple):
                item()
                continue
            topic, received, data = item
            if topic.id in stamps:
                stamps[topic.id].append(data[STAMP_BYTES])
            write(topic, received, data)

    def _flush(self) -> None:
        self._count_missing()
        start = time.monotonic()
        self.files.flush()
        self._flush_time = max(self._flush_time, time.monotonic() - start)

    def _count_missing(self) -> None:
        for stamps in self._stamps.values():
            if len(stamps) >= ENOUGH:
                self.missing += missing_samples(unpack_stamps(b"".join(stamps)))
                del stamps[:-1]

    def _forget_stamps(self) -> None:
        """Count gaps so far; later stamps start a new sequence."""
        self._count_missing()
        for stamps in self._stamps.values():
            stamps.clear()


RECORDING, PAUSED, STOPPED = "recording", "paused", "stopped"

Connect = Callable[[BagWriter], MessageWriter]

Answer = tuple[bool, str]
"""Success of a request, and a one-line message."""


class RecordingSession:
    """Recording session; not thread-safe.

    Parameters
    ----------
    bag : str
        Folder to create; empty for a name from date and time. If the folder exists, ``-2``, ``-3``
        and so on is appended.
    capacity : int
        Maximum number of messages in the queue.
    options : RecordingOptions
    custom : mapping
        Custom data of each bag, text by name.

    Attributes
    ----------
    writer : BagWriter
        Writer of the present or last bag.
    failures : list of str
        One line for each bag whose recording failed.

    Raises
    ------
    ParameterError
        The folder cannot be created.
    """

    def __init__(
        self, bag: str, capacity: int, options: RecordingOptions, custom: Mapping[str, str]
    ) -> None:
        self._bag = bag
        self._options = options
        self._write = partial(BagWriter, capacity=capacity, custom=custom)
        self._connects: dict[str, Connect] = {}
        self._writers: dict[str, MessageWriter] = {}
        self._stopped = False
        self.failures: list[str] = []
        self.writer = self._open(options)

    def connect(
        self, topic: str, kind: str, offered: Sequence[Qos], *, sampled: bool = False
    ) -> MessageWriter:
        """Add a topic to this bag and all later ones; see `BagWriter.connect`.

        Raises
        ------
        UndefinedTypeError
            The type has no definition.
        """

        def connect(writer: BagWriter) -> MessageWriter:
            return writer.connect(topic, kind, offered, sampled=sampled)

        puts = self._writers
        puts[topic] = connect(self.writer)
        self._connects[topic] = connect
        return lambda message, received=None: puts[topic](message, received)

    @property
    def state(self) -> str:
        """`RECORDING`, `PAUSED` or `STOPPED`."""
        if self._stopped:
            return STOPPED
        return PAUSED if self.writer.paused else RECORDING

    @property
    def path(self) -> Path:
        """Folder of the present or last bag."""
        return self.writer.files.path

    def start(self) -> Answer:
        """Continue after a pause, or start another bag after a stop."""
        if self.state == RECORDING:
            return False, f"{self.path}: is being recorded already"
        if self.state == PAUSED:
            self.writer.resume()
            return True, f"{self.path}: recording goes on"
        try:
            self.writer = self._open(replace(self._options, start_paused=False))
        except ParameterError as error:
            return False, str(error)
        for topic, connect in self._connects.items():
            self._writers[topic] = connect(self.writer)
        self._stopped = False
        return True, f"{self.path}: recording"

    def pause(self) -> Answer:
        """Skip messages until the next start."""
        if self.state != RECORDING:
            return False, f"{self.path}: is {self.state} already"
        self.writer.pause()
        return True, f"{self.path}: paused"

    def split(self) -> Answer:
        """Continue in another file of the bag."""
        if self.state == STOPPED:
            return False, f"{self.path}: is {self.state}: nothing to split"
        self.writer.split()
        return True, f"{self.path}: another file follows {self.writer.files.file_names[-1]}"

    def stop(self) -> Answer:
        """Finish the bag."""
        if self.state == STOPPED:
            return False, f"{self.path}: is {self.state} already"
        self._stopped = True
        summary = self.writer.close()
        if self.writer.files.failure:
            self.failures.append(summary)
        return not self.writer.files.failure, summary

    def _open(self, options: RecordingOptions) -> BagWriter:
        path = Path(self._bag or f"bags/{datetime.now():%Y-%m-%d_%H-%M-%S}")
        return self._write(free_name(path), options=options)


_TOPICS = (*topics.SIGNALS, topics.CONTACT_FORCE)

_FIELDS = ("tool_acceleration", "desired_acceleration", "handle_acceleration", "actuator_force")
"""Fields of a trial for the topics `ANALYSED`, in the same order."""


def trial_vectors(trial: Trial) -> dict[Topic, FloatArray]:
    """Return a trial's signals by topic, shape (n, 3) each; `SIGNALS` come first."""
    found = dict(trial.arms)
    for topic, name in zip(topics.ANALYSED, _FIELDS, strict=True):
        found[topic.name] = np.zeros((len(trial.time), 3))
        found[topic.name][:, trial.axes.indices] = np.c_[getattr(trial, name)]
    return {topic: found[topic.name] for topic in _TOPICS if topic.name in found}


def write_trial(path: Path, trial: Trial, custom: Mapping[str, str], start: int) -> None:
    """Write a trial's signals.

    Parameters
    ----------
    path : Path
        Folder to create.
    trial : Trial
    custom : mapping
        Metadata, text by name.
    start : int
        Stamp of the first sample, system time in ns; samples are one period apart.

    Raises
    ------
    ParameterError
        The folder exists already, or cannot be written.
    """
    files = BagFiles(path, RecordingOptions(), custom)
    if stated := read_custom_data(custom):  # other programs copy messages, not metadata
        described = connection(1, f"/{topics.DESCRIPTION.name}", topics.DESCRIPTION.type, [])
        files.add(described)
        files.write(described, start, pack_text(json.dumps({PARAMETERS: {}} | stated)))
        if trial.failed is not None:
            changed = description("compensator", {"controller": "none"})
            files.write(described, start + round(trial.failed * NANOSECONDS), pack_text(changed))
    added = []
    for number, (topic, vectors) in enumerate(trial_vectors(trial).items(), start=2):
        found = connection(number, f"/{topic.name}", topic.type, [])
        files.add(found)
        added.append((found, StampedVector(topic), vectors.tolist()))
    for index in range(len(trial.time)):
        stamp = start + round(index * NANOSECONDS / trial.rate)
        for found, message, rows in added:
            files.write(found, stamp, message.pack(stamp, rows[index]))
    files.close()
    if files.failure:
        raise ParameterError(f"{path}: cannot be written: {files.failure}")
