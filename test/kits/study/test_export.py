# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Export of a study, checked by the rules of its forms and by their own validators."""

from __future__ import annotations

import csv
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from kits.study.study_sessions import condition, often_right, paired, protocol, session, single
from markdown_it import MarkdownIt

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.tables import FORMS, export_study
from haptic_accel.kits.study.trials import SessionRecord

VALIDATORS = Path(__file__).resolve().parents[3] / ".validators"
"""Folder into which ``.ci/run`` installs the validators."""

BIDS_VALIDATOR = VALIDATORS / "bin/bids-validator-deno"
PSYCH_DS_VALIDATOR = VALIDATORS / "node_modules/.bin/validate"

STUDY = protocol("odd_one_out")


def sessions(study: Protocol = STUDY) -> list[SessionRecord]:
    trials = paired(study, 5) if study.pairs else single(study, 5)
    found = [session(study, name, trials, often_right(0.8)) for name in ("P01", "P02", "P-03")]
    stopped = 'stopped:\tthe participant\nwas tired, "very"'
    return [*found[:2], replace(found[2], ended=stopped)]


def export(form: str, folder: Path, study: Protocol = STUDY) -> Path:
    export_study(study, sessions(study), folder / "out", form, unblinded=True)
    return folder / "out"


def rows(file: Path, separator: str = ",") -> list[dict[str, str]]:
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines, delimiter=separator))


def read_json(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


@pytest.mark.parametrize("form", FORMS)
def test_a_sealed_study_is_not_exported(form: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="sealed; unblind the study first") as error:
        export_study(STUDY, sessions(), tmp_path / "out", form, unblinded=False)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_folder_with_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes").touch()
    with pytest.raises(ParameterError, match="must be a new or empty folder"):
        export_study(STUDY, sessions(), tmp_path, "csv", unblinded=True)


def test_an_unknown_form_and_a_study_without_sessions_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="form 'spss': must be one of csv, psych-ds, bids"):
        export_study(STUDY, sessions(), tmp_path, "spss", unblinded=True)
    with pytest.raises(ParameterError, match="no participant has begun"):
        export_study(STUDY, [], tmp_path, "csv", unblinded=True)


def test_csv_has_the_tables_with_their_columns_and_the_protocol(tmp_path: Path) -> None:
    out = export("csv", tmp_path)
    trials = pd.read_csv(out / "trials.csv")
    assert len(trials) == 3 * 13
    assert set(trials.participant) == {"P01", "P02", "P-03"}
    meanings = {row["column"]: row["unit"] for row in rows(out / "columns.csv")}
    assert set(trials.columns) < set(meanings)
    assert meanings["rms_m_s2"] == "m/s^2"
    assert (out / "study.yaml").read_text() == STUDY.content


@pytest.mark.parametrize("form", FORMS)
def test_no_export_has_a_date_of_a_session(form: str, tmp_path: Path) -> None:
    out = export(form, tmp_path)
    texts = [file.read_text(encoding="utf-8") for file in out.rglob("*") if file.is_file()]
    begun = sessions()[0].records[0].asked
    assert not any(str(begun) in text for text in texts)


def test_psych_ds_follows_the_published_rules(tmp_path: Path) -> None:
    """Keyword names, the required metadata, and each column in variableMeasured and back."""
    out = export("psych-ds", tmp_path)
    description = read_json(out / "dataset_description.json")
    assert description["@type"] == "Dataset"
    assert description["@context"] in {"https://schema.org/", "http://schema.org/"}
    assert {"name", "description", "variableMeasured"} <= set(description)
    measured = [each["name"] for each in description["variableMeasured"]]
    assert len(set(measured)) == len(measured)
    files = list((out / "data").rglob("*.csv"))
    legal = r"([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv"
    assert len(files) == 3
    assert all(re.fullmatch(legal, file.name) for file in files)
    assert {name for file in files for name in rows(file)[0]} == set(measured)
    assert (out / "README.md").is_file()
    assert (out / "CHANGES.md").is_file()


def test_bids_has_a_folder_for_each_participant(tmp_path: Path) -> None:
    out = export("bids", tmp_path)
    people = rows(out / "participants.tsv", "\t")
    assert [row["participant_id"] for row in people] == ["sub-P01", "sub-P02", "sub-P03"]
    assert people[2]["ended"] == 'stopped: the participant was tired, "very"'
    assert people[0]["excluded"] == "n/a"
    events = rows(out / "sub-P01/beh/sub-P01_task-oddoneout_events.tsv", "\t")
    assert list(events[0])[:2] == ["onset", "duration"]
    assert (float(events[0]["onset"]), float(events[0]["duration"])) == (5.0, 2.0)
    trials = rows(out / "sub-P01/beh/sub-P01_task-oddoneout_beh.tsv", "\t")
    assert len(trials) == 13
    assert {row["correct"] for row in trials} <= {"true", "false"}
    assert {row["level"] for row in trials} == {"n/a"}
    for suffix, row in (("beh", trials[0]), ("events", events[0])):
        assert set(row) <= set(read_json(out / f"task-oddoneout_{suffix}.json"))


@pytest.mark.parametrize("form", FORMS)
def test_no_cell_of_an_export_is_a_formula(form: str, tmp_path: Path) -> None:
    found = [replace(each, ended="=cmd|' /C calc'!A0", consent="@1") for each in sessions()]
    flawed = replace(found[0].records[0], flaw="-2+3")
    found[0] = replace(found[0], records=(flawed, *found[0].records[1:]))
    export_study(STUDY, found, tmp_path / "out", form, unblinded=True)
    cells = [
        cell
        for suffix, separator in ((".csv", ","), (".tsv", "\t"))
        for file in (tmp_path / "out").rglob(f"*{suffix}")
        for row in rows(file, separator)
        for cell in row.values()
    ]
    assert {"'=cmd|' /C calc'!A0", "'@1", "'-2+3"} <= set(cells)
    assert not [each for each in cells if each[:1] in ("=", "@", "+")]


@given(
    st.text(st.sampled_from("<script>&;*_`[]()!#-+=1. \n\t~|\\ax:'\"{}$^"), max_size=40),
    st.sampled_from(["psych-ds", "bids"]),
)
@example("<script>alert(1)</script>", "psych-ds")
@example('![x](javascript:alert(1)) <img src="x" onerror="y">', "bids")
def test_a_readme_shows_texts_as_they_are(text: str, form: str) -> None:
    words = text.split() or ["text"]
    study = replace(STUDY, title=" ".join(words), instructions=text)
    with TemporaryDirectory() as folder:
        export_study(study, sessions(study), Path(folder) / "out", form, unblinded=True)
        readme = (Path(folder) / "out" / "README.md").read_text(encoding="utf-8")
    heading, *others = MarkdownIt("commonmark", {"html": True}).parse(readme)
    inline = [token for token in (heading, *others) if token.type == "inline"]
    kinds = {child.type for token in inline for child in token.children or ()}
    assert kinds <= {"text", "text_special", "softbreak"}
    kinds = {token.type.partition("_")[0] for token in (heading, *others)}
    assert kinds <= {"heading", "paragraph", "inline"}
    shown = ["".join(each.content or " " for each in token.children or ()) for token in inline]
    assert shown[0].split() == words
    after = shown[shown.index("Instructions to the participants:") + 1 :]
    assert " ".join(after).split() == text.split()


@pytest.mark.parametrize("form", FORMS)
def test_trials_without_stimuli_and_people_without_trials_can_be_exported(
    form: str, tmp_path: Path
) -> None:
    whole, other, _ = sessions()
    lost = {"presented": (), "answer": None, "flaw": "no graph"}
    undelivered = tuple(replace(each, **lost) for each in whole.records)
    found = [replace(whole, records=undelivered), replace(other, records=())]
    export_study(STUDY, found, tmp_path / "out", form, unblinded=True)
    texts = [file.read_text() for file in (tmp_path / "out").rglob("*") if file.is_file()]
    assert any("no graph" in text for text in texts)
    assert not any("P02" in text for text in texts)


def test_participants_whose_labels_would_be_equal_are_refused(tmp_path: Path) -> None:
    found = [replace(sessions()[0], participant=name) for name in ("P-1", "P_1")]
    with pytest.raises(ParameterError, match="participants P-1 and P_1: both are sub-P1 in BIDS"):
        export_study(STUDY, found, tmp_path / "out", "bids", unblinded=True)


FELT = (condition(surface="wood", gain=0.5), condition(surface="foam", gain=1.0))
GERMAN = {"title": 'Hölzer & "Schäume"', "instructions": "Fühlen Sie.\n\n\tDann antworten Sie."}
EXPORTED = {
    "three intervals": STUDY,
    "one stimulus": protocol("identification", pairs=(), conditions=FELT, **GERMAN),
}


@pytest.mark.quiet
@pytest.mark.parametrize("study", EXPORTED.values(), ids=EXPORTED)
def test_the_bids_validator_accepts_the_export(study: Protocol, tmp_path: Path) -> None:
    if not BIDS_VALIDATOR.exists():
        pytest.skip("bids-validator-deno is not installed")
    out = export("bids", tmp_path, study)
    command = [str(BIDS_VALIDATOR), "--json", "--ignoreNiftiHeaders", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    issues = json.loads(done.stdout)["issues"]["issues"]
    assert [each for each in issues if each["severity"] == "error"] == []
    assert done.returncode == 0


@pytest.mark.quiet
@pytest.mark.parametrize("study", EXPORTED.values(), ids=EXPORTED)
def test_the_psych_ds_validator_accepts_the_export(study: Protocol, tmp_path: Path) -> None:
    if not PSYCH_DS_VALIDATOR.exists():
        pytest.skip("psychds-validator is not installed")
    command = [str(PSYCH_DS_VALIDATOR), str(export("psych-ds", tmp_path, study)), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    result = json.loads(next(line for line in done.stdout.splitlines() if line.startswith("{")))
    assert result["valid"], result["issues"]
