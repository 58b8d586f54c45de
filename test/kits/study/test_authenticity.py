# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Logs that were copied, moved, changed, cut or hashed again are found."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest
from kits.study.studies import run_session, write_study

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.folder import JOURNAL, Study, noted
from haptic_accel.kits.study.log import LOG, RUNNING, Log
from haptic_accel.kits.study.session import write_simulated

LOST = "1 sessions of the journal have no log, and were not deleted"


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """Return a study of two simulated observers."""
    made = write_study(tmp_path / "study")
    assert len(list(write_simulated(made, 2, 1))) == 2
    return made


def hashed_anew(lines: list[bytes]) -> bytes:
    """Return lines of a log, each with the right hash of the one before."""
    before, found = "", b""
    for line in lines:
        line = json.dumps({**json.loads(line), "before": before}).encode() + b"\n"
        before = hashlib.sha256(line).hexdigest()
        found += line
    return found


def lines_of(file: Path) -> list[bytes]:
    return file.read_bytes().splitlines(keepends=True)


@pytest.mark.parametrize("name", ["S01 (1)", "S01.sync-conflict-20261126-101112-ABCDEFG", "S09"])
@pytest.mark.parametrize("lines", [None, 3, 1])
def test_a_copy_whole_or_cut_off_is_refused_by_name(
    study: Study, name: str, lines: int | None
) -> None:
    copy = study.folder / "participants" / name
    shutil.copytree(study.participant_folder("S01"), copy)
    (copy / LOG).write_bytes(b"".join(lines_of(copy / LOG)[:lines]))
    found = f"'S01' and '{name}' have the same session of S01"
    for act in (lambda: study.sessions, lambda: study.begin("S03", simulated=True)):
        with pytest.raises(ParameterError) as told:
            act()
        assert found in str(told.value)
        assert "\n" not in str(told.value)
    assert not study.participant_folder("S03").exists()
    with pytest.raises(ParameterError, match=f"has the same session as {name[:3]}"):
        study.delete("S01")
    shutil.rmtree(copy)
    assert [each.participant for each in study.sessions] == ["S01", "S02"]


def test_a_renamed_folder_is_refused(study: Study) -> None:
    study.participant_folder("S02").rename(study.participant_folder("S07"))
    with pytest.raises(ParameterError, match="participants: 'S07' has the session of S02: must"):
        _ = study.sessions


@pytest.mark.parametrize("name", ["log (1).jsonl", "log.sync-conflict-20261126-1-A.jsonl"])
def test_two_logs_in_a_folder_are_refused(study: Study, name: str) -> None:
    (study.participant_folder("S02") / name).write_bytes(b"")
    with pytest.raises(ParameterError) as told:
        _ = study.sessions
    assert f"'S02' has '{name}' beside {LOG}" in str(told.value)


def test_two_journals_are_refused(study: Study) -> None:
    shutil.copy(study.folder / JOURNAL, study.folder / "journal (1).jsonl")
    with pytest.raises(ParameterError, match="must be journal.jsonl alone"):
        _ = study.sealed


def test_people_and_simulated_observers_are_not_mixed(study: Study, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="must have people or simulated observers, not both"):
        study.begin("P01")
    people = write_study(tmp_path / "people")
    run_session(people, people.begin("P01"))
    shutil.copytree(study.participant_folder("S01"), people.participant_folder("S01"))
    with pytest.raises(ParameterError, match="'S01' are simulated observers among people"):
        _ = people.sessions


def test_the_last_line_changed_is_found(study: Study) -> None:
    file = study.participant_folder("S01") / LOG
    *rest, last = lines_of(file)
    assert b"complete" in last
    file.write_bytes(b"".join([*rest, last.replace(b"complete", b"stopped!")]))
    number = len(rest) + 1
    with pytest.raises(ParameterError, match=f"^{file}: line {number} is not the one that the j"):
        _ = study.sessions


@pytest.mark.parametrize("cut", [1, 5])
def test_an_end_that_was_cut_off_is_found(study: Study, cut: int) -> None:
    file = study.participant_folder("S01") / LOG
    lines = lines_of(file)
    file.write_bytes(b"".join(lines[:-cut]))
    told = f"^{file}: ends at line {len(lines) - cut}, and the journal has its line {len(lines)}"
    for act in (lambda: study.sessions, lambda: study.resume("S01")):
        with pytest.raises(ParameterError, match=told):
            act()


def test_a_log_that_was_hashed_anew_is_found(study: Study) -> None:
    file = study.participant_folder("S01") / LOG
    lines = lines_of(file)
    entry = json.loads(lines[4])
    lines[4] = json.dumps({**entry, "answered": entry["answered"] + 1}).encode()
    file.write_bytes(hashed_anew(lines))
    with Log(file) as log:
        assert len(log.entries) == len(lines)  # by itself, it is in order
    with pytest.raises(ParameterError, match="is not the one that the journal has"):
        _ = study.sessions


def test_who_changes_the_first_line_leaves_a_session_without_a_log(study: Study) -> None:
    file = study.participant_folder("S01") / LOG
    first, *rest = lines_of(file)
    file.write_bytes(hashed_anew([first.replace(b'"row": 0', b'"row": 7'), *rest]))
    assert study.doubts == [LOST, "not in the journal: ends of sittings of S01"]
    assert [each.in_journal for each in study.ends] == [False, True]


def test_a_forger_of_both_files_changes_the_head_in_the_notebook(study: Study) -> None:
    before = [each.head for each in study.ends]
    file, journal = study.participant_folder("S01") / LOG, study.folder / JOURNAL
    lines = lines_of(file)
    lines[-1] = lines[-1].replace(b"complete", b"stopped!")
    file.write_bytes(hashed_anew(lines))
    head = hashlib.sha256(lines_of(file)[-1]).hexdigest()
    session = hashlib.sha256(lines_of(file)[0]).hexdigest()
    entries = [json.loads(line) for line in lines_of(journal)]
    forged = [
        each | {"head": head} if each.get("session") == session else each for each in entries
    ]
    journal.write_bytes(hashed_anew([json.dumps(each).encode() for each in forged]))
    after = [each.head for each in study.ends]
    assert after[0] != before[0]
    assert after[1] == before[1]


def test_the_printed_head_is_that_of_the_end(study: Study) -> None:
    lines = lines_of(study.participant_folder("S02") / LOG)
    end = study.ends[1]
    assert (end.participant, end.line, end.in_journal) == ("S02", len(lines), True)
    assert end.head == noted(hashlib.sha256(lines[-1]).hexdigest())


def test_a_deleted_session_is_not_missing_and_a_lost_one_is(study: Study) -> None:
    study.delete("S01")
    assert study.doubts == []
    shutil.rmtree(study.participant_folder("S02"))
    assert study.doubts == [LOST]


def test_a_journal_whose_head_is_none_is_refused_in_one_line(study: Study) -> None:
    with Log(study.folder / JOURNAL) as journal:
        journal.add("head", session=3)
    with pytest.raises(ParameterError, match="journal.jsonl: must be a journal: its line"):
        _ = study.sessions


def test_a_running_session_is_told_from_an_interrupted_one(tmp_path: Path) -> None:
    study = write_study(tmp_path / "study")
    with study.begin("P01"):
        assert study.sessions[0].ended == RUNNING
    assert study.sessions[0].ended == ""
    with study.resume("P01"):
        assert study.sessions[0].ended == RUNNING
