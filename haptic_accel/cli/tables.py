# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from haptic_accel.core.parameters import printable
from haptic_accel.core.tables import ResultTable


def print_table(table: ResultTable) -> None:
    """Print a table, or each row as lines if the terminal is too narrow for the numbers.

    Plain text is printed without markup, with control characters escaped; `rich` text is printed
    unchanged.
    """
    console = Console()
    rows = [
        [each if isinstance(each, Text) else Text(printable(each, "\n")) for each in row]
        for row in table.rows
    ]
    widths = [_number_width(column) for column in zip(*rows, strict=True)]
    if sum(widths) + FRAME * len(widths) + 1 > console.width:
        _print_lines(console, table, rows)
        return
    shown = Table(title=table.title or None, caption=table.note or None, caption_justify="left")
    for index, heading in enumerate(table.headings):
        side: Literal["left", "right"] = "left" if index < table.left else "right"
        width = widths[index] if rows else None
        shown.add_column(heading, justify=side, overflow="fold", min_width=width)
    for row in rows:
        shown.add_row(*row)
    console.print(shown)


FRAME = 3
"""Width of a column's frame and margins, characters; the table's frame adds one."""


NAME = 4
"""Minimum width of a column without numbers, in which words may be broken, characters."""


def _number_width(column: Sequence[Text]) -> int:
    """Return the width below which a number in a column would be broken."""
    parts = (part for cell in column for part in cell.plain.split())
    numbers = (w for w in parts if any(map(str.isdigit, w)) and not any(map(str.isalpha, w)))
    return max(NAME, *map(cell_len, numbers), 0)


def _print_lines(console: Console, table: ResultTable, rows: Sequence[Sequence[Text]]) -> None:
    """Print each row as lines of heading and cell."""
    if table.title:
        console.print(Text(table.title))
    for row in rows:
        console.print()
        for heading, cell in zip(table.headings, row, strict=True):
            if cell.plain:
                console.print(Text.assemble(f"{heading}: " if heading else "", cell))
    if table.note:
        console.print(Text(table.note))
