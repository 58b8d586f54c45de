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

"""Balance of the orders."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kits.study.protocol_maker import make_levels, make_protocol

from haptic_accel.kits.study.orders import ordered, rows, williams
from haptic_accel.kits.study.protocol import Order, Procedure, Protocol


def _constant(order: Order, repeats: int = 3, surfaces: int = 4) -> Protocol:
    procedure = Procedure(repeats=repeats)
    return make_protocol("rating", surfaces, order=order, procedure=procedure)


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
    firsts = {
        ordered(protocol, row, np.random.default_rng(1))[0][0] for row in range(rows(protocol))
    }
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
