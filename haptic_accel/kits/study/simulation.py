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

"""Simulated observers and a simulated rig, to try a study and to estimate its power.

Thurstone, "A law of comparative judgment", Psychological Review 34(4), 273-286, 1927; decisions
as in Macmillan, Creelman, "Detection theory: a user's guide", 2nd edition, 2005.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from haptic_accel.core.model import FloatArray
from haptic_accel.kits.study.folder import Study
from haptic_accel.kits.study.log import SESSION, Entries
from haptic_accel.kits.study.plan import Plan
from haptic_accel.kits.study.procedures import DIFFERENT, SAME, distance, labels, written
from haptic_accel.kits.study.protocol import Condition, Protocol
from haptic_accel.kits.study.session import Session
from haptic_accel.kits.study.trials import (
    Answer,
    PlannedTrial,
    PresentedStimulus,
    Screen,
    SessionRecord,
)

OBSERVER, ANSWER = 2, 3
"""Streams of random numbers: of an observer's strengths, and of one answer."""

SCALE_WIDTH = 6.0
"""Standard deviations of a sensation over the scale of a rating."""

SAME_WITHIN = 2**0.5
"""Difference of two sensations up to which they are the same: its standard deviation."""

RESPONSE_TIME = 1.0
"""Median time to an answer, s."""


class SimulatedParticipant:
    """Observer of a protocol, whose answer depends on seed and trial alone.

    A stimulus causes a sensation of standard deviation 1. Its mean is (distance of the level from
    the reference / threshold)^slope with levels, else the strength of the condition. Of two
    intervals, the observer prefers the stronger, and knows whether the comparison is usually the
    stronger or the weaker one. The odd one is that without which two are the most alike, the third
    of ABX equals the nearer one, two within `SAME_WITHIN` are the same, and a condition is
    identified by the nearest strength. Strengths of ratings are mean ratings, and the standard
    deviation is a sixth of the scale; so is the fall of a similarity for a difference of 1.

    Parameters
    ----------
    protocol : Protocol
    seed : int
        Seed of the observer, at least 0.
    """

    noise: float | None = None
    """No noise is heard."""

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
        """See a screen."""

    def ask(self, screen: Screen, trial: PlannedTrial | None = None) -> Answer:
        """Answer by the sensations of a trial; without a trial, by the first answer."""
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
        """Return the label of the condition with the nearest strength, of equal ones any."""
        candidates = (
            (abs(self.strength(condition) - sensation), generator.random(), label)
            for condition, label in labels(self._protocol).items()
        )
        return min(candidates)[2]

    def rated(self, deviations: float) -> str:
        """Return the rating so many standard deviations above the lowest."""
        low, high, step = self._protocol.scale
        value = low + (high - low) * min(max(deviations / SCALE_WIDTH, 0.0), 1.0)
        return written(low + step * round((value - low) / step))


def _strongest(sensations: FloatArray) -> str:
    return str(int(np.argmax(sensations)) + 1)


def _comparison(observer: SimulatedParticipant, felt: FloatArray, trial: PlannedTrial) -> str:
    strengths = dict(zip(trial.answers, map(observer.strength, trial.stimuli), strict=True))
    weaker = strengths[trial.right] < max(strengths.values())
    return _strongest(-felt if weaker else felt)


def _odd(sensations: FloatArray) -> str:
    # Without the odd one, the two others are the most alike.
    return _strongest(-abs(np.roll(sensations, -1) - np.roll(sensations, -2)))


_DECISIONS: Mapping[str, Callable[..., str]] = {
    "2ifc": lambda observer, felt, trial, _: _comparison(observer, felt, trial),
    "odd_one_out": lambda observer, felt, *_: _odd(felt),
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
"""RMS of the simulated acceleration, m/s^2, if the bounds ask for no more: clearly felt."""

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
        # No error; nothing clipped, late or lost.
        return PresentedStimulus(*times, "", rms, rms * 2**0.5, rms, 0.0, 0.0, 0.0, 0.0, settings)

    def stop(self) -> None:
        """Do nothing: there are no forces."""


def simulate_session(protocol: Protocol, log: Entries) -> SessionRecord:
    """Run a session, from where its log ends, with a simulated observer and without delays."""
    begun = log.record
    plan = Plan(protocol, begun.seed, begun.row)
    observer = SimulatedParticipant(protocol, begun.seed)
    rig = SimulatedRig(protocol)
    return Session(protocol, plan, log, rig, observer, sleep=lambda _: None).run()


def simulate_study(protocol: Protocol, participants: int, seed: int) -> list[SessionRecord]:
    """Return the sessions of a study with simulated observers."""
    found = []
    for row, own in enumerate(seeds(participants, seed)):
        log = Entries()
        name = pseudonym(row)
        own_line = {"participant": name, "digest": protocol.digest, "seed": own, "row": row}
        log.add(SESSION, **own_line, simulated=True)
        found.append(simulate_session(protocol, log))
    return found


def write_simulated(study: Study, participants: int, seed: int) -> Iterator[SessionRecord]:
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
        The share, and its 95 % interval (Wilson).
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
