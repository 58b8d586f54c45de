# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""State of a graph as a page shows it: the drawing of its scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.scenes import read_scene
from haptic_accel.scope import state as node_reports
from haptic_accel.scope.state import drawing, scene_of

SURFACE = {"device": "simulated", "simulated.surface.name": "vinyl"}


def test_of_a_simulated_surface_its_plane_is_drawn() -> None:
    assert scene_of(SURFACE) == "vinyl"
    drawn = drawing(SURFACE)
    ((line,),) = drawn["outlines"].values()
    assert {z for _, z in line} == {0}
    assert [x for x, _ in line] == list(drawn["view"][0])


def test_of_a_scene_the_outlines_of_all_its_objects_are_drawn() -> None:
    file = preset_file("scene", "workshop")
    slave = {"device": "virtual", "virtual.scene": str(file)}
    assert scene_of(slave) == str(file)
    scene, drawn = read_scene(file), drawing(slave)
    assert set(drawn["outlines"]) == {each.name for each in scene.objects}
    for each in scene.objects:
        for line in drawn["outlines"][each.name]:
            places = np.insert(np.array(line), 1, scene.start[1], axis=1)
            assert each.distances(places) == pytest.approx(0.0, abs=1e-3)
    assert drawn["offset"] == [scene.start[0], scene.start[2]]
    textured = {each.name for each in scene.objects if each.material.texture}
    assert set(drawn["nodes"]) == textured


def test_a_scene_whose_file_has_gone_is_not_drawn(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"gone\.yaml"):
        drawing({"device": "virtual", "virtual.scene": str(tmp_path / "gone.yaml")})


@pytest.mark.parametrize("slave", [{}, {"device": "can"}, {"device": "simulated"}])
def test_of_other_slaves_nothing_is_known(slave: dict[str, str]) -> None:
    assert scene_of(slave) is None
    assert drawing(slave)["outlines"] == {}


def row(reports: node_reports.NodeReports, node: str, now: float) -> dict[str, str]:
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
    reports = node_reports.NodeReports()
    reports.receive("coupler", node_reports.NodeReport(level, message, {}, 10.0))
    assert row(reports, "coupler", 10.5) == {"name": "coupler", "state": state, "message": shown}


def test_who_is_expected_is_shown_before_it_speaks_and_others_after() -> None:
    reports = node_reports.NodeReports()
    reports.receive("identifier", node_reports.NodeReport(0, "OK", {}, 0.0))
    rows = reports.rows(0.0)
    assert [row["name"] for row in rows] == [*node_reports.EXPECTED, "identifier"]
    assert {row["state"] for row in rows[:-1]} == {"absent"}


@pytest.mark.parametrize(
    ("side", "elsewhere"),
    [("", set()), ("master", {"slave_device"}), ("slave", {"master_device", "compensator"})],
)
def test_nodes_of_the_peers_arm_are_not_expected_here(side: str, elsewhere: set[str]) -> None:
    names = [
        row["name"]
        for row in node_reports.NodeReports().rows(0.0, node_reports.expected_nodes(side))
    ]
    assert names == [name for name in node_reports.EXPECTED if name not in elsewhere]


@pytest.mark.parametrize(
    ("told", "shown"),
    [
        (4, "delay 20.10 ms, loss 4.90 %, clock -0.120 ms, energy 4.800 mJ"),
        (1, "delay 20.10 ms, loss \u2013 %, clock \u2013 ms, energy \u2013 mJ"),
    ],
)
def test_a_peer_host_is_shown_by_what_it_tells(told: int, shown: str) -> None:
    values = {
        "one-way delay (ms)": "20.10",
        "packet loss (%)": "4.90",
        "clock offset (ms)": "-0.120",
        "energy tank (mJ)": "4.800",
    }
    reports = node_reports.NodeReports()
    known = dict([*values.items()][:told])
    reports.receive("coupler", node_reports.NodeReport(0, "OK", known, 0.0))
    assert row(reports, "coupler", 0.0)["message"] == shown


def test_who_falls_silent_is_said_to_be_and_believed_no_more() -> None:
    reports = node_reports.NodeReports()
    reports.receive("coupler", node_reports.NodeReport(0, "OK", {"engaged": "true"}, 0.0))
    assert reports.values("coupler", node_reports.SILENCE - 0.1) == {"engaged": "true"}
    assert row(reports, "coupler", node_reports.SILENCE)["state"] == "silent"
    assert reports.values("coupler", node_reports.SILENCE) == {}
    reports.receive("coupler", node_reports.NodeReport(0, "OK", {"engaged": "false"}, 9.0))
    assert row(reports, "coupler", 9.0)["state"] == "OK"


def test_of_a_flood_of_nodes_the_first_and_those_of_the_graph_are_shown() -> None:
    reports = node_reports.NodeReports()
    report = node_reports.NodeReport(0, "OK", {}, 0.0)
    taken = [reports.receive(f"node {k}", report) for k in range(node_reports.MOST_NODES + 3)]
    others = node_reports.MOST_NODES - len(node_reports.EXPECTED)
    assert taken == [True] * others + [False] * (node_reports.MOST_NODES + 3 - others)
    assert all(reports.receive(name, report) for name in ("node 0", *node_reports.EXPECTED))
    assert not reports.receive("one more", report)
    assert len(reports.rows(0.0, ())) == node_reports.MOST_NODES


def test_a_report_that_is_too_long_is_cut() -> None:
    reports = node_reports.NodeReports()
    values = {f"{k}": "x" * 10_000 for k in range(10 * node_reports.MOST_VALUES)}
    reports.receive("coupler", node_reports.NodeReport(1, "m" * 10_000, values, 0.0))
    assert len(row(reports, "coupler", 0.0)["message"]) == node_reports.LONGEST_TEXT + 1
    kept = reports.values("coupler", 0.0)
    assert len(kept) == node_reports.MOST_VALUES
    assert max(map(len, kept.values())) == node_reports.LONGEST_TEXT + 1


@pytest.mark.parametrize(
    ("text", "value"),
    [("12.5", 12.5), ("nan", None), ("-inf", None), ("much", None), (None, None)],
)
def test_a_number_that_was_reported_is_finite_or_unknown(
    text: str | None, value: float | None
) -> None:
    assert node_reports.number(text) == value


def test_the_nodes_of_a_graph_that_has_ended_are_forgotten() -> None:
    reports = node_reports.NodeReports()
    reports.receive("coupler", node_reports.NodeReport(0, "OK", {"engaged": "true"}, 0.0))
    reports.forget()
    assert reports.values("coupler", 0.0) == {}
    assert row(reports, "coupler", 0.0)["state"] == "absent"
