# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags cut into segments of one condition, and what is said of what they lack."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bag_maker import BagContent, meta, write_bag
from haptic_accel.analysis.description import UNKNOWN
from haptic_accel.analysis.segments import EXCLUDED_AFTER_CHANGE, Division, cut
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics

RATE = 1000.0
NAMES = {
    "tool": topics.TOOL_ACCELERATION.name,
    "desired": topics.DESIRED_ACCELERATION.name,
    "handle": topics.HANDLE_ACCELERATION.name,
    "force": topics.ACTUATOR_FORCE.name,
}


def content(seconds: float = 4.0, without: tuple[str, ...] = ()) -> BagContent:
    samples = round(seconds * RATE)
    generator = np.random.default_rng(1)
    signals = {name: generator.normal(size=samples) for name in NAMES.values()}
    for name in without:
        del signals[NAMES[name]]
    return BagContent(signals, RATE, meta("dynamic", "plywood", seed=3))


def cut_of(folder: Path, written: BagContent) -> Division:
    return cut(read_bag(write_bag(folder / "bag", written)))


def test_a_bag_of_one_condition_is_one_segment(tmp_path: Path) -> None:
    written = content()
    found = cut_of(tmp_path, written)
    assert found.problems == []
    (segment,) = found.segments
    assert (segment.condition.controller, segment.condition.surface) == ("dynamic", "plywood")
    assert (segment.rate, segment.seconds) == (RATE, 4.0)
    for name in NAMES.values():
        np.testing.assert_array_equal(segment.signals[name], written.signals[name])
    assert sum(segment.delivery.lost.values()) == 0


def test_a_change_of_controller_or_surface_ends_a_segment(tmp_path: Path) -> None:
    changes = [
        (3.0, "compensator", "controller", "inverse"),
        (3.0, "compensator", "controller", "inverse"),
        (6.0, "slave_device", "simulated.surface.name", "vinyl"),
        (6.5, "coupler", "scale", "2"),
    ]
    found = cut_of(tmp_path, replace(content(9.0), changes=changes))
    conditions = [(s.condition.controller, s.condition.surface) for s in found.segments]
    assert conditions == [("dynamic", "plywood"), ("inverse", "plywood"), ("inverse", "vinyl")]
    begins = [segment.begin for segment in found.segments]
    left_out = np.array([0.0, EXCLUDED_AFTER_CHANGE, EXCLUDED_AFTER_CHANGE])
    assert begins == pytest.approx(left_out + np.arange(0.0, 9.0, 3.0), abs=2 / RATE)
    lengths = [segment.seconds for segment in found.segments]
    assert lengths == pytest.approx(3.0 - left_out, abs=3 / RATE)


def test_a_surface_changed_in_part_is_another_one(tmp_path: Path) -> None:
    changes = [(2.0, "slave_device", "simulated.surface.friction", "0.9")]
    written = content(4.0)
    written.metadata["parameters"]["slave_device"]["simulated.surface.friction"] = 0.35
    found = cut_of(tmp_path, replace(written, changes=changes))
    names = [segment.condition.surface for segment in found.segments]
    assert names == ["plywood", "plywood (altered)"]


def test_a_scene_stands_for_the_surface(tmp_path: Path) -> None:
    made = content(6.0)
    made.metadata["arguments"] |= {"slave": "virtual", "scene": "workshop"}
    made.metadata["parameters"]["slave_device"]["virtual.scene"] = "/config/scenes/workshop.yaml"
    changes = [(3.0, "slave_device", "virtual.scene", "/home/me/mat.yaml")]
    found = cut_of(tmp_path, replace(made, changes=changes))
    assert [segment.condition.surface for segment in found.segments] == ["workshop", "mat"]


@pytest.mark.parametrize(
    ("slave", "given", "scene", "surface"),
    [
        ("simulated", "plywood", "", "plywood"),
        ("virtual", "plywood", "/config/scenes/workshop.yaml", "workshop"),
        ("none", "", "", UNKNOWN),
        ("serial", "vinyl", "", "vinyl"),
    ],
)
def test_what_another_device_would_touch_is_no_condition(
    tmp_path: Path, slave: str, given: str, scene: str, surface: str
) -> None:
    written = content(4.0)
    written.metadata["arguments"] |= {"slave": slave, "surface": given}
    written.metadata["parameters"]["slave_device"]["virtual.scene"] = scene
    # A recorder that was there first hears of the parameters as they are declared.
    declared = [("simulated.surface.name", "plywood"), ("virtual.scene", scene)]
    if slave == "virtual":
        declared.reverse()
    changes = [(index / RATE, "slave_device", *each) for index, each in enumerate(declared)]
    (segment,) = cut_of(tmp_path, replace(written, changes=changes)).segments
    assert segment.condition.surface == surface


def test_arms_that_let_go_end_a_segment(tmp_path: Path) -> None:
    found = cut_of(tmp_path, replace(content(5.0), gap=(2.0, 3.0)))
    begins = [segment.begin for segment in found.segments]
    assert begins == pytest.approx([0.0, 3.0], abs=2 / RATE)
    assert [s.seconds for s in found.segments] == pytest.approx([2.0, 2.0], abs=2 / RATE)


def test_times_without_any_signal_divide_a_trial_and_are_named(tmp_path: Path) -> None:
    written = content(4.0)
    lost = [*range(1000, 1200), *range(2500, 2900)]
    dropped = {name: lost for name in (*NAMES.values(), topics.MASTER_ARM_FORCE.name)}
    found = cut_of(tmp_path, replace(written, dropped=dropped))
    assert [segment.seconds for segment in found.segments] == [1.0, 1.3, 1.1]
    told = [problem[:29] for problem in found.problems if "no signal for" in problem]
    assert told == ["no signal for 0.201 s at 1.0 ", "no signal for 0.401 s at 2.5 "]
    for segment, begin in zip(found.segments, (0, 1200, 2900), strict=True):
        signal = written.signals[NAMES["tool"]][begin:][: round(segment.seconds * RATE)]
        np.testing.assert_array_equal(segment.signals[NAMES["tool"]], signal)
        assert segment.delivery.missed["master"] == 0


@pytest.mark.parametrize(
    ("lacking", "said"),
    [
        ("tool", "has no slave/tool/acceleration"),
        ("handle", "no error, regression, spectra, delay, travel"),
        ("force", "no force, travel"),
    ],
)
def test_a_missing_signal_is_named_with_what_follows(
    tmp_path: Path, lacking: str, said: str
) -> None:
    found = cut_of(tmp_path, content(2.0, without=(lacking,)))
    assert len(found.segments) == 1
    assert any(said in problem for problem in found.problems)
    assert NAMES[lacking] not in found.segments[0].signals


def test_what_is_desired_is_made_from_the_tool_where_it_is_missing(tmp_path: Path) -> None:
    found = cut_of(tmp_path, content(2.0, without=("desired",)))
    assert NAMES["desired"] in found.segments[0].signals
    assert any("made from the tool's acceleration" in problem for problem in found.problems)


@pytest.mark.parametrize(
    ("stated", "controller", "said"),
    [
        ({}, UNKNOWN, "does not state how it was made"),
        (meta("dynamic", "plywood", rate=4000.0), "dynamic", "in place of the 4000"),
    ],
)
def test_what_a_bag_does_not_say_or_stamps_contradict_is_named(
    tmp_path: Path, stated: dict[str, Any], controller: str, said: str
) -> None:
    found = cut_of(tmp_path, replace(content(), metadata=stated))
    (segment,) = found.segments
    assert segment.condition.controller == controller
    assert (segment.condition.surface == UNKNOWN) == (not stated)
    assert segment.rate == RATE
    assert any(said in problem for problem in found.problems)


def test_where_arm_forces_are_zero_the_time_in_which_they_came_is_taken(tmp_path: Path) -> None:
    late = {topics.MASTER_ARM_FORCE.name: range(round(1.0 * RATE))}
    found = cut_of(tmp_path, replace(content(3.0), pull=0.0, dropped=late))
    (segment,) = found.segments
    assert segment.seconds == pytest.approx(2.0, abs=0.01)
    assert any("forces are zero" in problem for problem in found.problems)


def test_without_arm_forces_all_is_taken_and_said(tmp_path: Path) -> None:
    found = cut_of(tmp_path, replace(content(), arms=False))
    assert len(found.segments) == 1
    assert any("coupled is not known" in problem for problem in found.problems)


@pytest.mark.parametrize("count", [1, 3300, 4000])
@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e30])
def test_samples_that_are_not_finite_are_missing_and_counted(
    tmp_path: Path, count: int, value: float
) -> None:
    written = content()
    name = NAMES["handle"]
    first = (4000 - count) // 2
    written.signals[name][first : first + count] = value
    found = cut_of(tmp_path, written)
    said = f"{name}: {count} of 4000 samples count as missing: no numbers, or beyond 1e+09"
    assert said in found.problems
    (segment,) = found.segments
    assert (name in segment.signals) == (count < 4000)
    assert np.isfinite([*segment.signals.values()]).all()
    lost = segment.delivery.lost.get(name, 0) + segment.delivery.missed.get("master", 0)
    assert lost == count or count == 4000


def test_ages_and_warnings_are_those_of_the_segment(tmp_path: Path) -> None:
    diagnostics = [
        (0.5, "master_device", "OK", {"actuator force age p50 (us)": "100.0"}),
        (1.3, "master_device", "stalled for 9 ms, 30 of 2000 deadlines missed", {}),
        (1.5, "master_device", "stalled for 30 ms", {"actuator force age p50 (us)": "130.0"}),
        (1.6, "slave_device", "arm force timed out", {"actuator force age p50 (us)": "99.0"}),
    ]
    (segment,) = cut_of(tmp_path, replace(content(2.0), diagnostics=diagnostics)).segments
    assert segment.delivery.age_us == {"p50": 130.0}
    assert segment.delivery.warnings == [
        "master_device: stalled for 30 ms (2 times)",
        "slave_device: arm force timed out",
    ]


@pytest.mark.parametrize(
    ("arguments", "surface"),
    [
        ({"slave": "replay", "replay": "/bags/monday.mcap"}, "replay of monday"),
        ({"slave": "topics"}, "played topics"),
        ({"surface": "recording", "recording": "plate.csv"}, "recording"),
        ({"surface": "plate.csv"}, "recording"),
        ({"surface": "/home/me/my_wood.yaml"}, "plywood"),
    ],
)
def test_a_surface_is_called_what_it_was(
    tmp_path: Path, arguments: dict[str, str], surface: str
) -> None:
    written = content(2.0)
    written.metadata["arguments"].update(arguments)
    (segment,) = cut_of(tmp_path, written).segments
    assert segment.condition.surface == surface
