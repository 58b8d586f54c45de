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

"""Tests of the templates of studies and of the languages of the participant's page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from haptic_accel.core.document import read_yaml_document
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.conditions import arguments, check_blanks, live
from haptic_accel.kits.study.plan import expected_minutes, expected_trials
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.templates import templates, write_template
from haptic_accel.materials.folders import config_folder, preset_file
from haptic_accel.materials.scenes import read_scene

LANGUAGES = sorted((config_folder() / "studies" / "languages").glob("*.yaml"))


def test_there_are_seven_templates() -> None:
    assert list(templates()) == [
        *("compensated_or_not", "gain_jnd", "network_delay", "one_or_three_axes", "preference"),
        *("real_or_virtual_texture", "texture_identification"),
    ]


@pytest.mark.parametrize("name", templates())
def test_a_template_is_a_protocol_of_its_own(name: str, tmp_path: Path) -> None:
    path = write_template(name, tmp_path / "new" / "study")
    found = read_protocol(path)
    assert found.digest == read_protocol(templates()[name]).digest
    assert found.tests
    assert len(found.content.splitlines()) <= 70


@pytest.mark.parametrize("name", templates())
def test_a_template_is_about_one_surface_at_a_time(name: str) -> None:
    found = read_protocol(templates()[name])
    for condition in found.conditions:
        settings = {**vars(arguments(found, condition)), **live(found, condition)}
        if settings["slave"] == "virtual":
            scene = read_scene(preset_file("scene", str(settings["surface"])))
            assert len(scene.objects) == 1


@pytest.mark.parametrize("name", templates())
def test_a_consent_text_has_what_ethics_boards_ask_for(name: str) -> None:
    found = read_protocol(templates()[name])
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
    path = write_template("preference", tmp_path)
    whole = path.read_text(encoding="utf-8")
    filled = re.sub(r"\[\[ blank: [^\]]*\]\]", "our text", whole)
    path.write_text(f"# [[ blank: in a comment ]]\n{filled}", encoding="utf-8")
    check_blanks(read_protocol(path))
    for part in ("[[blank]]", "[[ Blank: half"):
        path.write_text(filled.replace("No answer is wrong.", part), encoding="utf-8")
        with pytest.raises(
            ParameterError, match=r"study.yaml:\d+: instructions: must have its 1 b"
        ):
            check_blanks(read_protocol(path))


def test_a_protocol_is_not_written_over(tmp_path: Path) -> None:
    path = write_template("preference", tmp_path)
    with pytest.raises(ParameterError, match=f"^{path}: must be a new file: File exists$"):
        write_template("gain_jnd", tmp_path)
    assert read_protocol(path).task == "preference"


def test_an_unknown_template_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="^template = 'jnd': must be one of compensated_or"):
        write_template("jnd", tmp_path)


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_all_languages_have_the_same_words(path: Path) -> None:
    words = {name: each.text() for name, each in read_yaml_document(path).members()}
    english = read_yaml_document(config_folder() / "studies" / "languages" / "en.yaml")
    assert list(words) == list(english.mapping())
    assert all(words.values())
    assert words["language"] == path.stem
