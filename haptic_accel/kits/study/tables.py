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

"""Tidy tables of a study: sessions, trials and stimuli; exclusions by the protocol's rules.

Each column is declared once, with its meaning and unit, for tables, pages and exports. The tables
have no date, which could tell who took part: times count from the start of a session.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from haptic_accel.core.tables import Column, Row
from haptic_accel.kits.study.exposure import daily_exposure
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.trials import (
    CATCH,
    COMPLETE,
    MAIN,
    PresentedStimulus,
    SessionRecord,
    TrialRecord,
)

NANO = 1e-9
"""Seconds per nanosecond."""

COLUMNS = {
    each.key: each
    for each in (
        Column("participant", "pseudonym of the participant"),
        Column("observer", "person, or simulated"),
        Column("version", "start of the digest of the protocol"),
        Column("consent", "version of the consent text that the participant agreed to"),
        Column("order_seed", "seed of the order and of all random choices"),
        Column("row", "row of the Williams square, counted over the participants"),
        Column("ended", "complete, or the reason of a stop; empty if interrupted"),
        Column("main_trials", "main trials that were begun"),
        Column("counted_trials", "main trials that were delivered and answered"),
        Column("left_out_percent", "share of main trials left out", "%", 1),
        Column("catch_correct_percent", "share of correct catch trials", "%", 0),
        Column("exposure_m_s2", "daily vibration exposure A(8) by the session", "m/s^2", 3),
        Column("excluded", "rules by which the participant is excluded; empty if included"),
        Column("trial", "number of the trial in the session, from 0"),
        Column("attempt", "number of earlier attempts at the trial"),
        Column("kind", "practice, main or catch"),
        Column("block", "number of the block, from 0"),
        Column("track", "track, pair or condition, of trials that are analysed together"),
        Column("level", "level of the comparison"),
        Column("stimuli", "conditions in the order of presentation, separated by |"),
        Column("right", "right answer; empty if there is none"),
        Column("answer", "answer of the participant; empty without one"),
        Column("correct", "true for a right answer; empty if none is right"),
        Column("response_time_s", "time from the end of the last stimulus to the answer", "s"),
        Column("asked_s", "start of the trial, from the start of the session", "s"),
        Column("counted", "true for a main trial that was delivered and answered"),
        Column("flaw", "reason for which the trial was not delivered; empty if it was"),
        Column("interval", "place of the stimulus in the trial, from 1"),
        Column("condition", "condition that was asked for"),
        Column("begin_s", "first sample, from the start of the session", "s"),
        Column("duration_s", "time from the first to the last sample", "s"),
        Column("rms_m_s2", "RMS of the handle acceleration without hand motion", "m/s^2", 2),
        Column("peak_m_s2", "peak of the handle acceleration without hand motion", "m/s^2", 2),
        Column("desired_rms_m_s2", "RMS of the desired acceleration", "m/s^2", 2),
        Column("error_percent", "normalized RMS error (NRMSE); empty without a desire", "%", 1),
        Column("clipped_percent", "share of time at the limit of force", "%", 1),
        Column("late_percent", "share of time with a late force", "%", 1),
        Column("lost_percent", "share of missing samples", "%", 1),
        Column("read_back", "settings of the condition as the graph had them, JSON"),
        Column("bag", "bag with the stimulus; empty without one"),
    )
}
"""Meaning and unit of each column, by name."""

MEASURED = (
    *("rms_m_s2", "desired_rms_m_s2", "error_percent", "late_percent"),
    *("clipped_percent", "lost_percent", "peak_m_s2"),
)
"""Columns that were measured of a stimulus."""

SIMULATED, PERSON = "simulated", "person"
"""Kinds of observers, in the column `observer`."""

_PERCENT = 100.0


@dataclass(frozen=True)
class Tables:
    """Tidy tables by name, with all attempts of all participants.

    Attributes
    ----------
    sessions, trials, stimuli : DataFrame
    columns : dict of Column
        Meaning and unit of each column by name, with the factors of the study.
    """

    sessions: pd.DataFrame
    trials: pd.DataFrame
    stimuli: pd.DataFrame
    columns: dict[str, Column]

    @property
    def by_name(self) -> dict[str, pd.DataFrame]:
        """Return the tables that have rows."""
        frames = {"sessions": self.sessions, "trials": self.trials, "stimuli": self.stimuli}
        return {name: frame for name, frame in frames.items() if len(frame)}


def titled(
    protocol: Protocol, sessions: Sequence[SessionRecord] = (), *, simulated: bool = False
) -> Protocol:
    """Return a protocol whose title says that observers are simulated, if any is."""
    if not (simulated or any(each.simulated for each in sessions)):
        return protocol
    return replace(protocol, title=f"{protocol.title} (simulated observers)")


def observer(session: SessionRecord) -> str:
    """Return the kind of the observer of a session."""
    return SIMULATED if session.simulated else PERSON


def tables(protocol: Protocol, sessions: Sequence[SessionRecord]) -> Tables:
    """Return the tables of a study."""
    excluded = exclusions(protocol, sessions)
    attempts = [(session, record) for session in sessions for record in session.records]
    stimuli = [
        _stimulus(*attempt, interval, presented)
        for attempt in attempts
        for interval, presented in enumerate(attempt[1].presented, 1)
    ]
    frames = (
        pd.DataFrame([_session(each, excluded) for each in sessions]),
        pd.DataFrame([_trial(*attempt) for attempt in attempts]),
        pd.DataFrame(stimuli),
    )
    names = [name for frame in frames for name in frame.columns]
    factors = {name: Column(name, f"setting of the factor {name}") for name in names}
    return Tables(*frames, factors | {name: COLUMNS[name] for name in names if name in COLUMNS})


def exclusions(protocol: Protocol, sessions: Sequence[SessionRecord]) -> dict[str, str]:
    """Return the broken rules by participant, for those who are excluded from the analysis."""
    broken = {each.participant: "; ".join(_broken(protocol, each)) for each in sessions}
    return {participant: rules for participant, rules in broken.items() if rules}


def _broken(protocol: Protocol, session: SessionRecord) -> Iterator[str]:
    rules = protocol.rules
    catch, left = catch_correct(session), left_out(session)
    if session.digest != protocol.digest:
        yield f"version {session.digest[:8]} of the protocol, not {protocol.digest[:8]}"
    if session.ended != COMPLETE:
        yield f"session not complete ({session.ended or 'interrupted'})"
    if catch < rules.catch_correct:
        yield f"{catch:.0f} % of catch trials correct, less than {rules.catch_correct:g} %"
    if left > rules.left_out:
        yield f"{left:.0f} % of trials left out, more than {rules.left_out:g} %"


def catch_correct(session: SessionRecord) -> float:
    """Return the share of right answers to delivered catch trials, %; NaN without any."""
    found = [r.correct for r in session.records if r.trial.kind == CATCH and not r.flaw]
    answered = [correct for correct in found if correct is not None]
    return _PERCENT * sum(answered) / len(answered) if answered else math.nan


def left_out(session: SessionRecord) -> float:
    """Return the share of main trials without an answer to delivered stimuli, %."""
    begun, counted = _main(session), len(session.counted)
    return _PERCENT * (1 - counted / begun) if begun else 0.0


def _main(session: SessionRecord) -> int:
    return len({each.trial.number for each in session.records if each.trial.kind == MAIN})


def _session(session: SessionRecord, excluded: dict[str, str]) -> Row:
    return {
        "participant": session.participant,
        "observer": observer(session),
        "version": session.digest[:8],
        "consent": session.consent,
        "order_seed": session.seed,
        "row": session.row,
        "ended": session.ended,
        "main_trials": _main(session),
        "counted_trials": len(session.counted),
        "left_out_percent": left_out(session),
        "catch_correct_percent": catch_correct(session),
        "exposure_m_s2": daily_exposure(session.exposure),
        "excluded": excluded.get(session.participant, ""),
    }


def _trial(session: SessionRecord, record: TrialRecord) -> Row:
    trial, answer = record.trial, record.answer
    return {
        "participant": session.participant,
        "observer": observer(session),
        "trial": trial.number,
        "attempt": record.attempt,
        "kind": trial.kind,
        "block": trial.block,
        "track": trial.track,
        "level": trial.level,
        "stimuli": " | ".join(str(each) for each in trial.stimuli),
        "right": trial.right,
        "answer": answer.value if answer else "",
        "correct": record.correct,
        "response_time_s": answer.response_time if answer else None,
        "asked_s": (record.asked - session.begun) * NANO,
        "counted": trial.kind == MAIN and answer is not None and not record.flaw,
        "flaw": record.flaw,
    }


def _stimulus(
    session: SessionRecord, record: TrialRecord, interval: int, presented: PresentedStimulus
) -> Row:
    condition = record.trial.stimuli[interval - 1]
    return {
        "participant": session.participant,
        "observer": observer(session),
        "trial": record.trial.number,
        "attempt": record.attempt,
        "interval": interval,
        "condition": str(condition),
        **dict(condition.settings),
        "begin_s": (presented.begin - session.begun) * NANO,
        "duration_s": (presented.end - presented.begin) * NANO,
        **{name: getattr(presented, _attribute(name)) for name in MEASURED},
        "read_back": json.dumps(dict(presented.read_back)),
        "bag": presented.bag,
    }


def _attribute(column: str) -> str:
    """Return the attribute of `PresentedStimulus` that a column has."""
    return column.removesuffix("_m_s2").removesuffix("_percent")
