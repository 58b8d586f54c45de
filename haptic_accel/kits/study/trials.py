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
    """Error: a session was stopped; the message has the reason."""


class UndeliveredError(Exception):
    """Error: a stimulus could not be presented, with the reason; the trial may be repeated."""


@dataclass(frozen=True)
class PlannedTrial:
    """Trial before its presentation.

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
        System times of the first and last sample, ns.
    bag : str
        Bag with the stimulus, relative to the participant's folder; empty without a bag.
    rms, peak : float
        RMS and peak of the measured handle acceleration without hand motion, m/s^2.
    desired_rms : float
        RMS of the desired acceleration, m/s^2.
    error : float or None
        NRMSE, %; None if no vibration was desired.
    clipped, late, lost : float
        Shares of time at the force limit, of time with late forces by the clock, and of missing
        samples, %.
    read_back : mapping
        Settings of the condition, read back from the graph.
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
    """Trial after its presentation: a line of the log.

    Attributes
    ----------
    trial : PlannedTrial
    attempt : int
        Number of earlier, undelivered presentations of the trial.
    presented : tuple of PresentedStimulus
        Stimuli that were presented.
    answer : Answer or None
        Answer; None if the trial was interrupted before its question.
    asked, answered : int
        System times of the trial's start and of the answer's arrival, ns.
    asked_steady, answered_steady : int
        The same times by the steady clock of the machine, ns.
    flaw : str
        Reason why the trial does not count as delivered; empty if it counts.
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
    """Record of a participant's session.

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
        System time of the start, ns.
    records : tuple of TrialRecord
        All attempts in order.
    ended : str
        ``complete``, the reason of a stop, ``running`` while a process runs the session, or empty
        if interrupted.
    exposure : float
        Vibration dose of all sittings, m^2/s^3.
    simulated : bool
        True for a `SimulatedParticipant`, False for a person.
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
        Name of the screen, unique in a session. An answer contains the id, so that repeated or
        late answers are recognised.
    kind : str
        ``consent``, ``instructions``, ``ready``, ``stimulus``, ``question``, ``feedback``,
        ``break``, ``wait``, ``stopped`` or ``end``.
    text : str
    answers : tuple of str
        Admitted answers; empty if no answer is needed.
    progress : float
        Completed fraction of the session, from 0 to 1.
    interval : int
        Number of the present stimulus, from 1; 0 between stimuli.
    seconds : float
        Duration of the screen, or minimum time before an answer, s; 0 for none.
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
        """Present a condition with a fade-in and a fade-out; afterwards the handle is still.

        Parameters
        ----------
        condition : Condition
        seconds : float
            Duration, s.
        begun : callable
            Called once all settings are made, just before the fade-in.

        Raises
        ------
        UndeliveredError
            The condition could not be set or read back, or the graph does not run.
        StoppedError
            An emergency stop is in effect.
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
        """Show a screen that needs no answer.

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
            Trial of the question; only a simulated observer uses it.

        Raises
        ------
        StoppedError
            The participant has pressed stop.
        """
