# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the plant with three axes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.handle.plant import MatrixPlant, Plant, read_matrix_plant
from haptic_accel.core.model import HandleParameters
from haptic_accel.core.parameters import ParameterError

FREQUENCY = [20.0, 100.0, 400.0]


def a_plant() -> MatrixPlant:
    axes = tuple(Plant(handle=HandleParameters(m_h=m), delay=1e-4) for m in (0.1, 0.13, 0.2))
    coupling = np.zeros((3, 3, 2))
    coupling[:, :, 0] = [[1.0, 0.2, 0.0], [0.1, 1.0, 0.0], [0.0, -0.3, 1.0]]
    coupling[0, 1, 1] = 0.5
    return MatrixPlant((axes[0], axes[1], axes[2]), coupling, 1000.0)


def written(tmp_path: Path, content: dict[str, Any]) -> Path:
    path = tmp_path / "identification.json"
    path.write_text(json.dumps(content))
    return path


def test_a_column_is_the_own_response_times_the_coupling() -> None:
    plant = a_plant()
    response = plant.response(FREQUENCY, 1000.0)
    own = plant.axes[1].response(FREQUENCY, 1000.0)
    delayed = np.exp(-2j * np.pi * np.array(FREQUENCY) / 1000.0)
    assert response[:, 0, 1] == pytest.approx((0.2 + 0.5 * delayed) * own)
    assert response[:, 1, 1] == pytest.approx(own)
    assert response[:, 2, 0] == pytest.approx(0.0)


def test_uncoupled_axes_move_alone() -> None:
    response = MatrixPlant.uncoupled(Plant(), 1000.0).response(FREQUENCY, 1000.0)
    alone = Plant().response(FREQUENCY, 1000.0)
    assert response == pytest.approx(alone[:, np.newaxis, np.newaxis] * np.eye(3))


def test_a_latency_delays_every_element() -> None:
    turned = np.exp(-2j * np.pi * np.array(FREQUENCY) * 2 / 1000.0)[:, np.newaxis, np.newaxis]
    plant = a_plant()
    assert plant.delayed(2).response(FREQUENCY, 1000.0) == pytest.approx(
        plant.response(FREQUENCY, 1000.0) * turned
    )


def test_a_plant_is_read_as_it_was_written(tmp_path: Path) -> None:
    plant = a_plant()
    read = read_matrix_plant(written(tmp_path, {"three_axes": plant.as_document()}))
    assert read.axes == plant.axes
    assert read.rate == plant.rate
    assert np.array_equal(read.coupling, plant.coupling)


def test_a_file_of_one_axis_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="holds a handle with one axis: must be"):
        read_matrix_plant(written(tmp_path, {"discrete_model": {}}))


def test_coils_close_to_a_plane_are_refused(tmp_path: Path) -> None:
    content = a_plant().as_document()
    content["coupling"] = [[[1.0], [0.0], [0.9]], [[0.0], [1.0], [0.0]], [[0.0], [0.0], [0.05]]]
    with pytest.raises(ParameterError, match="condition number .* must be at most 10"):
        read_matrix_plant(written(tmp_path, {"three_axes": content}))


@pytest.mark.parametrize("taps", [[[[1.0]]], "none", [[[None] * 2] * 3] * 3])
def test_other_couplings_are_refused(tmp_path: Path, taps: object) -> None:
    content = a_plant().as_document() | {"coupling": taps}
    with pytest.raises(ParameterError, match="coupling"):
        read_matrix_plant(written(tmp_path, {"three_axes": content}))


def test_another_rate_is_refused() -> None:
    with pytest.raises(ParameterError, match="rate = 500: must be .* 1000 Hz"):
        a_plant().response(FREQUENCY, 500.0)
