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

from pathlib import Path

import pytest

from haptic_accel.core.document import read_yaml_document
from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import config_folder
from haptic_accel.study.reading import read_protocol
from haptic_accel.study.templates import templates, write_template

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
    assert len(found.content.splitlines()) <= 50


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
