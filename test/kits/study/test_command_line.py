# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel study``: every verb, as far as it needs no rig."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path

import pandas as pd
import pytest
from kits.study.studies import TEXT, Scripted, run_session, write_study

from haptic_accel.kits.study.folder import Study, templates
from haptic_accel.kits.study.tables import FORMS
from haptic_accel.kits.study.trials import COMPLETE
from nightly import rest_slow
from page_content import Page
from refusals import assert_refused, rows
from verbs import ODD_NAMES, next_command, next_words, output_of, refusal, status_of


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return write_study(tmp_path / "study")


@pytest.fixture
def simulated(study: Study, tmp_path: Path) -> Study:
    """Return a simulated study of three observers."""
    folder = tmp_path / "simulated"
    words = "study", "simulate", study.folder, "--write", folder, "--participants", 3
    assert status_of(*words) == 0
    return Study(folder)


@pytest.mark.parametrize("name", ODD_NAMES)
def test_a_study_may_be_in_a_folder_of_an_odd_name(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    words = next_words(output_of("study", "new", "--template", "preference", folder))
    assert words == [b"study", b"check", os.fsencode(folder)]


def test_a_study_begins_from_a_template(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    text = output_of("study", "new", "--template", "compensated_or_not", folder)
    assert next_command(text) == ["study", "check", str(folder)]
    message = refusal(*next_command(text))  # describes the study, and refuses its blanks
    assert message.startswith(f"{folder / 'study.yaml'}:")
    assert "consent.text: must have its" in message
    shown = capsys.readouterr().out
    assert "controller=none against controller=adaptive" in shown
    assert next_command(shown) == ["study", "simulate", str(folder)]
    message = refusal("study", "new", "--template", "compensated_or_not", folder)
    assert message == f"{folder / 'study.yaml'}: must be a new file: File exists"


def test_simulated_observers_are_named_wherever_results_are(
    simulated: Study, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("status", "verify", "analyze", "export"):
        assert status_of("study", verb, simulated.folder) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert shown.count("Compensated or not (simulated observers)") == 3
    analysis = simulated.folder / "analysis"
    page = Page(analysis / "index.html")
    assert "Compensated or not (simulated observers): results" in page.text
    results = [each for each in page.tables if "participants" in each[0] or "stimuli" in each[0]]
    assert len(results) >= 2
    assert all("observer" in table[0] for table in results)
    data = simulated.folder / "export" / "psych-ds" / "data"
    tables = [*analysis.glob("*.csv"), *data.glob("*.csv")]
    assert len(tables) >= 8
    for file in tables:
        assert set(pd.read_csv(file)["observer"]) == {"simulated"}, file
    assert "(simulated observers)" in (data.parent / "README.md").read_text()


def test_people_are_not_called_simulated(study: Study) -> None:
    run_session(study, study.begin("P01"))
    study.unblind("a look")
    assert status_of("study", "analyze", study.folder) == 0
    assert "simulated observers" not in Page(study.folder / "analysis" / "index.html").text
    assert set(pd.read_csv(study.folder / "analysis" / "trials.csv")["observer"]) == {"person"}


def test_the_study_of_the_present_folder(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(study.folder)
    assert "Compensated or not" in output_of("study", "check")


def test_status_tells_progress_and_no_condition(study: Study, tmp_path: Path) -> None:
    def give_up(_: object) -> None:
        raise KeyboardInterrupt

    run_session(study, study.begin("P01"))
    with pytest.raises(KeyboardInterrupt):
        run_session(study, study.begin("P02"), Scripted(study, {"break": give_up}))
    file = tmp_path / "status.json"
    shown = output_of("study", "status", study.folder, "--json", file)
    assert "1 of 12 participants complete" in shown
    assert "conditions are sealed" in shown
    content = json.loads(file.read_text())
    first, second = content["participants"]
    assert (first["participant"], first["state"], first["progress"]) == ("P01", COMPLETE, 1.0)
    assert (second["participant"], second["state"], second["trials"]) == ("P02", "interrupted", 7)
    assert second["progress"] == pytest.approx(0.5)
    assert content["sealed"] is True
    for word in ("adaptive", "none", "different", "d_prime"):
        assert word not in shown + file.read_text()


@pytest.mark.smoke
def test_a_simulated_study_says_that_it_is_one(study: Study, tmp_path: Path) -> None:
    folder = tmp_path / "simulated"
    shown = output_of("study", "simulate", study.folder, "--write", folder)
    assert next_command(shown) == ["study", "analyze", str(folder)]
    assert ": simulated observers" in output_of("study", "status", folder)
    assert len(Study(folder).sessions) == 12  # as planned
    message = refusal("study", "simulate", study.folder, "--write", folder)
    assert message.endswith("must be a new folder")


def test_conditions_stay_sealed_until_a_reason_is_given(
    study: Study, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run_session(study, study.begin("P01"))
    for verb in ("analyze", "export"):
        message = refusal("study", verb, study.folder)
        assert message.startswith(f"{study.folder}: conditions are sealed")
    assert "--reason" in refusal("study", "unblind", study.folder)
    words = "study", "unblind", study.folder, "--reason", "done"
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert status_of(*words) == 130  # one of twelve is complete, and nobody answers
    assert "1 of 12 participants have completed the study" in capsys.readouterr().out
    assert study.sealed
    assert next_command(output_of(*words, "--yes")) == ["study", "analyze", str(study.folder)]
    message = refusal("study", "unblind", study.folder, "--reason", "again")
    assert message == f"{study.folder}: is unblinded already"
    assert status_of("study", "export", study.folder, "--form", "csv") == 0
    assert (study.folder / "export" / "csv" / "trials.csv").is_file()


def test_nothing_asks_once_all_are_complete(tmp_path: Path) -> None:
    study = write_study(tmp_path / "study", f"{TEXT}rules: {{participants: 1}}\n")
    run_session(study, study.begin("P01"))
    assert status_of("study", "unblind", study.folder, "--reason", "done") == 0


def test_a_study_that_runs_is_not_called_interrupted(study: Study) -> None:
    study.unblind("a look")
    with study.begin("P01"):
        assert "running" in output_of("study", "status", study.folder)
        shown = output_of("study", "analyze", study.folder)
        assert "P01 is excluded: session not complete (running)" in shown


def test_results_are_not_written_through_a_link(simulated: Study, tmp_path: Path) -> None:
    for verb, name in (("analyze", "analysis"), ("export", "export")):
        (simulated.folder / name).symlink_to(tmp_path)
        message = refusal("study", verb, simulated.folder)
        assert message == f"{simulated.folder / name}: is a link: must be a folder, or nothing"


def test_a_study_without_participants_has_no_results(study: Study) -> None:
    study.unblind("a look")
    for verb in ("analyze", "export"):
        assert refusal("study", verb, study.folder) == f"{study.folder}: has no participant yet"


def test_an_export_is_written_anew(simulated: Study) -> None:
    for _ in range(2):
        assert status_of("study", "export", simulated.folder) == 0
    assert (simulated.folder / "export" / "psych-ds" / "dataset_description.json").is_file()


def test_a_participant_is_deleted_when_confirmed(
    simulated: Study, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert status_of("study", "export", simulated.folder) == 0
    words = "study", "delete-participant", simulated.folder, "--participant", "S02"
    assert status_of(*words) == 130  # nobody answers the question
    assert len(simulated.sessions) == 3
    assert str(simulated.participant_folder("S02") / "log.jsonl") in capsys.readouterr().out
    assert "S02 is deleted" in output_of(*words, "--yes")
    assert [each.participant for each in simulated.sessions] == ["S01", "S03"]
    for file in simulated.folder.rglob("*"):
        assert file.is_dir() or b"S02" not in file.read_bytes()
    assert "'S02': has no session; there are S01, S03" in refusal(*words, "--yes")


def test_a_complete_or_unknown_session_is_not_resumed(study: Study) -> None:
    run_session(study, study.begin("P01"))
    words = "study", "resume", study.folder, "--participant"
    assert refusal(*words, "P01") == "participant = 'P01': the session is complete"
    assert refusal(*words, "P02") == "participant = 'P02': has no session; there are P01"
    message = refusal("study", "run", study.folder, "--participant", "P01")
    assert message.startswith("participant = 'P01': has begun already")


def test_no_participant_follows_the_last_one(tmp_path: Path) -> None:
    study = write_study(tmp_path / "study", f"{TEXT}rules: {{participants: 2}}\n")
    for name in ("P01", "P02"):
        run_session(study, study.begin(name))
    message = refusal("study", "run", study.folder, "--participant", "P03")
    assert message.startswith(f"{study.folder}: 2 participants have completed it")
    assert not study.participant_folder("P03").exists()


@pytest.mark.parametrize("name", rest_slow(sorted(templates())))
def test_every_template_goes_from_its_file_to_exported_data(name: str, tmp_path: Path) -> None:
    folder, tried = tmp_path / "mine", tmp_path / "tried"
    assert status_of("study", "new", "--template", name, folder) == 0
    words = "study", "simulate", folder, "--write", tried, "--participants", 2
    assert status_of(*words) == 0
    assert {each.ended for each in Study(tried).sessions} == {COMPLETE}
    assert status_of("study", "analyze", tried) == 0
    assert (tried / "analysis" / "index.html").is_file()
    for form in FORMS:
        assert status_of("study", "export", tried, "--form", form) == 0
        assert any((tried / "export" / form).iterdir())


def test_the_power_of_the_planned_tests(study: Study, tmp_path: Path) -> None:
    file = tmp_path / "power.json"
    words = "study", "simulate", study.folder, "--studies", 4, "--participants", 5
    shown = output_of(*words, "--jobs", 2, "--json", file)
    assert "4 simulated studies with 5 participants" in shown
    (power,) = json.loads(file.read_text())
    assert (power["name"], power["share"]) == ("told apart", 1.0)  # strengths differ by 3
    assert power["low"] < 1.0 == pytest.approx(power["high"])


TEMPLATES = ", ".join(templates())

FILES = {
    "misspelt/study.yaml": TEXT.replace("adaptive", "adaptve"),
    "blank/study.yaml": TEXT.replace("I agree to take part.", '"[[ blank: purpose ]] I agree."'),
    "study/study.yaml": TEXT,
    "untested/study.yaml": TEXT.partition("tests:")[0],
}
"""Text of files in the working folder."""

REFUSED = {
    "study new --template gain mine": f"...: must be one of {TEMPLATES} (did you mean gain_jnd?)",
    "study check empty": "empty: must be a study's folder, ...",
    "study simulate empty": "empty: must be a study's folder, ...",
    "study status empty": "empty: must be a study's folder, ...",
    "study analyze empty": "empty: must be a study's folder, ...",
    "study export empty": "empty: must be a study's folder, ...",
    "study check misspelt": "misspelt/study.yaml:6: factors.controller = 'adaptve': ...",
    "study simulate untested": "untested/study.yaml: tests = nothing: must be given ...",
    "study run blank --participant P07": (
        "blank/study.yaml:5: consent.text: must have its 1 blanks filled in: purpose"
    ),
    "study run study --participant Anna": "participant = 'Anna': must be a pseudonym ...",
    "study resume study --participant Anna": "participant = 'Anna': must be a pseudonym ...",
}
"""Line of each command line, in which ... stands for any text."""


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)
