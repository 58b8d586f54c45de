# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Work in a process of its own: done, refused, or ended at its bounds."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_accel.core.bounded_work import OutOfBoundsError, data_in_use, run_bounded
from haptic_accel.core.parameters import ParameterError
from running import called

WORK = """
import os, sys
from pathlib import Path
from haptic_accel.core.bounded_work import bounded
from haptic_accel.core.parameters import ParameterError

def work():
    kind = sys.argv[1]
    if kind == "time":
        while True:
            pass
    if kind == "memory":
        bytearray(10**9)
    if kind == "abort":
        os.abort()
    print("a library says something", end="")
    if kind == "wrong":
        raise ParameterError("wood: must be oak")
    Path(sys.argv[2]).write_text("done")

bounded(work, 1.0, 100)
"""


@pytest.fixture(autouse=True)
def _module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "greedy.py").write_text(WORK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def test_memory_is_counted_for_a_process_whose_name_is_no_text() -> None:
    with called(b"\xff"):
        assert data_in_use() > 0


def test_work_is_done(tmp_path: Path) -> None:
    run_bounded("greedy", ["well", str(tmp_path / "result")], 1.0)
    assert (tmp_path / "result").read_text() == "done"


def test_a_wrong_file_is_refused_in_the_words_of_the_work() -> None:
    with pytest.raises(ParameterError, match=r"^wood: must be oak$"):
        run_bounded("greedy", ["wrong"], 1.0)


@pytest.mark.parametrize(
    ("kind", "says"),
    [("time", "longer than 1 s"), ("memory", "too much memory"), ("abort", "crashes its reader")],
)
def test_work_is_ended_at_its_bounds(kind: str, says: str) -> None:
    with pytest.raises(OutOfBoundsError, match=says):
        run_bounded("greedy", [kind], 1.0)
