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

"""Reader of texture models in the Penn Haptic Texture Toolkit's XML (Culbertson and others 2014).

Its licence permits non-profit research, but no redistribution; users provide the files.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from haptic_accel.core.bounded_files import located, read_xml
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.core.surfaces.texture import Provenance, TextureModel

MILLIMETRE = 1e-3
"""Metres per millimetre."""

UNITS = {"SpeedUnits": "mm/s", "ForceUnits": "N"}
"""Units in the toolkit's files; accelerations are in m/s^2."""

PROVENANCE = Provenance(
    source="Penn Haptic Texture Toolkit",
    licence="non-profit research only, no redistribution",
    author="H. Culbertson, J. J. Lopez Delgado, K. J. Kuchenbecker",
    calibration="m/s^2, as in the file",
)


def read_hatt(path: Path) -> TextureModel:
    """Read a texture model, autoregressive or with a moving average.

    The triangles of the file are ignored; those of the model are equal or better.

    Raises
    ------
    ParameterError
        The file cannot be read, has another format, or contains no valid model; the message is one
        line.
    """
    with located(path, "not XML"):
        model_set = read_xml(path)
    with located(path):
        return _model(model_set, path.stem)


def _model(model_set: ElementTree.Element, name: str) -> TextureModel:
    if model_set.tag != "modelSet":
        raise ParameterError(f"{shown(model_set.tag)}: must be a modelSet")
    for tag, unit in UNITS.items():
        found = model_set.findtext(tag, unit).strip()
        if found != unit:
            raise ParameterError(f"{tag} = {shown(found)}: must be {unit}")
    nodes = model_set.findall("model")
    friction = model_set.findtext("mu")
    return TextureModel(
        name=model_set.findtext("material", name).strip(),
        rate=_number(model_set, "SampleRate"),
        speeds=np.array([_number(node, "speedMod") for node in nodes]) * MILLIMETRE,
        forces=np.array([_number(node, "forceMod") for node in nodes]),
        lsf=_rows(nodes, "ARlsf"),
        deviation=np.sqrt([_number(node, "var", low=0.0) for node in nodes]),
        ma_lsf=_rows(nodes, "MAlsf"),
        gain=np.array([_number(node, "gain", default="1") for node in nodes]),
        coulomb_friction=None if friction is None else _float("mu", friction),
        provenance=PROVENANCE,
    )


def _rows(nodes: list[ElementTree.Element], tag: str) -> FloatArray:
    """Return the frequencies of each node below a tag; none if it is absent."""
    rows = [[_float(tag, value.text) for value in node.iterfind(f"{tag}/value")] for node in nodes]
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ParameterError(f"{tag}: {lengths[0]} to {lengths[-1]} values: must be one order")
    return np.array(rows, dtype=float)


def _number(
    parent: ElementTree.Element, tag: str, default: str | None = None, low: float = -np.inf
) -> float:
    text = parent.findtext(tag, default)
    if text is None:
        raise ParameterError(f"{tag}: missing in {parent.tag}")
    number = _float(tag, text)
    if number < low:
        raise ParameterError(f"{tag} = {number:g}: must be at least {low:g}")
    return number


def _float(tag: str, text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        raise ParameterError(f"{tag} = {shown(repr(text))}: must be a number") from None
