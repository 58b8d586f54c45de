# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture models as files: YAML for people, NPZ for programs, with the same names and units."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from haptic_accel.core.parameters import ParameterError, shown, suggestion
from haptic_accel.core.surfaces.texture import Provenance, TextureModel
from haptic_accel.core.yaml_text import LARGEST, load_yaml

UNITS = {
    "rate": "Hz",
    "speeds": "m/s",
    "forces": "N",
    "lsf": "rad/sample",
    "deviation": "m/s^2",
    "ma_lsf": "rad/sample",
}
"""Units of the numbers in a file, which states them."""

ARRAYS = ("speeds", "forces", "deviation", "gain", "lsf", "ma_lsf")
OPTIONAL = ("gain", "ma_lsf", "coulomb_friction")
NAMES = ("name", "rate", "units", "provenance", "coulomb_friction", *ARRAYS)

DIGITS = 7
"""Significant digits of a YAML file's numbers: a tenth of what single precision has."""


def read_texture(path: Path) -> TextureModel:
    """Read a texture model.

    Raises
    ------
    ParameterError
        In one line: the file, the name and the value that is wrong, and what is allowed.
    """
    content = read_npz(path) if path.suffix == ".npz" else _read_yaml(path)
    try:
        return _model(content)
    except ParameterError as error:
        raise ParameterError(f"{shown(str(path))}: {error}") from None


def write_texture(path: Path, model: TextureModel) -> None:
    """Write a texture model as NPZ, or as YAML by any other name.

    Raises
    ------
    ParameterError
        The file cannot be written; with the reason.
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
    try:
        if path.suffix == ".npz":
            np.savez_compressed(path, about=yaml.safe_dump(about, sort_keys=False), **arrays)
        else:
            path.write_text(_text(about | _rounded(arrays)), encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"{shown(str(path))}: {error.strerror}") from None


def _rounded(arrays: Mapping[str, Any]) -> dict[str, Any]:
    def plain(values: Any) -> Any:
        if isinstance(values, list):
            return [plain(each) for each in values]
        return float(f"{values:.{DIGITS}g}")

    return {name: plain(values.tolist()) for name, values in arrays.items()}


def _text(content: Mapping[str, Any]) -> str:
    # Rows of numbers in one line each.
    return yaml.safe_dump(
        dict(content), sort_keys=False, default_flow_style=None, width=100, allow_unicode=True
    )


def _read_yaml(path: Path) -> Any:
    try:
        if os.path.getsize(path) > LARGEST:
            raise ValueError(f"has more than {LARGEST} bytes")
        return load_yaml(path.read_text(encoding="utf-8"), exponents=True)
    except OSError as error:
        raise _no_file(path, error) from None
    except ValueError as error:  # UnicodeError, too
        raise ParameterError(f"{shown(str(path))}: is not YAML: {shown(str(error))}") from None


def read_npz(path: Path) -> Any:
    """Return the arrays of a file by name, and what its text ``about`` states in YAML.

    Raises
    ------
    ParameterError
        It cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        about = load_yaml(str(content.pop("about", "")), exponents=True)
    except OSError as error:
        raise _no_file(path, error) from None
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, AttributeError) as error:
        raise ParameterError(f"{shown(str(path))}: is not NPZ: {shown(str(error))}") from None
    return {**about, **content} if isinstance(about, dict) else content


def _no_file(path: Path, error: OSError) -> ParameterError:
    return ParameterError(f"{shown(str(path))}: {error.strerror or 'cannot be read'}")


def _model(content: Any) -> TextureModel:
    """Return the model that a file's content states."""
    if not isinstance(content, dict):
        raise ParameterError("must be a mapping with name, rate, units, speeds, forces, lsf, ...")
    for name in map(str, content):
        if name not in NAMES:
            near = suggestion(name, NAMES)
            raise ParameterError(f"{shown(name)}: must be one of {', '.join(NAMES)}{near}")
    for name in NAMES:
        if name not in (*content, *OPTIONAL):
            raise ParameterError(f"{name}: is missing")
    units = _mapping("units", content["units"], UNITS)
    for name, unit in units.items():
        if unit != UNITS[name]:
            raise ParameterError(f"units.{name} = {shown(str(unit))}: must be {UNITS[name]}")
    known = [each.name for each in fields(Provenance)]
    provenance = _mapping("provenance", content["provenance"], known)
    friction = content.get("coulomb_friction")
    return TextureModel(
        name=_text_of("name", content["name"]),
        rate=_number("rate", content["rate"]),
        coulomb_friction=None if friction is None else _number("coulomb_friction", friction),
        provenance=Provenance(
            **{name: _text_of(f"provenance.{name}", text) for name, text in provenance.items()}
        ),
        **{name: _array(name, content[name]) for name in ARRAYS if name in content},
    )


def _mapping(name: str, value: Any, known: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or not set(value) <= set(known):
        raise ParameterError(f"{name} = {shown(str(value))}: must have {', '.join(known)}")
    return value


def _text_of(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise ParameterError(f"{name} = {shown(str(value))}: must be text")
    return value


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ParameterError(f"{name} = {shown(str(value))}: must be a number")
    return float(value)


def _array(name: str, value: Any) -> Any:
    try:
        found = np.asarray(value)
        if found.dtype.kind not in "fiu" or not found.size:
            raise ValueError
    except ValueError:  # rows of different lengths, too
        form = "rows of as many numbers each" if "lsf" in name else "numbers"
        raise ParameterError(f"{name} = {shown(str(value)[:60])}: must be {form}") from None
    return found.astype(float)
