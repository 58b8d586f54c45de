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

"""Folder of a study: its protocol and versions, its participants, and a journal of what was done.

::

    study.yaml            protocol; a changed one is another version for new participants
    versions/DIGEST.yaml  versions with which participants began, and go on
    journal.jsonl         versions, unblinding, and deletions, without names
    participants/P07/     log.jsonl, bags/
    analysis/, export/    results, which a deletion removes
"""

from __future__ import annotations

import io
import os
import re
import secrets
import shutil
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.core.safe_writing import replace_file
from haptic_accel.study.log import LOG, SESSION, Entry, Log, lock, read_entries, read_session
from haptic_accel.study.protocol import Protocol
from haptic_accel.study.reading import read_protocol
from haptic_accel.study.session import COMPLETE
from haptic_accel.study.templates import PROTOCOL
from haptic_accel.study.trials import SessionRecord

JOURNAL, PARTICIPANTS, VERSIONS = "journal.jsonl", "participants", "versions"
ANALYSIS, EXPORT = "analysis", "export"
"""Names in a study's folder, beside `templates.PROTOCOL`."""

VERSION, UNBLINDING, DELETION = "version", "unblinding", "deletion"
"""Kinds of lines of the journal."""

PSEUDONYM = re.compile(r"(?=.*[0-9])(?!.*[0-9]{6})[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
"""Form of a pseudonym. Names have no digit; dates of birth, telephone numbers and numbers of
students have six in succession."""


class Study:
    """Study in a folder.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    ParameterError
        The folder has no protocol.
    """

    def __init__(self, folder: Path) -> None:
        if not os.path.isfile(folder / PROTOCOL):
            raise ParameterError(
                f"{folder}: must be a study's folder, with {PROTOCOL};"
                " haptic-accel study new makes one"
            )
        self.folder = folder

    @cached_property
    def protocol(self) -> Protocol:
        """Present version of the protocol."""
        return read_protocol(self.folder / PROTOCOL)

    @property
    def sessions(self) -> list[SessionRecord]:
        """Sessions of all participants, by pseudonym."""
        folders = sorted(file.parent for file in self.folder.glob(f"{PARTICIPANTS}/*/{LOG}"))
        return [read_session(each) for each in folders if read_entries(each / LOG)]

    @property
    def journal(self) -> list[Entry]:
        """Lines of the journal."""
        file = self.folder / JOURNAL
        return read_entries(file) if file.is_file() else []

    @property
    def sealed(self) -> bool:
        """False once the study is unblinded."""
        return all(entry["kind"] != UNBLINDING for entry in self.journal)

    def place(self, participant: str) -> Path:
        """Return the folder of a participant, who need not exist.

        Raises
        ------
        ParameterError
            The word is no pseudonym, or like a name.
        """
        if not PSEUDONYM.fullmatch(participant):
            raise ParameterError(
                f"participant = {shown(participant)!r}: must be a pseudonym such as P07, of 1 to"
                " 32 letters, digits, - and _, with a digit, and at most 5 digits in succession"
            )
        return self.folder / PARTICIPANTS / participant

    def version(self, digest: str) -> Protocol:
        """Return a version of the protocol.

        Raises
        ------
        ParameterError
            Its file cannot be read, or was changed.
        """
        file = self.folder / VERSIONS / f"{digest}.yaml"
        protocol = read_protocol(file)
        if protocol.digest != digest:
            raise ParameterError(f"{file}: was changed: its content has another digest")
        return replace(protocol, source=self.folder / PROTOCOL)

    def begin(self, participant: str, seed: int | None = None) -> Log:
        """Return the log of a new participant, with the least row that no other one has.

        Raises
        ------
        ParameterError
            The participant has begun already.
        """
        folder, protocol = self.place(participant), self.protocol
        (self.folder / PARTICIPANTS).mkdir(mode=0o700, exist_ok=True)
        with Log(self.folder / JOURNAL) as journal:  # one at a time, as rows must differ
            others = self.sessions
            if participant.lower() in (each.participant.lower() for each in others):
                raise ParameterError(
                    f"participant = {participant!r}: has begun already; haptic-accel study resume"
                    " goes on"
                )
            self._keep_version(journal)
            rows = {each.row for each in others}
            log = Log(folder / LOG)
            log.add(
                SESSION,
                participant=participant,
                digest=protocol.digest,
                seed=secrets.randbits(32) if seed is None else seed,
                row=next(row for row in range(len(rows) + 1) if row not in rows),
            )
        return log

    def resume(self, participant: str) -> Log:
        """Return the log of a participant whose session is not complete.

        Raises
        ------
        ParameterError
            There is no such participant, or nothing is left to do.
        """
        folder = self._existing(participant)
        if read_session(folder).ended == COMPLETE:
            raise ParameterError(f"participant = {participant!r}: the session is complete")
        return Log(folder / LOG)

    def unblind(self, reason: str) -> None:
        """Let conditions be analysed from now on; the journal keeps when, and why."""
        complete = sum(each.ended == COMPLETE for each in self.sessions)
        with Log(self.folder / JOURNAL) as journal:
            journal.add(UNBLINDING, reason=reason, complete=complete)

    def delete(self, participant: str) -> None:
        """Delete a participant's log and bags, and all results, which may hold them.

        Raises
        ------
        ParameterError
            There is no such participant, or the session is running.
        """
        folder = self._existing(participant)
        # The log need not be readable.
        with io.FileIO(folder / LOG) as held, Log(self.folder / JOURNAL) as journal:
            lock(held, folder / LOG)
            for name in (ANALYSIS, EXPORT):
                with suppress(FileNotFoundError):
                    shutil.rmtree(self.folder / name)
            for each in folder.iterdir():
                if each.is_dir():
                    shutil.rmtree(each)
                elif each.name != LOG:
                    each.unlink()
            (folder / LOG).unlink()  # last, so that an interrupted deletion can be repeated
            folder.rmdir()
            journal.add(DELETION)

    def _existing(self, participant: str) -> Path:
        folder = self.place(participant)
        if not (folder / LOG).is_file():
            known = ", ".join(sorted(each.name for each in folder.parent.glob("*"))) or "none"
            raise ParameterError(
                f"participant = {participant!r}: has no session; there are {known}"
            )
        return folder

    def _keep_version(self, journal: Log) -> None:
        file = self.folder / VERSIONS / f"{self.protocol.digest}.yaml"
        if not file.exists():
            file.parent.mkdir(exist_ok=True)
            replace_file(file, self.protocol.content.encode())
            journal.add(VERSION, digest=self.protocol.digest)
