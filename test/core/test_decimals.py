# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import ODD_NUMBERS
from haptic_accel.core.parameters import defined, read_decimal, read_whole


@pytest.mark.parametrize(
    ("text", "number"),
    [("1", 1.0), ("-1.5", -1.5), (".5", 0.5), ("5.", 5.0), ("1e5", 1e5), ("+2.5E-3 ", 2.5e-3)],
)
def test_a_decimal_with_or_without_an_exponent_is_read(text: str, number: float) -> None:
    assert read_decimal(text) == number


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers())
def test_what_python_writes_is_read_exactly(number: float, whole: int) -> None:
    assert read_decimal(repr(number)) == number
    assert read_whole(str(whole)) == whole


@pytest.mark.parametrize("text", ODD_NUMBERS)
def test_other_scripts_and_underscores_are_no_numbers(text: str) -> None:
    for read in (read_decimal, read_whole):
        with pytest.raises(ValueError, match="must be a number"):
            read(text)


def test_a_whole_number_has_no_decimal_point() -> None:
    with pytest.raises(ValueError, match=r"'1\.0': must be a number"):
        read_whole("1.0")


def test_a_number_too_large_is_infinite_or_refused() -> None:
    assert read_decimal("1e999") == math.inf
    with pytest.raises(ValueError, match="must be a number"):
        read_whole("9" * 10_000)


def test_json_has_null_in_place_of_what_is_not_finite() -> None:
    given = {"error": math.nan, "rows": ({"bound": math.inf}, [1.5, -math.inf, "nan", None, 3])}
    expected = {"error": None, "rows": [{"bound": None}, [1.5, None, "nan", None, 3]]}
    assert defined(given) == expected
