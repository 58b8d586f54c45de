"""Executable `recorder`: every topic of the graph into a bag."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from queue import Full, Queue
from typing import Literal

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core.parameters import ParameterError
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.topics import TOPICS, Topic

BAG_VERSION: Literal[9] = 9
"""Of metadata.yaml, as Jazzy and newer write it."""

DEPTH = 1000
"""Messages of one topic that the middleware keeps while Python is busy."""

NICENESS = 10
"""How much less the recorder asks for a core than the nodes that make the force."""

_UNSPECIFIED = QosTime(0, 0)

Written = tuple[Connection, int, bytes]


class BagWriter:
    """Writes messages to a bag on a thread of its own, from a bounded queue.

    Parameters
    ----------
    path : Path
        Folder to make.
    capacity : int
        Messages that may wait.

    Attributes
    ----------
    written, dropped : int
        Messages in the bag; messages for which the queue had no room, or the disk none.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be made.
    """

    def __init__(self, path: Path, capacity: int) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = Writer(path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise ParameterError(f"bag = '{path}': must be a folder to make: {error}") from None
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._queue: Queue[Written | None] = Queue(capacity)
        self._thread = threading.Thread(target=self._write, name="bag writer")
        self.written = self.dropped = 0
        self.failure = ""
        self._thread.start()

    def connect(self, topic: Topic, name: str) -> Callable[[bytes], None]:
        """Add a topic by its full name; return what to call with each serialised message."""
        connection = self._writer.add_connection(
            name,
            topic.type,
            typestore=self._types,
            offered_qos_profiles=[_offered(topic)],
        )
        return partial(self._put, connection)

    @property
    def waiting(self) -> int:
        """How many messages wait."""
        return self._queue.qsize()

    def close(self) -> None:
        """Write what waits, then finish the file and its metadata."""
        self._queue.put(None)
        self._thread.join()
        self._writer.close()

    def _put(self, connection: Connection, message: bytes) -> None:
        try:
            self._queue.put_nowait((connection, time.time_ns(), bytes(message)))
        except Full:
            self.dropped += 1

    def _write(self) -> None:
        while (item := self._queue.get()) is not None:
            if self.failure:
                self.dropped += 1
                continue
            try:
                self._writer.write(*item)
                self.written += 1
            except OSError as error:
                # A full disk: what was written stays, what comes is counted.
                self.failure = str(error)
                self.dropped += 1


class Recorder(GraphNode):
    """Takes messages as they are serialised and hands them to the writer."""

    def __init__(self) -> None:
        super().__init__("recorder")
        path = Path(self.parameters.bag or f"bags/{datetime.now():%Y-%m-%d_%H-%M-%S}")
        self._bag = BagWriter(path, self.parameters.queue)
        self._path = path
        self._reported = 0
        for topic in TOPICS:
            name = self.resolve_topic_name(topic.name)
            self.subscribe_raw(topic, self._bag.connect(topic, name), DEPTH)
        self.get_logger().info(f"recording to {path}")

    def close(self) -> None:
        """Finish the bag and say what is in it."""
        self._bag.close()
        bag = self._bag
        print(f"{self._path}: {bag.written} messages, {bag.dropped} dropped", flush=True)
        if bag.failure:
            raise OSError(f"{self._path}: {bag.failure}")

    def status(self) -> tuple[str, dict[str, str]]:
        """Return how many messages are written, waiting and dropped."""
        bag = self._bag
        new = bag.dropped - self._reported
        self._reported = bag.dropped
        if new:
            self.get_logger().warning(f"{new} messages dropped {bag.failure}".rstrip())
        warning = bag.failure or (f"{bag.dropped} messages dropped" if bag.dropped else "")
        return warning, {
            "bag": str(self._path),
            "written": str(bag.written),
            "waiting": str(bag.waiting),
            "dropped": str(bag.dropped),
        }


def _offered(topic: Topic) -> Qos:
    """Return a topic's quality of service as rosbag2 stores it."""
    return Qos(
        QosHistory.KEEP_LAST,
        DEPTH,
        QosReliability.RELIABLE if topic.reliable else QosReliability.BEST_EFFORT,
        QosDurability.VOLATILE,
        _UNSPECIFIED,
        _UNSPECIFIED,
        QosLiveliness.AUTOMATIC,
        _UNSPECIFIED,
        False,
    )


def main() -> None:
    """Run the node."""
    # The force that is felt does not wait for its being written down. Said before the
    # middleware starts its threads, which inherit it.
    os.nice(NICENESS)
    run("recorder", Recorder, realtime=False)


if __name__ == "__main__":
    main()
