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

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.words import described


def test_no_words_are_the_defaults() -> None:
    assert parse_arguments([]) == GraphArguments()
    assert GraphArguments().rate == 1000.0
    assert GraphArguments().record is True


def test_words_have_their_types() -> None:
    arguments = parse_arguments(
        ["rate:=4000", "seed:=7", "record:=False", "bag:=12", "surface:=a:=b"]
    )
    assert arguments.rate == 4000.0
    assert arguments.seed == 7
    assert arguments.record is False
    assert arguments.bag == "12"
    assert arguments.surface == "a:=b"


def test_every_argument_is_described_with_its_default() -> None:
    names = [name for name, _, _ in described(GraphArguments)]
    listed = ["controller", "surface", "master", "slave", "rate", "duration", "record"]
    listed += ["bag", "params_file", "seed"]
    assert set(listed) <= set(names)
    texts = {name: text for name, _, text in described(GraphArguments)}
    assert "[Hz]" in texts["rate"]
    assert "none, constant, dynamic" in texts["controller"]
    # What is shown as a default can be given as a word.
    words = [f"{name}:={default}" for name, default, _ in described(GraphArguments)]
    assert parse_arguments(words) == GraphArguments()


@given(st.lists(st.text(), max_size=4))
def test_any_words_are_read_or_refused_in_one_line(words: list[str]) -> None:
    try:
        parse_arguments(words)
    except ParameterError as error:
        assert "\n" not in str(error).replace("\\n", "")


@given(st.sampled_from(["rate", "seed", "duration", "recording_rate"]), st.text())
def test_any_value_of_a_number_is_read_or_refused_by_name(key: str, value: str) -> None:
    try:
        arguments = parse_arguments([f"{key}:={value}"])
    except ParameterError as error:
        assert key in str(error)
    else:
        assert getattr(arguments, key) == float(value)


def test_the_virtual_slave_touches_a_scene_and_no_other_does() -> None:
    with pytest.raises(
        ParameterError, match=r"scene = 'mine\.yaml': must come with slave:=virtual"
    ):
        parse_arguments(["scene:=mine.yaml"])
    with pytest.raises(ParameterError, match="surface = 'text': must come without slave:=virtual"):
        parse_arguments(["slave:=virtual", "surface:=text"])
    assert parse_arguments(["slave:=virtual", "scene:=mine.yaml"]).touched == "mine.yaml"
    assert parse_arguments(["surface:=text"]).touched == "text"
