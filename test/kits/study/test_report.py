# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a study through what it writes: page, figures, tables and JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import pandas as pd
import pytest
from kits.study.study_sessions import (
    ADAPTIVE,
    MASS,
    NONE,
    often_right,
    paired,
    protocol,
    session,
    single,
)
from PIL import Image

from browsing import opened, violations
from haptic_accel.kits.study.folder import templates
from haptic_accel.kits.study.planned_tests import distance_name
from haptic_accel.kits.study.protocol import Levels, Pair, PlannedTest, Protocol, Rules
from haptic_accel.kits.study.reading import read_protocol
from haptic_accel.kits.study.report import StudyResult, analyse_study, write_report
from haptic_accel.kits.study.results import EXPLORATORY, PLANNED, Result
from haptic_accel.kits.study.session import simulate_study
from haptic_accel.kits.study.trials import PlannedTrial, SessionRecord
from nightly import rest_slow
from page_content import Page

if TYPE_CHECKING:
    from playwright.sync_api import Browser

STUDY = protocol("2ifc", tests=(PlannedTest("Better than <chance>", alternative="greater"),))


def sessions(study: Protocol = STUDY, count: int = 4) -> list[SessionRecord]:
    trials = paired(study, 10) if study.pairs else single(study, 5)
    return [session(study, f"P{i:02d}", trials, often_right(0.8)) for i in range(count)]


def result(found: StudyResult, name: str) -> Result:
    return next(each for each in found.results if each.name == name)


def read_json(folder: Path) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = (folder / "results.json").read_text(encoding="utf-8")
    return json.loads(text, parse_constant=refuse)


def test_planned_tests_come_first_and_excluded_participants_are_named_with_the_rule(
    tmp_path: Path,
) -> None:
    made = sessions()
    stopped = [*made[:3], replace(made[3], ended="stopped by the participant")]
    found = analyse_study(STUDY, stopped)
    why = "2026-11-26 12:00: all are complete"
    page = Page(write_report(found, tmp_path, why))
    assert f"Unblinded on {why}." in page.text
    headings = ["Planned tests", "Exploratory results", "Delivered stimuli", "Participants"]
    places = [page.text.index(each) for each in headings]
    assert places == sorted(places)
    assert page.tables[0][1][0] == "Better than <chance>"
    assert "their probabilities are not corrected" in page.text
    assert STUDY.digest[:12] in page.text
    rule = "session not complete (stopped by the participant)"
    assert f"P03: {rule}" in page.text
    assert read_json(tmp_path)["excluded"] == {"P03": rule}
    counted = [row["participant"] for row in result(found, "sensitivity").rows]
    assert set(counted) == {"P00", "P01", "P02"}


def test_a_study_without_planned_tests_says_so(tmp_path: Path) -> None:
    study = replace(STUDY, tests=())
    found = analyse_study(study, sessions(study))
    assert all(each.kind != PLANNED for each in found.results)
    assert "has no planned test" in Page(write_report(found, tmp_path)).text


def test_delivered_stimuli_are_stated_by_condition_with_what_was_not_delivered() -> None:
    made = sessions(count=1)
    records = list(made[0].records)
    flawed = replace(records[4], answer=None, flaw="error 80 %, more than 50 %")
    found = analyse_study(STUDY, [replace(made[0], records=(*records[:4], flawed, *records[5:]))])
    delivered = result(found, "delivered")
    assert sum(row["stimuli"] for row in delivered.rows) == 2 * 19
    assert "1 of 23. 1 times error 80 %, more than 50 %" in delivered.text
    first = delivered.rows[0]
    assert first["rms_m_s2"].low <= first["rms_m_s2"].value <= first["rms_m_s2"].high
    assert first["error_percent"].value == pytest.approx(20.0)


def test_sensitivity_states_the_exact_interval_of_each_participant() -> None:
    row = result(analyse_study(STUDY, sessions()), "sensitivity").plain[0]
    right = round(row["proportion_correct"] * 10)
    assert row["trials"] == 10
    from scipy.stats import binomtest

    exact = binomtest(right, 10, 0.5)
    assert row["p"] == pytest.approx(exact.pvalue)
    assert row["proportion_correct_low"] == pytest.approx(exact.proportion_ci().low)


def test_confusions_are_counted_together_and_their_information_by_participant() -> None:
    """Two of three conditions are confused: 5 of 15 answers stand alone, 0.92 bits."""
    study = protocol("identification", pairs=(), rules=Rules(catch_correct=0.0))
    names = {str(each): str(each["controller"]) for each in (NONE, MASS, ADAPTIVE)}
    confused = {"none": "none", "mass": "none", "adaptive": "adaptive"}
    trials = single(study, 5)

    def answer(trial: PlannedTrial, _: object) -> str:
        return confused[names[str(trial.stimuli[0])]]

    found = analyse_study(study, [session(study, name, trials, answer) for name in ("P1", "P2")])
    counts = [list(row.values()) for row in result(found, "confusions").rows]
    assert counts == [["none", 10, 0, 0], ["mass", 10, 0, 0], ["adaptive", 0, 0, 10]]
    rows = result(found, "information").rows
    assert [row["participant"] for row in rows] == ["P1", "P2"]
    assert rows[0]["uncorrected"] == pytest.approx(0.918, abs=1e-3)


def test_worths_follow_the_preferences() -> None:
    study = protocol("preference", rules=Rules(catch_correct=0.0))
    found = analyse_study(study, sessions(study, 5))
    worths = {row["condition"]: row["log_worth"].value for row in result(found, "worths").rows}
    # The maker's right answer is the comparison: adaptive or mass, never none.
    assert worths["none"] < min(worths["mass"], worths["adaptive"])
    assert sum(worths.values()) == pytest.approx(0.0, abs=1e-9)


def test_pairs_that_do_not_connect_the_conditions_give_no_worths() -> None:
    study = protocol("preference", pairs=(Pair(NONE, ADAPTIVE),), rules=Rules(catch_correct=0.0))
    names = [each.name for each in analyse_study(study, sessions(study)).results]
    assert names == ["preferences", "delivered"]


def test_dissimilarities_become_a_map() -> None:
    """Ratings are 10 less the distance on a line: none, mass, adaptive at 0, 3 and 7."""
    places = {str(NONE): 0.0, str(MASS): 3.0, str(ADAPTIVE): 7.0}
    pairs = (Pair(NONE, MASS), Pair(NONE, ADAPTIVE), Pair(MASS, ADAPTIVE))
    rules = Rules(catch_correct=0.0)
    study = protocol("similarity", pairs=pairs, scale=(0.0, 10.0, 1.0), rules=rules)

    def rated(trial: PlannedTrial, _: object) -> str:
        first, second = (places[str(each)] for each in trial.stimuli)
        return str(10 - abs(first - second))

    made = [session(study, f"P{i}", paired(study, 3), rated) for i in range(3)]
    found = analyse_study(study, made)
    rows = [list(row.values())[1:] for row in result(found, "dissimilarities").rows]
    assert rows == [[0.0, 3.0, 7.0], [3.0, 0.0, 4.0], [7.0, 4.0, 0.0]]
    points = [row["dimension_1"] for row in result(found, "map").rows]
    assert abs(points[2] - points[0]) == pytest.approx(7.0, abs=1e-3)
    assert "Stress: " in result(found, "map").text


@pytest.mark.parametrize("ended", ["", "stopped by the operator"])
def test_a_study_in_which_nobody_counts_has_a_report(ended: str, tmp_path: Path) -> None:
    made = [replace(each, ended=ended) for each in sessions(count=2)]
    for number, found in enumerate((made, [replace(made[0], records=())])):
        page = Page(write_report(analyse_study(STUDY, found), tmp_path / str(number)))
        assert "of them excluded" in page.text
        assert read_json(tmp_path / str(number))["excluded"]


SHORT = 4  # participants, and repeats of each pair or condition


def shortened(name: str) -> Protocol:
    study = read_protocol(templates()[name])
    procedure = replace(study.procedure, repeats=SHORT, trials=20, reversals=4)
    return replace(study, procedure=procedure)


@pytest.mark.parametrize("name", rest_slow(templates(), now=3))
def test_each_template_is_reported_from_simulated_observers(name: str, tmp_path: Path) -> None:
    study = shortened(name)
    found = analyse_study(study, simulate_study(study, SHORT, 1))
    assert found.excluded == {}
    page = Page(write_report(found, tmp_path))
    planned = [row[0] for table in page.tables for row in table[1:]]
    assert [test.name for test in study.tests] == planned[: len(study.tests)]
    assert any(each.kind == EXPLORATORY and each.figure for each in found.results)
    assert all(picture["alt"] and picture["src"].startswith("data:") for picture in page.pictures)
    assert all((tmp_path / link).is_file() for link in page.links)
    for each in found.results:
        assert {(tmp_path / f"{each.name}.{kind}").is_file() for kind in ("png", "pdf")} == {True}
        with Image.open(tmp_path / f"{each.name}.png") as picture:
            assert picture.info["dpi"][0] == pytest.approx(300, abs=1)
        table = pd.read_csv(tmp_path / f"{each.name}.csv")
        assert len(table) == len(each.rows) == len(read_json(tmp_path)[each.name])
        assert each.figure
        panels = [panel for panel in each.figure.get_axes() if panel.get_label() != "<colorbar>"]
        named = all(panel.get_xlabel() for panel in panels)
        assert named or (each.figure.get_supxlabel() and each.figure.get_supylabel())
    assert len(pd.read_csv(tmp_path / "trials.csv")) == len(found.tables.trials)


def test_distances_of_levels_have_their_unit() -> None:
    for factor, name in (("gain", "(1)"), ("network", "(ms)"), ("latency", "(")):
        levels = Levels(factor, 0.0, (1.0, 2.0))
        assert distance_name(levels).startswith(f"distance of {factor} from 0 {name}")


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_no_rule_of_accessibility_is_broken(
    browser: Browser, tmp_path: Path, scheme: Literal["light", "dark"]
) -> None:
    study = read_protocol(templates()["compensated_or_not"])
    *whole, last = simulate_study(study, 4, 1)
    stopped = replace(last, ended="stopped by the participant")
    write_report(analyse_study(study, [*whole, stopped]), tmp_path / "report")
    address = (tmp_path / "report" / "index.html").as_uri()
    with opened(browser, address, color_scheme=scheme) as page:
        assert violations(page) == []
