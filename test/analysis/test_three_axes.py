# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags with vibration in three axes, from metrics to page, beside bags with one."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from bag_maker import BagContent, meta, write_bag
from browsing import opened
from haptic_accel.analysis import groups, load, signals, trials
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.segments import read_segment
from haptic_accel.analysis.summary import summary, tables
from haptic_accel.analysis.writing import PICTURES, as_json, signal_table, write_analysis
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.control.filters import high_passed
from haptic_accel.core.evaluation.metrics import by_component
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import FloatArray
from page_content import Page

if TYPE_CHECKING:
    from playwright.sync_api import Browser

RATE = 1000.0
TURNS = {"none": None, "constant": 10.0, "inverse": 0.0}
"""Angle by which the handle's vibration is turned about y, degrees; None for a handle at rest."""

ANALYSED = [topic.name for topic in topics.ANALYSED]


def vibration(seed: int = 0, seconds: float = 4.0) -> FloatArray:
    """Return noise above the hand's own motion, in three axes of unlike strength, m/s^2."""
    noise = np.random.default_rng(seed).normal(0.0, 2.0, (round(seconds * RATE), 3))
    passed = by_component(lambda axis: high_passed(axis, 60.0, RATE), noise)
    return passed * np.array([2.0, 0.5, 1.0])


def turned(vectors: FloatArray, degrees: float | None) -> FloatArray:
    if degrees is None:
        return np.zeros_like(vectors)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.asarray(vectors @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]))


def content(controller: str = "constant", seed: int = 0, axes: str | None = None) -> BagContent:
    """Return a bag whose handle follows one sample later, in a direction of the controller."""
    desired = vibration(seed) * [1.0, controller == "inverse", 1.0]
    handle = np.vstack([np.zeros((1, 3)), turned(desired, TURNS[controller])[:-1]])
    stated = meta(controller, "plywood", seed=seed)
    if axes:
        stated["parameters"]["compensator"]["axes"] = axes
    values = (desired, desired, handle + np.array([0.0, 0.0, 9.81]), 0.1 * desired)
    return BagContent(dict(zip(ANALYSED, values, strict=True)), RATE, stated)


def along_z(written: BagContent) -> BagContent:
    signals = {name: values[:, 2].copy() for name, values in written.signals.items()}
    return BagContent(signals, RATE, written.metadata)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags")
    for controller in TURNS:
        write_bag(folder / controller, content(controller, axes="x, y, z"))
    return folder


@pytest.fixture(scope="module")
def analysis(bags: Path) -> Analysis:
    return load(bags)


@pytest.fixture(scope="module")
def report(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_bag(folder / "bags" / "one", along_z(content("inverse", seed=1)))
    write_analysis(load(bags, folder / "bags"), folder)
    return folder


@pytest.mark.parametrize(
    ("scale", "stated", "axes"),
    [
        ((1, 1, 1), "x, y, z", ALL_AXES),
        ((0, 0, 1), "x, y, z", ALL_AXES),
        ((1, 1, 1), "z", ACTUATOR_AXES),
        ((1, 1, 1), None, ALL_AXES),
        ((1, 0, 1), None, Axes(("x", "z"))),
        ((0, 0, 1), None, ACTUATOR_AXES),
        ((0, 0, 0), None, ACTUATOR_AXES),
        ((0, 0, 1), "up", ACTUATOR_AXES),
    ],
)
def test_axes_are_those_stated_or_those_in_which_the_actuators_acted(
    tmp_path: Path, scale: tuple[int, int, int], stated: str | None, axes: Axes
) -> None:
    written = content("inverse", axes=stated)
    # What tool and handle measure beside the controlled axes is no axis of the compensation.
    for name in (topics.DESIRED_ACCELERATION.name, topics.ACTUATOR_FORCE.name):
        written.signals[name][:] *= scale
    assert read_bag(write_bag(tmp_path / "bag", written)).axes == axes


def test_a_bag_of_one_axis_has_the_figures_of_that_axis(tmp_path: Path) -> None:
    write_bag(tmp_path / "one", along_z(content("inverse", seed=1)))
    segment = read_segment(tmp_path / "one")
    assert {values.shape for values in segment.signals.values()} == {(4000,)}
    (row,) = as_json(load(tmp_path))["trials"]
    assert not [name for name in row if "direction" in name or name == "nrmse_z_percent"]
    assert list(signals(tmp_path / "one")) == ANALYSED


def test_a_rotation_of_the_handle_is_an_error_of_the_vector_and_of_direction(
    analysis: Analysis,
) -> None:
    found = trials(analysis).set_index("controller")
    turned_by_10 = found.loc["constant"]
    assert turned_by_10.direction_error_deg == pytest.approx(10.0, abs=0.1)
    assert turned_by_10.nrmse_percent == pytest.approx(17.43, abs=0.1)
    assert math.isnan(turned_by_10.nrmse_y_percent)  # nothing was to vibrate there
    assert turned_by_10.nrmse_z_percent > turned_by_10.nrmse_x_percent > 5.0
    exact = found.loc["inverse"]
    assert exact.direction_error_deg < 0.2
    assert exact.nrmse_percent < 1.0  # at the ends, where the filter has no neighbours
    assert exact.force_rms_N == pytest.approx(0.1 * np.sqrt(np.mean(vibration() ** 2) * 3), 1e-6)
    assert found.loc["none"].nrmse_percent == pytest.approx(100.0)
    assert groups(analysis).direction_error_deg.notna().sum() == 2


def test_the_power_that_one_coil_would_keep_is_that_of_its_signal(analysis: Analysis) -> None:
    row = trials(analysis).set_index("controller").loc["inverse"]
    wished = content("inverse").signals[topics.DESIRED_ACCELERATION.name]
    for name, kept in (("axis", wished[:, 2]), ("sum", wished.sum(axis=1))):
        share = 100 * np.sum(kept**2) / np.sum(wished**2)
        assert row[f"kept_{name}_percent"] == pytest.approx(share, abs=1)
    assert row.kept_dft321_percent == pytest.approx(100.0, abs=0.01)


def test_a_missing_desired_acceleration_is_made_from_all_axes_of_the_tool(tmp_path: Path) -> None:
    written = content("inverse", axes="x, y, z")
    del written.signals[topics.DESIRED_ACCELERATION.name]
    segment = read_segment(write_bag(tmp_path / "bag", written))
    made = segment.signals[topics.DESIRED_ACCELERATION.name]
    tool = written.signals[topics.TOOL_ACCELERATION.name]
    assert np.array_equal(made, np.column_stack([high_passed(a, 15.0, RATE) for a in tool.T]))


def test_the_direction_is_told_in_words_table_and_json(analysis: Analysis) -> None:
    (told,) = [line for line in summary(analysis) if line.startswith("Angle")]
    assert re.search(r": constant 10\.0°, inverse 0\.0°\.$", told)
    rows = {row[0]: row for row in list(tables(analysis))[1].rows}
    assert rows["direction error (°)"][1:] == ["–", "10.0", "0.0"]
    assert {f"NRMSE {axis} (%)" for axis in "xyz"} <= set(rows)
    content = as_json(analysis)
    json.dumps(content, allow_nan=False)
    assert content["trials"][1]["nrmse_y_percent"] is not None


def test_each_axis_has_its_own_signals(bags: Path, analysis: Analysis) -> None:
    columns = list(signal_table(analysis.trials[1].segment))
    assert columns[:2] == ["tool_acceleration_x_m_s2", "tool_acceleration_y_m_s2"]
    assert columns[-1] == "actual_acceleration_z_m_s2"
    assert len(columns) == 15
    assert list(signals(bags / "inverse"))[:3] == [f"{ANALYSED[0]}_{axis}" for axis in "xyz"]


@pytest.mark.slow
def test_plots_show_each_axis_and_the_planes_between(report: Path) -> None:
    for name in (*PICTURES, "polarisation_plywood"):
        with Image.open(report / f"{name}.png") as picture:
            assert picture.width == pytest.approx(7.16 * 300, abs=5)
            assert len(picture.convert("L").getcolors() or []) > 20
    text = Page(report / "index.html").text
    assert "polarisation_plywood.pdf" in text
    assert "direction error (°)" in text
    assert len(pd.read_csv(report / "trials.csv")) == 4


def test_the_page_shows_the_axis_that_is_chosen(browser: Browser, report: Path) -> None:
    with opened(browser, (report / "index.html").as_uri()) as page:
        for row in page.locator("tr[data-trial] a").all():
            row.click()
            has_one_axis = row.inner_text() == "one"
            assert page.locator("#polarisation").is_hidden() == has_one_axis
            pictures = set()
            for axis in "xyz":
                page.click(f"button[data-axis={axis}]")
                pictures.add(page.eval_on_selector("#force canvas", "one => one.toDataURL()"))
            assert len(pictures) == (1 if has_one_axis else 3)
            assert page.locator(".planes canvas").count() == 3


def test_the_bound_is_that_of_the_compensators_model_in_three_axes(tmp_path: Path) -> None:
    model = tmp_path / "handle.json"
    plant = MatrixPlant.uncoupled(Plant(), RATE)
    model.write_text(json.dumps({"three_axes": plant.as_document()}))
    for seed, (name, file) in enumerate((("known", model), ("lost", tmp_path / "lost.json"))):
        written = content("inverse", seed, axes="x, y, z")
        written.metadata["parameters"]["compensator"]["plant.model"] = str(file)
        write_bag(tmp_path / "bags" / name, written)
    analysis = load(tmp_path / "bags")
    found = trials(analysis).set_index("trial")
    assert 0.0 < found.bound_percent["known"] <= found.limited_bound_percent["known"] < 100.0
    assert math.isnan(found.bound_percent["lost"])
    assert any(re.search("no bound.*lost.json", line) for line in analysis.problems["lost"])
