# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A study's folder: versions, pseudonyms, rows, unblinding, and deletion without a trace."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from kits.study.studies import TEXT, Scripted, run_session, write_study

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study import folder
from haptic_accel.kits.study.conditions import arguments, check_blanks, live
from haptic_accel.kits.study.log import LOG
from haptic_accel.kits.study.procedures import expected_minutes, expected_trials
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.scenes import read_scene


@pytest.fixture
def study(tmp_path: Path) -> folder.Study:
    return write_study(tmp_path / "study")


def test_a_folder_without_a_protocol_is_none(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=f"^{tmp_path}: must be a study's folder"):
        folder.Study(tmp_path)


@pytest.mark.parametrize("name", ["P07", "7", "a-1_b", "x" * 31 + "1", "AB12CD"])
def test_pseudonyms(study: folder.Study, name: str) -> None:
    study.begin(name).close()
    assert [each.participant for each in study.sessions] == [name]


@pytest.mark.parametrize(
    "name",
    [
        *("", "Anna", "anna-karenina", "anna@example.org", "anna1@example.org", "Anna Smith 7"),
        *("19840229", "m123456", "../P07", "-1", ".1", "P07/..", "x" * 32 + "1", "Ä1", "P07\n"),
    ],
)
def test_what_may_tell_who_somebody_is_is_no_pseudonym(study: folder.Study, name: str) -> None:
    for act in (study.begin, study.resume, study.delete):
        with pytest.raises(ParameterError, match="^participant = .*: must be a pseudonym"):
            act(name)
    assert [*study.folder.iterdir()] == [study.folder / folder.PROTOCOL]


@pytest.mark.parametrize("again", ["P07", "p07"])
def test_a_participant_begins_once(study: folder.Study, again: str) -> None:
    study.begin("P07").close()
    with pytest.raises(ParameterError, match=f"^participant = '{again}': has begun already"):
        study.begin(again)


def test_rows_are_filled_up_after_a_deletion(study: folder.Study) -> None:
    for name in ("P01", "P02", "P03"):
        study.begin(name).close()
    study.delete("P02")
    study.begin("P04").close()
    study.begin("P05").close()
    rows = {each.participant: each.row for each in study.sessions}
    assert rows == {"P01": 0, "P03": 2, "P04": 1, "P05": 3}
    assert len({each.seed for each in study.sessions}) == 4, "seeds differ"


def test_a_participant_goes_on_with_the_version_of_the_begin(study: folder.Study) -> None:
    def give_up(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_session(study, study.begin("P01"), Scripted(study, {"question": give_up}))
    changed = write_study(study.folder, TEXT.replace("repeats: 12", "repeats: 6"))
    assert len(run_session(changed, changed.resume("P01")).counted) == 12
    assert len(run_session(changed, changed.begin("P02")).counted) == 6
    first, second = changed.sessions
    assert first.digest != second.digest
    assert [each["digest"] for each in changed.journal] == [first.digest, second.digest]


def test_a_changed_version_is_refused(study: folder.Study) -> None:
    study.begin("P01").close()
    (version,) = (study.folder / "versions").iterdir()
    version.write_text(TEXT.replace("repeats: 12", "repeats: 13"))
    with pytest.raises(ParameterError, match=f"^{version}: was changed"):
        study.version(study.sessions[0].digest)


def test_unblinding_is_kept_with_its_reason(study: folder.Study) -> None:
    run_session(study, study.begin("P01"))
    study.begin("P02").close()
    assert study.sealed
    study.unblind("the study is complete")
    assert not study.sealed
    entry = study.journal[-1]
    assert (entry["reason"], entry["complete"]) == ("the study is complete", 1)


def test_a_deletion_leaves_no_trace(study: folder.Study) -> None:
    for name in ("P01", "P07"):
        run_session(study, study.begin(name))
    place = study.participant_folder("P07")
    (place / "bags" / "1").mkdir(parents=True)
    (place / "bags" / "1" / "bag.mcap").write_bytes(b"P07")
    (place / "graph.log").write_text("P07")
    for name in (folder.ANALYSIS, folder.EXPORT):
        (study.folder / name / "psych-ds").mkdir(parents=True)
        (study.folder / name / "psych-ds" / "trials_data.csv").write_text("participant\nP07\n")
    kept = (study.participant_folder("P01") / LOG).read_bytes()
    study.delete("P07")
    for path in study.folder.rglob("*"):
        assert "P07" not in str(path.relative_to(study.folder))
        assert path.is_dir() or b"P07" not in path.read_bytes()
    assert study.journal[-1]["kind"] == "deletion"
    assert (study.participant_folder("P01") / LOG).read_bytes() == kept
    assert [each.participant for each in study.sessions] == ["P01"]


@pytest.mark.parametrize("content", [b"", b"damaged\n"])
def test_a_log_that_cannot_be_read_is_deleted_too(study: folder.Study, content: bytes) -> None:
    study.begin("P07").close()
    (study.participant_folder("P07") / LOG).write_bytes(content)
    with pytest.raises(ParameterError, match=f"^{study.participant_folder('P07') / LOG}: "):
        study.resume("P07")
    study.delete("P07")
    assert not study.participant_folder("P07").exists()


def test_a_running_session_is_not_deleted(study: folder.Study) -> None:
    with study.begin("P07"), pytest.raises(ParameterError, match="another process"):
        study.delete("P07")
    assert study.participant_folder("P07").exists()


def test_a_deletion_that_was_broken_off_can_be_repeated(
    study: folder.Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    study.begin("P07").close()
    (study.participant_folder("P07") / "bags").mkdir()
    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.unlink", lambda _: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            study.delete("P07")
    study.delete("P07")
    assert not study.participant_folder("P07").exists()


@pytest.mark.parametrize("name", folder.templates())
def test_a_template_is_a_protocol_of_its_own(name: str, tmp_path: Path) -> None:
    found = read_protocol(folder.write_template(name, tmp_path / "new" / "study"))
    assert found.digest == read_protocol(folder.templates()[name]).digest
    assert found.tests
    assert len(found.content.splitlines()) <= 70


@pytest.mark.parametrize("name", folder.templates())
def test_a_template_is_about_one_surface_at_a_time(name: str) -> None:
    found = read_protocol(folder.templates()[name])
    for condition in found.conditions:
        settings = {**vars(arguments(found, condition)), **live(found, condition)}
        if settings["slave"] == "virtual":
            assert len(read_scene(preset_file("scene", str(settings["surface"]))).objects) == 1


@pytest.mark.parametrize("name", folder.templates())
def test_a_consent_text_has_what_ethics_boards_ask_for(name: str) -> None:
    found = read_protocol(folder.templates()[name])
    text = found.consent.text
    parts = ("Purpose", "What happens", "Risks", "Benefit", "Free will", "Data", "Contact")
    assert [part for part in parts if f"{part}" in text] == list(parts)
    breaks = expected_trials(found) // found.extras.break_every * found.extras.break_seconds / 60
    stated = re.search(r"takes about (\d+) minutes", text)
    assert stated
    assert int(stated[1]) >= expected_minutes(found) + breaks
    assert f"reached {found.limits.exposure:g} m/s²" in " ".join(text.split())
    with pytest.raises(
        ParameterError, match=r"consent.text: must have its \d blanks filled"
    ) as told:
        check_blanks(found)
    assert str(told.value).startswith(f"{found.source}:")
    assert "; investigator, address and telephone; " in str(told.value)


def test_a_text_whose_blanks_are_filled_in_passes(tmp_path: Path) -> None:
    path = folder.write_template("preference", tmp_path)
    filled = re.sub(r"\[\[ blank: [^\]]*\]\]", "our text", path.read_text(encoding="utf-8"))
    path.write_text(f"# [[ blank: in a comment ]]\n{filled}", encoding="utf-8")
    check_blanks(read_protocol(path))
    for part in ("[[blank]]", "[[ Blank: half"):
        path.write_text(filled.replace("No answer is wrong.", part), encoding="utf-8")
        with pytest.raises(
            ParameterError, match=r"study.yaml:\d+: instructions: must have its 1 b"
        ):
            check_blanks(read_protocol(path))
