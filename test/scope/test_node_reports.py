"""Latest diagnostics of nodes, and their absence."""

from __future__ import annotations

import pytest

from haptic_accel.scope.node_reports import EXPECTED, SILENCE, NodeReport, NodeReports


def row(reports: NodeReports, node: str, now: float) -> dict[str, str]:
    (found,) = [row for row in reports.rows(now) if row["name"] == node]
    return found


@pytest.mark.parametrize(
    ("level", "message", "state", "shown"),
    [
        (0, "OK", "OK", ""),
        (1, "stalled for 30 ms", "warning", "stalled for 30 ms"),
        (2, "broken", "error", "broken"),
        (3, "stale", "silent", "stale"),
    ],
)
def test_a_level_becomes_a_word(level: int, message: str, state: str, shown: str) -> None:
    reports = NodeReports()
    reports.take("coupler", NodeReport(level, message, {}, 10.0))
    assert row(reports, "coupler", 10.5) == {"name": "coupler", "state": state, "message": shown}


def test_who_is_expected_is_shown_before_it_speaks_and_others_after() -> None:
    reports = NodeReports()
    reports.take("identifier", NodeReport(0, "OK", {}, 0.0))
    rows = reports.rows(0.0)
    assert [row["name"] for row in rows] == [*EXPECTED, "identifier"]
    assert {row["state"] for row in rows[:-1]} == {"absent"}


def test_who_falls_silent_is_said_to_be_and_believed_no_more() -> None:
    reports = NodeReports()
    reports.take("coupler", NodeReport(0, "OK", {"engaged": "true"}, 0.0))
    assert reports.values("coupler", SILENCE - 0.1) == {"engaged": "true"}
    assert row(reports, "coupler", SILENCE)["state"] == "silent"
    assert reports.values("coupler", SILENCE) == {}
    reports.take("coupler", NodeReport(0, "OK", {"engaged": "false"}, 9.0))
    assert row(reports, "coupler", 9.0)["state"] == "OK"
