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

"""Tables for the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rich.console import Console
from rich.table import Table
from rich.text import Text

from haptic_accel.core.parameters import printable

Row: TypeAlias = dict[str, Any]
"""Results of one condition by name: a row of the JSON file, and of a table."""


@dataclass(frozen=True)
class Column:
    """Column of a table of results.

    Parameters
    ----------
    heading : str
        Name, with the unit.
    value : str or callable
        Key or attribute of the value in a row, or function of the row.
    form : str
        Format of the value.
    """

    heading: str
    value: str | Callable[[Any], Any]
    form: str = ""

    def cell(self, row: Any) -> str:
        """Return the value of a row as text; empty where it has none."""
        if callable(self.value):
            value = self.value(row)
        else:
            value = row.get(self.value) if isinstance(row, dict) else getattr(row, self.value)
        return "" if value is None else format(value, self.form)


def print_results(columns: Sequence[Column], rows: Iterable[Any], **settings: Any) -> None:
    """Print results as a table; `settings` are those of `print_table`."""
    cells = ([column.cell(row) for column in columns] for row in rows)
    print_table([column.heading for column in columns], cells, **settings)


def print_table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    *,
    left: int = 1,
    **settings: Any,
) -> None:
    """Print a table.

    Parameters
    ----------
    headings : sequence of str
    rows : iterable of sequence of str or Text
        A plain text has no markup, and is escaped where a terminal would obey it.
    left : int
        Number of columns aligned to the left: the first ones; numbers are aligned to the right.
    **settings
        Settings of `rich.table.Table`: title, caption.
    """
    table = Table(**settings)
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if place < left else "right", overflow="fold")
    for row in rows:
        table.add_row(
            *(each if isinstance(each, Text) else Text(printable(each, "\n")) for each in row)
        )
    Console().print(table)
