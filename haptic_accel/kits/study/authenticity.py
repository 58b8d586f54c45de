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

"""Contradictions between the logs of a study, the folders that have them, and the journal.

A participant is in the first line of the log; the folder must say the same, and no other folder
may have the same session, as it does after a copy or a conflict of a program that synchronises
folders. The journal has the head of each log at the end of each sitting: a log that was changed
or cut since then has another one. Who can write both files can forge both: a head in a notebook
on paper is what such a person cannot change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.kits.study.log import END, LOG, Chain, Entry
from haptic_accel.kits.study.trials import SessionRecord

HEAD, DELETION = "head", "deletion"
"""Kinds of lines of the journal: a sitting's end, and the deletion of a participant."""

NOTED_DIGITS, GROUP = 16, 4
"""Hexadecimal digits of a head for a notebook, and of a group of them: 64 bits, so that another
log with the same digits takes 10^19 attempts."""

Logs: TypeAlias = Mapping[Path, tuple[Chain, SessionRecord]]
"""Logs by the folder of the participant."""


@dataclass(frozen=True)
class SittingEnd:
    """End of a sitting, as the log has it.

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


def head_entry(chain: Chain) -> Entry:
    """Return the content of the journal's line of a log, without the participant."""
    return {"session": chain.heads[0], "line": len(chain.heads), "head": chain.head}


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
    """Return lines on sittings that only the journal or only the logs have, unless deleted."""
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
    """Refuse copies of a log, and a log in the folder of somebody else.

    Raises
    ------
    ParameterError
        With all that is wrong, in one line.
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
        With the number of its line.
    """
    for number, entry in enumerate(journal, 1):
        kinds = {"session": str, "line": int, "head": str} if entry["kind"] == HEAD else {}
        if not all(isinstance(entry.get(name), kind) for name, kind in kinds.items()):
            raise ValueError(f"its line {number} has no head")


def check_heads(logs: Logs, journal: Sequence[Entry]) -> None:
    """Refuse a log without the lines that the journal states.

    Raises
    ------
    ParameterError
        With the file and its line.
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
