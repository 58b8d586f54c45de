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

"""Orders of the stimuli, admitted and right answers of each task."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest
from kits.study.protocol_maker import make_protocol

from haptic_accel.kits.study.protocol import Condition
from haptic_accel.kits.study.tasks import TASKS, labels


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
        assert Counter(stimuli[interval] for stimuli in orders) == {
            "r": len(orders) / 2,
            "c": len(orders) / 2,
        }


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
