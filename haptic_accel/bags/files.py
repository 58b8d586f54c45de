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

"""Files of a bag during its recording: splitting, metadata and error handling."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from rosbags.interfaces import Connection

from haptic_accel.bags.chunked_writer import ChunkedWriter, MisplacedError
from haptic_accel.bags.folder import MCAP, listed_name
from haptic_accel.bags.mcap_format import Tally
from haptic_accel.bags.metadata import Metadata, file_entry, topic_entry
from haptic_accel.bags.recording_options import ZSTD_FAST, RecordingOptions
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS


class BagFiles:
    """Folder of a bag with its files; the last one is being written.

    Recording raises no exceptions. The first OSError ends the recording; earlier messages remain
    readable, later messages are counted.

    Parameters
    ----------
    path : Path
        Folder to create.
    options : RecordingOptions
    facts : mapping
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
        Error that did not end the recording; empty if none.

    Raises
    ------
    ParameterError
        The folder exists already or cannot be created.
    """

    def __init__(self, path: Path, options: RecordingOptions, facts: Mapping[str, str]) -> None:
        self.path = path
        self.lost = self.bytes = 0
        self.failure = self.trouble = ""
        self._options = options
        self._facts = facts
        self._connections: list[Connection] = []
        self._finished: dict[str, Tally] = {}
        self._given = 0  # messages in the file being written
        self._begun = 0  # recording time of its first message
        self._is_misplaced = False
        self._moved_to: Path | None = None  # where misplaced files are now
        self._known: dict[str, os.stat_result] = {}  # finished files, whatever has their names
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
        return sum(tally.messages for tally in self._finished.values()) + self._given

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
        self._begun = self._begun or received
        self._given += 1
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
            self._begun = 0  # not tried again with each message
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

    def _attempt(self, action: Callable[..., None], *given: object) -> None:
        """Apply an action to the file, unless the recording has failed."""
        if not self._file or self.failure:
            return
        try:
            action(self._file, *given)
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
        given, self._given = self.written, self._file.kept.messages
        if isinstance(error, MisplacedError):
            self._is_misplaced = True
            if error.is_removed:
                self._given = 0
            elif error.location:
                is_renamed = error.location.name != self._file.path.name
                self._moved_to = error.location if is_renamed else error.location.parent
        self.lost += given - self.written
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
        """Return whether a finished file, and no other one, has its name."""
        for folder in (self.path, self._moved_to):
            with suppress(OSError):
                if folder and os.path.samestat((folder / name).stat(), self._known[name]):
                    return True
        return False

    def _is_full(self, received: int) -> bool:
        if not (self._begun and self._file):
            return False
        size, duration = self._options.max_bag_size, self._options.max_bag_duration
        is_long = received - self._begun >= duration * NANOSECONDS
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
        self._given = self._begun = 0

    def _renew_metadata(self) -> bool:
        """Write the metadata; return whether this succeeded."""
        if self._is_misplaced:
            return True  # leave alone whatever replaced the folder
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
        return Metadata(files, topics, self._facts)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
