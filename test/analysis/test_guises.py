# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One bag in many guises has the same figures to the last digit, or a line says why not."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from fuzzing import fuzz_fewest
from guises import BAG_CHANGES, GAIN, RATE, SAMPLES, BagForm, Kind, Made, right_bag, write_form
from haptic_accel.analysis import loading
from haptic_accel.analysis.loading import analyse
from haptic_accel.analysis.segments import Segment


def figures(form: BagForm, folder: Path) -> tuple[object, list[str]]:
    """Return all metrics of all trials of a bag, and the lines on it."""
    found = analyse([write_form(form, folder)])
    metrics = [
        {name: repr(value) for name, value in trial.metrics.items()} for trial in found.trials
    ]
    lines = [line for lines in found.problems.values() for line in lines]
    assert not any("cannot be analysed" in line for line in lines), lines
    return metrics, lines


BAGS = Kind(right_bag, BAG_CHANGES, figures)


def test_the_right_form_has_the_error_of_theory(tmp_path: Path) -> None:
    (trial,) = analyse([write_form(right_bag(tmp_path), tmp_path)]).trials
    assert trial.metrics["nrmse_percent"] == pytest.approx(100 * (1 - GAIN), abs=0.5)
    assert trial.segment.seconds == SAMPLES / RATE


@pytest.mark.parametrize("change", sorted(BAG_CHANGES))
def test_each_change_of_form(change: str) -> None:
    BAGS.check([(change, 0.3, 0.7)])


@fuzz_fewest
@given(BAGS.any_changes)
def test_any_changes_of_form(made: Made) -> None:
    BAGS.check(made)


def test_a_clock_set_forward_leaves_the_parts(tmp_path: Path) -> None:
    found = analyse(
        [write_form(BAGS.changed([("clock set forward", 0.8, 1.0)], tmp_path), tmp_path)]
    )
    # Of 1.5 s, 1.11 s are before the step; the rest is too short for a trial.
    assert [round(trial.segment.seconds, 2) for trial in found.trials] == [1.11]
    (lines,) = found.problems.values()
    assert [line[:30] for line in lines] == [
        "no signal for 5.004 s at 1.1 s",
        "constant on vinyl, 0.39 s at 6",
    ]


def test_one_bag_that_fails_costs_no_other_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("good", "bad"):
        (tmp_path / name).mkdir()
        write_form(right_bag(tmp_path), tmp_path / name)
    measure = loading.measure

    def failing(segment: Segment, *given: object, **rest: object) -> object:
        if segment.bag.parent.name == "bad":
            raise IndexError("a fault of the\nprogram")
        return measure(segment, *given, **rest)  # type: ignore[arg-type]

    monkeypatch.setattr(loading, "measure", failing)
    found = analyse([tmp_path])
    assert (len(found.trials), found.failed) == (1, 1)
    assert [*found.problems.values()] == [
        ["cannot be analysed: IndexError: a fault of the program"]
    ]
