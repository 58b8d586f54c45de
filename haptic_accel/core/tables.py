# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of results: each column is declared once, for text, JSON and pages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

DASH = "\N{EN DASH}"
"""Text for an undefined number."""

Row: TypeAlias = dict[str, Any]
"""Results of one condition by name: a row of the JSON file, and of a table."""


def number(value: float | None, decimals: int = 2, unit: str = "") -> str:
    """Return a number as text, or a dash if it is undefined."""
    if value is None or not math.isfinite(value):
        return DASH
    rounded = round(value, decimals) + 0.0  # no minus sign before zero
    return f"{rounded:.{decimals}f}{unit}".replace("-", "\N{MINUS SIGN}")


@dataclass(frozen=True)
class Column:
    """Column of a table of results.

    Parameters
    ----------
    key : str
        Name of the value in JSON, empty for text alone; without `value`, also its key or attribute
        in a row.
    label : str
        Name of the value for readers.
    unit : str
        Unit of the text.
    digits : int, optional
        Number of decimals of the text; by default as few as possible.
    value : callable, optional
        Returns the value of a row.
    factor : float
        Text units per unit of the value.
    low, high : float
        Ends of the range of possible values.
    """

    key: str
    label: str
    unit: str = ""
    digits: int | None = None
    value: Callable[[Any], Any] | None = None
    factor: float = 1.0
    low: float = -math.inf
    high: float = math.inf

    @property
    def heading(self) -> str:
        """Label and unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def of(self, row: Any) -> Any:
        """Return the value of a row."""
        if self.value:
            return self.value(row)
        return row.get(self.key) if isinstance(row, dict) else getattr(row, self.key)

    def text(self, value: Any) -> str:
        """Return a value as text: a dash if it is undefined."""
        if value is None or self.digits is not None:
            return number(value and value * self.factor, self.digits or 0)
        return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class ResultTable:
    """Table for a terminal or a page.

    Parameters
    ----------
    headings : sequence of str
    rows : iterable of sequence
        Cells: texts, or objects that a terminal can show instead.
    title, note : str
        Lines above and below the table.
    left : int
        Number of columns aligned to the left: the first ones; numbers are aligned to the right.
    """

    headings: Sequence[str]
    rows: Iterable[Sequence[Any]]
    title: str = ""
    note: str = ""
    left: int = 1

    @classmethod
    def of(cls, columns: Sequence[Column], rows: Iterable[Any], **texts: Any) -> ResultTable:
        """Return the table of results by column; `texts` are further parameters of the table."""
        cells = [[column.text(column.of(row)) for column in columns] for row in rows]
        return cls([column.heading for column in columns], cells, **texts)


def records(columns: Sequence[Column], rows: Iterable[Any]) -> list[Row]:
    """Return results by column for a JSON file."""
    return [{each.key: each.of(row) for each in columns if each.key} for row in rows]
