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

"""Texture models as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.texture import Provenance, TextureModel
from haptic_accel.materials.texture_files import read_texture, write_texture

ABOUT = Provenance("two strokes", "CC0-1.0", "somebody", "±5 g by gravity")


def model(**changed: object) -> TextureModel:
    values = {
        "name": "oak: new",
        "rate": 1000.0,
        "speeds": np.array([0.0, 0.1, 0.1, 1 / 3]),
        "forces": np.array([0.0, 0.5, 2.0, 1.0]),
        "lsf": np.array([[0.5, 1.5], [0.6, 1 / 0.7], [0.7, 2.0], [0.1, 3.1]]),
        "deviation": np.array([0.0, 1e-5, 0.5, 1.0]),
        "coulomb_friction": 0.3,
        "provenance": ABOUT,
    }
    return TextureModel(**{**values, **changed})  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["yaml", "npz"])
@pytest.mark.parametrize(
    "changed",
    [{}, {"coulomb_friction": None}, {"ma_lsf": np.full((4, 1), 1.5), "gain": np.full(4, 2.0)}],
    ids=["AR", "no friction", "ARMA"],
)
def test_a_file_holds_the_whole_model(
    tmp_path: Path, form: str, changed: dict[str, object]
) -> None:
    written = model(**changed)
    file = tmp_path / f"oak.{form}"
    write_texture(file, written)
    found = read_texture(file)
    assert (found.name, found.rate, found.provenance) == ("oak: new", 1000.0, ABOUT)
    assert found.coulomb_friction == written.coulomb_friction
    for name in ("speeds", "forces", "lsf", "deviation", "ma_lsf", "gain"):
        np.testing.assert_allclose(getattr(found, name), getattr(written, name), rtol=1e-6)


def test_the_file_states_units_and_licence(tmp_path: Path) -> None:
    write_texture(tmp_path / "oak.yaml", model())
    content = yaml.safe_load((tmp_path / "oak.yaml").read_text())
    assert content["units"]["speeds"] == "m/s"
    assert content["provenance"]["licence"] == "CC0-1.0"


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("units", {"speeds": "mm/s"}, "units.speeds = 'mm/s': must be m/s"),
        ("rate", "fast", "rate = 'fast': must be a finite number"),
        ("rate", -1.0, "rate = -1.0: must be above 0 Hz"),
        ("speeds", [0.0, 0.1], "forces"),
        ("lsf", [[0.5, 1.5], [0.6]], "lsf = .*: must be numbers, in rows"),
        ("lsf", [[1.5, 0.5] for _ in range(4)], "lsf: must rise"),
        ("deviation", [0.0, -1.0, 1.0, 1.0], "deviation = -1: must be"),
        ("provenance", {"license": "MIT"}, r"provenance.license: unknown \(did you mean licence"),
        ("forcs", [1.0], r"forcs: unknown \(did you mean forces"),
        ("lsf", None, "lsf = nothing: must be given"),
    ],
)
def test_a_wrong_file_is_refused_with_file_name_and_range(
    tmp_path: Path, name: str, value: object, says: str
) -> None:
    file = tmp_path / "oak.yaml"
    write_texture(file, model())
    content = yaml.safe_load(file.read_text())
    if value is None:
        del content[name]
    else:
        content[name] = value
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ParameterError, match=rf"oak\.yaml:\d+: .*{says}") as refused:
        read_texture(file)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"[1, 2]", b"\xff\xfe", b"a: *b", b"PK\x03\x04rubbish"])
@pytest.mark.parametrize("form", ["yaml", "npz"])
def test_what_is_no_model_is_refused(tmp_path: Path, form: str, content: bytes) -> None:
    file = tmp_path / f"oak.{form}"
    file.write_bytes(content)
    with pytest.raises(ParameterError, match=rf"oak\.{form}:"):
        read_texture(file)
