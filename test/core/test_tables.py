# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_accel.core.tables import DASH, Column, ResultTable, records

COLUMNS = (
    Column("name", "name"),
    Column("speed_m_s", "speed", "mm/s", 1, lambda row: row.speed, 1e3),
    Column("", "rate", "Hz", value=lambda row: 2 * row.rate),
)


@dataclass
class Condition:
    name: str
    speed: float | None
    rate: float


ROWS = [Condition("a", -0.00123, 500.0), Condition("b", None, math.pi)]


def test_text_has_units_and_digits_of_its_columns() -> None:
    table = ResultTable.of(COLUMNS, ROWS, title="both")
    assert table.headings == ["name", "speed (mm/s)", "rate (Hz)"]
    assert table.rows == [["a", "−1.2", "1000"], ["b", DASH, "6.28319"]]


def test_json_has_all_digits_of_the_columns_with_a_key() -> None:
    assert records(COLUMNS, ROWS) == [
        {"name": "a", "speed_m_s": -0.00123},
        {"name": "b", "speed_m_s": None},
    ]


def test_an_undefined_number_is_a_dash() -> None:
    assert Column("x", "x", digits=2).text(math.nan) == DASH
    assert Column("x", "x").of({}) is None
