# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""One bag in many guises has the same figures to the last digit, or a line says why not."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from guises import BAG_CHANGES, BagForm, Kind, write_form
from hypothesis import given
from hypothesis import strategies as st

from bag_maker import START, Message, facts, vector_bytes
from fuzzing import fuzz_fewest
from haptic_accel.analysis import loading
from haptic_accel.analysis.loading import analyse
from haptic_accel.analysis.segments import Segment
from haptic_accel.bags.facts import PREFIX
from haptic_accel.core import topics

RATE, SAMPLES, DELAY, GAIN = 1000.0, 1500, 1, 0.8


@cache
def right() -> BagForm:
    """Return a bag whose handle repeats 0.8 of the desired acceleration one sample later.

    The error is thus 20 % by theory: RMS of 0.2 times the signal over RMS of the signal.
    """
    # Differences of white noise have hardly any power below the high-pass of the comparison.
    desired = np.diff(np.random.default_rng(3).normal(size=SAMPLES + 1))
    actual = GAIN * np.concatenate([np.zeros(DELAY), desired[:-DELAY]])
    along = {
        topics.TOOL_ACCELERATION: desired,
        topics.DESIRED_ACCELERATION: desired,
        topics.HANDLE_ACCELERATION: actual,
        topics.ACTUATOR_FORCE: 0.1 * actual,
        topics.MASTER_ARM_FORCE: np.ones(SAMPLES),
    }
    messages = []
    for place in range(SAMPLES):
        stamp = START + round(place * 1e9 / RATE)
        for topic, values in along.items():
            data = vector_bytes(topic.type, stamp, "", (0.0, 0.0, float(values[place])))
            messages.append(Message(f"/{topic.name}", topic.type, stamp, data))
    stated = facts("constant", "vinyl", rate=RATE)
    custom = {
        PREFIX + name: value if isinstance(value, str) else json.dumps(value)
        for name, value in stated.items()
    }
    return BagForm(tuple(messages), custom)


def figures(form: BagForm, folder: Path) -> tuple[object, list[str]]:
    """Return all metrics of all trials of a bag, and the lines on it."""
    found = analyse([write_form(form, folder)])
    metrics = [
        {name: repr(value) for name, value in trial.metrics.items()} for trial in found.trials
    ]
    lines = [line for lines in found.problems.values() for line in lines]
    return metrics, lines


BAGS = Kind(right, BAG_CHANGES, figures)

choices = st.lists(
    st.tuples(st.sampled_from(sorted(BAG_CHANGES)), st.floats(0, 1), st.floats(0, 1)),
    min_size=1,
    max_size=3,
)


@cache
def truth() -> object:
    with TemporaryDirectory() as folder:
        metrics, lines = figures(right(), Path(folder))
    assert lines == []
    return metrics


def test_the_right_form_has_the_error_of_theory(tmp_path: Path) -> None:
    (trial,) = analyse([write_form(right(), tmp_path)]).trials
    assert trial.metrics["nrmse_percent"] == pytest.approx(100 * (1 - GAIN), abs=0.5)
    assert trial.segment.seconds == SAMPLES / RATE


@pytest.mark.parametrize("change", sorted(BAG_CHANGES))
def test_each_change_of_form(tmp_path: Path, change: str) -> None:
    check([(change, 0.3, 0.7)], tmp_path)


SAME = [
    [("split", 0.3, 0.0), ("split", 0.6, 0.0), ("renamed", 0.0, name)] for name in (0.3, 0.5, 0.7)
] + [
    [("split", 0.4, 0.0), ("listed in reverse", 0.0, 0.0)],
    [("other storage", 0.0, 0.0)],
    [("compressed by file", 0.0, 0.0)],
    [("compressed by message", 0.0, 0.0)],
    [("compressed by message", 0.0, 0.0), ("no metadata", 0.0, 0.0)],
    [("split", 0.4, 0.0), ("copy of a file", 0.0, 0.0)],
    [("file of another recording", 0.0, 0.0)],
    [("split", 0.4, 0.0), ("file of another recording", 0.0, 0.0), ("no metadata", 0.0, 0.0)],
    [("clock off", 0.0, 0.9)],
    [("clock set back", 0.5, 0.0)],
    [("clock set back", 0.5, 0.1)],
    [("clock set back", 0.5, 0.9)],
    [("split", 0.7, 0.0), ("clock set back", 0.5, 0.1), ("renamed", 0.0, 0.5)],
    [("clock slewed", 0.0, 0.95)],
    [("clock slewed", 0.9, 0.1)],
    [("blocks in another order", 0.4, 1.0)],
    [("by topic", 0.0, 0.0)],
    [("some messages twice", 0.3, 1.0)],
]
"""Changes after which all figures are the same."""


@pytest.mark.parametrize("made", SAME, ids=lambda made: ", ".join(name for name, *_ in made))
def test_changes_that_cost_nothing(tmp_path: Path, made: list[tuple[str, float, float]]) -> None:
    metrics, _ = figures(BAGS.changed(made), tmp_path)
    assert metrics == truth()


@fuzz_fewest
@given(choices)
def test_any_changes_of_form(made: list[tuple[str, float, float]]) -> None:
    with TemporaryDirectory() as folder:
        check(made, Path(folder))


def check(made: list[tuple[str, float, float]], folder: Path) -> None:
    """Require the same figures, or a line that says why not."""
    metrics, lines = figures(BAGS.changed(made), folder)
    assert not any("cannot be analysed" in line for line in lines), lines
    assert metrics == truth() or lines


def test_a_clock_set_forward_leaves_the_parts(tmp_path: Path) -> None:
    found = analyse([write_form(BAGS.changed([("clock set forward", 0.8, 1.0)]), tmp_path)])
    # Of 1.5 s, 1.11 s are before the step; the rest is too short for a trial.
    assert [round(trial.segment.seconds, 2) for trial in found.trials] == [1.11]
    (lines,) = found.problems.values()
    assert [line[:30] for line in lines] == [
        "no signal for 5.001 s at 1.1 s",
        "constant on vinyl, 0.39 s at 6",
    ]


def test_one_bag_that_fails_costs_no_other_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("good", "bad"):
        (tmp_path / name).mkdir()
        write_form(right(), tmp_path / name)
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
