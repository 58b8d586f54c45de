# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an identification of three coils writes: page, figures, metrics and parameters."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from haptic_accel.analysis.identification_result import (
    COMPARED,
    ThreeAxisResult,
    plant_error,
    write_report,
)
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.handle.plant import read_matrix_plant
from haptic_accel.core.identification.fit import DEFAULT_FREE
from haptic_accel.core.identification.three_axes import identify_three_axes
from haptic_accel.setup.files import parameter_text
from page_content import Page
from three_coils import BANDWIDTH, RANGE, RATE, SWEEP, plant, trials

FREQUENCY = np.linspace(*COMPARED, 100)


@pytest.fixture(scope="module")
def result() -> ThreeAxisResult:
    found = identify_three_axes(trials(plant(), 1), SWEEP, RANGE, BANDWIDTH, free=DEFAULT_FREE)
    modelled, true = (each.response(FREQUENCY, RATE) for each in (found.plant, plant()))
    error = plant_error(modelled, true)
    return ThreeAxisResult(found, ActuatorParameters(), 3, found.doubts, errors={"plant": error})


def test_the_compensators_plant_is_the_one_in_the_metrics(
    result: ThreeAxisResult, tmp_path: Path
) -> None:
    metrics = json.loads(json.dumps(result.metrics(), allow_nan=False))
    file = tmp_path / "identification.json"
    file.write_text(json.dumps(metrics))
    read = read_matrix_plant(file)
    assert read.axes == result.found.plant.axes
    assert np.array_equal(read.coupling, result.found.plant.coupling)
    low, high = metrics["axes"]["y"]["intervals"]["m_h"]
    assert low < 0.128 < high
    assert np.shape(metrics["cross_coupling_db"]) == (3, 3)
    response = metrics["response"]
    assert {len(each) for each in response.values()} == {443}
    assert np.shape(response["interval_half_width"]) == (443, 3, 3)
    assert metrics["max_magnitude_error_db"] < 0.2


def test_the_parameter_file_names_model_and_axes(result: ThreeAxisResult) -> None:
    known = replace(result, doubts=["axis x: doubtful"])
    model = Path("/rig/identification.json")
    content = yaml.safe_load(known.heading + parameter_text(known.parameters(0.0, model)))
    compensator = content["/**/compensator"]["ros__parameters"]
    assert compensator["axes"] == "x, y, z"
    assert compensator["plant"]["model"] == "/rig/identification.json"
    assert compensator["plant"]["doubt"] == "axis x: doubtful"
    assert content["/**"]["ros__parameters"]["actuator"]["b_s"] == pytest.approx(2.0, rel=0.01)


def test_the_page_shows_parameters_and_figures(result: ThreeAxisResult, tmp_path: Path) -> None:
    noted = replace(result, doubts=["axis x: doubtful"])
    page = Page(write_report(noted, tmp_path / "report", SWEEP, {"seed": "7"}))
    words = ["axis x: doubtful", "multiple coherence: x 0.99", "axis z", "mount frequency"]
    words += ["value of the response): ", "at most; condition number of the coils' directions: 2"]
    assert [each for each in words if each not in page.text] == [], page.text
    for name in ("response.png", "coherence.png", "condition.png"):
        assert (tmp_path / "report" / name).read_bytes().startswith(b"\x89PNG")


def test_an_error_is_that_of_the_strong_elements() -> None:
    true = np.broadcast_to(np.eye(3) + 0j, (4, 3, 3)).copy()
    true[:, 0, 1], true[:, 0, 2] = 0.2, 0.05
    modelled = true.copy()
    modelled[2, 0, 1] *= 2.0
    modelled[3, 2, 2] *= np.exp(-1j * np.deg2rad(7.0))
    modelled[:, 0, 2] *= -5.0
    error = plant_error(modelled, np.where(true == 0, 1e-9, true))
    assert error.magnitude_db == pytest.approx(6.02, abs=0.01)
    assert error.phase_deg == pytest.approx(7.0)
