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

"""Export of a study's tables as CSV, Psych-DS or BIDS.

Psych-DS (https://psychds-docs.readthedocs.io): tidy CSV files below ``data``, and one data
dictionary. BIDS 1.10 (https://bids-specification.readthedocs.io): the sessions as participants,
trials as ``_beh.tsv`` and stimuli as ``_events.tsv`` of each.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

import haptic_accel
from haptic_accel.analysis.frames import csv_text
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.tables import Tables, tables, titled
from haptic_accel.kits.study.trials import SessionRecord

Files: TypeAlias = dict[str, str]
"""Texts of files by path in the exported folder."""

BIDS_VERSION = "1.10.0"

_FIRST = ("begin_s", "duration_s", "participant")
_BIDS_NAMES = {"begin_s": "onset", "duration_s": "duration", "participant": "participant_id"}


def export_study(
    protocol: Protocol,
    sessions: Sequence[SessionRecord],
    folder: Path,
    form: str,
    *,
    unblinded: bool,
) -> None:
    """Write the tables of a study, with all who began and without dates, to a new folder.

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
        Conditions are sealed, the folder is not empty, no trial was begun, the form is unknown,
        or two participants cannot be told apart in it.
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
    """Return a table as BIDS has them: the times of events first, n/a for unknown values."""
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
    """Return the labels of participants, which may have letters and digits alone."""
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
    """Return a text in one line, which Markdown shows as it is, without markup, HTML or links."""
    line = re.sub(r"[\\`*_\[\]<>&#~|]", r"\\\g<0>", " ".join(text.split()))
    return re.sub(r"^(\d*)([-+=.)])", r"\1\\\2", line)


def _changes() -> str:
    software = f"haptic_accel {haptic_accel.__version__}"
    return f"1.0.0 {date.today().isoformat()}\n  - Exported by {software}.\n"
