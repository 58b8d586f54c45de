# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Folder of a study: protocol and versions, participants, and a journal of actions.

::

    study.yaml            protocol; a changed one is another version for new participants
    versions/DIGEST.yaml  versions with which participants began, and go on
    journal.jsonl         versions, heads of the logs, unblinding, deletions, without names
    participants/P07/     log.jsonl, bags/
    analysis/, export/    results, which a deletion removes

The first line of a log names the participant; the folder must have the same name, and no other
folder may have the same session, as after a copy or a conflict of a program that synchronises
folders. The journal has the head of each log at the end of each sitting: a log that was changed or
truncated since then has another head. A person who can write both files can forge both, but not a
head in a notebook on paper.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

from haptic_accel import ParameterError
from haptic_accel.core import located, opened, replace_file
from haptic_accel.core.parameters import shown, suggestion
from haptic_accel.kits.study.log import (
    END,
    LARGEST_LOG,
    LOG,
    SESSION,
    Chain,
    Entry,
    Log,
    lock,
    read_chain,
    read_log,
    read_session,
)
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.trials import COMPLETE, SessionRecord
from haptic_accel.materials import config_folder

HEAD, DELETION = "head", "deletion"
"""Kinds of lines of the journal: a sitting's end, and the deletion of a participant."""

NOTED_DIGITS, GROUP = 16, 4
"""Number of hexadecimal digits of a head for a notebook, and of digits per group: 64 bits, so that
another log with the same digits takes 10^19 attempts."""

Logs: TypeAlias = Mapping[Path, tuple[Chain, SessionRecord]]
"""Logs by the folder of the participant."""


@dataclass(frozen=True)
class SittingEnd:
    """End of a sitting, as recorded in the log.

    Attributes
    ----------
    participant : str
    at : int
        System time, ns.
    line : int
        Number of the log's line, from 1.
    head : str
        Start of the line's SHA-256, in groups, for a notebook.
    in_journal : bool
        True if the journal has the same head.
    """

    participant: str
    at: int
    line: int
    head: str
    in_journal: bool


def noted(head: str) -> str:
    """Return the first digits of a log's hash, in groups, as in the notebook.

    Examples
    --------
    >>> noted("0123456789abcdef0123456789abcdef")
    '0123 4567 89ab cdef'
    """
    return " ".join(head[index : index + GROUP] for index in range(0, NOTED_DIGITS, GROUP))


def sitting_ends(logs: Logs, journal: Sequence[Entry]) -> list[SittingEnd]:
    """Return all ends of sittings, by participant."""
    known = {(each["session"], each["line"]) for each in journal if each["kind"] == HEAD}
    return [
        SittingEnd(
            session.participant, entry["at"], line, noted(head), (chain.heads[0], line) in known
        )
        for chain, session in logs.values()
        for line, (entry, head) in enumerate(zip(chain.entries, chain.heads, strict=True), 1)
        if entry["kind"] == END
    ]


def doubts(logs: Logs, journal: Sequence[Entry]) -> list[str]:
    """Return lines on sittings missing in journal or logs, unless deleted."""
    there = {chain.heads[0] for chain, _ in logs.values()}
    deleted = {entry.get("session") for entry in journal if entry["kind"] == DELETION}
    heads = {entry["session"] for entry in journal if entry["kind"] == HEAD}
    lost = len(heads - there - deleted)
    own = [each.participant for each in sitting_ends(logs, journal) if not each.in_journal]
    return [
        *[f"{lost} sessions of the journal have no log, and were not deleted"] * bool(lost),
        *[f"not in the journal: ends of sittings of {', '.join(dict.fromkeys(own))}"] * bool(own),
    ]


def check_folders(participants: Path, logs: Logs) -> None:
    """Refuse copies of a log, and a log in another participant's folder.

    Raises
    ------
    ParameterError
        The message has all faults in one line.
    """
    if problems := "; ".join(_problems(logs)):
        raise ParameterError(
            f"{participants}: {problems}: must be one folder for each participant, with one log:"
            " move the others out"
        )


def _problems(logs: Logs) -> Iterator[str]:
    same: dict[str, list[str]] = {}
    for folder, (chain, _) in logs.items():
        same.setdefault(chain.heads[0], []).append(folder.name)
        if others := [each.name for each in folder.glob("log*.jsonl") if each.name != LOG]:
            yield f"{_listed([folder.name])} has {_listed(others)} beside {LOG}"
    for folder, (chain, session) in logs.items():
        own = same.pop(chain.heads[0], [])
        if len(own) > 1:
            yield f"{_listed(own)} have the same session of {session.participant}"
        elif own and folder.name != session.participant:
            yield f"{_listed(own)} has the session of {session.participant}"
    simulated = [session.simulated for _, session in logs.values()]
    if any(simulated) and not all(simulated):
        some = [session.participant for _, session in logs.values() if session.simulated]
        yield f"{_listed(some)} are simulated observers among people"


def check_journal(journal: Sequence[Entry]) -> None:
    """Refuse a journal with a malformed entry of a log's hash.

    Raises
    ------
    ValueError
        The message has the number of the line.
    """
    for number, entry in enumerate(journal, 1):
        kinds = {"session": str, "line": int, "head": str} if entry["kind"] == HEAD else {}
        if not all(isinstance(entry.get(name), kind) for name, kind in kinds.items()):
            raise ValueError(f"its line {number} has no head")


def check_heads(logs: Logs, journal: Sequence[Entry]) -> None:
    """Refuse a log that lacks lines recorded in the journal.

    Raises
    ------
    ParameterError
        The message has the file and the line.
    """
    heads: dict[str, list[Entry]] = {}
    for entry in journal:
        if entry["kind"] == HEAD:
            heads.setdefault(entry["session"], []).append(entry)
    for folder, (chain, _) in logs.items():
        for entry in heads.get(chain.heads[0], []):
            line, found = entry["line"], len(chain.heads)
            if not 1 <= line <= found:
                raise ParameterError(
                    f"{folder / LOG}: ends at line {found}, and the journal has its line {line}:"
                    " the end was cut off"
                )
            if chain.heads[line - 1] != entry["head"]:
                raise ParameterError(
                    f"{folder / LOG}: line {line} is not the one that the journal has: it, or one"
                    " before it, was changed"
                )


def _listed(names: Iterable[str]) -> str:
    return " and ".join(repr(shown(each)) for each in sorted(names))


PROTOCOL = "study.yaml"
"""Name of the protocol in the folder of a study."""


def templates() -> dict[str, Path]:
    """Return the templates by name."""
    return {path.stem: path for path in sorted((config_folder() / "studies").glob("*.yaml"))}


def write_template(name: str, folder: Path) -> Path:
    """Write a template to a folder, which is made if missing; return the file.

    Raises
    ------
    ParameterError
        The template is unknown, or the folder already has a protocol.
    """
    known = templates()
    if name not in known:
        allowed = f"must be one of {', '.join(known)}{suggestion(name, known)}"
        raise ParameterError(f"template = {name!r}: {allowed}")
    path = folder / PROTOCOL
    with located(shown(str(path)), unreadable="must be a new file: "):
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            file.write(known[name].read_bytes())
    return path


BAGS = "bags"
"""Name of the folder of bags, or of a link to it, in a participant's folder."""

BAG, BAG_FILE = re.compile(r"[0-9]{3,}"), re.compile(r"metadata\.yaml|.*\.mcap.*", re.DOTALL)
"""Names of bags, counted from 000, and of their files."""


@dataclass(frozen=True)
class Deletion:
    """Files, folders and links that a deletion removes, and those that it keeps.

    Attributes
    ----------
    removed : tuple of Path
        Removed paths in order; the log and its folder come last, so that an interrupted deletion
        can be repeated.
    left : tuple of Path
        Targets of links, and other files next to the bags in the target of `BAGS`.
    """

    removed: tuple[Path, ...]
    left: tuple[Path, ...]

    def carry_out(self) -> None:
        """Remove everything in `removed`."""
        for path in self.removed:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()


def plan_deletion(folder: Path, results: tuple[Path, ...]) -> Deletion:
    """Return the data that the deletion of a participant removes, and the data that it keeps.

    Parameters
    ----------
    folder : Path
        Folder of the participant, with a log.
    results : tuple of Path
        Folders of results, which contain data of all participants.

    Raises
    ------
    ParameterError
        The folder is a link or reached through one, or shares a linked folder of bags.
    """
    for each in (folder, folder.parent):
        if each.is_symlink():
            raise ParameterError(
                f"{each}: is a link to {each.resolve()}: must be a folder; nothing is deleted"
                " behind a link, but bags"
            )
    bags = tuple(_linked_bags(folder / BAGS))
    own = sorted(each for each in folder.iterdir() if each.name != LOG)
    there = [each for each in results if each.is_symlink() or each.exists()]
    removed = (*there, *bags, *own, folder / LOG, folder)
    links = [each.resolve() for each in (*there, *own, folder / LOG) if each.is_symlink()]
    beside = [
        each
        for target in ([(folder / BAGS).resolve()] if (folder / BAGS).is_symlink() else [])
        if target.is_dir()
        for each in sorted(target.iterdir())
        if each not in bags
    ]
    return Deletion(removed, (*links, *beside))


def _linked_bags(link: Path) -> Iterator[Path]:
    """Yield the bags in the target of a link."""
    if not (link.is_symlink() and link.is_dir()):
        return
    target = link.resolve()
    for other in link.parent.parent.glob(f"*/{BAGS}"):
        folder = other.resolve()
        if other != link and (target in (folder, *folder.parents) or folder in target.parents):
            raise ParameterError(
                f"{link}: leads to {target}, as {other} does: must be a folder of its own, as it"
                " is not known whose bags are there"
            )
    yield from sorted(each for each in target.iterdir() if _is_bag(each))


def _is_bag(path: Path) -> bool:
    """Return whether a path is a recorder's bag folder without other files."""
    if not BAG.fullmatch(path.name) or path.is_symlink() or not path.is_dir():
        return False
    return all(
        each.is_file() and not each.is_symlink() and BAG_FILE.fullmatch(each.name)
        for each in path.iterdir()
    )


JOURNAL, PARTICIPANTS, VERSIONS = "journal.jsonl", "participants", "versions"
ANALYSIS, EXPORT = "analysis", "export"
"""Names of the results' folders in a study's folder."""

VERSION, UNBLINDING = "version", "unblinding"
"""Additional kinds of lines of the journal."""

JOURNAL_TIME = 30.0
"""Longest time to wait for other processes that write to the journal, s."""

PSEUDONYM = re.compile(r"(?=.*[0-9])(?!.*[0-9]{6})[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
"""Pattern of a pseudonym. Names have no digit; dates of birth, telephone numbers and student
numbers have six digits in succession."""


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
        """Sessions of all participants, by pseudonym.

        Raises
        ------
        ParameterError
            A log cannot be read, exists twice, is in a wrong folder, or contradicts the journal.
        """
        return [session for _, session in self._logs().values()]

    @property
    def ends(self) -> list[SittingEnd]:
        """Ends of all sittings; raises as `sessions` does."""
        return sitting_ends(self._logs(), self.journal)

    @property
    def doubts(self) -> list[str]:
        """Lines on sittings missing in journal or logs; raises as `sessions` does."""
        return doubts(self._logs(), self.journal)

    @property
    def journal(self) -> list[Entry]:
        """Lines of the journal.

        Raises
        ------
        ParameterError
            The journal cannot be read, was changed, or exists twice.
        """
        found = sorted(each.name for each in self.folder.glob("journal*.jsonl"))
        if any(name != JOURNAL for name in found):
            raise ParameterError(f"{self.folder}: has {', '.join(found)}: must be {JOURNAL} alone")
        file = self.folder / JOURNAL
        entries = read_chain(file).entries if found else []
        with located(file, "must be a journal"):
            check_journal(entries)
        return entries

    @property
    def sealed(self) -> bool:
        """False once the study is unblinded."""
        return all(entry["kind"] != UNBLINDING for entry in self.journal)

    def participant_folder(self, participant: str) -> Path:
        """Return the folder of a participant, which may be missing.

        Raises
        ------
        ParameterError
            The text is no pseudonym, or resembles a name.
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
            The version's file cannot be read, or was changed.
        """
        file = self.folder / VERSIONS / f"{digest}.yaml"
        protocol = read_protocol(file)
        if protocol.digest != digest:
            raise ParameterError(f"{file}: was changed: its content has another digest")
        return replace(protocol, source=self.folder / PROTOCOL)

    def begin(self, participant: str, seed: int | None = None, *, simulated: bool = False) -> Log:
        """Return the log of a new participant, with the lowest unused row.

        Raises
        ------
        ParameterError
            The participant has started already, or a simulated observer and persons would be in
            the same study.
        """
        folder, protocol = self.participant_folder(participant), self.protocol
        (self.folder / PARTICIPANTS).mkdir(mode=0o700, exist_ok=True)
        with self._open_journal() as journal:  # one process at a time, as rows must differ
            others = self.sessions
            if any(each.simulated != simulated for each in others):
                raise ParameterError(
                    f"{self.folder}: must have people or simulated observers, not both;"
                    " haptic-accel study new begins another study"
                )
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
                **{"simulated": True} if simulated else {},
            )
        return log

    def withdraw(self, log: Log) -> None:
        """Remove an open log without events since `begin`, and its bags.

        The output of a graph that did not start remains in the folder.
        """
        if len(log.entries) > 1:
            return
        folder = log.file.parent
        bags = folder / BAGS
        if bags.is_dir() and not bags.is_symlink():
            shutil.rmtree(bags)
        log.file.unlink()
        if not any(folder.iterdir()):
            folder.rmdir()

    def note_end(self, log: Log) -> str:
        """Write the hash of a log's last line to the journal after a sitting; return the hash."""
        chain = read_chain(log.file)
        with self._open_journal() as journal:
            journal.add(HEAD, session=chain.heads[0], line=len(chain.heads), head=chain.head)
        return chain.head

    def resume(self, participant: str) -> Log:
        """Return the log of a participant whose session is not complete.

        Raises
        ------
        ParameterError
            The participant is unknown, or the session is complete.
        """
        folder = self._existing(participant)
        if read_session(folder).ended == COMPLETE:
            raise ParameterError(f"participant = {participant!r}: the session is complete")
        self._logs()  # refuse a log that was changed or exists twice
        return Log(folder / LOG)

    def unblind(self, reason: str) -> None:
        """Allow the analysis of conditions from now on; the journal records time and reason."""
        complete = sum(each.ended == COMPLETE for each in self.sessions)
        with self._open_journal() as journal:
            journal.add(UNBLINDING, reason=reason, complete=complete)

    def deletion(self, participant: str) -> Deletion:
        """Return the data that `delete` removes, and the data that it keeps.

        Raises
        ------
        ParameterError
            The participant is unknown, the log exists twice, or data to delete are reached through
            a link.
        """
        folder = self._existing(participant)
        copies = [
            each.parent.name
            for each in folder.parent.glob(f"*/{LOG}")
            if each.parent != folder and _same_first_line(each, folder / LOG)
        ]
        if copies:
            raise ParameterError(
                f"{folder}: has the same session as {' and '.join(sorted(copies))}: must be one"
                " folder: delete the copies by hand first"
            )
        return plan_deletion(folder, tuple(self.folder / each for each in (ANALYSIS, EXPORT)))

    def delete(self, participant: str) -> None:
        """Delete a participant's log and bags, and all results, which may contain their data.

        Raises
        ------
        ParameterError
            As for `deletion`, or the session is running.
        """
        deletion, file = self.deletion(participant), self.participant_folder(participant) / LOG
        # Deletion works even if the log is not readable.
        with io.FileIO(file) as held, self._open_journal() as journal:
            lock(held, file)
            session = hashlib.sha256(held.readline()).hexdigest()
            deletion.carry_out()
            journal.add(DELETION, session=session)

    def _existing(self, participant: str) -> Path:
        folder = self.participant_folder(participant)
        if not (folder / LOG).is_file():
            logs = folder.parent.glob(f"*/{LOG}")
            known = ", ".join(sorted(each.parent.name for each in logs)) or "none"
            raise ParameterError(
                f"participant = {participant!r}: has no session; there are {known}"
            )
        return folder

    def _logs(self) -> Logs:
        """Return all logs with a complete line, unless they contradict each other."""
        participants, journal = self.folder / PARTICIPANTS, self.journal
        folders = sorted(file.parent for file in participants.glob(f"*/{LOG}"))
        logs = {each: log for each in folders if (log := read_log(each))}
        check_folders(participants, logs)
        check_heads(logs, journal)
        return logs

    def _open_journal(self) -> Log:
        return Log(self.folder / JOURNAL, JOURNAL_TIME)

    def _keep_version(self, journal: Log) -> None:
        file = self.folder / VERSIONS / f"{self.protocol.digest}.yaml"
        if not file.exists():
            file.parent.mkdir(exist_ok=True)
            replace_file(file, self.protocol.content.encode())
            journal.add(VERSION, digest=self.protocol.digest)


def _same_first_line(one: Path, other: Path) -> bool:
    """Return whether two logs, readable or not, belong to the same session."""
    with located(one), opened(one, LARGEST_LOG) as first, opened(other, LARGEST_LOG) as second:
        line = first.readline()
        return line.endswith(b"\n") and line == second.readline()
