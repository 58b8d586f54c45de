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

"""No cell of a table is a formula, and no text and no number is lost."""

from __future__ import annotations

import csv
import io
import re

import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.analysis.csv_tables import csv_text

FORMULAS = [*("=1+1", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "\uff1d1", "-", "'=1"), ""]
"""Texts after OWASP's list of first characters."""

TEXTS = st.one_of(
    st.sampled_from(FORMULAS),
    st.text("=+-@'\t\r\n,\";1e. a", max_size=6),
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=6),
)


def rows(text: str) -> list[list[str]]:
    # Line ends are those of the rows: a reader of lines would see a carriage return as one.
    return list(csv.reader(io.StringIO(text, newline="")))


def is_number(text: str) -> bool:
    try:
        return float(text) is not None and not re.search(r"[^-+.\deE]", text, re.ASCII)
    except ValueError:
        return False


@given(st.lists(TEXTS, min_size=1, max_size=4))
def test_no_cell_is_a_formula_and_taking_off_one_apostrophe_gives_the_text(
    texts: list[str],
) -> None:
    headings = list(dict.fromkeys(f"{text}{place}" for place, text in enumerate(texts)))
    frame = pd.DataFrame([texts], columns=headings)
    frame["last"] = 1
    found = rows(csv_text(frame))
    assert len(found) == 2
    for written, given_ in zip(found, ([*headings], texts), strict=True):
        assert len(written) == len(texts) + 1
        for cell, text in zip(written[:-1], given_, strict=True):
            assert not re.match("[=+@\t\n\r\uff1d\uff0b\uff0d\uff20-]", cell) or is_number(cell)
            assert cell.removeprefix("'") == re.sub("\r\n?", "\n", text)


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(10**9), 10**9))
def test_numbers_stay_numbers_also_as_texts(number: float, whole: int) -> None:
    frame = pd.DataFrame({"number": [number], "whole": [whole], "answer": [str(whole)]})
    _, (first, second, third) = rows(csv_text(frame))
    assert float(first) == float(f"{number:.9g}")
    assert (int(second), int(third)) == (whole, whole)


def test_an_index_with_a_name_is_a_column_and_unknown_values_are_empty() -> None:
    frame = pd.DataFrame(
        {"a": [None, 1.5], "b": ["=x", None]}, index=pd.Index(["-y", "z"], name="n")
    )
    assert rows(csv_text(frame)) == [["n", "a", "b"], ["'-y", "", "'=x"], ["z", "1.5", ""]]
