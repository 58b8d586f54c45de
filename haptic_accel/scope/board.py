"""What the graph's nodes say of themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

EXPECTED = ("master_device", "slave_device", "coupler", "compensator", "recorder")
"""Nodes that are shown even when they have said nothing."""

SILENCE = 2.5
"""After which a node counts as silent, s: two of its reports are missing then, they come once a
second."""

LEVELS = {0: "OK", 1: "warning", 2: "error"}
"""Of diagnostics; any other counts as stale."""


@dataclass(frozen=True)
class Report:
    """The last diagnostics of a node, and when they came (steady time, s)."""

    level: int
    message: str
    values: Mapping[str, str]
    moment: float


class Board:
    """The last report of every node; one thread takes, another may read."""

    def __init__(self) -> None:
        self._reports: dict[str, Report] = {}

    def take(self, node: str, report: Report) -> None:
        """Take what a node says."""
        # A new dictionary, so that no reader sees one change.
        self._reports = {**self._reports, node: report}

    def values(self, node: str, now: float) -> Mapping[str, str]:
        """Return what a node says of itself; nothing if it has fallen silent."""
        report = self._reports.get(node)
        return report.values if report and now - report.moment < SILENCE else {}

    def rows(self, now: float, expected: Sequence[str] = EXPECTED) -> list[dict[str, str]]:
        """Return name, state and message of every node, those first that are expected."""
        reports = self._reports
        names = [*expected, *(name for name in reports if name not in expected)]
        return [{"name": name, **_row(reports.get(name), now)} for name in names]


def _row(report: Report | None, now: float) -> dict[str, str]:
    if report is None:
        return {"state": "absent", "message": "not heard yet"}
    silent = now - report.moment
    if silent >= SILENCE:
        return {"state": "silent", "message": f"silent for {silent:.0f} s"}
    state = LEVELS.get(report.level, "silent")
    return {"state": state, "message": "" if report.message == state else report.message}
