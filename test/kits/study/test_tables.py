# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tidy tables of a study, and exclusions by the protocol's rules."""

from __future__ import annotations

from dataclasses import replace

import pytest
from kits.study.study_sessions import often_right, paired, protocol, session

from haptic_accel.kits.study.protocol import Rules
from haptic_accel.kits.study.reading import FACTORS
from haptic_accel.kits.study.tables import COLUMNS, catch_correct, exclusions, left_out, tables
from haptic_accel.kits.study.trials import CATCH, SessionRecord

STUDY = protocol("2ifc")
FLAW = "error 80 %, more than 50 %"


def complete(participant: str = "P01") -> SessionRecord:
    return session(STUDY, participant, paired(STUDY, 10), often_right(0.8))


def repeated(found: SessionRecord, place: int, *, left: bool = False) -> SessionRecord:
    """Return a session whose trial at a place was not delivered, and then repeated or left out."""
    flawed = replace(found.records[place], answer=None, flaw=FLAW)
    again = (flawed,) if left else (flawed, replace(found.records[place], attempt=1))
    return replace(found, records=(*found.records[:place], *again, *found.records[place + 1 :]))


def test_each_attempt_has_a_row_and_only_delivered_main_trials_count() -> None:
    trials = tables(STUDY, [repeated(complete(), 3)]).trials
    assert len(trials) == 1 + 20 + 2 + 1
    assert trials.counted.sum() == 20
    both = trials[trials.trial == 3][["attempt", "counted", "flaw"]]
    assert both.to_numpy().tolist() == [[0, False, FLAW], [1, True, ""]]
    assert not trials[trials.kind != "main"].counted.any()


def test_each_presented_stimulus_has_a_row_with_its_factors_and_measures() -> None:
    stimuli = tables(STUDY, [complete()]).stimuli
    assert len(stimuli) == 2 * 23
    assert set(stimuli.controller) == {"none", "mass", "adaptive"}
    assert stimuli.duration_s.to_numpy() == pytest.approx(2.0)
    assert stimuli.rms_m_s2.between(2, 3).all()
    assert stimuli.condition[0] in {"controller=none", "controller=adaptive"}


def test_times_count_from_the_begin_of_a_session() -> None:
    trials = tables(STUDY, [complete()]).trials
    assert trials.asked_s[:3].tolist() == pytest.approx([5.0, 15.0, 25.0])


def test_every_column_has_a_meaning() -> None:
    found = tables(STUDY, [complete()])
    names = {name for frame in found.by_name.values() for name in frame.columns}
    assert names == set(found.columns)
    assert names - set(COLUMNS) == {"controller"}
    assert set(COLUMNS) <= names
    assert all(column.label for column in found.columns.values())


def test_no_factor_has_the_name_of_another_column() -> None:
    assert not set(FACTORS) & set(COLUMNS)


def test_wrong_catch_trials_exclude() -> None:
    found = complete()
    *others, last = found.records
    assert last.trial.kind == CATCH
    assert last.answer
    wrong = replace(last, answer=replace(last.answer, value="0"))
    half = replace(found, records=(*others, wrong))
    assert catch_correct(half) == 50.0
    assert exclusions(STUDY, [half]) == {"P01": "50 % of catch trials correct, less than 75 %"}


def test_trials_that_were_left_out_exclude_above_the_bound() -> None:
    found = complete()
    for place in range(1, 6):
        found = repeated(found, place, left=True)
    assert left_out(found) == pytest.approx(25.0)
    assert exclusions(STUDY, [found]) == {"P01": "25 % of trials left out, more than 20 %"}
    assert exclusions(replace(STUDY, rules=Rules(left_out=25.0)), [found]) == {}


def test_a_session_of_another_version_is_excluded() -> None:
    changed = replace(STUDY, digest="f" * 64)
    why = "version 01234567 of the protocol, not ffffffff"
    assert exclusions(changed, [complete()]) == {"P01": why}


def test_a_session_without_trials_has_a_row() -> None:
    found = tables(STUDY, [replace(complete(), records=(), ended="")])
    assert found.sessions.main_trials.tolist() == [0]
    assert found.sessions.excluded.tolist() == ["session not complete (interrupted)"]
    assert found.trials.empty
