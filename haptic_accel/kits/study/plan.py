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

"""Plan of a session: its trials, one after the other, each planned from the records before it.

Beforehand, it tells the length of a session.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.procedures import TASKS, Choice, Item, easiest, family, method
from haptic_accel.kits.study.protocol import Pair, Protocol
from haptic_accel.kits.study.trials import CATCH, MAIN, PRACTICE, PlannedTrial, TrialRecord

ANSWERING, CHANGING = 3.0, 1.0
"""Time to answer, and to change to the next condition, s (assumed)."""

TRIAL, ORDER = 0, 1
"""Streams of random numbers: of one trial, and of the order of a session."""


class Plan:
    """Trials of a session.

    Random numbers depend on the seed and the trial's number alone, and all other state on the
    records: a plan to which the records of a log were given is the plan of the session that wrote
    them.

    Parameters
    ----------
    protocol : Protocol
    seed : int
        Seed of the participant, at least 0.
    row : int
        Row of the Williams square, counted over the participants.

    Attributes
    ----------
    trials : int
        Number of trials with practice and catch trials; with staircases, the largest number.
    attempt : int
        Number of presentations of the next trial so far, which were not delivered.

    Raises
    ------
    ParameterError
        The protocol's procedure or catch trials do not fit its task and levels.
    """

    def __init__(self, protocol: Protocol, seed: int, row: int) -> None:
        self._protocol, self._task, self._seed = protocol, TASKS[protocol.task], seed
        extras = self._extras = protocol.extras
        generator = np.random.default_rng([seed, 0, ORDER])
        self._method = method(protocol, row, generator)
        self._certain = easiest(protocol)
        if extras.catch_every and not self._certain:
            raise ParameterError(
                f"extras.catch_every = {extras.catch_every}: must be 0 without levels"
            )
        catch = (self._method.trials - 1) // extras.catch_every if extras.catch_every else 0
        self.trials = extras.practice + self._method.trials + catch
        items = self._certain or self._task.items(protocol)
        self._practice = [items[index] for index in generator.permutation(len(items))]
        self._finished: Counter[str] = Counter()
        self.attempt = 0
        self._planned = self._plan()

    @property
    def progress(self) -> float:
        """Share of the session that is done, from 0 to 1."""
        after = self.trials - self._extras.practice
        return (self._finished[PRACTICE] + self._method.progress * after) / self.trials

    @property
    def break_due(self) -> bool:
        """True if there is a break before the next trial."""
        every = self._extras.break_every
        done = self._finished[MAIN] + self._finished[CATCH]
        between = bool(every and done and self._planned) and self.attempt == 0
        return between and done % every == 0

    def next(self) -> PlannedTrial | None:
        """Return the next trial, the same until it is recorded; None at the end."""
        return self._planned

    def record(self, record: TrialRecord) -> None:
        """Go on after a trial.

        A trial without an answer, or with a flaw, is repeated up to `Bounds.repeats` times, and
        then left out.

        Raises
        ------
        ValueError
            The record is not one of the next trial.
        """
        trial = record.trial
        if trial != self._planned:
            raise ValueError(f"trial {trial.number}: must be the next trial of the plan")
        delivered = record.answer is not None and not record.flaw
        if not delivered and self.attempt < self._protocol.bounds.repeats:
            self.attempt += 1
            return
        if trial.kind == MAIN:
            self._method.record(trial.track, record.correct if delivered else None)
        self._finished[trial.kind] += 1
        self.attempt = 0
        self._planned = self._plan()

    def _plan(self) -> PlannedTrial | None:
        number = self._finished.total()
        generator = np.random.default_rng([self._seed, number, TRIAL])
        kind, choice = self._choose(generator)
        if choice is None:
            return None
        made = self._task.arrange(self._protocol, choice.item, choice.order)
        level = choice.item.level if isinstance(choice.item, Pair) else None
        return PlannedTrial(number, kind, *made, choice.track, level, choice.block)

    def _choose(self, generator: np.random.Generator) -> tuple[str, Choice | None]:
        practised, every = self._finished[PRACTICE], self._extras.catch_every
        if practised < self._extras.practice:
            item = self._practice[practised % len(self._practice)]
            return PRACTICE, self._extra(item, 0, generator)
        choice = self._method.choose(generator)
        if choice and every and self._finished[CATCH] < self._finished[MAIN] // every:
            item = self._certain[generator.integers(len(self._certain))]
            return CATCH, self._extra(item, choice.block, generator)
        return MAIN, choice

    def _extra(self, item: Item, block: int, generator: np.random.Generator) -> Choice:
        orders = len(self._task.orders)
        return Choice(item, int(generator.integers(orders)), family(item), block)


def expected_trials(protocol: Protocol) -> int:
    """Return the largest number of trials, with practice and catch trials, without repetitions."""
    return Plan(protocol, seed=0, row=0).trials


def expected_minutes(protocol: Protocol) -> float:
    """Return the expected duration of all trials, without breaks, min."""
    stimuli, timing = TASKS[protocol.task].stimuli, protocol.timing
    presenting = stimuli * (CHANGING + timing.seconds) + (stimuli - 1) * timing.gap
    return expected_trials(protocol) * (presenting + ANSWERING) / 60


def describe(protocol: Protocol) -> list[str]:
    """Return lines that describe a study before its first participant."""
    participants, trials = protocol.rules.participants, expected_trials(protocol)
    most = "" if protocol.procedure.kind == "constant" else "at most "
    presented = [f"{each.reference} against {each.comparison}" for each in protocol.pairs]
    tests = [f"test {each.name}: {each.measure} {each.condition}" for each in protocol.tests]
    return [
        f"{protocol.title} (version {protocol.digest[:12]})",
        f"{protocol.task}, {protocol.procedure.kind}, order {protocol.order.kind}",
        f"{most}{trials} trials, about {math.ceil(expected_minutes(protocol))} min without breaks,"
        f" {participants} participants",
        *(presented or map(str, protocol.conditions)),
        *tests,
    ]
