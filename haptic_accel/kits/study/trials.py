# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of a session, and the interfaces of the rig and of the participant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol as Interface

from haptic_accel.kits.study.protocol import Condition

PRACTICE, MAIN, CATCH = "practice", "main", "catch"
"""Kinds of trials."""

COMPLETE = "complete"
"""End of a session in which all trials were run."""


class StoppedError(Exception):
    """A session was stopped; the message states by whom or why."""


class UndeliveredError(Exception):
    """A stimulus could not be presented; the message states why. The trial may be repeated."""


@dataclass(frozen=True)
class PlannedTrial:
    """A trial before it is presented.

    Attributes
    ----------
    number : int
        Number in the session, from 0.
    kind : str
        `PRACTICE`, `MAIN` or `CATCH`.
    stimuli : tuple of Condition
        Conditions in the order of presentation.
    answers : tuple of str
        Admitted answers.
    right : str
        Right answer; empty if there is none.
    track : str
        Track of a staircase, or the pair or condition, under which trials are analysed together.
    level : float or None
        Level of the comparison.
    block : int
        Number of the block, from 0.
    """

    number: int
    kind: str
    stimuli: tuple[Condition, ...]
    answers: tuple[str, ...]
    right: str = ""
    track: str = ""
    level: float | None = None
    block: int = 0


@dataclass(frozen=True)
class PresentedStimulus:
    """Stimulus as it was delivered.

    Attributes
    ----------
    begin, end : int
        System time of its first and last sample, ns.
    bag : str
        Bag that has it, relative to the participant's folder; empty without one.
    rms, peak : float
        Of the measured handle acceleration without hand motion, m/s^2.
    desired_rms : float
        RMS of the desired acceleration, m/s^2.
    error : float or None
        NRMSE, %; None where nothing was desired.
    clipped, late, lost : float
        Shares of time at the limit of force, of time with a late force by the clock, and of
        missing samples, %.
    read_back : mapping
        Settings of the condition as the graph has them.
    """

    begin: int
    end: int
    bag: str
    rms: float
    peak: float
    desired_rms: float
    error: float | None
    clipped: float
    late: float
    lost: float
    read_back: Mapping[str, str | float]


@dataclass(frozen=True)
class Answer:
    """Answer of a participant.

    Attributes
    ----------
    value : str
    response_time : float
        Time from the end of the last stimulus to the answer, s, by the page's clock.
    """

    value: str
    response_time: float


@dataclass(frozen=True)
class TrialRecord:
    """A trial as it was run: a line of the log.

    Attributes
    ----------
    trial : PlannedTrial
    attempt : int
        Number of earlier presentations of the trial, which were not delivered.
    presented : tuple of PresentedStimulus
        Stimuli, as far as they were presented.
    answer : Answer or None
        None if the trial was broken off before its question.
    asked, answered : int
        System times of the trial's start and of the answer's arrival, ns.
    asked_steady, answered_steady : int
        The same times by the steady clock of the machine, ns.
    flaw : str
        Reason for which the stimulus does not count as delivered; empty if the trial counts.
    """

    trial: PlannedTrial
    attempt: int
    presented: tuple[PresentedStimulus, ...]
    answer: Answer | None
    asked: int
    answered: int
    asked_steady: int
    answered_steady: int
    flaw: str = ""

    @property
    def correct(self) -> bool | None:
        """True for a right answer; None without an answer, or if no answer is right."""
        if self.answer is None or not self.trial.right:
            return None
        return self.answer.value == self.trial.right


@dataclass(frozen=True)
class SessionRecord:
    """All that a participant did.

    Attributes
    ----------
    participant : str
        Pseudonym.
    digest : str
        Version of the protocol.
    seed : int
        Seed of the order and of all random choices.
    row : int
        Row of the Williams square, counted over the participants.
    consent : str
        Version of the text that the participant agreed to.
    begun : int
        System time, ns.
    records : tuple of TrialRecord
        All attempts in order.
    ended : str
        ``complete``, the reason of a stop, ``running`` while a process runs it, or empty if
        interrupted.
    exposure : float
        Vibration dose of all sittings, m^2/s^3.
    simulated : bool
        True if a `SimulatedParticipant` took part, and no person.
    """

    participant: str
    digest: str
    seed: int
    row: int
    consent: str
    begun: int
    records: tuple[TrialRecord, ...]
    ended: str = ""
    exposure: float = 0.0
    simulated: bool = False

    @property
    def counted(self) -> tuple[TrialRecord, ...]:
        """Main trials that were delivered and answered."""
        return tuple(
            each
            for each in self.records
            if each.trial.kind == MAIN and each.answer is not None and not each.flaw
        )


@dataclass(frozen=True)
class Screen:
    """Content of the participant's page.

    Attributes
    ----------
    id : str
        Name of this screen, unique in a session; an answer carries it, so that a repeated or late
        answer is recognised.
    kind : str
        ``consent``, ``instructions``, ``ready``, ``stimulus``, ``question``, ``feedback``,
        ``break``, ``wait``, ``stopped`` or ``end``.
    text : str
    answers : tuple of str
        Admitted answers; empty where none is asked for.
    progress : float
        Share of the session that is done, from 0 to 1.
    interval : int
        Number of the present stimulus, from 1; 0 outside.
    seconds : float
        Time that the screen lasts, or that must pass before it can be left, s; 0 for none.
    """

    id: str
    kind: str
    text: str = ""
    answers: tuple[str, ...] = ()
    progress: float = 0.0
    interval: int = 0
    seconds: float = 0.0


class Rig(Interface):
    """Interface of the rig that presents stimuli: the live graph, or a simulation."""

    @property
    def exposure(self) -> float:
        """Frequency-weighted vibration dose of this session so far, m^2/s^3 (integral of a^2)."""

    def present(
        self, condition: Condition, seconds: float, begun: Callable[[], None] = lambda: None
    ) -> PresentedStimulus:
        """Present a condition with a faded beginning and end; afterwards the handle is still.

        Parameters
        ----------
        condition : Condition
        seconds : float
            Duration, s.
        begun : callable
            Called when all is set, just before the stimulus is faded in.

        Raises
        ------
        UndeliveredError
            The condition could not be set or read back, or the graph was not there.
        StoppedError
            An emergency stop holds.
        """

    def stop(self) -> None:
        """Set all forces to zero."""


class Participant(Interface):
    """Interface of the participant: a person at a page, or a simulated observer.

    Attributes
    ----------
    noise : float or None
        Level of the masking noise that played during the last stimulus, dB of full scale; None
        without noise.
    """

    noise: float | None

    def show(self, screen: Screen) -> None:
        """Show a screen that is not answered.

        Raises
        ------
        StoppedError
            The participant has pressed stop.
        UndeliveredError
            The page was lost during the stimulus before.
        """

    def ask(self, screen: Screen, trial: PlannedTrial | None = None) -> Answer:
        """Show a screen, and wait for one of its answers.

        Parameters
        ----------
        screen : Screen
        trial : PlannedTrial, optional
            Trial of the question, from which only a simulated observer knows the stimuli.

        Raises
        ------
        StoppedError
            The participant has pressed stop.
        """
