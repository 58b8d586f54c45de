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

"""Tasks: stimuli of a trial, admitted answers, and the right answer.

Macmillan, Creelman, "Detection theory: a user's guide", 2nd edition, 2005, chapters 5,
7, 9 and 10.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from haptic_accel.kits.study.protocol import Condition, Levels, Pair, Protocol

Item: TypeAlias = Pair | Condition
"""Subject of a trial: the pair that is compared, or the only condition."""

SAME, DIFFERENT = "same", "different"
"""Answers of the task ``same_different``."""


@dataclass(frozen=True)
class Task:
    """Question of a trial and the order of its stimuli.

    Attributes
    ----------
    orders : tuple of (str, str)
        Possible orders of the stimuli, each with its right answer: ``r`` is the reference, ``c``
        the comparison, ``x`` the only condition, whose label is right where that is ``x``.
    admitted : callable
        Admitted answers in a protocol.
    chance : float or None
        Proportion correct of an observer who guesses; None where no answer is right, and for
        ``identification``, where it is one of the number of conditions.
    adaptive : bool
        Whether a level can be chosen by right and wrong answers: the proportion correct grows with
        the level from `chance`.
    """

    orders: tuple[tuple[str, str], ...]
    admitted: Callable[[Protocol], tuple[str, ...]]
    chance: float | None = None
    adaptive: bool = False

    @property
    def stimuli(self) -> int:
        """Number of stimuli of a trial."""
        return len(self.orders[0][0])

    @property
    def paired(self) -> bool:
        """True if a trial compares the two conditions of a pair."""
        return self.stimuli > 1

    def items(self, protocol: Protocol) -> tuple[Item, ...]:
        """Return the subjects of the trials: pairs or conditions."""
        return protocol.pairs if self.paired else protocol.conditions

    def arrange(
        self, protocol: Protocol, item: Item, order: int
    ) -> tuple[tuple[Condition, ...], tuple[str, ...], str]:
        """Return stimuli, admitted answers, and the right answer; empty if there is none.

        Parameters
        ----------
        protocol : Protocol
        item : Pair or Condition
        order : int
            Place in `orders`.
        """
        items, right = self.orders[order]
        if isinstance(item, Pair):
            conditions = {"r": item.reference, "c": item.comparison}
        else:
            conditions = {"x": item}
            right = labels(protocol)[item] if right == "x" else right
        return tuple(conditions[item] for item in items), self.admitted(protocol), right


def labels(protocol: Protocol) -> dict[Condition, str]:
    """Return a short name for each condition: the values of the factors that differ.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> wood, foam = (Condition((("gain", 1.0), ("surface", each))) for each in ("wood", "foam"))
    >>> list(labels(SimpleNamespace(conditions=(wood, foam))).values())
    ['wood', 'foam']
    """
    shared = set.intersection(*(set(each.settings) for each in protocol.conditions))
    return {
        condition: " ".join(written(each[1]) for each in condition.settings if each not in shared)
        for condition in protocol.conditions
    }


def distance(levels: Levels, condition: Condition) -> float:
    """Return the distance of a condition's level from the reference, in the level's unit."""
    return abs(float(condition[levels.factor]) - levels.reference)


def written(value: str | float) -> str:
    """Return a value as an answer has it.

    Examples
    --------
    >>> written(50.0), written(0.5), written("wood")
    ('50', '0.5', 'wood')
    """
    return value if isinstance(value, str) else f"{value:g}"


def ratings(protocol: Protocol) -> tuple[str, ...]:
    """Return the values of the scale, from the lowest to the highest."""
    low, high, step = protocol.scale
    return tuple(written(low + step * index) for index in range(round((high - low) / step) + 1))


TASKS: Mapping[str, Task] = {
    "2ifc": Task((("rc", "2"), ("cr", "1")), lambda _: ("1", "2"), 1 / 2, adaptive=True),
    "odd_one_out": Task(
        (("crr", "1"), ("rcr", "2"), ("rrc", "3"), ("rcc", "1"), ("crc", "2"), ("ccr", "3")),
        lambda _: ("1", "2", "3"),
        1 / 3,
        adaptive=True,
    ),
    "abx": Task(
        (("rcr", "A"), ("rcc", "B"), ("crc", "A"), ("crr", "B")),
        lambda _: ("A", "B"),
        1 / 2,
        adaptive=True,
    ),
    "same_different": Task(
        (("rr", SAME), ("rc", DIFFERENT), ("cc", SAME), ("cr", DIFFERENT)),
        lambda _: (SAME, DIFFERENT),
        1 / 2,
    ),
    "identification": Task((("x", "x"),), lambda protocol: tuple(labels(protocol).values())),
    "rating": Task((("x", ""),), ratings),
    "similarity": Task((("rc", ""), ("cr", "")), ratings),
    "preference": Task((("rc", ""), ("cr", "")), lambda _: ("1", "2")),
}
"""Tasks by their names in a protocol.

``2ifc``: which of two intervals had the comparison; ``odd_one_out``: which of three differs from
the others; ``abx``: which of the first two the third equals; ``same_different``: whether two are
the same; ``identification``: which condition it was; ``rating``: a number on the scale;
``similarity``: a number on the scale, of which the highest is for two stimuli that feel the same;
``preference``: which of two is preferred.
"""
