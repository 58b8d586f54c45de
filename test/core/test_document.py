# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from haptic_accel.core import document
from haptic_accel.core.files import LARGEST_TEXT
from haptic_accel.core.parameters import ParameterError, Specification

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
        document.load_yaml(HOSTILE[kind])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["1_000", "0x10", "0b1", "010", "1:30", ".nan", ".inf", "1e"])
def test_only_plain_decimals_are_numbers(text: str) -> None:
    assert document.load_yaml(text) == text
    with pytest.raises(ValueError, match="must be a number"):
        document.load_yaml(f"!!float {text}") if text != "010" else document.load_yaml(
            "!!int 0o10"
        )


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e5", 1e5), ("2.5e3", 2500.0), ("-12", -12), ("+.5", 0.5), ("5.", 5.0), ("0", 0)],
)
def test_a_decimal_may_have_an_exponent_if_told_so(text: str, number: float) -> None:
    found = document.load_yaml(text, exponents=True)
    assert (found, type(found)) == (number, type(number))


@pytest.mark.parametrize("text", ["1e5", "12345e10", "2.5e3"])
def test_what_yaml_takes_for_text_stays_text_in_metadata(text: str) -> None:
    assert document.load_yaml(yaml.safe_dump(text)) == document.load_yaml(text) == text


def test_a_number_to_the_base_60_costs_no_time() -> None:
    assert document.load_yaml("1" + ":0" * 1_000_000) == "1" + ":0" * 1_000_000


def test_what_another_program_wrote_without_quotation_marks_is_text() -> None:
    assert document.texts_of(document.load_yaml("{run: 5, on: x}")) == {"run": "5", "True": "x"}
    assert document.texts_of(None) == {}


@pytest.mark.parametrize("text", ["[1]", "{a: [1]}", "{a: {b: c}}", "x"])
def test_custom_data_that_is_no_text_by_name_is_refused(text: str) -> None:
    with pytest.raises((ValueError, TypeError)):
        document.texts_of(document.load_yaml(text))


YAML = "wood:\n  stiffness: 300\n  name: oak\n  modes:\n    - [1, x]\n  none:\n"
POSITIVE = Specification("stiffness", "N/m", 1.0)


@pytest.fixture
def wood(tmp_path: Path) -> document.Document:
    file = tmp_path / "a.yaml"
    file.write_text(YAML)
    return document.read_yaml_document(file).at("wood")


def test_values_are_read_by_their_keys(wood: document.Document) -> None:
    assert "stiffness" in wood
    assert "grain" not in wood
    assert wood.at("stiffness").number(POSITIVE) == 300.0
    assert wood.at("name").text() == "oak"
    assert wood.at("name").choice({"oak": 1}) == 1
    assert wood.get("grain", 5).number() == wood.get("none", 5).number() == 5.0
    (row,) = wood.at("modes").items()
    assert [each.value for each in row.items()] == [1, "x"]
    assert wood.get("origin").vector(POSITIVE) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("read", "line", "problem"),
    [
        (lambda wood: wood.at("grain"), 1, "wood.grain = nothing: must be given"),
        (lambda wood: wood.at("name").number(POSITIVE), 3, "wood.name = 'oak': must be at least"),
        (lambda wood: wood.at("name").items().__next__(), 3, "wood.name = 'oak': must be a list"),
        (lambda wood: wood.at("name").mapping(), 3, "wood.name = 'oak': must map names to val"),
        (lambda wood: wood.at("stiffness").text(), 2, "wood.stiffness = 300: must be text"),
        (lambda wood: wood.at("modes").array(), 4, "wood.modes = [[1, 'x']]: must be numbers"),
        (
            lambda wood: next(wood.at("modes").items()).vector(POSITIVE),
            5,
            "wood.modes.0 = [1, 'x']: must be three numbers",
        ),
        (lambda wood: wood.check_keys("names"), 2, "wood.stiffness: unknown: must be one of"),
        (lambda wood: wood.at("name").choice({}), 3, "wood.name = 'oak': must be one of"),
    ],
)
def test_an_error_names_file_line_place_value_and_what_is_allowed(
    wood: document.Document, read: Callable[[document.Document], Any], line: int, problem: str
) -> None:
    with pytest.raises(ParameterError) as refused:
        read(wood)
    assert str(refused.value).startswith(f"{wood.path}:{line}: {problem}")
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("error", ["name = 3: must be short", "no such tree"])
def test_an_error_from_elsewhere_is_located(wood: document.Document, error: str) -> None:
    with pytest.raises(ParameterError) as refused, wood.located("name"):
        raise ParameterError(error)
    own = error if error.startswith("name") else f"name: {error}"
    assert str(refused.value) == f"{wood.path}:3: wood.{own}"


def test_json_has_places_without_lines(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text('{"a": [{"b": "\\ud800"}]}')
    (found,) = document.read_json_document(file).at("a").items()
    assert found.at("b").text() == "?"
    with pytest.raises(ParameterError) as refused:
        found.at("b").number()
    assert str(refused.value) == rf"{file}: a.0.b = '\ud800': must be a finite number"


@pytest.mark.parametrize("read", [document.read_yaml_document, document.read_json_document])
@pytest.mark.parametrize("content", [b"{", b"\xff\xfe", b"[" * 100_000, None])
def test_a_file_that_is_none_is_refused_in_one_line(
    tmp_path: Path, read: Callable[[Path], document.Document], content: bytes | None
) -> None:
    file = tmp_path / "a"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ParameterError, match=rf"^{file}: must be ") as refused:
        read(file)
    assert str(refused.value).isprintable()
