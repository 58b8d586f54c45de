# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables in the documentation that come from the code: commands, arguments, parameters.

``python docs/tables.py`` puts each table of a kit or driver between its marks in a page: a line
with the comment ``table: NAME``, and one with the comment ``end``. ``python docs/tables.py
parameters`` prints the parameters of all nodes; the site has a page of them, which it makes of
`reference`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from haptic_accel.cli.commands import command_line
from haptic_accel.core.parameters import Checked, Specification, allowed_values, own_schema
from haptic_accel.devices.audio import PRESETS
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments
from haptic_accel.setup.node_parameters import NODES, node_schema
from haptic_accel.setup.words import described, group

SOURCE = Path(__file__).resolve().parents[1]
PAGES = "docs/*.md", "haptic_accel/**/*.md"
"""Pages with tables, from the repository's root."""

PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def row(*cells: str) -> str:
    """Return a row of a table in Markdown."""
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def table(headings: Iterable[str], rows: Iterable[str]) -> str:
    """Return a table in Markdown with its line end."""
    heads = list(headings)
    return "\n".join([row(*heads), "|" + "---|" * len(heads), *rows, ""])


def code(value: Any) -> str:
    """Return a default as code, or nothing for an empty text."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    text = f"{value:g}" if isinstance(value, float) and len(text) > 8 else text
    return f"`{text}`" if text else ""


def commands() -> str:
    """Return the verbs of ``haptic-accel`` with their summaries, under headings."""
    rows = []
    for heading, verbs in command_line.sections.items():
        rows.append(row(f"**{heading}**", ""))
        rows += [row(f"`{verb}`", summary) for verb, summary in verbs.items()]
    return table(("command", "purpose"), rows)


def arguments(kind: type[Checked]) -> str:
    """Return the arguments of a dataclass, under headings."""
    rows, above = [], ""
    for name, default, text in described(kind):
        if (heading := group(kind, name)) != above:
            rows.append(row(f"**{heading}**", "", ""))
            above = heading
        rows.append(row(f"`{name}`", code(default), text))
    return table(("argument", "default", "meaning"), rows)


def parameters() -> str:
    """Return the parameters of all nodes, those that several nodes share only once."""
    sharing: dict[tuple[str, Any, Specification], list[str]] = {}
    for node in NODES:
        for name, (default, specification) in node_schema(node).items():
            sharing.setdefault((name, default, specification), []).append(node)
    sections: dict[tuple[str, ...], list[str]] = {}
    for (name, default, specification), nodes in sharing.items():
        cells = code(default), allowed_values(default, specification), specification.text
        sections.setdefault(tuple(nodes), []).append(row(f"`{name}`", *cells))
    parts = []
    for nodes in sorted(sections, key=lambda nodes: (len(nodes) == 1, -len(nodes))):
        headings = ("parameter", "default", "allowed", "meaning")
        parts.append(f"### {', '.join(nodes)}\n\n{table(headings, sorted(sections[nodes]))}")
    return "\n" + "\n".join(parts) + "\n"


def study() -> str:
    """Return the keys of a study's protocol that have a default."""
    # Here, as other tables do not need the kit.
    from haptic_accel.kits.study.protocol import PlannedTest
    from haptic_accel.kits.study.reading import SECTIONS

    rows = [
        row(f"`{section}.{name}`", code(default), allowed_values(default, each), each.text)
        for section, kind in (SECTIONS | {"tests": PlannedTest}).items()
        for name, (default, each) in own_schema(kind).items()
    ]
    return table(("key", "default", "allowed", "meaning"), rows)


def study_columns() -> str:
    """Return the columns of a study's tables."""
    from haptic_accel.kits.study.tables import COLUMNS

    rows = [row(f"`{each.key}`", each.unit, each.label) for each in COLUMNS.values()]
    return table(("column", "unit", "meaning"), rows)


def audio_presets() -> str:
    """Return the kinds of coils on sound cards."""
    rows = [
        row(
            f"`{name}`",
            each.device or "the default",
            each.channels,
            f"{each.rate:g} Hz" if each.rate else "the card's",
            each.assumed,
            each.unknown,
        )
        for name, each in PRESETS.items()
    ]
    headings = ("preset", "card", "channels", "rate", "assumed", "to be identified")
    return table(headings, rows)


TABLES: dict[str, Callable[[], str]] = {
    "study_columns": study_columns,
    "study": study,
    "audio_presets": audio_presets,
}
"""Tables within pages."""

REFERENCE: dict[str, tuple[str, Callable[[], str]]] = {
    "commands": ("Commands", commands),
    "teleop": ("Arguments of the graph", partial(arguments, GraphArguments)),
    "identify": ("Arguments of identify", partial(arguments, IdentifyArguments)),
    "parameters": ("Parameters of the nodes", parameters),
}
"""Headings and tables of the site's reference."""


def reference() -> str:
    """Return the page of commands, arguments and parameters, which only the site has."""
    parts = (f"## {heading}\n\n{text()}" for heading, text in REFERENCE.values())
    return "# Commands, arguments, parameters\n\n" + "\n".join(parts)


def with_tables(text: str) -> str:
    """Return a page with its tables as the code has them."""
    return PLACE.sub(lambda place: f"{place[1]}{TABLES[place[2]]()}{place[3]}", text)


def main(names: list[str]) -> None:
    """Print tables of the reference, or rewrite the tables of all pages."""
    for name in names:
        if name not in REFERENCE:
            raise SystemExit(f"{name}: must be one of {', '.join(REFERENCE)}")
        print(REFERENCE[name][1]())
    for page in () if names else (path for part in PAGES for path in SOURCE.glob(part)):
        text = page.read_text(encoding="utf-8")
        if (new := with_tables(text)) != text:
            page.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
