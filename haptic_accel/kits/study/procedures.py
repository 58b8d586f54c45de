# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tasks, and procedures that choose the item of each trial, by plan or by earlier answers.

A task defines the stimuli of a trial, the admitted answers and the right answer. Macmillan,
Creelman, "Detection theory: a user's guide", 2nd edition, 2005, chapters 5, 7, 9 and 10.

Levitt, "Transformed up-down methods in psychoacoustics", JASA 49(2B), 467-477, 1971;
Kaernbach, "Simple adaptive testing with the weighted up-down method", Perception & Psychophysics
49(3), 227-229, 1991; Watson, "QUEST+: A general multidimensional Bayesian adaptive psychometric
method", Journal of Vision 17(3):10, 2017. Orders of the trials: Williams, "Experimental designs
balanced for the estimation of residual effects of treatments", Australian Journal of Scientific
Research A 2(2), 149-168, 1949.

The plan of a session yields its trials in turn, each planned from the earlier records. It also
predicts the length of a session.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.special import entr

from haptic_accel import FloatArray, ParameterError
from haptic_accel.kits.study.protocol import Condition, Levels, Pair, Procedure, Protocol, Value
from haptic_accel.kits.study.trials import CATCH, MAIN, PRACTICE, PlannedTrial, TrialRecord

Item: TypeAlias = Pair | Condition
"""Subject of a trial: the compared pair, or the only condition."""

SAME, DIFFERENT = "same", "different"
"""Answers of the task ``same_different``."""


@dataclass(frozen=True)
class Task:
    """Question of a trial and the order of its stimuli.

    Attributes
    ----------
    orders : tuple of (str, str)
        Possible orders of the stimuli, each with its right answer: ``r`` is the reference, ``c``
        the comparison, ``x`` the only condition, whose label is the right answer if that is ``x``.
    admitted : callable
        Function that returns the admitted answers in a protocol.
    chance : float or None
        Proportion correct of an observer who guesses; None if no answer is right, and for
        ``identification``, where chance depends on the number of conditions.
    adaptive : bool
        True if right and wrong answers can determine the next level: the proportion correct rises
        with the level from `chance`.
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
            Index in `orders`.
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
    """Return a value in the form of an answer.

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


Slots: TypeAlias = list[tuple[int, int]]
"""Trials in order: index of the item in the protocol, and number of the block."""


def williams(count: int) -> list[list[int]]:
    """Return a Williams square: each number is followed by each other one equally often.

    Parameters
    ----------
    count : int
        Number of conditions.

    Returns
    -------
    list of list of int
        Rows, one per participant: `count` rows, or twice as many if `count` is odd.

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
    """Return the indices of the items in groups, which a Williams square orders."""
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
"""Functions that return the common property of a group: none, a value, or the index."""


@dataclass(frozen=True)
class Choice:
    """Subject of the next trial.

    Attributes
    ----------
    item : Pair or Condition
    order : int
        Order of the stimuli: index in `Task.orders`.
    track : str
        Track of a staircase, pair or condition; trials of one track are analysed together.
    block : int
        Number of the block, from 0.
    """

    item: Item
    order: int
    track: str
    block: int = 0


def family(item: Item) -> str:
    """Return the name under which trials with an item are analysed together.

    Pairs that differ only in their level share a name: their other factors, or ``all levels`` if
    there are none.

    Examples
    --------
    >>> low, high = (Condition((("gain", gain), ("surface", "wood"))) for gain in (1.0, 2.0))
    >>> family(low), family(Pair(low, high)), family(Pair(low, high, 2.0))
    ('gain=1 surface=wood', 'gain=1 surface=wood / gain=2 surface=wood', 'surface=wood')
    """
    if isinstance(item, Condition):
        return str(item)
    if item.level is None:
        return f"{item.reference} / {item.comparison}"
    shared = [each for each in item.comparison.settings if each in item.reference.settings]
    return str(Condition(tuple(shared))) or "all levels"


def easiest(protocol: Protocol) -> tuple[Pair, ...]:
    """Return the pairs of each family that are farthest from the reference; none without levels.

    Practice and catch trials use these pairs, and adaptive procedures start with them.
    """
    levels = protocol.levels
    if levels is None:
        return ()
    nearest_first = sorted(protocol.pairs, key=lambda pair: distance(levels, pair.comparison))
    return tuple({family(pair): pair for pair in nearest_first}.values())


def method(protocol: Protocol, row: int, generator: np.random.Generator) -> Method:
    """Return the procedure of a protocol in its initial state.

    Parameters
    ----------
    protocol : Protocol
    row : int
        Row of the Williams square.
    generator : numpy.random.Generator
        Random numbers of the participant, for the order of a constant procedure.

    Raises
    ------
    ParameterError
        The task has no items; an adaptive procedure has no levels, or a task without adaptive
        answers; or a factor of a step is not above 1.
    """
    task, kind, name = TASKS[protocol.task], protocol.procedure.kind, protocol.task
    if not task.items(protocol):
        raise ParameterError(f"task = '{name}': needs {'pairs' if task.paired else 'conditions'}")
    if kind == "constant":
        return Constant(protocol, row, generator)
    if not task.adaptive:
        raise ParameterError(f"procedure.kind = '{kind}': must be constant for task '{name}'")
    if protocol.levels is None:
        raise ParameterError(f"procedure.kind = '{kind}': needs levels")
    return Interleaved(protocol, protocol.levels)


class Constant:
    """Method of constant stimuli: each item equally often, in an order fixed in advance.

    The orders of an item's stimuli occur equally often, with a difference of at most one.

    Attributes
    ----------
    trials : int
        Number of main trials.
    """

    def __init__(self, protocol: Protocol, row: int, generator: np.random.Generator) -> None:
        task = TASKS[protocol.task]
        items = task.items(protocol)
        slots = ordered(protocol, row, generator)
        decks = [_deck(len(task.orders), protocol.procedure.repeats, generator) for _ in items]
        self._choices = [
            Choice(items[index], decks[index].pop(), family(items[index]), block)
            for index, block in slots
        ]
        self.trials = len(self._choices)
        self._done = 0

    @property
    def progress(self) -> float:
        """Fraction completed, from 0 to 1."""
        return self._done / self.trials

    def choose(self, generator: np.random.Generator) -> Choice | None:
        """Return the next choice; None at the end."""
        return self._choices[self._done] if self._done < self.trials else None

    def record(self, track: str, correct: bool | None) -> None:
        """Advance to the next choice."""
        self._done += 1


def _deck(orders: int, repeats: int, generator: np.random.Generator) -> list[int]:
    """Return the orders shuffled, each equally often, with a difference of at most one."""
    balanced = np.resize(generator.permutation(orders), repeats)
    return [int(order) for order in generator.permutation(balanced)]


class Span:
    """Range of distances from the reference for an adaptive procedure.

    Parameters
    ----------
    levels : Levels

    Examples
    --------
    >>> span = Span(Levels("gain", 1.0, (1.1, 1.4, 2.0), "log"))
    >>> span.level(span.moved(0.5, -span.step(4.0)))
    1.125
    """

    def __init__(self, levels: Levels) -> None:
        distances = [abs(value - levels.reference) for value in levels.values]
        self.least, self.largest = min(distances), max(distances)
        self._sign = math.copysign(1.0, levels.values[0] - levels.reference)
        self._reference, self._log = levels.reference, levels.scale == "log"

    def step(self, size: float) -> float:
        """Return the size of a step on the scale; on a logarithmic one, the factor's logarithm.

        Raises
        ------
        ParameterError
            A factor is not above 1.
        """
        if not self._log:
            return size
        if size <= 1:
            raise ParameterError(f"procedure.step = {size:g}: must be above 1 as a factor")
        return math.log(size)

    def moved(self, distance: float, step: float) -> float:
        """Return the distance after a step on the scale, within the span."""
        moved = distance * math.exp(step) if self._log else distance + step
        return min(max(moved, self.least), self.largest)

    def grid(self) -> FloatArray:
        """Return `GRID` distances at equal steps of the scale."""
        return (np.geomspace if self._log else np.linspace)(self.least, self.largest, GRID)

    def level(self, distance: float) -> float:
        """Return the level at a distance, rounded to six digits as in the text of a condition."""
        return float(f"{self._reference + self._sign * distance:.6g}")


class Staircase:
    """Transformed and weighted staircase, which begins at the largest distance.

    Parameters
    ----------
    procedure : Procedure
    span : Span

    Attributes
    ----------
    trials : int
        Maximum number of trials.
    distance : float
        Distance of the next trial, in the level's unit.
    reversals : int
        Number of changes of direction so far.
    """

    def __init__(self, procedure: Procedure, span: Span) -> None:
        self._procedure, self._span = procedure, span
        self._up, self._down = span.step(procedure.step_up), -span.step(procedure.step_down)
        self._in_a_row, self._direction, self._done = 0, 0.0, 0
        self.trials, self.distance, self.reversals = procedure.trials, span.largest, 0

    @property
    def progress(self) -> float:
        """Fraction completed, from 0 to 1."""
        return max(self._done / self.trials, min(self.reversals / self._procedure.reversals, 1.0))

    def update(self, correct: bool | None) -> None:
        """Advance after a trial; `correct` is None if the trial was dropped."""
        self._done += 1
        if correct is False:
            self._in_a_row = 0
            self._move(self._up)
        elif correct:
            self._in_a_row = (self._in_a_row + 1) % self._procedure.down
            if self._in_a_row == 0:
                self._move(self._down)

    def _move(self, step: float) -> None:
        self.reversals += step * self._direction < 0
        self._direction = step
        fine = self.reversals >= self._procedure.fine_after
        self.distance = self._span.moved(self.distance, step / 2 if fine else step)


class QuestPlus:
    """Choice of the distance that minimises the expected entropy of the parameters.

    The psychometric function is Weibull's, 1 - lapse - (1 - guess - lapse) exp(-(x / t)^slope), of
    the distance x. The logarithm of the likelihood is stored, and no probability is 0, so that the
    posterior is a distribution after any answers.

    Parameters
    ----------
    distances : array of shape (n,)
        Possible distances, above 0, which are also the possible thresholds.
    guess : float
        Proportion correct by chance.
    trials : int
        Number of trials.

    Attributes
    ----------
    distance : float
        Distance of the next trial, in the level's unit.
    """

    def __init__(self, distances: FloatArray, guess: float, trials: int) -> None:
        grids = np.meshgrid(distances, SLOPES, LAPSES, indexing="ij")
        threshold, slope, lapse = (each.ravel() for each in grids)
        missed = np.exp(-((distances[:, None] / threshold) ** slope))
        right = 1 - lapse - (1 - guess - lapse) * missed
        # Probabilities of wrong and right answers, by distance and by parameters.
        self._probabilities = np.stack((1 - right, right))
        self._entropies = entr(self._probabilities).sum(axis=0)
        self._log_likelihood = np.zeros(len(threshold))
        self._distances, self.trials, self._done = distances, trials, 0
        self._choose()

    @property
    def progress(self) -> float:
        """Fraction completed, from 0 to 1."""
        return self._done / self.trials

    def update(self, correct: bool | None) -> None:
        """Advance after a trial; `correct` is None if the trial was dropped."""
        self._done += 1
        if correct is not None:
            self._log_likelihood += np.log(self._probabilities[int(correct), self._index])
            self._choose()

    def _choose(self) -> None:
        posterior = np.exp(self._log_likelihood - self._log_likelihood.max())
        posterior /= posterior.sum()
        # The entropy of the parameters falls by the answer's information on them.
        information = entr(self._probabilities @ posterior).sum(0) - self._entropies @ posterior
        # Rounded, so that another order of summation on another machine gives the same choice.
        self._index = int(np.argmax(np.round(information, 9)))
        self.distance = float(self._distances[self._index])


GRID = 31
"""Number of distances, and of thresholds, of QUEST+."""

SLOPES = np.geomspace(0.5, 8.0, 9)
"""Slopes of QUEST+: from flatter to steeper than the usual 1 to 4 (Watson 2017)."""

LAPSES = np.array([0.01, 0.03, 0.05])
"""Lapse rates of QUEST+; above 0, so that one wrong answer excludes nothing."""


class Interleaved:
    """Interleaved adaptive tracks; a random unfinished track has the next trial.

    Each family of pairs has `Procedure.tracks` staircases, or one QUEST+.

    Parameters
    ----------
    protocol : Protocol
    levels : Levels
        Levels of the protocol.

    Attributes
    ----------
    trials : int
        Maximum number of main trials.
    """

    def __init__(self, protocol: Protocol, levels: Levels) -> None:
        task, procedure = TASKS[protocol.task], protocol.procedure
        self._factor, self._span, self._orders = levels.factor, Span(levels), len(task.orders)
        self._tracks: dict[str, tuple[Pair, Staircase | QuestPlus]] = {}
        for pair in easiest(protocol):
            name = family(pair)
            if procedure.kind == "quest_plus":
                quest = QuestPlus(self._span.grid(), task.chance or 0.0, procedure.trials)
                self._tracks[name] = pair, quest
            else:
                for track in range(1, procedure.tracks + 1):
                    self._tracks[f"{name} #{track}"] = pair, Staircase(procedure, self._span)
        self.trials = sum(track.trials for _, track in self._tracks.values())

    @property
    def progress(self) -> float:
        """Fraction completed, from 0 to 1."""
        return sum(track.progress for _, track in self._tracks.values()) / len(self._tracks)

    def choose(self, generator: np.random.Generator) -> Choice | None:
        """Return the next choice; None when all tracks are done."""
        unfinished = [name for name, (_, track) in self._tracks.items() if track.progress < 1]
        if not unfinished:
            return None
        name = unfinished[generator.integers(len(unfinished))]
        pair, track = self._tracks[name]
        level = self._span.level(track.distance)
        settings = {**dict(pair.comparison.settings), self._factor: level}
        chosen = Pair(pair.reference, Condition(tuple(settings.items())), level)
        return Choice(chosen, int(generator.integers(self._orders)), name)

    def record(self, track: str, correct: bool | None) -> None:
        """Advance a track after a trial; `correct` is None if the trial was dropped."""
        self._tracks[track][1].update(correct)


Method: TypeAlias = Constant | Interleaved
"""Procedure in progress for one participant."""


ANSWERING, CHANGING = 3.0, 1.0
"""Time to answer, and to change to the next condition, s (assumed)."""

TRIAL, ORDER = 0, 1
"""Streams of random numbers: of one trial, and of the order of a session."""


class Plan:
    """Trials of a session.

    Random numbers depend only on the seed and the trial's number, and all other state on the
    records: a plan that has processed the records of a log equals the plan of the session that
    wrote them.

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
        Number of trials with practice and catch trials; for staircases, the maximum number.
    attempt : int
        Number of undelivered presentations of the next trial so far.

    Raises
    ------
    ParameterError
        The protocol's procedure or catch trials do not suit its task and levels.
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
        """Completed fraction of the session, from 0 to 1."""
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
        """Return the next trial, which stays the same until recorded; None at the end."""
        return self._planned

    def record(self, record: TrialRecord) -> None:
        """Advance after a trial.

        A trial without an answer, or with a flaw, is repeated up to `Bounds.repeats` times, then
        dropped.

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
