# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.cli.output import StoppedError
from haptic_accel.cli.studies import Journal, key_of, run_study
from haptic_accel.core.parameters import ParameterError

NUMBERS = [0.1, 1 / 3, 1e-300, -2.5e17, 7.0]


@dataclass(frozen=True)
class Condition:
    number: float
    samples: Any = None
    file: str = ""


def conditions() -> list[Condition]:
    return [Condition(number) for number in NUMBERS]


def line(number: float) -> str:
    return f"is {number}"


def run(file: Path, ends: int, items: Sequence[Condition] | None = None) -> tuple[Any, list[Any]]:
    """Run a study that a failure ends after some conditions; return results and what was run."""
    begun: list[Any] = []

    def start(left: Sequence[Condition], *_: Any) -> Iterator[tuple[int, float]]:
        for index, condition in enumerate(left):
            if index == ends:
                raise StoppedError("a graph failed")
            begun.append(condition)
            yield index, condition.number / 3

    given = conditions() if items is None else list(items)
    return run_study(start, given, "conditions", line, Journal(file)), begun


def test_an_interrupted_study_goes_on_with_the_same_digits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.part"
    (first, end), _ = run(file, 3)
    assert str(end) == "a graph failed after 3 of 5 conditions; the same command goes on"
    assert len(first) == 3
    (found, end), begun = run(file, 9)
    assert end is None
    assert found == {index: number / 3 for index, number in enumerate(NUMBERS)}
    assert [each.number for each in begun] == NUMBERS[3:]
    assert not file.exists()
    assert f"3 of 5 conditions are taken from {file}" in capsys.readouterr().out


@given(length=st.integers(0, 400), tail=st.binary(max_size=20))
def test_a_file_cut_anywhere_gives_results_of_whole_lines_alone(
    tmp_path_factory: pytest.TempPathFactory, length: int, tail: bytes
) -> None:
    file = tmp_path_factory.mktemp("study") / "study.part"
    run(file, 4)
    whole = file.read_bytes()
    file.write_bytes(whole[:length] + tail.replace(b"\n", b""))
    journal = Journal(file)
    lines = whole[:length].count(b"\n")
    known = [journal.result(key_of(each)) for each in conditions()]
    assert known == [number / 3 for number in NUMBERS[:lines]] + [None] * (5 - lines)


def test_a_result_counts_for_its_condition_alone(tmp_path: Path) -> None:
    measured = tmp_path / "drag.csv"
    measured.write_text("1\n2\n")
    condition = Condition(1.0, np.arange(5000.0), str(measured))
    journal = Journal(tmp_path / "study.part")
    journal.add(key_of(condition), 5.0)
    journal = Journal(tmp_path / "study.part")
    assert journal.result(key_of(replace(condition, samples=np.arange(5000.0)))) == 5.0
    other = np.arange(5000.0)
    other[2500] += 1e-12
    assert journal.result(key_of(replace(condition, samples=other))) is None
    assert journal.result(key_of(replace(condition, number=2.0))) is None
    os.utime(measured, (1, 1))
    assert journal.result(key_of(condition)) is None


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=f"{tmp_path}/none/study.part: No such file"):
        run(tmp_path / "none" / "study.part", 3)
    with pytest.raises(ParameterError, match=f"{tmp_path}: must be a readable file: is a folder"):
        Journal(tmp_path)
