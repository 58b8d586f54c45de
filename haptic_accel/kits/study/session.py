# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Session of a participant: consent, instructions, trials and breaks, within safety limits.

Every event is in the log before the participant sees the next screen. A session continues from its
log: the trials in the log restore the state of the plan.

Simulated observers and a simulated rig test a study, and estimate its power: Thurstone, "A law of
comparative judgment", Psychological Review 34(4), 273-286, 1927; decisions as in Macmillan,
Creelman, "Detection theory: a user's guide", 2nd edition, 2005.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import binomtest

from haptic_accel import FloatArray, ParameterError, __version__
from haptic_accel.core.parameters import schema
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.kits.study import trials
from haptic_accel.kits.study.exposure import DAY, daily_exposure
from haptic_accel.kits.study.folder import Study
from haptic_accel.kits.study.log import CONSENT, END, SESSION, SITTING, TRIAL, Entries, trial_entry
from haptic_accel.kits.study.procedures import DIFFERENT, SAME, Plan, distance, labels, written
from haptic_accel.kits.study.protocol import Bounds, Condition, Protocol
from haptic_accel.kits.study.trials import Answer, PlannedTrial, PresentedStimulus, Screen

NO_CONSENT = "no consent"
"""Reason of a session's end without the participant's consent."""

AGREE, DISAGREE, CONTINUE, BEGIN = "agree", "disagree", "continue", "begin"
RIGHT, WRONG = "right", "wrong"
"""Answers and texts that the page's languages translate."""

FEEDBACK = 1.0
"""Time for which the feedback is shown, s."""

MOST_BROKEN_OFF = 5
"""Number of successive incomplete trials after which the rig counts as out of order."""


@dataclass
class Session:
    """Session of a participant, from its start or from the end of its log.

    Parameters
    ----------
    protocol : Protocol
    plan : Plan
        Plan of the participant, without any recorded trial.
    log : Log
        Log with the session's first line.
    rig : Rig
    participant : Participant
    watch : callable, optional
        Called before each trial, for the operator.
    sleep : callable, optional
        Waits for a time in s.
    """

    protocol: Protocol
    plan: Plan
    log: Entries
    rig: trials.Rig
    participant: trials.Participant
    watch: Callable[[Session], None] = lambda _: None
    sleep: Callable[[float], None] = time.sleep
    records: list[trials.TrialRecord] = field(default_factory=list)
    _screens: int = 0
    _dose: float = 0.0

    def __post_init__(self) -> None:
        """Advance the plan to the end of the log."""
        session = self.log.record
        try:
            for record in session.records:
                self._take(record)
        except ValueError as error:
            raise ParameterError(
                f"participant {session.participant}: the log is not of this plan: {error}"
            ) from None

    def run(self) -> trials.SessionRecord:
        """Run the session to its end or a stop; return the contents of the log.

        Raises
        ------
        OSError
            The log cannot be written; no acknowledged data are lost.
        """
        reason = ""
        try:
            self.log.add(SITTING, version=__version__)
            self._welcome()
            self._run_trials()
            reason = trials.COMPLETE
        except trials.StoppedError as stopped:
            reason = str(stopped)
        finally:
            self.rig.stop()
            with suppress(trials.StoppedError, trials.UndeliveredError):
                if reason:
                    self.log.add(END, reason=reason, dose=self._new_dose())
                self._show("end" if reason == trials.COMPLETE else "stopped")
        return self.log.record

    @property
    def exposure(self) -> float:
        """Exposure A(8) of the last 24 hours, m/s^2."""
        begin = time.time_ns() - int(DAY * NANOSECONDS)
        return daily_exposure(self.log.dose_since(begin) + self.rig.exposure - self._dose)

    @property
    def minutes(self) -> float:
        """Duration of all trials so far, min."""
        times = (record.answered_steady - record.asked_steady for record in self.records)
        return sum(times) / NANOSECONDS / 60

    @property
    def undelivered(self) -> int:
        """Number of trials that do not count as delivered."""
        return sum(bool(record.flaw) for record in self.records)

    def _welcome(self) -> None:
        """Request consent unless already obtained, and show the instructions."""
        consent = self.protocol.consent
        if not self.log.record.consent:
            answer = self._ask("consent", AGREE, DISAGREE, text=consent.text)
            self.log.add(CONSENT, version=consent.version, agreed=answer == AGREE)
            if answer != AGREE:
                raise trials.StoppedError(NO_CONSENT)
        self._ask("instructions", CONTINUE, text=self.protocol.instructions)

    def _run_trials(self) -> None:
        practice: bool | None = None
        paused = -1  # number of the trial before the last pause
        while (trial := self.plan.next()) is not None:
            if practice is not (practice := trial.kind == trials.PRACTICE):
                self._ask("ready", BEGIN, text=trials.PRACTICE if practice else BEGIN)
                paused = trial.number
            if self.plan.break_due and paused != trial.number:
                paused = trial.number
                self._ask("break", CONTINUE, seconds=self.protocol.extras.break_seconds)
            self._check_limits()
            self.watch(self)
            record = self._run_trial(trial)
            dose, noise = self._new_dose(), self.participant.noise
            self.log.add(TRIAL, **trial_entry(record), dose=dose, noise=noise)
            self._take(record)
            self._respond(record)

    def _check_limits(self) -> None:
        limits = self.protocol.limits
        if self.exposure >= limits.exposure:
            raise trials.StoppedError(
                f"limit of exposure: A(8) has reached {limits.exposure:g} m/s^2"
            )
        if self.minutes >= limits.minutes:
            raise trials.StoppedError(f"limit of time: trials have taken {limits.minutes:g} min")

    def _run_trial(self, trial: trials.PlannedTrial) -> trials.TrialRecord:
        """Present a trial's stimuli, and request the answer."""
        presented: list[trials.PresentedStimulus] = []
        answer, flaw = None, ""
        asked, asked_steady = time.time_ns(), time.monotonic_ns()
        try:
            for interval, condition in enumerate(trial.stimuli, 1):
                presented.append(self._present(interval, condition))
            flaw = ", ".join(self._flaws(trial, presented))
            question = self.protocol.question
            screen = self._screen("question", answers=trial.answers, text=question)
            answer = self.participant.ask(screen, trial)
        except trials.UndeliveredError as error:
            flaw = str(error)
            with suppress(trials.UndeliveredError):  # the page may be lost, too
                self._show("wait")
        times = asked, time.time_ns(), asked_steady, time.monotonic_ns()
        return trials.TrialRecord(trial, self.plan.attempt, tuple(presented), answer, *times, flaw)

    def _present(self, interval: int, condition: Condition) -> trials.PresentedStimulus:
        seconds = self.protocol.timing.seconds
        self._show("wait")
        self.sleep(self.protocol.timing.gap)
        show = partial(self._show, "stimulus", interval=interval, seconds=seconds)
        return self.rig.present(condition, seconds, show)

    def _flaws(
        self, trial: trials.PlannedTrial, presented: list[trials.PresentedStimulus]
    ) -> Iterator[str]:
        """Yield the measures of stimuli that are outside the protocol's bounds."""
        bounds, units = self.protocol.bounds, schema(Bounds)
        for condition, stimulus in zip(trial.stimuli, presented, strict=True):
            settings = {**self.protocol.graph, **dict(condition.settings)}
            outside = {name: getattr(stimulus, name) for name in ("clipped", "late", "lost")}
            if bounds.error and settings.get("controller") != "none":
                outside["error"] = stimulus.error or 0.0
            for name, value in outside.items():
                if not value <= (bound := getattr(bounds, name)):
                    yield f"{name} = {value:.3g}: must be at most {bound:g} {units[name][1].unit}"
            # A gain below 1 reduces the desired vibration, 0 removes it.
            least = bounds.least_rms * float(settings.get("gain", 1.0))
            if not stimulus.desired_rms >= least:
                yield f"desired RMS = {stimulus.desired_rms:.3g}: must be at least {least:g} m/s^2"

    def _take(self, record: trials.TrialRecord) -> None:
        self.records.append(record)
        self.plan.record(record)

    def _respond(self, record: trials.TrialRecord) -> None:
        """Show feedback in practice; after an interrupted trial, wait for the participant."""
        if record.answer is None:
            last = self.records[-MOST_BROKEN_OFF:]
            if len(last) == MOST_BROKEN_OFF and all(each.answer is None for each in last):
                raise trials.StoppedError(f"{MOST_BROKEN_OFF} trials in succession broke off")
            self._ask("ready", BEGIN, text=BEGIN)
            return
        told = record.trial.kind == trials.PRACTICE and self.protocol.extras.feedback
        if told and record.correct is not None:
            self._show("feedback", text=RIGHT if record.correct else WRONG, seconds=FEEDBACK)
            self.sleep(FEEDBACK)

    def _new_dose(self) -> float:
        """Return the dose since the last log line with a dose, m^2/s^3."""
        before, self._dose = self._dose, self.rig.exposure
        return self._dose - before

    def _show(self, kind: str, **content: Any) -> None:
        self.participant.show(self._screen(kind, **content))

    def _ask(self, kind: str, *answers: str, **content: Any) -> str:
        return self.participant.ask(self._screen(kind, answers=answers, **content)).value

    def _screen(self, kind: str, **content: Any) -> trials.Screen:
        """Return a screen with the progress and a unique id."""
        self._screens += 1
        name = f"{len(self.log.entries)}.{self._screens}"
        return trials.Screen(name, kind, progress=self.plan.progress, **content)


OBSERVER, ANSWER = 2, 3
"""Streams of random numbers: of an observer's strengths, and of one answer."""

SCALE_WIDTH = 6.0
"""Width of a rating's scale, in standard deviations of a sensation."""

SAME_WITHIN = 2**0.5
"""Largest difference of two sensations that count as the same: its standard deviation."""

RESPONSE_TIME = 1.0
"""Median time to an answer, s."""


class SimulatedParticipant:
    """Simulated observer, whose answers depend only on seed and trial.

    A stimulus causes a sensation of standard deviation 1. Its mean is (distance of the level from
    the reference / threshold)^slope with levels, else the strength of the condition. Of two
    intervals, the observer prefers the stronger, and knows whether the comparison is usually the
    stronger or the weaker one. The odd one is the stimulus whose removal leaves the two most
    similar ones; the third stimulus of ABX equals the nearer one; two sensations within
    `SAME_WITHIN` are the same; a condition is identified by the nearest strength. Strengths of
    ratings are mean ratings, with a standard deviation of a sixth of the scale, which is also the
    decrease of a similarity for a difference of 1.

    Parameters
    ----------
    protocol : Protocol
    seed : int
        Seed of the observer, at least 0.
    """

    noise: float | None = None
    """Level of the masking noise: none."""

    def __init__(self, protocol: Protocol, seed: int) -> None:
        self._protocol, self._seed = protocol, seed
        generator = np.random.default_rng([seed, 0, OBSERVER])
        own = protocol.observer.spread * generator.standard_normal(len(protocol.conditions) + 1)
        self._threshold = protocol.observer.threshold * np.exp(own[-1])
        low, high, _ = protocol.scale if protocol.task == "rating" else (0.0, SCALE_WIDTH, 0.0)
        unit = (high - low) / SCALE_WIDTH
        self._strengths: dict[Condition, float] = {
            condition: (protocol.strengths.get(str(condition), 0.0) - low) / unit + difference
            for condition, difference in zip(protocol.conditions, own[:-1].tolist(), strict=True)
        }

    def show(self, screen: Screen) -> None:
        """Ignore a screen."""

    def ask(self, screen: Screen, trial: PlannedTrial | None = None) -> Answer:
        """Return the answer from a trial's sensations or, without a trial, the first answer."""
        if trial is None:
            return Answer(next(iter(screen.answers), ""), RESPONSE_TIME)
        generator = np.random.default_rng([self._seed, trial.number, ANSWER])
        seconds = RESPONSE_TIME * generator.lognormal(0.0, 0.3)
        if generator.random() < self._protocol.observer.lapse:
            return Answer(str(generator.choice(trial.answers)), seconds)
        felt = generator.normal([self.strength(each) for each in trial.stimuli])
        return Answer(_DECISIONS[self._protocol.task](self, felt, trial, generator), seconds)

    def strength(self, condition: Condition) -> float:
        """Return the mean sensation of a condition."""
        levels = self._protocol.levels
        if levels is None:
            return self._strengths.get(condition, 0.0)
        thresholds = distance(levels, condition) / self._threshold
        return float(thresholds**self._protocol.observer.slope)

    def identified(self, sensation: float, generator: np.random.Generator) -> str:
        """Return the label of the condition with the nearest strength; ties at random."""
        candidates = (
            (abs(self.strength(condition) - sensation), generator.random(), label)
            for condition, label in labels(self._protocol).items()
        )
        return min(candidates)[2]

    def rated(self, deviations: float) -> str:
        """Return the rating that is `deviations` standard deviations above the lowest."""
        low, high, step = self._protocol.scale
        value = low + (high - low) * min(max(deviations / SCALE_WIDTH, 0.0), 1.0)
        return written(low + step * round((value - low) / step))


def _strongest(sensations: FloatArray) -> str:
    return str(int(np.argmax(sensations)) + 1)


def _comparison(observer: SimulatedParticipant, felt: FloatArray, trial: PlannedTrial) -> str:
    strengths = dict(zip(trial.answers, map(observer.strength, trial.stimuli), strict=True))
    weaker = strengths[trial.right] < max(strengths.values())
    return _strongest(-felt if weaker else felt)


_DECISIONS: Mapping[str, Callable[..., str]] = {
    "2ifc": lambda observer, felt, trial, _: _comparison(observer, felt, trial),
    # Without the odd one, the other two are the most similar.
    "odd_one_out": lambda _, felt, *__: _strongest(-abs(np.roll(felt, -1) - np.roll(felt, -2))),
    "abx": lambda observer, felt, *_: "AB"[int(np.argmin(abs(felt[:2] - felt[2])))],
    "same_different": lambda observer, felt, *_: (
        SAME if abs(felt[0] - felt[1]) <= SAME_WITHIN else DIFFERENT
    ),
    "identification": lambda observer, felt, _, random: observer.identified(felt[0], random),
    "rating": lambda observer, felt, *_: observer.rated(felt[0]),
    "similarity": lambda observer, felt, *_: observer.rated(SCALE_WIDTH - abs(felt[0] - felt[1])),
    "preference": lambda observer, felt, *_: _strongest(felt),
}

RMS = 2.0
"""RMS of the simulated acceleration, m/s^2, unless the bounds require more: clearly
perceptible."""

WEIGHTING = 0.064
"""Factor of hand-arm vibration at 250 Hz: 16 Hz over the frequency (ISO 5349-1, Wh)."""


class SimulatedRig:
    """Simulated rig that delivers each requested stimulus at once.

    Parameters
    ----------
    protocol : Protocol

    Attributes
    ----------
    exposure : float
        Frequency-weighted vibration dose so far, m^2/s^3.
    """

    def __init__(self, protocol: Protocol) -> None:
        self._rms = max(RMS, protocol.bounds.least_rms)
        self.exposure = 0.0

    def present(
        self, condition: Condition, seconds: float, begun: Callable[[], None] = lambda: None
    ) -> PresentedStimulus:
        """Return a stimulus as if it had been delivered."""
        begun()
        self.exposure += (WEIGHTING * self._rms) ** 2 * seconds
        begin, rms, settings = time.time_ns(), self._rms, dict(condition.settings)
        times = begin, begin + round(seconds * 1e9)
        # No error, and no clipped, late or lost samples.
        return PresentedStimulus(*times, "", rms, rms * 2**0.5, rms, 0.0, 0.0, 0.0, 0.0, settings)

    def stop(self) -> None:
        """Do nothing, as a simulated rig has no forces."""


def simulate_session(protocol: Protocol, log: Entries) -> trials.SessionRecord:
    """Run a session from the end of its log, with a simulated observer and without delays."""
    begun = log.record
    plan = Plan(protocol, begun.seed, begun.row)
    observer = SimulatedParticipant(protocol, begun.seed)
    rig = SimulatedRig(protocol)
    return Session(protocol, plan, log, rig, observer, sleep=lambda _: None).run()


def simulate_study(protocol: Protocol, participants: int, seed: int) -> list[trials.SessionRecord]:
    """Return the sessions of a study with simulated observers."""
    found = []
    for row, own in enumerate(seeds(participants, seed)):
        log = Entries()
        name = pseudonym(row)
        own_line = {"participant": name, "digest": protocol.digest, "seed": own, "row": row}
        log.add(SESSION, **own_line, simulated=True)
        found.append(simulate_session(protocol, log))
    return found


def write_simulated(study: Study, participants: int, seed: int) -> Iterator[trials.SessionRecord]:
    """Write sessions of simulated observers to a study's folder, and yield them."""
    for row, own in enumerate(seeds(participants, seed)):
        with study.begin(pseudonym(row), own, simulated=True) as log:
            session = simulate_session(study.protocol, log)
            study.note_end(log)
            yield session


def seeds(participants: int, seed: int) -> list[int]:
    """Return the seeds of a study's participants."""
    return [int(each) for each in np.random.SeedSequence(seed).generate_state(participants)]


def pseudonym(row: int) -> str:
    """Return the pseudonym of a simulated observer.

    Examples
    --------
    >>> pseudonym(0)
    'S01'
    """
    return f"S{row + 1:02d}"


@dataclass(frozen=True)
class Power:
    """Share of simulated studies in which a test was significant.

    Attributes
    ----------
    name : str
        Name of the test.
    share, low, high : float
        Share of significant studies, and its 95 % interval (Wilson).
    """

    name: str
    share: float
    low: float
    high: float


def power(name: str, significant: Iterable[bool]) -> Power:
    """Return the power of a test from its outcomes.

    Examples
    --------
    >>> power("more than chance", [True] * 8 + [False] * 2).share
    0.8
    """
    outcomes = list(significant)
    found = binomtest(sum(outcomes), len(outcomes))
    interval = found.proportion_ci(method="wilson")
    return Power(name, float(found.statistic), float(interval.low), float(interval.high))
