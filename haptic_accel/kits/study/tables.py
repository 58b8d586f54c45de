# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tidy tables of a study: sessions, trials and stimuli; exclusions by its rules, and exports.

Each column is declared once, with its meaning and unit, for tables, pages and exports. The tables
have no dates, which could reveal participants: times count from the start of a session.

Exports are CSV, Psych-DS (https://psychds-docs.readthedocs.io: tidy CSV files below ``data``, and
one data dictionary) and BIDS 1.10 (https://bids-specification.readthedocs.io: the sessions as
participants, trials as ``_beh.tsv`` and stimuli as ``_events.tsv`` of each).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

import haptic_accel
from haptic_accel import ParameterError
from haptic_accel.analysis import csv_text
from haptic_accel.commands import Column, Row
from haptic_accel.kits.study import trials as records
from haptic_accel.kits.study.exposure import daily_exposure
from haptic_accel.kits.study.protocol import Protocol

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
"""Columns with measures of a stimulus."""

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
    protocol: Protocol, sessions: Sequence[records.SessionRecord] = (), *, simulated: bool = False
) -> Protocol:
    """Return a protocol whose title mentions simulated observers, if there are any."""
    if not (simulated or any(each.simulated for each in sessions)):
        return protocol
    return replace(protocol, title=f"{protocol.title} (simulated observers)")


def observer(session: records.SessionRecord) -> str:
    """Return the kind of the observer of a session."""
    return SIMULATED if session.simulated else PERSON


def tables(protocol: Protocol, sessions: Sequence[records.SessionRecord]) -> Tables:
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


def exclusions(protocol: Protocol, sessions: Sequence[records.SessionRecord]) -> dict[str, str]:
    """Return the broken rules by participant, for those who are excluded from the analysis."""
    broken = {each.participant: "; ".join(_broken(protocol, each)) for each in sessions}
    return {participant: rules for participant, rules in broken.items() if rules}


def _broken(protocol: Protocol, session: records.SessionRecord) -> Iterator[str]:
    rules = protocol.rules
    catch, left = catch_correct(session), left_out(session)
    if session.digest != protocol.digest:
        yield f"version {session.digest[:8]} of the protocol, not {protocol.digest[:8]}"
    if session.ended != records.COMPLETE:
        yield f"session not complete ({session.ended or 'interrupted'})"
    if catch < rules.catch_correct:
        yield f"{catch:.0f} % of catch trials correct, less than {rules.catch_correct:g} %"
    if left > rules.left_out:
        yield f"{left:.0f} % of trials left out, more than {rules.left_out:g} %"


def catch_correct(session: records.SessionRecord) -> float:
    """Return the share of right answers to delivered catch trials, %; NaN without any."""
    found = [r.correct for r in session.records if r.trial.kind == records.CATCH and not r.flaw]
    answered = [correct for correct in found if correct is not None]
    return _PERCENT * sum(answered) / len(answered) if answered else math.nan


def left_out(session: records.SessionRecord) -> float:
    """Return the share of main trials without an answer to delivered stimuli, %."""
    begun, counted = _main(session), len(session.counted)
    return _PERCENT * (1 - counted / begun) if begun else 0.0


def _main(session: records.SessionRecord) -> int:
    return len({each.trial.number for each in session.records if each.trial.kind == records.MAIN})


def _session(session: records.SessionRecord, excluded: dict[str, str]) -> Row:
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


def _trial(session: records.SessionRecord, record: records.TrialRecord) -> Row:
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
        "counted": trial.kind == records.MAIN and answer is not None and not record.flaw,
        "flaw": record.flaw,
    }


def _stimulus(
    session: records.SessionRecord,
    record: records.TrialRecord,
    interval: int,
    presented: records.PresentedStimulus,
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


Files: TypeAlias = dict[str, str]
"""Texts of files by path in the exported folder."""

BIDS_VERSION = "1.10.0"

_FIRST = ("begin_s", "duration_s", "participant")
_BIDS_NAMES = {"begin_s": "onset", "duration_s": "duration", "participant": "participant_id"}


def export_study(
    protocol: Protocol,
    sessions: Sequence[records.SessionRecord],
    folder: Path,
    form: str,
    *,
    unblinded: bool,
) -> None:
    """Write the tables of a study, with all participants and without dates, to a new folder.

    Parameters
    ----------
    protocol : Protocol
    sessions : sequence of SessionRecord
    folder : Path
        New or empty folder.
    form : str
        One of `FORMS`.
    unblinded : bool
        False if conditions are sealed.

    Raises
    ------
    ParameterError
        Conditions are sealed, the folder is not empty, no trial was started, the form is unknown,
        or the form gives two participants the same label.
    """
    if not unblinded:
        raise ParameterError(f"{protocol.title}: conditions are sealed; unblind the study first")
    if form not in FORMS:
        raise ParameterError(f"form {form!r}: must be one of {', '.join(FORMS)}")
    begun = [session for session in sessions if session.records]
    if not begun:
        raise ParameterError(f"{protocol.title}: no participant has begun a trial")
    if folder.exists() and any(folder.iterdir()):
        raise ParameterError(f"{folder}: must be a new or empty folder")
    named = titled(protocol, begun)
    for name, text in FORMS[form](named, tables(protocol, begun)).items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8", errors="backslashreplace")


def _csv(protocol: Protocol, found: Tables) -> Files:
    columns = [
        {"column": c.key, "meaning": c.label, "unit": c.unit} for c in found.columns.values()
    ]
    frames = found.by_name | {"columns": pd.DataFrame(columns)}
    files = {f"{name}.csv": csv_text(frame) for name, frame in frames.items()}
    return files | {"study.yaml": protocol.content}


def _psych_ds(protocol: Protocol, found: Tables) -> Files:
    description = {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": protocol.title,
        "description": _summary(protocol),
        "variableMeasured": [
            {"@type": "PropertyValue", "name": c.key, "description": c.label, "unitText": c.unit}
            for c in found.columns.values()
        ],
    }
    data = {f"data/description-{name}_data.csv": table for name, table in found.by_name.items()}
    return {
        "dataset_description.json": _json(description),
        "README.md": _readme(protocol, found),
        "CHANGES.md": _changes(),
        "materials/study.yaml": protocol.content,
        **{name: csv_text(frame) for name, frame in data.items()},
    }


def _bids(protocol: Protocol, found: Tables) -> Files:
    task = _alphanumeric(protocol.task)
    labels = _labels([str(each) for each in found.sessions["participant"]])
    description = {
        "Name": protocol.title,
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "haptic_accel", "Version": haptic_accel.__version__}],
    }
    files = {
        "dataset_description.json": _json(description),
        "README.md": _readme(protocol, found),
        "CHANGES": _changes(),
        "code/study.yaml": protocol.content,
        "participants.tsv": _tsv(found.sessions.replace({"participant": labels})),
        "participants.json": _json(_sidecar(found, found.sessions)),
    }
    named = {"TaskName": protocol.task, "Instructions": protocol.instructions}
    for suffix, name in (("beh", "trials"), ("events", "stimuli")):
        frame = found.by_name.get(name, pd.DataFrame({"participant": []}))
        files[f"task-{task}_{suffix}.json"] = _json(named | _sidecar(found, frame))
        for participant, rows in frame.groupby("participant", sort=False):
            person = labels[str(participant)]
            files[f"{person}/beh/{person}_task-{task}_{suffix}.tsv"] = _tsv(rows)
    return files


FORMS: Mapping[str, Callable[[Protocol, Tables], Files]] = {
    "csv": _csv,
    "psych-ds": _psych_ds,
    "bids": _bids,
}
"""Functions that return the files of each form."""


def _tsv(frame: pd.DataFrame) -> str:
    """Return a table in BIDS form: times of events first, n/a for unknown values."""
    first = [name for name in _FIRST if name in frame]
    ordered = frame[[*first, *frame.columns.drop(first)]].rename(columns=_BIDS_NAMES)
    return csv_text(ordered.astype(object).map(_cell), "\t", "n/a")


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return " ".join(value.split()) or None
    return str(value).lower() if isinstance(value, bool) else value


def _sidecar(found: Tables, frame: pd.DataFrame) -> dict[str, Any]:
    """Return the meaning and unit of each column of a table."""
    columns = {_BIDS_NAMES.get(name, name): found.columns[name] for name in frame.columns}
    units = {
        name: {"Units": column.unit} if column.unit else {} for name, column in columns.items()
    }
    return {name: {"Description": each.label} | units[name] for name, each in columns.items()}


def _labels(participants: Sequence[str]) -> dict[str, str]:
    """Return the labels of participants, which may have only letters and digits."""
    labels = {each: f"sub-{_alphanumeric(each)}" for each in participants}
    for label in labels.values():
        same = [each for each, own in labels.items() if own == label]
        if len(same) > 1:
            raise ParameterError(f"participants {' and '.join(same)}: both are {label} in BIDS")
    return labels


def _alphanumeric(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", text)


def _json(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _summary(protocol: Protocol) -> str:
    return (
        f"Study of haptic display of tool contact. Task: {protocol.task}. Question:"
        f" {protocol.question} Version of the protocol: {protocol.digest[:8]}."
    )


def _readme(protocol: Protocol, found: Tables) -> str:
    excluded = int((found.sessions["excluded"] != "").sum())
    return f"""# {_literal(protocol.title)}

{_literal(_summary(protocol))}

{len(found.sessions)} participants, of whom {excluded} are excluded by the rules of the protocol:
the tables have them, too, with the reason. Participants have pseudonyms; times count from the
start of a session. Handle accelerations were measured during each stimulus. The protocol is
study.yaml.

Instructions to the participants:

{_paragraphs(protocol.instructions)}
"""


def _paragraphs(text: str) -> str:
    """Return the paragraphs of a text, each in one line without markup."""
    return "\n\n".join(_literal(each) for each in re.split(r"\n\s*\n", text.strip()))


def _literal(text: str) -> str:
    """Return a text in one line, escaped so that Markdown shows it literally."""
    line = re.sub(r"[\\`*_\[\]<>&#~|]", r"\\\g<0>", " ".join(text.split()))
    return re.sub(r"^(\d*)([-+=.)])", r"\1\\\2", line)


def _changes() -> str:
    software = f"haptic_accel {haptic_accel.__version__}"
    return f"1.0.0 {date.today().isoformat()}\n  - Exported by {software}.\n"
