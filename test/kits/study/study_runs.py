# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sessions of a plan without rig, page or log."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from haptic_accel.kits.study.procedures import Plan
from haptic_accel.kits.study.session import SimulatedParticipant
from haptic_accel.kits.study.trials import Answer, PlannedTrial, Screen, TrialRecord

Answerer = Callable[[PlannedTrial], Answer | None]


def record(trial: PlannedTrial, answer: Answer | None, attempt: int = 0) -> TrialRecord:
    """Return the record of a trial; without an answer it has a flaw."""
    flaw = "" if answer else "late = 50 %"
    return TrialRecord(trial, attempt, (), answer, 0, 0, 0, 0, flaw)


def run(plan: Plan, answer: Answerer) -> Iterator[TrialRecord]:
    """Run a session to its end; no answer is a trial that was not delivered."""
    while (trial := plan.next()) is not None:
        made = record(trial, answer(trial), plan.attempt)
        plan.record(made)
        yield made


def asking(participant: SimulatedParticipant) -> Answerer:
    """Return the answers of a simulated participant."""
    return lambda trial: participant.ask(Screen("q", "question"), trial)


def always_right(trial: PlannedTrial) -> Answer:
    """Answer right, or the first where no answer is right."""
    return Answer(trial.right or trial.answers[0], 1.0)
