"""The files of a bag while it is recorded: split, compressed, described, and saved."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path

from rosbags.interfaces import Connection

from haptic_accel.bags.compression import compress_file, is_compressed, message_compressor
from haptic_accel.bags.metadata import FileEntry, Metadata, topic_entry
from haptic_accel.bags.recording_options import FILE, MESSAGE, NONE, RecordingOptions
from haptic_accel.bags.storage import SUFFIXES, Storage, open_storage
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS


class BagFiles:
    """A bag's folder with its files, the last of which is written.

    Nothing is raised while recording: the first OSError ends it, what was saved by then stays
    readable, and what comes is counted.

    Parameters
    ----------
    path : Path
        Folder to make.
    options : RecordingOptions
    facts : mapping
        What the bag says of itself, text by name.

    Attributes
    ----------
    written, lost : int
        Messages in the bag, or about to be; messages that are not.
    bytes : int
        Of all messages written.
    failure : str
        What ended the recording, empty as long as it goes on.
    trouble : str
        What did not work and ended nothing, empty if all did.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be made.
    """

    def __init__(self, path: Path, options: RecordingOptions, facts: Mapping[str, str]) -> None:
        self.path = path
        self.lost = self.bytes = 0
        self.failure = self.trouble = ""
        self._options = options
        self._facts = facts
        self._connections: list[Connection] = []
        self._finished: list[FileEntry] = []
        self._counts: Counter[int] = Counter()  # messages of the finished files
        self._given = 0  # messages, to the file that is written
        self._begun = 0  # when its first message was recorded
        self._compressing: dict[str, Future[Path]] = {}
        self._compressor = ThreadPoolExecutor(1, "bag compressor")
        self._compress = message_compressor() if options.compression_mode == MESSAGE else None
        try:
            path.mkdir(parents=True)
            self._file: Storage | None = self._open(0)
            self._metadata().write(path)
        except OSError as error:
            raise ParameterError(
                f"bag = '{path}': must be a folder to make: {_reason(error)}"
            ) from None

    @property
    def written(self) -> int:
        """Messages in the bag, or about to be."""
        return sum(file.messages for file in self._finished) + self._given

    @property
    def file_names(self) -> list[str]:
        """The bag's files, the last of which is written until the bag is closed."""
        return [file.name for file in self._entries]

    @property
    def free_space(self) -> int:
        """Left on the disk, bytes; 0 where the folder is gone."""
        try:
            return shutil.disk_usage(self.path).free
        except OSError:
            return 0

    def add(self, added: Connection) -> None:
        """Add a topic."""
        self._connections.append(added)
        self._attempt(lambda file: file.add(added))

    def write(self, topic: Connection, received: int, data: bytes) -> None:
        """Add a message of a topic that was added, recorded at a system time in ns."""
        if self._is_full(received):
            self.split()
        if not self._file or self.failure:
            self.lost += 1
            return
        if self._compress:
            data = self._compress(data)
        try:
            self._file.write(topic, received, data)
        except OSError as error:
            self.lost += 1
            self._fail(error)
            return
        self._begun = self._begun or received
        self._given += 1
        self.bytes += len(data)

    def flush(self) -> None:
        """Bring everything to the disk."""
        self._attempt(lambda file: file.flush())
        if any(future.done() for future in self._compressing.values()):
            self._take_compressed()

    def split(self) -> None:
        """Put what comes into another file; where that cannot be made, go on with this one."""
        if self.failure:
            return
        try:
            following = self._open(len(self._finished) + 1)
        except OSError as error:
            self._begun = 0  # not tried again with every message
            self.trouble = f"{self.path}: cannot be split: {_reason(error)}"
            return
        self._attempt(self._close_file)
        if self.failure:
            following.path.unlink(missing_ok=True)
            return
        self._count_finished()
        self._file = following
        for known in self._connections:
            self._attempt(partial(_add, known))
        self._renew_metadata()

    def close(self) -> None:
        """Finish the last file, compress what is to be, and write the metadata."""
        self._attempt(self._close_file)
        self._count_finished()
        self._renew_metadata()
        self._compressor.shutdown(wait=True)
        self._take_compressed()

    def summary(self, dropped: int) -> str:
        """Return one line: what is saved, and what is not.

        Parameters
        ----------
        dropped : int
            Messages that are not in the bag.
        """
        if not self.failure:
            return f"{self.path}: {self.written} messages, {dropped} dropped"
        end = max(file.end for file in self._entries)
        until = f" up to {datetime.fromtimestamp(end / NANOSECONDS):%H:%M:%S}" if end else ""
        trouble = f"; {self.trouble}" if self.trouble else ""
        return (
            f"{self.path}: {self.failure}: {self.written} messages{until} are saved and can be"
            f" read, {dropped} are not{trouble}"
        )

    def _attempt(self, action: Callable[[Storage], None]) -> None:
        """Do with the file what may fail, unless the recording has."""
        if not self._file or self.failure:
            return
        try:
            action(self._file)
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        """End the recording and keep what is saved."""
        assert self._file
        self.failure = _reason(error)
        try:
            self._file.give_up(self._metadata().text)
        except OSError:
            self.trouble = f"{self._file.path.name} has no index: haptic-accel bag repair makes it"
        saved = self._file.kept.messages
        self.lost += self._given - saved
        self._given = saved
        self._renew_metadata()

    def _is_full(self, received: int) -> bool:
        size, duration = self._options.max_bag_size, self._options.max_bag_duration
        if not (self._begun and self._file):
            return False
        if size and self._file.size >= size:
            return True
        return bool(duration) and received - self._begun >= duration * NANOSECONDS

    def _open(self, number: int) -> Storage:
        storage = self._options.storage
        name = f"{self.path.name}_{number}{SUFFIXES[storage]}"
        return open_storage(storage, self.path / name, self._options.storage_preset_profile)

    def _close_file(self, file: Storage) -> None:
        file.flush()
        file.close(self._metadata().text)

    def _count_finished(self) -> None:
        """Count the file that was written among those that are finished."""
        file, self._file = self._file, None
        if not file:
            return
        self._finished.append(_entry(file))
        self._counts.update(file.kept.counts)
        self._given = self._begun = 0
        if self._options.compression_mode == FILE and not self.failure:
            self._compressing[file.path.name] = self._compressor.submit(compress_file, file.path)

    def _take_compressed(self) -> None:
        """List files under the names they have compressed; what they were goes after that."""
        replaced = []
        for name in [name for name, future in self._compressing.items() if future.done()]:
            try:
                compressed = self._compressing.pop(name).result()
            except OSError as error:
                self.trouble = f"{self.path / name} cannot be compressed: {_reason(error)}"
                continue
            replaced.append(name)
            self._finished = [
                replace(file, name=compressed.name) if file.name == name else file
                for file in self._finished
            ]
        if replaced and self._renew_metadata():
            for name in replaced:
                (self.path / name).unlink(missing_ok=True)

    def _renew_metadata(self) -> bool:
        try:
            self._metadata().write(self.path)
        except OSError as error:
            self.trouble = f"{self.path}/metadata.yaml cannot be written: {_reason(error)}"
            return False
        return True

    @property
    def _entries(self) -> list[FileEntry]:
        return [*self._finished, *([_entry(self._file)] if self._file else [])]

    def _metadata(self) -> Metadata:
        """Return what the bag is, as far as it is saved."""
        counts = self._counts + (self._file.kept.counts if self._file else Counter())
        entries = self._entries
        mode = self._options.compression_mode
        if mode == NONE or (mode == FILE and not any(is_compressed(e.name) for e in entries)):
            mode = ""
        return Metadata(
            self._options.storage,
            tuple(entries),
            tuple(topic_entry(known, counts[known.id]) for known in self._connections),
            mode,
            self._options.compression_format if mode else "",
            self._facts,
        )


def _add(known: Connection, file: Storage) -> None:
    file.add(known)


def _entry(file: Storage) -> FileEntry:
    kept = file.kept
    return FileEntry(file.path.name, kept.start, kept.end, kept.messages)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
