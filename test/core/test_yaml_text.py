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
import yaml

from haptic_accel.core.bounded_files import LARGEST_TEXT
from haptic_accel.core.yaml_text import load_yaml, texts_of

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "aliases": BOMB,
    "an alias of itself": "&a [*a]",
    "nesting": "[" * 100_000,
    "nested keys": "? " * 100_000,
    "a number of many digits": "9" * 1_000_000,
    "many values": "[" + "[]," * 300_000 + "]",
    "size": "x" * (LARGEST_TEXT + 1),
    "no date": "2001-13-45",
    "no base 64": "!!binary ä",
    "a key that is a list": "{[]: 1}",
    "an object of Python": "!!python/object/apply:os.system [exit]",
    "no YAML": "a: b: c",
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_hostile_or_damaged_is_refused_in_one_line(kind: str) -> None:
    with pytest.raises(ValueError, match=".") as caught:
        load_yaml(HOSTILE[kind])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["1_000", "0x10", "0b1", "010", "1:30", ".nan", ".inf", "1e"])
def test_only_plain_decimals_are_numbers(text: str) -> None:
    assert load_yaml(text) == text
    with pytest.raises(ValueError, match="must be a number"):
        load_yaml(f"!!float {text}") if text != "010" else load_yaml("!!int 0o10")


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e5", 1e5), ("2.5e3", 2500.0), ("-12", -12), ("+.5", 0.5), ("5.", 5.0), ("0", 0)],
)
def test_a_decimal_may_have_an_exponent_if_told_so(text: str, number: float) -> None:
    found = load_yaml(text, exponents=True)
    assert (found, type(found)) == (number, type(number))


@pytest.mark.parametrize("text", ["1e5", "12345e10", "2.5e3"])
def test_what_yaml_takes_for_text_stays_text_in_metadata(text: str) -> None:
    assert load_yaml(yaml.safe_dump(text)) == load_yaml(text) == text


def test_a_number_to_the_base_60_costs_no_time() -> None:
    assert load_yaml("1" + ":0" * 1_000_000) == "1" + ":0" * 1_000_000


def test_what_another_program_wrote_without_quotation_marks_is_text() -> None:
    assert texts_of(load_yaml("{run: 5, on: x}")) == {"run": "5", "True": "x"}
    assert texts_of(None) == {}


@pytest.mark.parametrize("text", ["[1]", "{a: [1]}", "{a: {b: c}}", "x"])
def test_custom_data_that_is_no_text_by_name_is_refused(text: str) -> None:
    with pytest.raises((ValueError, TypeError)):
        texts_of(load_yaml(text))
