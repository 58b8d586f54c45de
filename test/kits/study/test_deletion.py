# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Deletion of a participant: all that is theirs, and nothing else, wherever links lead."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from kits.study.studies import write_study

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.folder import ANALYSIS, EXPORT, Study
from haptic_accel.kits.study.log import LOG


@pytest.fixture
def study(tmp_path: Path) -> Study:
    study = write_study(tmp_path / "study")
    for name in ("P01", "P07"):
        study.begin(name).close()
    return study


@pytest.fixture
def stranger(tmp_path: Path) -> Path:
    """Return a folder with files of somebody else."""
    folder = tmp_path / "stranger"
    (folder / "2026" / "photos").mkdir(parents=True)
    (folder / "letter.txt").write_text("Dear")
    (folder / "2026" / "letter.txt").write_text("Dear")
    return folder


def bag(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "metadata.yaml").touch()
    (folder / f"{folder.name}_0.mcap").write_bytes(b"P07")
    return folder


def files(folder: Path) -> list[str]:
    return sorted(str(each.relative_to(folder)) for each in folder.rglob("*"))


def test_nothing_behind_a_participant_that_is_a_link_is_deleted(
    study: Study, stranger: Path, tmp_path: Path
) -> None:
    (study.participant_folder("P07") / LOG).rename(stranger / LOG)
    study.participant_folder("P07").rmdir()
    link = study.participant_folder("P07")
    link.symlink_to(stranger)
    before = files(tmp_path)
    with pytest.raises(ParameterError, match=f"^{link}: is a link to {stranger}: "):
        study.delete("P07")
    assert files(tmp_path) == before


def test_links_go_and_what_they_lead_to_stays(study: Study, stranger: Path) -> None:
    before, place = files(stranger), study.participant_folder("P07")
    (place / "notes").symlink_to(stranger)
    (place / "deep").mkdir()
    (place / "deep" / "link").symlink_to(stranger)
    for name in (ANALYSIS, EXPORT):
        (study.folder / name).symlink_to(stranger)
    assert set(study.deletion("P07").left) == {stranger}
    study.delete("P07")
    assert files(stranger) == before
    assert not place.exists()
    assert not any(os.path.lexists(study.folder / name) for name in (ANALYSIS, EXPORT))


def test_linked_bags_are_deleted_and_no_more(study: Study, stranger: Path) -> None:
    before = files(stranger)
    (study.participant_folder("P07") / "bags").symlink_to(stranger)
    bags = [bag(stranger / f"{number:03d}") for number in range(2)]
    deletion = study.deletion("P07")
    assert set(bags) < set(deletion.removed)
    assert {stranger / "letter.txt", stranger / "2026"} < set(deletion.left)
    study.delete("P07")
    assert files(stranger) == before
    assert not study.participant_folder("P07").exists()


def test_bags_of_two_participants_in_one_folder_are_not_deleted(
    study: Study, tmp_path: Path
) -> None:
    (tmp_path / "disk").mkdir()
    bag(tmp_path / "disk" / "000")
    for name in ("P01", "P07"):
        (study.participant_folder(name) / "bags").symlink_to(tmp_path / "disk")
    before = files(tmp_path)
    with pytest.raises(ParameterError, match="not known whose bags are there"):
        study.delete("P07")
    assert files(tmp_path) == before


def test_a_plan_names_all_that_is_deleted(study: Study) -> None:
    place = study.participant_folder("P07")
    bag(place / "bags" / "000")
    (place / "graph.log").touch()
    names = [each.name for each in study.deletion("P07").removed]
    assert names == ["bags", "graph.log", LOG, "P07"]
    assert study.deletion("P07").left == ()
