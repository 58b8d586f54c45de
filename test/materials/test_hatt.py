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

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.line_spectrum import is_ordered, to_polynomial
from haptic_accel.core.surfaces.texture import Texture
from haptic_accel.materials.hatt import read_hatt
from hatt_file import hatt_file

SHAPES = {
    "arma": ((14, 12), 25, 1000.0),
    "large arma": ((20, 18), 57, 1000.0),
    "ar": ((20, 0), 40, 10000.0),
}
"""Orders, nodes and rate of the toolkit's files."""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_file_is_read_in_si_units(tmp_path: Path) -> None:
    model = read_hatt(written(tmp_path / "slate.xml", hatt_file((14, 12), 25)))
    assert (model.name, model.rate, model.coulomb_friction) == ("Slate", 1000.0, 0.25)
    assert (model.lsf.shape, model.ma_lsf.shape) == ((25, 14), (25, 12))
    assert (model.speeds.max(), model.forces.max()) == (0.3, 4.0)
    assert np.all(model.gain > 0)
    assert np.all((model.deviation == 0) == ((model.speeds == 0) | (model.forces == 0)))
    assert "no redistribution" in model.provenance.licence


def test_a_file_without_moving_average_is_autoregressive(tmp_path: Path) -> None:
    text = hatt_file((20, 0), 40, 10000.0).replace("<numMACoeff>0</numMACoeff>", "")
    model = read_hatt(written(tmp_path / "slate.xml", text))
    assert (model.rate, model.ma_lsf.shape) == (10000.0, (40, 0))
    assert model.gain.tolist() == [1.0] * 40


@pytest.mark.parametrize(
    ("found", "given", "message"),
    [
        ("</modelSet>", "", "not XML"),
        ("modelSet", "model", "model: must be a modelSet"),
        ("mm/s", "in/s", "SpeedUnits = in/s: must be mm/s"),
        ("<SampleRate>1000</SampleRate>", "", "SampleRate: missing in modelSet"),
        ("<SampleRate>1000", "<SampleRate>0", "rate = 0.0: must be above 0 Hz"),
        ("<SampleRate>1000", "<SampleRate>fast", "SampleRate = 'fast': must be a number"),
        ("<var>", "<var>-", "var = -.*: must be at least 0"),
        ("<gain>", "<gain>nan ", "gain = 'nan .*': must be a number"),
        ('<ARlsf type="array">', "<ARlsf><value>4</value>", "lsf: must rise within 0 to pi"),
        ("model>", "texture>", "nodes = 0: must be three or more"),
    ],
)
def test_a_wrong_file_is_refused_by_name(
    tmp_path: Path, found: str, given: str, message: str
) -> None:
    path = written(tmp_path / "slate.xml", hatt_file().replace(found, given))
    with pytest.raises(ParameterError, match=message) as refused:
        read_hatt(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_nodes_of_different_orders_are_refused(tmp_path: Path) -> None:
    text = hatt_file().replace('<ARlsf type="array">', "<ARlsf><value>0.001</value>", 1)
    with pytest.raises(ParameterError, match="ARlsf: 14 to 15 values: must be one order"):
        read_hatt(written(tmp_path / "slate.xml", text))


def are_stable(polynomials: np.ndarray) -> bool:
    """Return True if all reflection coefficients are below 1, by the recursion backwards."""
    while polynomials.shape[1] > 1:
        reflection = polynomials[:, -1:]
        if not np.all(np.abs(reflection) < 1):
            return False
        reversed_ = polynomials[:, ::-1]
        polynomials = ((polynomials - reflection * reversed_) / (1 - reflection**2))[:, :-1]
    return True


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", [1000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_a_texture_is_stable_at_every_point_and_along_every_path(
    shape: str, count: int, tmp_path: Path
) -> None:
    orders, nodes, rate = SHAPES[shape]
    model = read_hatt(written(tmp_path / "slate.xml", hatt_file(orders, nodes, rate)))
    random = np.random.default_rng(1)
    places = model.locate(random.uniform(0, 0.4, count), random.uniform(0, 6, count))
    assert places.weights.min() >= 0
    assert places.weights.sum(axis=1) == pytest.approx(1.0)
    for lsf in (places.interpolate(model.lsf), places.interpolate(model.ma_lsf)):
        assert is_ordered(lsf)
        assert are_stable(to_polynomial(lsf))
    # Half of the path jumps, half creeps; a fifth of it is out of contact.
    for held in (1, 100):
        texture = Texture(model, rate, seed=1)
        speeds, forces = (
            np.repeat(random.uniform(low, high, count // held), held)
            for low, high in ((0, 0.4), (-1, 4.5))
        )
        samples = texture.block(speeds, np.maximum(forces, 0.0))
        assert np.all(np.abs(samples) <= 100.0)
        assert texture.saturated == np.sum(np.abs(samples) == 100.0)
        quiet = texture.block(np.zeros(2_000), np.zeros(2_000))
        assert np.abs(quiet[-1]) < 1e-3
