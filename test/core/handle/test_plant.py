# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Discrete models: their response, and the file that holds one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from haptic_accel.core.handle.plant import DiscreteModel, read_discrete_model
from haptic_accel.core.parameters import ParameterError

RATE = 1000.0
FREQUENCY = np.linspace(10.0, 450.0, 45)


def test_the_response_is_that_of_the_filter() -> None:
    sections = np.asarray(signal.butter(3, 100.0, fs=RATE, output="sos"))
    model = DiscreteModel(sections, RATE, 2)
    passed = signal.sosfilt(sections, np.eye(1, 1000)[0])
    impulse = np.concatenate([[0.0, 0.0], passed[:-2]])
    turn = np.exp(-2j * np.pi * np.outer(FREQUENCY, np.arange(1000)) / RATE)
    assert model.response(FREQUENCY) == pytest.approx(turn @ impulse, abs=1e-9)


def test_a_model_is_read_back_from_the_figures_of_an_identification(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    sections = [[0.5, 0.1, 0.0, 1.0, -0.4, 0.05]]
    content = {"sections": sections, "rate_hz": 1000.0, "delay_samples": 2}
    file.write_text(json.dumps({"discrete_model": content}))
    model = read_discrete_model(file)
    assert model.sections.tolist() == sections
    assert (model.rate, model.delay_samples) == (1000.0, 2)


def of_section(*numbers: float) -> str:
    model = {"sections": [numbers], "rate_hz": 1, "delay_samples": 1}
    return json.dumps({"discrete_model": model})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{}", "discrete_model"),
        ("not json", "must be JSON"),
        (of_section(1), "six numbers"),
        (of_section(1, 0, 0, 1, -2, 0), "stable"),
        (of_section(1, 0, 0, 1e-300, 1e300, 0), "the fourth of them 1"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "figures.json"
    file.write_text(text)
    with pytest.raises(ParameterError, match=reason):
        read_discrete_model(file)
    with pytest.raises(ParameterError, match="readable"):
        read_discrete_model(tmp_path / "none.json")
