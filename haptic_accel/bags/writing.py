# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Writer of bags on a separate thread, so that nothing waits for the disk, and its session.

A session starts, pauses, splits and stops the recording, with one bag after another.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Protocol

from rosbags.interfaces import Connection, Qos

from haptic_accel.bags.definitions import connection
from haptic_accel.bags.files import BagFiles
from haptic_accel.bags.folder import free_name
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core.cdr import STAMP_BYTES, unpack_stamps
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import missing_samples

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
        Messages in the queue at present, and the maximum since the last request.
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
    facts : mapping
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
        Number of samples missing between the stamps of messages.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be created.
    """

    def __init__(
        self, path: Path, capacity: int, options: RecordingOptions, facts: Mapping[str, str]
    ) -> None:
        self.files = BagFiles(path, options, facts)
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
            The stamps lie on a sampling grid, so that gaps can be counted.

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

        def put(message: bytes, received: int | None = None) -> None:
            if self.paused:
                return
            if len(queue) < capacity:
                queue.append((added, received or now(), bytes(message)))
            else:
                self._overflow += 1

        return put

    @property
    def dropped(self) -> int:
        """Number of messages lost for lack of room in the queue or on the disk."""
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
            # A failure here must not appear to be a recording.
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
        """Write the queue; later messages wait for the next call."""
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
        """Count gaps up to here; later stamps start a new sequence."""
        self._count_missing()
        for stamps in self._stamps.values():
            stamps.clear()


RECORDING, PAUSED, STOPPED = "recording", "paused", "stopped"

Connect = Callable[[BagWriter], MessageWriter]

Answer = tuple[bool, str]
"""Success of a request, and a message line."""


class RecordingSession:
    """Recording session; not thread-safe.

    Parameters
    ----------
    bag : str
        Folder to create; empty for a name from date and time. If it exists, ``-2``, ``-3`` and so
        on is added.
    capacity : int
        Maximum number of messages in the queue.
    options : RecordingOptions
    facts : mapping
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
        self, bag: str, capacity: int, options: RecordingOptions, facts: Mapping[str, str]
    ) -> None:
        self._bag = bag
        self._options = options
        self._write = partial(BagWriter, capacity=capacity, facts=facts)
        self._connects: dict[str, Connect] = {}
        self._puts: dict[str, MessageWriter] = {}
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

        puts = self._puts
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
            self._puts[topic] = connect(self.writer)
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
