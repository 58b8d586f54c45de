# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small studies for tests: a protocol, its folder, and participants that follow a script."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

from haptic_accel.kits.study import trials
from haptic_accel.kits.study.folder import PROTOCOL, Study
from haptic_accel.kits.study.log import Log
from haptic_accel.kits.study.procedures import Plan
from haptic_accel.kits.study.protocol import Condition, Protocol
from haptic_accel.kits.study.session import Session, SimulatedParticipant, SimulatedRig

TEXT = """\
title: Compensated or not
task: same_different
question: Were they the same?
instructions: Stroke the surface.
consent: {version: "2026-1", text: I agree to take part.}
factors: {controller: [none, adaptive]}
procedure: {kind: constant, repeats: 12}
extras: {practice: 2, break_every: 5, break_seconds: 1}
timing: {seconds: 0.2, gap: 0.1}
bounds: {error: 40}
strengths: {controller=none: 0, controller=adaptive: 3}
tests:
  - {name: told apart, measure: d_prime, alternative: greater}
"""
"""A study of 2 practice trials and 12 that count, for the page of a laptop."""


def write_study(folder: Path, text: str = TEXT) -> Study:
    """Write and return a study."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / PROTOCOL).write_text(text, encoding="utf-8")
    return Study(folder)


class Scripted:
    """Simulated observer that keeps its screens, and does something else at some of them.

    Parameters
    ----------
    study : Study
    acts : mapping
        By the kind of a screen: called with it; returns an answer, or None for the usual one.
    """

    def __init__(
        self, study: Study, acts: Mapping[str, Callable[[trials.Screen], str | None]] | None = None
    ) -> None:
        self.noise: float | None = None
        self.screens: list[trials.Screen] = []
        self._acts = acts or {}
        self._observer = SimulatedParticipant(study.protocol, 1)

    @property
    def kinds(self) -> list[str]:
        return [screen.kind for screen in self.screens]

    def of(self, kind: str) -> list[trials.Screen]:
        return [screen for screen in self.screens if screen.kind == kind]

    def show(self, screen: trials.Screen) -> None:
        self._see(screen)

    def ask(
        self, screen: trials.Screen, trial: trials.PlannedTrial | None = None
    ) -> trials.Answer:
        given = self._see(screen)
        return self._observer.ask(screen, trial) if given is None else trials.Answer(given, 1.0)

    def _see(self, screen: trials.Screen) -> str | None:
        self.screens.append(screen)
        act = self._acts.get(screen.kind)
        return act(screen) if act else None


Fault: TypeAlias = Exception | Mapping[str, Any]
"""Exception that is raised, or differing fields of `PresentedStimulus`, as ``{"late": 50.0}``."""


class FaultyRig(SimulatedRig):
    """Simulated rig with faults by the number of the presentation since the start, from 0."""

    def __init__(self, protocol: Protocol, faults: Mapping[int, Fault]) -> None:
        super().__init__(protocol)
        self._faults, self._numbers = faults, count()

    def present(
        self, condition: Condition, seconds: float, begun: Callable[[], None] = lambda: None
    ) -> trials.PresentedStimulus:
        fault = self._faults.get(next(self._numbers), {})
        if isinstance(fault, Exception):
            raise fault
        return replace(super().present(condition, seconds, begun), **fault)


def run_session(
    study: Study, log: Log, participant: Scripted | None = None, rig: trials.Rig | None = None
) -> trials.SessionRecord:
    """Run a session without delays, from where its log ends; close the log."""
    with log:
        return make_session(study, log, participant, rig).run()


def make_session(
    study: Study,
    log: Log,
    participant: Scripted | None = None,
    rig: trials.Rig | None = None,
    more_seed: int = 0,
) -> Session:
    """Return a session without delays, from where its log ends; perhaps by another seed."""
    begun = log.record
    protocol = study.version(begun.digest)
    plan = Plan(protocol, begun.seed + more_seed, begun.row)
    rig, participant = rig or SimulatedRig(protocol), participant or Scripted(study)
    return Session(protocol, plan, log, rig, participant, sleep=lambda _: None)
