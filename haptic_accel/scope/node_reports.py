"""Latest diagnostics of the graph's nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

EXPECTED = ("master_device", "slave_device", "coupler", "compensator", "recorder")
"""Nodes that are shown even if they have sent no diagnostics."""

SILENCE = 2.5
"""Time without diagnostics after which a node counts as silent, s: two reports are missing then,
as nodes send one per second."""

LEVELS = {0: "OK", 1: "warning", 2: "error"}
"""State by diagnostic level; any other level counts as silent."""


@dataclass(frozen=True)
class NodeReport:
    """Diagnostics of a node, with the steady time of their arrival in s."""

    level: int
    message: str
    values: Mapping[str, str]
    moment: float


class NodeReports:
    """Latest report of every node; one thread writes, another may read."""

    def __init__(self) -> None:
        self._reports: dict[str, NodeReport] = {}

    def take(self, node: str, report: NodeReport) -> None:
        """Store the report of a node."""
        # A new dictionary, so that no reader sees one change.
        self._reports = {**self._reports, node: report}

    def values(self, node: str, now: float) -> Mapping[str, str]:
        """Return the values that a node reported; none if it has fallen silent."""
        report = self._reports.get(node)
        return report.values if report and now - report.moment < SILENCE else {}

    def rows(self, now: float, expected: Sequence[str] = EXPECTED) -> list[dict[str, str]]:
        """Return name, state and message of every node, expected nodes first."""
        reports = self._reports
        names = [*expected, *(name for name in reports if name not in expected)]
        return [{"name": name, **_row(reports.get(name), now)} for name in names]


def _row(report: NodeReport | None, now: float) -> dict[str, str]:
    if report is None:
        return {"state": "absent", "message": "no diagnostics received yet"}
    silent = now - report.moment
    if silent >= SILENCE:
        return {"state": "silent", "message": f"no diagnostics for {silent:.0f} s"}
    state = LEVELS.get(report.level, "silent")
    return {"state": state, "message": "" if report.message == state else report.message}
