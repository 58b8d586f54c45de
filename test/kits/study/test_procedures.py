# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Staircases at the points where theory lets them settle, and QUEST+ beside another program."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise, permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kits.study.protocol_maker import make_levels, make_protocol

from haptic_accel.kits.study import procedures
from haptic_accel.kits.study.procedures import TASKS, labels, ordered, rows, williams
from haptic_accel.kits.study.protocol import Condition, Levels, Order, Pair, Procedure, Protocol


def _constant(order: Order, repeats: int = 3, surfaces: int = 4) -> Protocol:
    return make_protocol("rating", surfaces, order=order, procedure=Procedure(repeats=repeats))


@given(st.integers(2, 14))
def test_each_condition_follows_each_other_equally_often(count: int) -> None:
    square = williams(count)
    followed = Counter(pair for row in square for pair in pairwise(row))
    assert followed == dict.fromkeys(permutations(range(count), 2), len(square) // count)


@given(st.integers(1, 14))
def test_each_condition_is_equally_often_at_each_place(count: int) -> None:
    square = williams(count)
    for column in zip(*square, strict=True):
        assert Counter(column) == dict.fromkeys(range(count), len(square) // count)


@given(
    st.sampled_from([Order("random"), Order("blocked", "surface"), Order("williams")]),
    st.integers(0, 30),
    st.integers(1, 5),
    st.integers(1, 5),
)
def test_each_condition_is_presented_equally_often(
    order: Order, row: int, repeats: int, surfaces: int
) -> None:
    protocol = _constant(order, repeats, surfaces)
    places = [place for place, _ in ordered(protocol, row, np.random.default_rng(1))]
    assert Counter(places) == dict.fromkeys(range(surfaces), repeats)


def test_a_block_has_one_value_of_its_factor() -> None:
    protocol = make_levels(surfaces=("wood", "foam"), order=Order("blocked", "surface"))
    slots = ordered(protocol, 0, np.random.default_rng(1))
    blocks = {(block, protocol.pairs[place].comparison["surface"]) for place, block in slots}
    assert len(blocks) == 2
    assert [block for _, block in slots] == [0] * 40 + [1] * 40


def test_blocks_begin_with_another_value_in_the_next_row() -> None:
    protocol = _constant(Order("blocked", "surface"))
    generators = [np.random.default_rng(1) for _ in range(rows(protocol))]
    firsts = {ordered(protocol, row, rng)[0][0] for row, rng in enumerate(generators)}
    assert firsts == {0, 1, 2, 3}


def test_a_block_of_a_williams_order_is_a_row_of_the_square() -> None:
    slots = ordered(_constant(Order("williams")), 2, np.random.default_rng(1))
    square = williams(4)
    assert [place for place, block in slots if block == 1] == square[3]
    assert [place for place, block in slots if block == 2] == square[0]


@pytest.mark.parametrize(
    ("order", "surfaces", "expected"),
    [
        (Order("random"), 4, 1),
        (Order("blocked", "surface"), 3, 6),
        (Order("williams"), 4, 4),
        (Order("williams"), 5, 10),
    ],
)
def test_participants_are_balanced_over_the_rows(
    order: Order, surfaces: int, expected: int
) -> None:
    assert rows(_constant(order, surfaces=surfaces)) == expected


def test_adaptive_procedures_have_one_row() -> None:
    assert rows(make_levels(procedure=Procedure("staircase"), order=Order("williams"))) == 1


def test_a_random_order_depends_on_the_seed_alone() -> None:
    protocol = _constant(Order("random"), repeats=10)
    orders = [ordered(protocol, 0, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert orders[0] == orders[1] != orders[2]


WIDE = Levels("gain", 0.0, (0.01, 100.0))


def _weibull(distance: float, threshold: float, guess: float = 0.5, lapse: float = 0.0) -> float:
    return float(1 - lapse - (1 - guess - lapse) * np.exp(-((distance / threshold) ** 2)))


def _distances(
    track: procedures.Staircase | procedures.QuestPlus, correct: Callable[[float], bool]
) -> list[float]:
    distances = []
    while track.progress < 1:
        distances.append(track.distance)
        track.update(correct(track.distance))
    return distances


def _staircase(levels: Levels = WIDE, **changes: Any) -> procedures.Staircase:
    return procedures.Staircase(Procedure("staircase", **changes), procedures.Span(levels))


def _answers(seed: int, proportion: Callable[[float], float]) -> Callable[[float], bool]:
    generator = np.random.default_rng(seed)
    return lambda distance: bool(generator.random() < proportion(distance))


# Levitt 1971, table I; Kaernbach 1991: up (1 - p) = down p.
SETTLED = [
    *((down, 1.0, 1.0, p) for down, p in enumerate((0.5, 0.707, 0.794, 0.841, 0.871), 1)),
    *((1, up / 2, down / 2, p) for up, down, p in ((3, 1, 0.75), (1, 1, 0.5), (4.5, 0.5, 0.9))),
]


@pytest.mark.parametrize(("down", "step_up", "step_down", "expected"), SETTLED)
def test_a_staircase_settles_where_theory_says(
    down: int, step_up: float, step_down: float, expected: float
) -> None:
    # Steps are small beside the function, so that it is linear.
    steps = {"down": down, "step_up": step_up, "step_down": step_down}
    staircase = _staircase(trials=1000, reversals=100, fine_after=100, **steps)
    answers = _answers(4, _linear)
    for _ in range(100):
        staircase.update(answers(staircase.distance))
    proportions = []
    for _ in range(20_000):
        proportions.append(_linear(staircase.distance))
        staircase.update(answers(staircase.distance))
    tolerance = 0.02 if step_up == step_down else 0.025
    assert np.mean(proportions) == pytest.approx(expected, abs=tolerance)


def _linear(distance: float) -> float:
    return min(max(distance / 100, 0.0), 1.0)


def _after_each(staircase: procedures.Staircase, *answers: bool) -> list[float]:
    distances = []
    for correct in answers:
        staircase.update(correct)
        distances.append(staircase.distance)
    return distances


def test_a_staircase_goes_down_after_right_answers_and_up_after_a_wrong_one() -> None:
    staircase = _staircase(down=2, step_up=5.0, step_down=10.0, fine_after=100)
    assert staircase.distance == 100
    distances = _after_each(staircase, True, True, True, False, True, True)
    assert distances == [100, 90, 90, 95, 95, 85]
    assert staircase.reversals == 2


def test_steps_are_halved_after_some_reversals() -> None:
    staircase = _staircase(down=1, step_up=8.0, step_down=8.0, fine_after=2)
    assert _after_each(staircase, True, True, False, True, False) == [92, 84, 92, 88, 92]


def test_steps_are_factors_on_a_logarithmic_scale() -> None:
    levels = Levels("gain", 1.0, (1.01, 9.0), "log")
    staircase = _staircase(levels, down=1, step_up=4.0, step_down=4.0, fine_after=2)
    assert _after_each(staircase, True, True, False, True) == pytest.approx([2, 0.5, 2, 1])


@given(st.lists(st.sampled_from([True, False, None]), max_size=100))
def test_a_staircase_stays_between_its_levels(answers: list[bool | None]) -> None:
    staircase = _staircase(Levels("gain", 1.0, (1.2, 1.5)), step_up=0.2, step_down=0.15)
    for correct in answers:
        staircase.update(correct)
        assert 0.2 <= round(staircase.distance, 9) <= 0.5


def test_a_staircase_ends_after_its_reversals_or_trials() -> None:
    by_reversals = _staircase(down=1, reversals=4, trials=100)
    generator = np.random.default_rng(1)
    _distances(by_reversals, lambda distance: bool(generator.random() < 0.5))
    assert by_reversals.reversals == 4
    assert len(_distances(_staircase(trials=30), lambda distance: True)) == 30


def test_a_trial_that_was_left_out_moves_no_staircase() -> None:
    staircase = _staircase(down=1)
    staircase.update(None)
    assert staircase.distance == 100


def test_tracks_are_interleaved_and_each_ends_by_itself() -> None:
    procedure = Procedure("staircase", tracks=3, trials=10, step_up=0.1, step_down=0.1)
    levels = make_levels(surfaces=("wood", "foam"), procedure=procedure)
    work = procedures.method(levels, 0, np.random.default_rng(1))
    tracks = []
    while (choice := work.choose(np.random.default_rng(len(tracks)))) is not None:
        tracks.append(choice.track)
        work.record(choice.track, True)
    names = {f"surface={surface} #{track}" for surface in ("wood", "foam") for track in (1, 2, 3)}
    assert {name: tracks.count(name) for name in names} == dict.fromkeys(names, 10)
    assert len(set(tracks[:8])) > 2


def test_levels_below_the_reference_go_up_towards_it() -> None:
    span = procedures.Span(Levels("gain", 1.0, (0.2, 0.6, 0.9)))
    assert span.level(span.largest) == 0.2
    assert span.level(span.moved(span.largest, -0.3)) == 0.5
    assert span.level(span.moved(span.largest, -5.0)) == 0.9


def test_pairs_that_differ_in_their_level_alone_are_a_family() -> None:
    low, high = Condition((("gain", 1.0),)), Condition((("gain", 2.0),))
    assert procedures.family(Pair(low, high, 2.0)) == "all levels"
    assert procedures.family(Pair(low, high)) == "gain=1 / gain=2"


GRID = np.geomspace(0.1, 10.0, 31)


@pytest.mark.parametrize("threshold", [0.4, 1.0, 3.0])
def test_quest_plus_presents_levels_near_the_threshold(threshold: float) -> None:
    quest = procedures.QuestPlus(GRID, 0.5, 100)
    answers = _answers(2, lambda distance: _weibull(distance, threshold, lapse=0.02))
    distances = _distances(quest, answers)
    assert len(distances) == 100
    assert np.median(distances[20:]) == pytest.approx(threshold, rel=0.6)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.booleans(), min_size=40, max_size=400))
def test_quest_plus_goes_on_after_any_answers(answers: list[bool]) -> None:
    # PsychoPy's procedure stopped at a trial whose probabilities were no longer numbers (#4305).
    quest = procedures.QuestPlus(GRID, 1 / 3, len(answers))
    for correct in answers:
        quest.update(correct)
        assert quest.distance in GRID


def test_quest_plus_ignores_a_trial_that_was_left_out() -> None:
    quest = procedures.QuestPlus(GRID, 0.5, 10)
    before = quest.distance
    quest.update(None)
    assert (quest.distance, quest.progress) == (before, 0.1)


@pytest.mark.parametrize("guess", [0.5, 1 / 3])
@pytest.mark.parametrize("scale", ["linear", "log10"])
@pytest.mark.parametrize("seed", [1, 2])
def test_quest_plus_chooses_as_another_program(guess: float, scale: str, seed: int) -> None:
    questplus = pytest.importorskip("questplus")
    grid = GRID if scale == "linear" else np.log10(GRID)
    other = questplus.QuestPlus(
        stim_domain={"intensity": grid},
        param_domain={
            "threshold": grid,
            "slope": procedures.SLOPES,
            "lower_asymptote": np.array([guess]),
            "lapse_rate": procedures.LAPSES,
        },
        outcome_domain={"response": ["right", "wrong"]},
        func="weibull",
        stim_scale=scale,
    )
    quest = procedures.QuestPlus(GRID, guess, 40)
    answers = _answers(seed, lambda distance: _weibull(distance, 1.3, guess, 0.02))
    for _ in range(40):
        chosen = other.next_stim
        expected = chosen["intensity"] if scale == "linear" else 10 ** chosen["intensity"]
        assert quest.distance == pytest.approx(expected)
        correct = answers(quest.distance)
        quest.update(correct)
        other.update(stim=chosen, outcome={"response": "right" if correct else "wrong"})


def _arranged(task: str) -> list[tuple[str, str]]:
    protocol = make_protocol(task)
    pair = protocol.pairs[0]
    letters = {pair.reference: "r", pair.comparison: "c"}
    arranged = []
    for order in range(len(TASKS[task].orders)):
        stimuli, answers, right = TASKS[task].arrange(protocol, pair, order)
        assert right in (*answers, "")
        arranged.append(("".join(letters[each] for each in stimuli), right))
    return arranged


@pytest.mark.parametrize("task", [name for name, task in TASKS.items() if task.paired])
def test_each_stimulus_is_as_often_in_each_interval(task: str) -> None:
    orders = [stimuli for stimuli, _ in _arranged(task)]
    for interval in range(TASKS[task].stimuli):
        half = len(orders) / 2
        assert Counter(stimuli[interval] for stimuli in orders) == {"r": half, "c": half}


@pytest.mark.parametrize("task", ["2ifc", "odd_one_out", "abx", "same_different"])
def test_a_guess_is_right_by_chance(task: str) -> None:
    right = Counter(right for _, right in _arranged(task))
    admitted = TASKS[task].admitted(make_protocol(task))
    assert set(right) == set(admitted)
    for answer in admitted:
        assert right[answer] / right.total() == TASKS[task].chance


@pytest.mark.parametrize(
    ("task", "is_right"),
    [
        ("2ifc", lambda of, right: of[int(right) - 1] == "c"),
        ("odd_one_out", lambda of, right: of.count(of[int(right) - 1]) == 1),
        ("abx", lambda of, right: of[2] == of["AB".index(right)] != of["BA".index(right)]),
        ("same_different", lambda of, right: (right == "same") == (of[0] == of[1])),
    ],
)
def test_the_right_answer_is_that_of_the_stimuli(
    task: str, is_right: Callable[[str, str], bool]
) -> None:
    assert all(is_right(*each) for each in _arranged(task))


def test_a_condition_is_identified_by_its_label() -> None:
    protocol = make_protocol("identification", surfaces=3)
    for condition, label in zip(protocol.conditions, ("s0", "s1", "s2"), strict=True):
        arranged = TASKS["identification"].arrange(protocol, condition, 0)
        assert arranged == ((condition,), ("s0", "s1", "s2"), label)


def test_a_label_has_all_factors_that_differ() -> None:
    conditions = tuple(
        Condition((("surface", surface), ("gain", gain), ("controller", "adaptive")))
        for surface in ("wood", "foam")
        for gain in (0.5, 1.0)
    )
    names = labels(make_protocol(conditions=conditions))
    assert list(names.values()) == ["wood 0.5", "wood 1", "foam 0.5", "foam 1"]


def test_ratings_are_the_values_of_the_scale() -> None:
    protocol = make_protocol("rating", scale=(0.0, 1.0, 0.25))
    stimuli, answers, right = TASKS["rating"].arrange(protocol, protocol.conditions[0], 0)
    assert answers == ("0", "0.25", "0.5", "0.75", "1")
    assert (len(stimuli), right) == (1, "")


@pytest.mark.parametrize("task", ["rating", "similarity", "preference"])
def test_no_answer_is_right_where_there_is_no_truth(task: str) -> None:
    assert {right for _, right in TASKS[task].orders} == {""}
    assert TASKS[task].chance is None
