from __future__ import annotations

import pytest

from haptic_accel.bags.yaml_text import LARGEST, load_yaml, texts_of

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "aliases": BOMB,
    "an alias of itself": "&a [*a]",
    "nesting": "[" * 100_000,
    "nested keys": "? " * 100_000,
    "a number to the base 60": "1" + ":0" * 1_000_000,
    "size": "x" * (LARGEST + 1),
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


def test_what_another_program_wrote_without_quotation_marks_is_text() -> None:
    assert texts_of(load_yaml("{run: 5, on: x}")) == {"run": "5", "True": "x"}
    assert texts_of(None) == {}


@pytest.mark.parametrize("text", ["[1]", "{a: [1]}", "{a: {b: c}}", "x"])
def test_custom_data_that_is_no_text_by_name_is_refused(text: str) -> None:
    with pytest.raises((ValueError, TypeError)):
        texts_of(load_yaml(text))
