# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The log of a session: nothing in it is lost, and nothing is changed without notice."""

from __future__ import annotations

import json
import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study import trials
from haptic_accel.kits.study.log import (
    CONSENT,
    END,
    LOG,
    SESSION,
    SITTING,
    TRIAL,
    Log,
    read_session,
    seal,
    trial_entry,
    unseal,
)
from haptic_accel.kits.study.protocol import Condition

NONE = Condition((("controller", "none"), ("gain", 1.0)))
ADAPTIVE = Condition((("controller", "adaptive"), ("gain", 0.5)))
STRENGTH = {"rms": 1.5, "peak": 3.0, "desired_rms": 1.4, "error": None}
FLAWS = {"clipped": 0.0, "late": 0.1, "lost": 0.0}
SET = {"controller": "none", "gain": 1.0}
PRESENTED = trials.PresentedStimulus(5, 6, "bags/1", **STRENGTH, **FLAWS, read_back=SET)


def trial(number: int) -> trials.TrialRecord:
    stimuli = (NONE, ADAPTIVE)
    planned = trials.PlannedTrial(number, trials.MAIN, stimuli, ("1", "2"), "2", "pair", 0.5, 3)
    answer = trials.Answer("2", 0.7)
    return trials.TrialRecord(planned, 1, (PRESENTED,), answer, 10, 20, 30, 40, "late")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a participant's folder with a session of three trials."""
    with Log(tmp_path / LOG) as log:
        log.add(SESSION, participant="P07", digest="d", seed=3, row=2)
        log.add(SITTING)
        log.add(CONSENT, version="2026-1", agreed=True)
        for number in range(3):
            log.add(TRIAL, **trial_entry(trial(number)), dose=0.25)
    return tmp_path


@contextmanager
def full_disk(size: int) -> Iterator[None]:
    """Let no file become larger than a size, bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def test_a_session_is_read_as_it_was_logged(folder: Path) -> None:
    session = read_session(folder)
    assert session.records == tuple(trial(number) for number in range(3))
    assert (session.participant, session.digest, session.seed, session.row) == ("P07", "d", 3, 2)
    assert (session.consent, session.ended, session.exposure) == ("2026-1", "", 0.75)


def test_a_session_ends_until_its_next_sitting(folder: Path) -> None:
    with Log(folder / LOG) as log:
        log.add(END, reason="stopped by the participant")
        assert log.record.ended == "stopped by the participant"
        log.add(SITTING)
        assert log.record.ended == ""


def test_conditions_are_not_read_by_accident(folder: Path) -> None:
    text = (folder / LOG).read_text()
    for word in ("adaptive", "controller", "0.7", "1.5", "late", trials.MAIN):
        assert word not in text
    assert unseal(seal({"controller": "none"})) == {"controller": "none"}


def test_a_line_that_was_cut_off_is_none(folder: Path) -> None:
    whole = (folder / LOG).read_bytes()
    before = read_session(folder)
    for cut in (1, 10, 300):
        (folder / LOG).write_bytes(whole + whole.splitlines()[-1][:cut])
        assert read_session(folder) == before
        with Log(folder / LOG) as log:
            log.add(END, reason="complete")
        assert read_session(folder).ended == "complete"


@pytest.mark.parametrize(
    ("line", "old", "new", "found"),
    [
        (2, b'"2026-1"', b'"2026-2"', "line 4 does not follow the line before it"),
        (2, b"{", b"", "line 3 is damaged"),
        (0, b'"format": 1', b'"format": 9', "format = 9: must be 1"),
    ],
)
def test_a_changed_log_is_refused(
    folder: Path, line: int, old: bytes, new: bytes, found: str
) -> None:
    lines = (folder / LOG).read_bytes().splitlines(keepends=True)
    assert old in lines[line]
    lines[line] = lines[line].replace(old, new)
    (folder / LOG).write_bytes(b"".join(lines))
    for read in (lambda: read_session(folder), lambda: Log(folder / LOG)):
        with pytest.raises(ParameterError, match=f"^{folder / LOG}: {found}"):
            read()


@pytest.mark.parametrize("content", [b"", b"{}\n", b"\xff\n", b"[1]\n", b'{"before": ""}\n'])
def test_a_file_that_is_no_log_is_refused(folder: Path, content: bytes) -> None:
    (folder / LOG).write_bytes(content)
    with pytest.raises(ParameterError, match=f"^{folder / LOG}: "):
        read_session(folder)


def test_lines_of_another_program_are_refused(tmp_path: Path) -> None:
    line = {"kind": SESSION, "before": "", "format": 1, "at": 1}
    (tmp_path / LOG).write_text(json.dumps(line) + "\n")
    with pytest.raises(ParameterError, match="must be a session's log"):
        read_session(tmp_path)


def test_one_process_at_a_time_runs_a_session(folder: Path) -> None:
    with Log(folder / LOG), pytest.raises(ParameterError, match="another process"):
        Log(folder / LOG)
    Log(folder / LOG).close()


def test_a_full_disk_leaves_the_lines_before(folder: Path) -> None:
    before = (folder / LOG).read_bytes()
    with Log(folder / LOG) as log, full_disk(len(before) + 100):
        with pytest.raises(OSError, match=LOG) as error:
            log.add(TRIAL, **trial_entry(trial(3)))
        assert error.value.filename == str(folder / LOG)
        assert len(log.record.records) == 3
    assert (folder / LOG).read_bytes() == before
    with Log(folder / LOG) as log:
        log.add(TRIAL, **trial_entry(trial(3)))
    assert len(read_session(folder).records) == 4


def test_others_do_not_read_a_log(folder: Path) -> None:
    assert os.stat(folder / LOG).st_mode & 0o077 == 0
