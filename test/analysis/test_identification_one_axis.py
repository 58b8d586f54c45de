# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of an identification through what it writes: page and figures."""

from __future__ import annotations

import base64
import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from haptic_accel.analysis.identification_result import (
    KNOWN,
    POOLED,
    ModelError,
    OneAxisResult,
    write_report,
)
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.identification.evaluation import Identification, identify_handle
from haptic_accel.core.identification.fit import DEFAULT_FREE
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import HandleParameters, MountParameters
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.trial import run_identification
from page_content import Page

FIGURES = ("fig4_sweep.png", "fig5_models.png", "coherence.png")
SWEEP = SweepParameters(duration=1.0)
TRUTH = HandleParameters()
HELD = {"pinch": TRUTH, "hook": dataclasses.replace(TRUTH, m_h=0.15, k_u=2600.0, b_u=17.0)}
ERRORS = {"discrete": ModelError(1.02, 4.13), "physical": ModelError(0.78, 2.94)}
DASH = "–"
PNG = b"\x89PNG\r\n\x1a\n"


def identified(handles: Mapping[str, HandleParameters]) -> Identification:
    rigs = {name: MasterRigParameters(handle=handle) for name, handle in handles.items()}
    recorded = {name: run_identification(rig, SWEEP) for name, rig in rigs.items()}
    accelerometer = MasterRigParameters().accelerometer
    return identify_handle(
        recorded, SWEEP, accelerometer.range, accelerometer.bandwidth, free=DEFAULT_FREE
    )


@pytest.fixture(scope="module")
def one() -> Identification:
    return identified({"pinch": TRUTH})


@pytest.fixture(scope="module")
def two() -> Identification:
    return identified(HELD)


def report(
    found: Identification,
    folder: Path,
    settings: Mapping[str, str] | None = None,
    doubts: Sequence[str] = (),
    *,
    simulated: bool = True,
) -> Page:
    result = OneAxisResult(found, ActuatorParameters(), 3, doubts)
    if simulated:
        result = replace(result, truth=TRUTH, errors=ERRORS)
    path = write_report(result, folder, SWEEP, settings or {"seed": "7", "rig": "simulated"})
    assert path == folder / "index.html"
    return Page(path)


@pytest.fixture(scope="module")
def page(two: Identification, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Write a report of two grips, once because it is only read."""
    return report(two, tmp_path_factory.mktemp("results") / "now")


def test_writes_page_and_figures_into_a_new_folder(page: Page) -> None:
    assert {path.name for path in page.folder.iterdir()} == {"index.html", *FIGURES}
    assert page.html.startswith("<!doctype html>")
    for name in FIGURES:
        assert (page.folder / name).read_bytes().startswith(PNG)
        with Image.open(page.folder / name) as image:
            assert len(image.convert("L").getcolors() or []) > 20


def test_page_shows_its_figures_without_other_files(page: Page) -> None:
    assert set(page.links) == {*FIGURES, "handle.yaml"}
    assert sorted(page.links) == sorted({*page.links})
    assert not re.search(
        r"https?:|\bfile:|url\(|@import|src=\"(?!data:image/png;base64,)", page.html
    )
    assert not {"link", "script", "iframe", "object"} & set(page.tags)
    embedded = [base64.b64decode(picture["src"].split(",")[1]) for picture in page.pictures]
    assert sorted(embedded) == sorted((page.folder / name).read_bytes() for name in FIGURES)
    for picture in page.pictures:
        assert picture["alt"]
        assert int(picture["width"]) > int(picture["height"]) > 0


def test_every_parameter_has_unit_truth_and_a_pair_of_cells_for_each_grip(
    page: Page, two: Identification
) -> None:
    assert page.tables[0][0] == ["parameter", "unit", "true", "pinch", "hook", POOLED]
    fits = [*(grip.fit for grip in two.grips.values()), two.fit]
    for name, (_, given) in own_schema(HandleParameters).items():
        unit, true, *cells = page.row(0, name)
        assert unit == given.unit
        assert float(true) == getattr(TRUTH, name)
        for fit, value, error in zip(fits, cells[::2], cells[1::2], strict=True):
            assert float(value) == pytest.approx(getattr(fit.handle, name), rel=0.01)
            if name in ("m_a", "k_s"):
                assert error == KNOWN
            else:
                assert float(error) == pytest.approx(fit.standard_errors[name], rel=0.05)
    unit, true, *cells = page.row(0, "delay")
    assert (unit, true) == ("µs", DASH)
    assert float(cells[4]) == pytest.approx(1e6 * two.fit.delay, abs=0.5)


def test_a_value_ends_where_its_standard_error_does(page: Page) -> None:
    for name in ("b_s", "m_h", "k_u", "b_u", "delay"):
        _, _, *cells = page.row(0, name)
        for value, error in zip(cells[::2], cells[1::2], strict=True):
            assert len(value.partition(".")[2]) <= len(error.partition(".")[2])


def test_models_and_their_errors_are_named(page: Page, two: Identification) -> None:
    assert page.row(1, "discrete") == ["1.02", "4.1"]
    assert page.row(1, "physical") == ["0.78", "2.9"]
    assert "15 to 180 Hz" in page.text
    pairs = {row[0]: [float(cell) for cell in row[1:]] for row in page.tables[2][1:]}
    assert pairs.keys() == {f"{kind} pair {n}" for kind in ("zero", "pole") for n in (1, 2)}
    for pair, shown in pairs.items():
        names = [f"{pair.replace(' pair ', '_')}_{name}" for name in ("frequency", "damping")]
        expected = [getattr(two.approximate, name) for name in names]
        assert shown == pytest.approx(expected, abs=0.01)
    assert "discrete model has order 7" in page.text
    assert "haptic-accel teleop params_file:=handle.yaml" in page.text


def test_what_the_fit_leaves_is_explained(page: Page, one: Identification, tmp_path: Path) -> None:
    assert "compromise between the grips" in page.text
    assert "no significant deviation from the model" in report(one, tmp_path).text
    # Of 2,000 values, noise alone gives a residual of 1.00 within 0.016.
    off = replace(one, fit=replace(one.fit, residual=1.2, count=2000))
    assert "the handle deviates from the model" in report(off, tmp_path).text


def test_without_truth_there_are_neither_true_values_nor_errors_and_notes_come_first(
    one: Identification, tmp_path: Path
) -> None:
    page = report(one, tmp_path, {"seed": "12"}, ["First of all.", "And then."], simulated=False)
    places = [page.text.index(words) for words in ("First of all.", "And then.", "Parameters")]
    assert places == sorted(places)
    assert page.tables[-1] == [["seed", "12"]]
    assert "mount" not in page.text
    assert page.tables[0][0] == ["parameter", "unit", "pinch"]
    assert page.row(0, "k_s") == ["N/m", "266", KNOWN]
    assert "true response" not in page.text
    assert "simulated handle" not in page.text


def fitted(one: Identification, **changes: Any) -> Identification:
    """Return an identification of one grip whose fits are changed."""
    fit = replace(one.fit, **changes)
    return replace(one, fit=fit, grips={"pinch": replace(one.grips["pinch"], fit=fit)})


def test_a_fitted_mount_is_shown(one: Identification, tmp_path: Path) -> None:
    errors = one.fit.standard_errors | {"mount_frequency": 0.4, "mount_damping": 0.0012}
    mount = MountParameters(frequency=280.0, damping=0.127)
    page = report(fitted(one, mount=mount, standard_errors=errors), tmp_path)
    rows = {row[0]: row[1:] for row in page.tables[0] if row[0].startswith("mount")}
    assert list(rows.values()) == [["Hz", DASH, "280.00", "0.40"], ["1", DASH, "0.1270", "0.0012"]]


def test_numbers_that_are_none_never_reach_the_reader(one: Identification, tmp_path: Path) -> None:
    broken = dict.fromkeys(one.fit.standard_errors, float("nan")) | {"b_s": 0.0}
    page = report(fitted(one, delay=-1e-12, standard_errors=broken), tmp_path)
    assert page.row(0, "m_h")[3] == DASH
    assert not {"nan", "inf"} & {word.lower() for word in re.findall(r"[A-Za-z]+", page.text)}


@pytest.mark.parametrize(
    "hostile",
    [
        *("<script>alert(1)</script>", '"><img src=x onerror=alert(1)>'),
        *("{{ 7 * 7 }} & $x_{2$ \\frac", "_" + "long " * 40),
    ],
)
def test_hostile_text_stays_text(hostile: str, one: Identification, tmp_path: Path) -> None:
    found = dataclasses.replace(one, grips={hostile: one.grips["pinch"]})
    page = report(found, tmp_path, {hostile: hostile}, [hostile])
    assert "script" not in page.tags
    assert page.tags.count("img") == len(FIGURES)
    assert page.text.count(hostile) >= 6


def test_a_gap_in_the_data_can_be_drawn(one: Identification, tmp_path: Path) -> None:
    """An averaged estimate is zero, with zero coherence, where there was no force."""
    grip = one.grips["pinch"]
    h1 = dataclasses.replace(
        grip.averaged_h1,
        response=np.zeros_like(grip.averaged_h1.response),
        coherence=np.zeros_like(grip.averaged_h1.coherence),
    )
    grips = {"pinch": dataclasses.replace(grip, averaged_h1=h1)}
    report(dataclasses.replace(one, grips=grips), tmp_path)
    assert (tmp_path / "coherence.png").read_bytes().startswith(PNG)
