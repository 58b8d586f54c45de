# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Latest diagnostics of the graph's nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

EXPECTED = ("master_device", "slave_device", "coupler", "compensator", "recorder")
"""Nodes that are shown even if they have sent no diagnostics."""

NETWORK = (
    "delay {one-way delay (ms)} ms, loss {packet loss (%)} %, clock {clock offset (ms)} ms,"
    " energy {energy account (mJ)} mJ"
)
"""Line for a node with a peer host, of the values that it reports."""

SILENCE = 2.5
"""Time without diagnostics after which a node counts as silent, s: two reports are missing then,
as nodes send one per second."""

LEVELS = {0: "OK", 1: "warning", 2: "error"}
"""State by diagnostic level; any other level counts as silent."""


def expected_nodes(side: str) -> list[str]:
    """Return the nodes that are expected on a host with the arm of a side; empty for both."""
    of_peer = {
        "": (),
        "master": ("slave_device",),
        "slave": ("master_device", "compensator"),
    }
    return [name for name in EXPECTED if name not in of_peer[side]]


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
    if report.message != state:
        return {"state": state, "message": report.message}
    has_peer = report.values.get("one-way delay (ms)")
    return {"state": state, "message": NETWORK.format_map(report.values) if has_peer else ""}
