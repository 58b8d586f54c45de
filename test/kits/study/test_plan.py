# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of a session: practice, catch trials, repetitions, breaks, and the replay of a log."""

from __future__ import annotations

import math
from collections import Counter
from itertools import islice
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kits.study.protocol_maker import make_levels, make_protocol
from kits.study.study_runs import always_right, asking, run

from haptic_accel.kits.study.folder import templates
from haptic_accel.kits.study.procedures import (
    ANSWERING,
    CHANGING,
    TASKS,
    Plan,
    describe,
    expected_trials,
)
from haptic_accel.kits.study.protocol import Bounds, Extras, Order, Procedure, Protocol
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.session import SimulatedParticipant
from haptic_accel.kits.study.trials import CATCH, MAIN, PRACTICE, Answer, PlannedTrial

NOTHING_ELSE = Extras(practice=0, break_every=0)
FOUR, QUEST = Procedure(repeats=4), Procedure("quest_plus", trials=12)

PROTOCOLS = {
    **{
        task: make_protocol(task, 3, procedure=Procedure(repeats=3), extras=Extras(practice=2))
        for task in TASKS
    },
    "blocked": make_levels(
        surfaces=("wood", "foam"),
        order=Order("blocked", "surface"),
        procedure=Procedure(repeats=2),
        extras=Extras(practice=3, catch_every=4, break_every=5),
    ),
    "williams": make_protocol("rating", 4, order=Order("williams"), procedure=FOUR),
    "staircase": make_levels(
        surfaces=("wood", "foam"),
        procedure=Procedure("staircase", step_up=0.1, step_down=0.1, trials=20),
        extras=Extras(practice=2, catch_every=7),
    ),
    "quest_plus": make_levels(task="odd_one_out", scale="log", procedure=QUEST),
}


def _kinds(plan: Plan) -> list[str]:
    return [each.trial.kind for each in run(plan, always_right)]


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=PROTOCOLS)
def test_a_session_has_no_more_trials_than_planned_and_progress_grows_from_0_to_1(
    protocol: Protocol,
) -> None:
    plan = Plan(protocol, 1, 0)
    shares, records = [plan.progress], []
    for each in run(plan, asking(SimulatedParticipant(protocol, 1))):
        records.append(each)
        shares.append(plan.progress)
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, pytest.approx(1.0))
    assert [each.trial.number for each in records] == list(range(len(records)))
    assert len(records) <= plan.trials
    if protocol.procedure.kind != "staircase":
        assert len(records) == plan.trials
    assert all(each.correct in (True, False) for each in records if each.trial.right)


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(sorted(PROTOCOLS)),
    st.integers(0, 2**40),
    st.integers(0, 20),
    st.lists(st.booleans(), max_size=200),
)
def test_a_replay_of_any_prefix_plans_the_same_next_trial(
    name: str, seed: int, row: int, delivered: list[bool]
) -> None:
    protocol = PROTOCOLS[name]
    participant = SimulatedParticipant(protocol, seed)
    plan, replayed = Plan(protocol, seed, row), Plan(protocol, seed, row)
    flaws = iter(delivered)

    def answer(trial: PlannedTrial) -> Answer | None:
        return asking(participant)(trial) if next(flaws, True) else None

    for each in list(islice(run(plan, answer), len(delivered))):
        replayed.record(each)
    assert replayed.next() == plan.next()
    assert replayed.attempt == plan.attempt
    assert replayed.break_due == plan.break_due
    assert replayed.progress == plan.progress
    assert list(run(replayed, always_right)) == list(run(plan, always_right))


def test_practice_comes_first_with_the_largest_difference() -> None:
    protocol = make_levels(extras=Extras(practice=3))
    trials = [each.trial for each in run(Plan(protocol, 1, 0), always_right)]
    assert [each.kind for each in trials[:4]] == [PRACTICE, PRACTICE, PRACTICE, MAIN]
    assert {each.level for each in trials[:3]} == {1.8}


def test_practice_shows_each_condition() -> None:
    protocol = make_protocol("identification", 4, extras=Extras(practice=4))
    trials = islice(run(Plan(protocol, 1, 0), always_right), 4)
    assert {each.trial.right for each in trials} == {"s0", "s1", "s2", "s3"}


def test_catch_trials_come_between_a_number_of_trials() -> None:
    procedure = Procedure(repeats=2)
    protocol = make_levels(procedure=procedure, extras=Extras(practice=0, catch_every=3))
    assert _kinds(Plan(protocol, 1, 0)) == [*[MAIN] * 3, CATCH, *[MAIN] * 3, CATCH, *[MAIN] * 2]
    catch = [each for each in run(Plan(protocol, 1, 0), always_right) if each.trial.kind == CATCH]
    assert {each.trial.level for each in catch} == {1.8}


def test_an_undelivered_trial_is_repeated_and_then_left_out() -> None:
    plan = Plan(make_protocol(bounds=Bounds(repeats=2), extras=NOTHING_ELSE), 1, 0)
    records = list(run(plan, lambda trial: None if trial.number == 1 else always_right(trial)))
    numbers = [(each.trial.number, each.attempt) for each in records[:5]]
    assert numbers == [(0, 0), (1, 0), (1, 1), (1, 2), (2, 0)]
    assert records[1].trial == records[3].trial
    assert len(records) == plan.trials + 2


def test_a_staircase_ends_though_nothing_is_delivered() -> None:
    staircase = Procedure("staircase", trials=5, tracks=2)
    protocol = make_levels(procedure=staircase, bounds=Bounds(repeats=0), extras=NOTHING_ELSE)
    assert len(list(run(Plan(protocol, 1, 0), lambda trial: None))) == 10


@pytest.mark.parametrize(("every", "expected"), [(4, [5, 9]), (0, [])])
def test_breaks_come_after_a_number_of_trials_but_not_at_the_end(
    every: int, expected: list[int]
) -> None:
    extras = Extras(practice=2, break_every=every)
    plan = Plan(make_protocol(procedure=Procedure(repeats=12), extras=extras), 1, 0)
    assert [each.trial.number for each in run(plan, always_right) if plan.break_due] == expected


def test_no_break_comes_before_a_repetition() -> None:
    protocol = make_protocol(extras=Extras(practice=0, break_every=1))
    plan = Plan(protocol, 1, 0)
    attempts = [each.attempt for each in run(plan, lambda trial: None) if plan.break_due]
    assert set(attempts) == {protocol.bounds.repeats}


def test_a_record_of_another_trial_is_refused() -> None:
    plan, other = (Plan(PROTOCOLS["2ifc"], seed, 0) for seed in (1, 2))
    records = list(run(other, always_right))
    with pytest.raises(ValueError, match="^trial 1: must be the next trial of the plan$"):
        plan.record(records[1])


def test_each_order_of_stimuli_is_equally_frequent_and_another_for_each_seed() -> None:
    protocol = make_protocol("odd_one_out", procedure=Procedure(repeats=12), extras=NOTHING_ELSE)
    plans = (Plan(protocol, seed, 0) for seed in (1, 2))
    stimuli, others = ([each.trial.stimuli for each in run(plan, always_right)] for plan in plans)
    assert Counter(Counter(stimuli).values()) == {2: 6}
    assert stimuli != others


@pytest.mark.parametrize(
    ("name", "trials"),
    [
        ("compensated_or_not", 4 + 40),
        ("preference", 2 + 6 * 8),
        ("real_or_virtual_texture", 4 + 4 * 6),
        ("gain_jnd", 4 + 2 * 60),
        ("network_delay", 4 + 5 * 20),
    ],
)
def test_the_trials_of_a_session_are_known_before(name: str, trials: int) -> None:
    assert expected_trials(read_protocol(templates()[name])) == trials


def test_catch_trials_count(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    text = templates()["network_delay"].read_text()
    path.write_text(text.replace("practice: 4", "practice: 4, catch_every: 20"))
    assert expected_trials(read_protocol(path)) == 4 + 100 + 4


def test_a_study_is_described_by_trials_duration_and_conditions() -> None:
    found = read_protocol(templates()["gain_jnd"])
    lines = describe(found)
    assert lines[0] == f"{found.title} (version {found.digest[:12]})"
    seconds = 2 * found.timing.seconds + found.timing.gap + ANSWERING + 2 * CHANGING
    minutes = math.ceil(124 * seconds / 60)
    assert lines[2].startswith(f"at most 124 trials, about {minutes} min without breaks")
    assert "gain=1 against gain=2" in lines
