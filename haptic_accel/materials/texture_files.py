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

"""Texture model files: YAML for people, NPZ for programs, with the same names and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from haptic_accel.core.bounded_files import located
from haptic_accel.core.document import Document, load_yaml, read_yaml_document
from haptic_accel.core.parameters import shown
from haptic_accel.core.surfaces.texture import Provenance, TextureModel
from haptic_accel.materials.array_files import read_arrays

UNITS = {
    **{"rate": "Hz", "speeds": "m/s", "forces": "N", "deviation": "m/s^2"},
    **dict.fromkeys(("lsf", "ma_lsf"), "rad/sample"),
}
"""Units of the numbers in a file, which are stated there."""

ARRAYS = ("speeds", "forces", "deviation", "gain", "lsf", "ma_lsf")
OPTIONAL = ("gain", "ma_lsf", "coulomb_friction")
NAMES = ("name", "rate", "units", "provenance", "coulomb_friction", *ARRAYS)

DIGITS = 7
"""Significant digits of numbers in a YAML file; the rounding error is a tenth of single
precision's."""


def read_texture(path: Path) -> TextureModel:
    """Read a texture model.

    Raises
    ------
    ParameterError
        The message is one line with the file, the name, the invalid value and the allowed values.
    """
    return _model(read_npz(path) if path.suffix == ".npz" else read_yaml_document(path))


def write_texture(path: Path, model: TextureModel) -> None:
    """Write a texture model as NPZ or, for other suffixes, YAML.

    Raises
    ------
    ParameterError
        The file cannot be written; the message gives the reason.
    """
    arrays = {name: getattr(model, name) for name in ARRAYS if name not in OPTIONAL}
    if model.ma_lsf.size:
        arrays |= {name: getattr(model, name) for name in ("gain", "ma_lsf")}
    about = {
        "name": model.name,
        "rate": model.rate,
        "units": {name: unit for name, unit in UNITS.items() if name in (*arrays, "rate")},
        "provenance": asdict(model.provenance),
    }
    if model.coulomb_friction is not None:
        about["coulomb_friction"] = model.coulomb_friction
    with located(shown(str(path)), unreadable=""):
        if path.suffix == ".npz":
            np.savez_compressed(path, about=yaml.safe_dump(about, sort_keys=False), **arrays)
        else:
            # Rows of numbers in one line each.
            options: dict[str, Any] = {
                "sort_keys": False,
                "default_flow_style": None,
                "allow_unicode": True,
            }
            text = yaml.safe_dump(about | _rounded(arrays), width=100, **options)
            path.write_text(text, encoding="utf-8")


def _rounded(arrays: Mapping[str, Any]) -> dict[str, Any]:
    plain = np.vectorize(lambda value: float(f"{value:.{DIGITS}g}"), otypes=[float])
    return {name: plain(values).tolist() for name, values in arrays.items()}


def read_npz(path: Path) -> Document:
    """Return the arrays of a file by name, and the YAML data in its text ``about``.

    Raises
    ------
    ParameterError
        The file cannot be read.
    """
    with located(shown(str(path)), "must be NPZ"):
        arrays = read_arrays(path)
        about = load_yaml(str(arrays.pop("about", "")), exponents=True)
    content = {name: each if each.ndim else each.item() for name, each in arrays.items()}
    return Document(path, {**(about if isinstance(about, dict) else {}), **content})


def _model(file: Document) -> TextureModel:
    """Return the model from a file."""
    file.check_keys(*NAMES)
    units, provenance = file.at("units"), file.at("provenance")
    units.check_keys(*UNITS)
    for name, unit in units.members():
        if unit.value != UNITS[name]:
            unit.wrong(f"must be {UNITS[name]}")
    provenance.check_keys(*(each.name for each in fields(Provenance)))
    friction = file.get("coulomb_friction")
    given: dict[str, Any] = {
        "name": file.at("name").text(),
        "rate": file.at("rate").number(),
        "coulomb_friction": None if friction.value is None else friction.number(),
        "provenance": Provenance(**{name: each.text() for name, each in provenance.members()}),
    }
    arrays = [name for name in ARRAYS if name in file or name not in OPTIONAL]
    given |= {name: file.at(name).array() for name in arrays}
    with file.located():
        return TextureModel(**given)
