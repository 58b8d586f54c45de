"""What nodes say of themselves, and what they do not."""

from __future__ import annotations

import pytest

from haptic_accel.scope.board import EXPECTED, SILENCE, Board, Report


def row(board: Board, node: str, now: float) -> dict[str, str]:
    (found,) = [row for row in board.rows(now) if row["name"] == node]
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
    board = Board()
    board.take("coupler", Report(level, message, {}, 10.0))
    assert row(board, "coupler", 10.5) == {"name": "coupler", "state": state, "message": shown}


def test_who_is_expected_is_shown_before_it_speaks_and_others_after() -> None:
    board = Board()
    board.take("identifier", Report(0, "OK", {}, 0.0))
    rows = board.rows(0.0)
    assert [row["name"] for row in rows] == [*EXPECTED, "identifier"]
    assert {row["state"] for row in rows[:-1]} == {"absent"}


def test_who_falls_silent_is_said_to_be_and_believed_no_more() -> None:
    board = Board()
    board.take("coupler", Report(0, "OK", {"engaged": "true"}, 0.0))
    assert board.values("coupler", SILENCE - 0.1) == {"engaged": "true"}
    assert row(board, "coupler", SILENCE)["state"] == "silent"
    assert board.values("coupler", SILENCE) == {}
    board.take("coupler", Report(0, "OK", {"engaged": "false"}, 9.0))
    assert row(board, "coupler", 9.0)["state"] == "OK"
