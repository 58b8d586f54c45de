"""Writes a bag on a thread of its own, so that nothing waits for the disk."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection, Qos

from haptic_accel.bags.definitions import connection
from haptic_accel.bags.files import BagFiles
from haptic_accel.bags.gaps import StampGaps
from haptic_accel.bags.recording_options import RecordingOptions

FLUSH_PERIOD = 0.5
"""How much a power cut takes at most, s."""

DRAIN_PERIOD = 0.02
"""How often the queue is emptied, s: waking for each message would cost more than writing it."""

Message = tuple[Connection, int, bytes]
Command = Callable[[], None]


@dataclass(frozen=True)
class Load:
    """How hard it is to keep up.

    Attributes
    ----------
    waiting, highest : int
        Messages that wait, and the most that did since this was last asked.
    flush_time : float
        Longest time that the disk took since this was last asked, s.
    free_space : int
        Left on the disk, bytes.
    """

    waiting: int
    highest: int
    flush_time: float
    free_space: int


class BagWriter:
    """Writes messages to a bag on a thread of its own, from a bounded queue.

    Parameters
    ----------
    path : Path
        Folder to make.
    capacity : int
        Messages that may wait.
    options : RecordingOptions
    facts : mapping
        What the bag says of itself, text by name.

    Attributes
    ----------
    files : BagFiles
        What is written, to be read only.
    paused : bool
        Whether messages are left out.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be made.
    """

    def __init__(
        self, path: Path, capacity: int, options: RecordingOptions, facts: Mapping[str, str]
    ) -> None:
        self.files = BagFiles(path, options, facts)
        self.paused = options.start_paused
        self._capacity = capacity
        self._overflow = 0
        self._topics = 0
        self._gaps: dict[int, StampGaps] = {}
        self._highest = 0
        self._flush_time = 0.0
        # One thread appends, another takes from the other end: that needs no lock.
        self._queue: deque[Message | Command] = deque()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def connect(
        self, topic: str, kind: str, offered: Sequence[Qos], *, sampled: bool = False
    ) -> Callable[[bytes], None]:
        """Add a topic; return what to call with each serialised message.

        Parameters
        ----------
        topic, kind : str
            Full name and message type.
        offered : sequence of Qos
            What its publishers offer.
        sampled : bool
            Whether its messages have stamps on a grid, so that gaps can be counted.

        Raises
        ------
        UndefinedTypeError
            There is no definition of the type.
        """
        added = connection(self._topics + 1, topic, kind, offered)
        self._topics = added.id
        if sampled:
            self._gaps[added.id] = StampGaps()
        self._queue.append(lambda: self.files.add(added))
        queue, capacity, now = self._queue, self._capacity, time.time_ns

        def put(message: bytes) -> None:
            if self.paused:
                return
            if len(queue) < capacity:
                queue.append((added, now(), bytes(message)))
            else:
                self._overflow += 1

        return put

    @property
    def dropped(self) -> int:
        """Messages for which the queue had no room, or the disk none."""
        return self._overflow + self.files.lost

    @property
    def missing(self) -> int:
        """Samples that stamps show to be missing."""
        return sum(gaps.missing for gaps in self._gaps.values())

    def take_load(self) -> Load:
        """Return how hard it is to keep up."""
        waiting = len(self._queue)
        highest, self._highest = max(self._highest, waiting), 0
        flush_time, self._flush_time = self._flush_time, 0.0
        return Load(waiting, highest, flush_time, self.files.free_space)

    def pause(self) -> None:
        """Leave out what comes."""
        self.paused = True
        self._queue.append(self._forget_stamps)

    def resume(self) -> None:
        """Record what comes."""
        self.paused = False

    def split(self) -> None:
        """Put what comes into another file."""
        self._queue.append(self.files.split)

    def close(self) -> str:
        """Write what waits and finish the bag; return one line: what is saved and what not."""
        self._closing.set()
        self._thread.join()
        return self.files.summary(self.dropped)

    def _run(self) -> None:
        try:
            self._record()
        except Exception as error:
            # A fault in here must not pass for a recording.
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
        """Take what waits now; what comes meanwhile waits for the next time."""
        queue, write, gaps = self._queue, self.files.write, self._gaps
        waiting = len(queue)
        self._highest = max(self._highest, waiting)
        for _ in range(waiting):
            item = queue.popleft()
            if not isinstance(item, tuple):
                item()
                continue
            topic, received, data = item
            if topic.id in gaps:
                gaps[topic.id].take(data)
            write(topic, received, data)

    def _flush(self) -> None:
        for gaps in self._gaps.values():
            gaps.count()
        start = time.monotonic()
        self.files.flush()
        self._flush_time = max(self._flush_time, time.monotonic() - start)

    def _forget_stamps(self) -> None:
        for gaps in self._gaps.values():
            gaps.forget()
