# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Made sessions of studies, for tests of tables, reports and exports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from kits.study.protocol_maker import make_protocol

from haptic_accel.kits.study.protocol import Condition, Pair, Protocol, Value
from haptic_accel.kits.study.trials import (
    CATCH,
    COMPLETE,
    MAIN,
    PRACTICE,
    Answer,
    PlannedTrial,
    PresentedStimulus,
    SessionRecord,
    TrialRecord,
)

SECOND = 1_000_000_000
"""Nanoseconds per second."""

Answering = Callable[[PlannedTrial, np.random.Generator], str]
"""Returns the answer to a trial."""


def condition(**settings: Value) -> Condition:
    """Return a condition."""
    return Condition(tuple(settings.items()))


NONE, MASS, ADAPTIVE = (condition(controller=name) for name in ("none", "mass", "adaptive"))


def protocol(task: str, **changes: Any) -> Protocol:
    """Return a study of controllers."""
    found: dict[str, Any] = {
        "title": "Compensated or not",
        "graph": {"master": "pointer"},
        "factors": {"controller": ("none", "mass", "adaptive")},
        "conditions": (NONE, MASS, ADAPTIVE),
        "pairs": (Pair(NONE, ADAPTIVE), Pair(NONE, MASS)),
        "digest": "0123456789abcdef" * 4,
        "content": "title: Compensated or not\n",
    }
    return make_protocol(task, **found | changes)


def presented(
    begin: int, rng: np.random.Generator, error: float | None = 20.0
) -> PresentedStimulus:
    """Return a stimulus of two seconds."""
    rms = float(rng.uniform(2.0, 3.0))
    strength = {"rms": rms, "peak": 4 * rms, "desired_rms": rms / 0.9, "error": error}
    flaws = {"clipped": 0.0, "late": 0.1, "lost": 0.0}
    end, read_back = begin + 2 * SECOND, {"controller": "adaptive"}
    return PresentedStimulus(begin, end, "bags/start_0", **strength, **flaws, read_back=read_back)


def record(
    trial: PlannedTrial, answer: str, rng: np.random.Generator, **changes: Any
) -> TrialRecord:
    """Return a trial that was run, 10 s after the one before."""
    asked = 10 * SECOND * (trial.number + 1)
    answered = asked + 6 * SECOND
    stimuli = tuple(presented(asked + i * 3 * SECOND, rng) for i in range(len(trial.stimuli)))
    found: dict[str, Any] = {
        "attempt": 0,
        "presented": stimuli,
        "answer": Answer(answer, float(rng.uniform(0.4, 2.0))),
        "asked": asked,
        "answered": answered,
        "asked_steady": asked,
        "answered_steady": answered,
    }
    return TrialRecord(trial, **found | changes)


def session(
    study: Protocol,
    participant: str,
    trials: Sequence[PlannedTrial],
    answer: Answering,
    **changes: Any,
) -> SessionRecord:
    """Return a complete session of planned trials."""
    rng = np.random.default_rng([*participant.encode()])
    records = tuple(record(trial, answer(trial, rng), rng) for trial in trials)
    found: dict[str, Any] = {"seed": 1, "row": 0, "consent": "2026-1", "begun": 5 * SECOND}
    found |= {"ended": COMPLETE, "exposure": 900.0, "records": records}
    return SessionRecord(participant, study.digest, **found | changes)


def practised(trials: Sequence[PlannedTrial]) -> list[PlannedTrial]:
    """Return trials with a practice trial before and two catch trials after them."""
    kinds = [PRACTICE, *[MAIN] * len(trials), CATCH, CATCH]
    numbered = enumerate(zip([trials[0], *trials, trials[0], trials[-1]], kinds, strict=True))
    return [replace(trial, number=place, kind=kind) for place, (trial, kind) in numbered]


def paired(study: Protocol, repeats: int) -> list[PlannedTrial]:
    """Return trials of two intervals, of which the first or second has the comparison."""
    trials = []
    for i, pair in product(range(repeats), study.pairs):
        first = i % 2 == 0
        both = (pair.comparison, pair.reference) if first else (pair.reference, pair.comparison)
        right, track = "1" if first else "2", f"{pair.reference} / {pair.comparison}"
        trials.append(PlannedTrial(len(trials), MAIN, both, ("1", "2"), right, track, pair.level))
    return practised(trials)


def single(study: Protocol, repeats: int) -> list[PlannedTrial]:
    """Return trials with one stimulus, whose name is the right answer."""
    names = tuple(str(each) for each in study.conditions)
    each_once = [((one,), str(one)) for _, one in product(range(repeats), study.conditions)]
    return practised(
        [
            PlannedTrial(number, MAIN, stimuli, names, name, name)
            for number, (stimuli, name) in enumerate(each_once)
        ]
    )


def often_right(share: float) -> Answering:
    """Return answers that are right with a probability, catch trials always."""

    def answer(trial: PlannedTrial, rng: np.random.Generator) -> str:
        wrong = [each for each in trial.answers if each != trial.right]
        certain = trial.kind == CATCH
        return trial.right if certain or rng.uniform() < share else str(rng.choice(wrong))

    return answer
