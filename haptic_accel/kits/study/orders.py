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

"""Orders of the trials of a constant procedure.

Williams, "Experimental designs balanced for the estimation of residual effects of treatments",
Australian Journal of Scientific Research A 2(2), 149-168, 1949.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from haptic_accel.kits.study.protocol import Condition, Pair, Protocol, Value
from haptic_accel.kits.study.tasks import TASKS

Slots: TypeAlias = list[tuple[int, int]]
"""Trials in their order: the place of the item in the protocol, and the number of the block."""


def williams(count: int) -> list[list[int]]:
    """Return a Williams square: each number is followed by each other one equally often.

    Parameters
    ----------
    count : int
        Number of conditions.

    Returns
    -------
    list of list of int
        Rows, one for a participant: `count` of them, twice as many for an odd number.

    Examples
    --------
    >>> williams(4)
    [[0, 3, 1, 2], [1, 0, 2, 3], [2, 1, 3, 0], [3, 2, 0, 1]]
    """
    first = [(index + 1) // 2 * (-1) ** index % count for index in range(count)]
    rows = [[(number + row) % count for number in first] for row in range(count)]
    mirrored = count % 2 and count > 1
    return rows + [row[::-1] for row in rows] if mirrored else rows


def rows(protocol: Protocol) -> int:
    """Return the number of orders over which participants are balanced."""
    if protocol.procedure.kind != "constant":
        return 1
    return len(williams(len(_groups(protocol))))


def ordered(protocol: Protocol, row: int, generator: np.random.Generator) -> Slots:
    """Return the order of all main trials of a constant procedure.

    Parameters
    ----------
    protocol : Protocol
    row : int
        Row of the Williams square, of conditions or of blocks.
    generator : numpy.random.Generator
        Random numbers of the participant.
    """
    groups, repeats = _groups(protocol), protocol.procedure.repeats
    square = williams(len(groups))
    if protocol.order.kind == "williams":
        turns = [square[(row + turn) % len(square)] for turn in range(repeats)]
        return [(index, block) for block, turn in enumerate(turns) for index in turn]
    return [
        (int(index), block)
        for block, group in enumerate(square[row % len(square)])
        for index in generator.permutation(np.repeat(groups[group], repeats))
    ]


def _groups(protocol: Protocol) -> list[list[int]]:
    """Return the indices of the items in groups, which a Williams square puts in order."""
    groups: dict[Value, list[int]] = {}
    for index, item in enumerate(TASKS[protocol.task].items(protocol)):
        condition = item.comparison if isinstance(item, Pair) else item
        key = _KEYS[protocol.order.kind](protocol, condition, index)
        groups.setdefault(key, []).append(index)
    return list(groups.values())


_KEYS: Mapping[str, Callable[[Protocol, Condition, int], Value]] = {
    "random": lambda protocol, condition, index: 0,
    "blocked": lambda protocol, condition, index: condition[protocol.order.block_by],
    "williams": lambda protocol, condition, index: index,
}
"""Common property of the members of a group: nothing, a value, or their place."""
