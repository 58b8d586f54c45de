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

"""Recording session: start, pause, split and stop, with one bag after another."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path

from rosbags.interfaces import Qos

from haptic_accel.bags.folder import free_name
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import BagWriter, MessageWriter
from haptic_accel.core.parameters import ParameterError

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
