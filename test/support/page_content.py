# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pages as readers see them."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path


class Page(HTMLParser):
    """Content of a page: tables as lists of rows, links, pictures, and the text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.folder = path.parent
        self.html = path.read_text(encoding="utf-8")
        self.tags: list[str] = []
        self.links: list[str] = []
        self.sources: list[str] = []
        self.pictures: list[dict[str, str]] = []
        self.tables: list[list[list[str]]] = []
        self.text = ""
        self._cell: list[str] | None = None
        self.feed(self.html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        self.tags.append(tag)
        for name, found in (("href", self.links), ("src", self.sources)):
            found += [attributes[name]] if name in attributes else []
        if tag == "img":
            self.pictures.append(attributes)
        elif tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in {"td", "th"}:
            self._cell = self.tables[-1][-1]
            self._cell.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag in {"td", "th"} and self._cell:
            self._cell[-1] = " ".join(self._cell[-1].split())
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self.lasttag not in ("style", "script"):
            self.text += data
        if self._cell is not None:
            self._cell[-1] += data

    def row(self, table: int, name: str) -> list[str]:
        """Return the cells after a row's name, which is matched by its first word."""
        rows = (row for row in self.tables[table] if row[0].split(" ")[0] == name)
        return next(rows)[1:]
