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

"""Planned tests: which value each participant has, and what it is tested against."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from kits.study.study_sessions import (
    ADAPTIVE,
    MASS,
    NONE,
    Answering,
    paired,
    protocol,
    session,
    single,
)

from haptic_accel.kits.study.folder import templates
from haptic_accel.kits.study.planned_tests import counted, planned_tests, values
from haptic_accel.kits.study.protocol import PlannedTest, Protocol, Rules
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.simulation import simulate_study
from haptic_accel.kits.study.trials import CATCH, PlannedTrial, SessionRecord


def unruled(task: str, **changes: object) -> Protocol:
    """Return a study without right answers, whose catch trials do not exclude."""
    return protocol(task, rules=Rules(catch_correct=0.0), **changes)


def with_test(study: Protocol, measure: str, condition: str = "", **changes: object) -> Protocol:
    given = {"name": "test", "measure": measure, "condition": condition, **changes}
    return replace(study, tests=(PlannedTest(**given),))  # type: ignore[arg-type]


def wrong_at(*numbers: int) -> Answering:
    """Return answers that are wrong at some main trials."""

    def answer(trial: PlannedTrial, _: np.random.Generator) -> str:
        wrong = [each for each in trial.answers if each != trial.right]
        return wrong[0] if trial.number in numbers and trial.kind != CATCH else trial.right

    return answer


def preferring(order: Mapping[str, float]) -> Answering:
    """Return the interval with the stronger condition."""

    def answer(trial: PlannedTrial, _: np.random.Generator) -> str:
        first, second = (order[str(each)] for each in trial.stimuli)
        return "1" if first > second else "2"

    return answer


def rated(ratings: Mapping[str, float], more: float = 0.0) -> Answering:
    return lambda trial, _: str(ratings[str(trial.stimuli[0])] + more)


def sessions(study: Protocol, *answers: Answering) -> list[SessionRecord]:
    trials = paired(study, 10) if study.pairs else single(study, 5)
    return [session(study, f"P{i}", trials, answer) for i, answer in enumerate(answers)]


def test_each_participant_has_one_value_whatever_the_number_of_trials() -> None:
    study = with_test(protocol("2ifc"), "correct")
    found = planned_tests(study, sessions(study, *[wrong_at(1), wrong_at(1, 2), wrong_at()] * 2))
    (result,) = found
    assert list(result.values.values()) == [0.95, 0.9, 1.0] * 2
    assert result.outcome.n == 6
    assert result.against == 0.5
    assert result.mean.value == pytest.approx(0.95)
    assert result.outcome.significant


def test_the_interval_of_a_share_ends_at_one() -> None:
    study = with_test(protocol("2ifc"), "correct")
    (result,) = planned_tests(
        study, sessions(study, wrong_at(1, 2, 3, 4, 5), wrong_at(), wrong_at())
    )
    assert result.outcome.mean.high + result.against > 1.0, "Student's own"
    assert (result.mean.low < result.mean.value, result.mean.high) == (True, 1.0)


def test_a_test_of_a_condition_has_the_trials_whose_comparison_it_is() -> None:
    # Odd trials compare adaptive, even ones mass, both with none.
    study = with_test(protocol("2ifc"), "correct", "controller=mass")
    (result,) = planned_tests(study, sessions(study, wrong_at(2, 3)))
    assert result.values == {"P0": 0.9}
    study = with_test(
        protocol("2ifc"), "correct", "controller=mass", against="controller=adaptive"
    )
    (result,) = planned_tests(study, sessions(study, wrong_at(2, 4), wrong_at(3), wrong_at(2)))
    assert list(result.values.values()) == pytest.approx([-0.2, 0.1, -0.1])
    assert result.against == 0.0
    assert result.measured == "difference of proportion correct"


def test_excluded_participants_and_other_kinds_of_trials_do_not_count() -> None:
    study = with_test(protocol("2ifc"), "correct")
    found = sessions(study, wrong_at(0), wrong_at(1), wrong_at())
    (result,) = planned_tests(study, [*found[:2], replace(found[2], ended="stopped")])
    assert result.values == {"P0": 1.0, "P1": 0.95}
    assert len(counted(study, found)) == 3 * 20


def test_sensitivity_follows_the_task() -> None:
    """Of 20 trials, 15 right: d' of the log-linear proportion 15.5 / 21 (2IFC: sqrt 2 z)."""
    study = with_test(protocol("2ifc"), "d_prime")
    (result,) = planned_tests(study, sessions(study, wrong_at(1, 2, 3, 4, 5)))
    assert result.values["P0"] == pytest.approx(math.sqrt(2) * 0.6372, abs=2e-3)


def test_same_and_different_answers_give_d_prime_by_their_rates() -> None:
    study = with_test(read_protocol(templates()["compensated_or_not"]), "d_prime")
    found = simulate_study(study, 12, 5)
    (result,) = planned_tests(study, found)
    assert result.mean.low < 2.0 < result.mean.high
    assert result.against == 0.0


def test_preference_is_a_share_of_the_trials_with_the_condition() -> None:
    study = unruled("preference")
    order = {str(NONE): 1.0, str(MASS): 0.0, str(ADAPTIVE): 2.0}
    found = sessions(study, preferring(order))
    expected = {
        ("controller=adaptive", ""): 1.0,
        ("controller=none", ""): 0.5,
        ("controller=none", "controller=adaptive"): 0.0,
        ("controller=none", "controller=mass"): 1.0,
        ("controller=none", "0.25"): 0.5,
    }
    for (condition, against), share in expected.items():
        tested = with_test(study, "preferred", condition, against=against)
        (result,) = planned_tests(tested, found)
        assert result.values == {"P0": share}
        assert result.against == (0.25 if against == "0.25" else 0.5)


def test_a_condition_that_was_never_compared_has_no_value() -> None:
    given = {"against": "controller=adaptive"}
    study = with_test(unruled("preference"), "preferred", "controller=mass", **given)
    order = dict.fromkeys(map(str, (NONE, MASS, ADAPTIVE)), 0.0)
    (result,) = planned_tests(study, sessions(study, preferring(order)))
    assert result.values == {}
    assert not result.outcome.significant


def test_ratings_of_two_conditions_are_paired_by_participant() -> None:
    study = unruled("rating", pairs=())
    ratings = {str(NONE): 20.0, str(MASS): 40.0, str(ADAPTIVE): 60.0}
    tested = with_test(study, "rating", "controller=adaptive", against="controller=mass")
    (result,) = planned_tests(tested, sessions(study, *(rated(ratings, i) for i in range(3))))
    assert list(result.values.values()) == [20.0] * 3
    (result,) = planned_tests(with_test(study, "rating"), sessions(study, rated(ratings)))
    assert result.values == {"P0": 40.0}


def test_thresholds_of_simulated_observers_are_found() -> None:
    study = read_protocol(templates()["network_delay"])
    observer = replace(study.observer, threshold=60.0, spread=0.0)
    study = replace(study, observer=observer, procedure=replace(study.procedure, repeats=60))
    (result,) = planned_tests(study, simulate_study(study, 8, 2))
    assert float(np.median(list(result.values.values()))) == pytest.approx(60.0, rel=0.2)
    assert result.outcome.significant


def test_equivalence_is_tested_within_its_margin() -> None:
    study = unruled("rating", pairs=())
    ratings = {str(NONE): 20.0, str(MASS): 41.0, str(ADAPTIVE): 40.0}
    given = {"alternative": "equivalent", "against": "controller=mass"}
    answers = [rated(ratings | {str(MASS): 39.0 + i / 2}) for i in range(5)]
    for margin, shown in ((5.0, True), (0.5, False)):
        tested = with_test(study, "rating", "controller=adaptive", margin=margin, **given)
        (result,) = planned_tests(tested, sessions(study, *answers))
        assert result.outcome.significant is shown


def test_a_study_without_sessions_has_results_without_values() -> None:
    study = with_test(protocol("2ifc"), "correct")
    (result,) = planned_tests(study, [])
    assert result.values == values(study, [], study.tests[0], "") == {}
    assert math.isnan(result.mean.value)
