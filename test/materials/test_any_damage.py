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

"""Damaged files of every kind: read or refused in one line, within 2 s and 500 MB."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import wavfile

from fuzzing import accepted, fuzz_few, in_child, measured, mutated
from haptic_accel.core.handle.discrete import read_discrete_model
from haptic_accel.core.surfaces.taps import Tap
from haptic_accel.kits.textures.foreign import import_texture
from haptic_accel.materials.mesh_baking import baked
from haptic_accel.materials.sampled_shapes import Sampling, read_heights
from haptic_accel.materials.scenes import read_taps
from haptic_accel.materials.texture_files import read_texture, write_texture
from hatt_file import hatt_file

NOISE = np.random.default_rng(0).normal(size=64)
PIECES = st.sampled_from(
    [
        *(b"0", b"9", b"99999999", b"-1", b"1e308", b"e9", b"nan", b"null", b".", b" ", b"\n"),
        *(b"[", b"]", b"{", b"}", b'"', b"'", b",", b":", b"<", b">", b"/>", b"<a>", b"&lt;"),
        *(b"\0", b"\xff", b"\xff\xff\xff\xff", b"\x7f", b"\x1b[2J", "\u202e".encode(), b"\\ud800"),
    ]
)
ANY_BYTES = PIECES | st.binary(max_size=4)


def array(values: Any) -> bytes:
    """Return an NPY file."""
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


ODD_VALUES = (
    "0",
    "-1",
    "1",
    "2.5",
    "60",
    "9999",
    "1e-300",
    "1e300",
    "1e999",
    "9" * 400,
    '"x"',
    "",
)
ODD_ARRAYS: list[Any] = [
    *(np.nan, np.inf, 0, -1, 1e300, 5e-324, 2**63, True, "x", "\ud800", b"x", 1j, None),
    *([], [[]], [1.0], [0.1, 0.2], [0.2, 0.1], [np.nan] * 4, np.zeros((2, 0)), np.ones((4, 300))),
    *(np.ones((1, 1, 1)), np.full(4, 1e300), np.zeros(4), np.arange(4.0), np.ones((2, 3, 4))),
    *(np.ones((4, 3)) * 1e-300, np.ones(500), np.ones((500, 2)), ["acc"], ["a", "b", "c"]),
    *(np.zeros(2, "M8[s]"), np.zeros(2, "i4,f8"), np.zeros(2, "(2,)f8"), "[" * 1000, "rate: .nan"),
]


@st.composite
def revalued(draw: st.DrawFn, whole: bytes) -> bytes:
    """Texts in which a few numbers are others."""
    parts = re.split(r"(-?[0-9][0-9.e+-]*)", whole.decode())
    for place in draw(st.lists(st.sampled_from(range(1, len(parts), 2)), min_size=1, max_size=3)):
        parts[place] = draw(st.sampled_from(ODD_VALUES))
    return "".join(parts).encode()


@st.composite
def other_arrays(draw: st.DrawFn, arrays: Mapping[str, Any]) -> bytes:
    """NPZ files in which a few arrays are others."""
    others = draw(
        st.dictionaries(st.sampled_from([*arrays]), st.sampled_from(ODD_ARRAYS), max_size=3)
    )
    file = io.BytesIO()
    np.savez(file, **{**arrays, **others})
    return file.getvalue()


@st.composite
def zipped(draw: st.DrawFn, arrays: Mapping[str, Any]) -> bytes:
    """NPZ files whose arrays are damaged, or they themselves, or both."""
    file = io.BytesIO()
    damaged = draw(st.sampled_from([None, None, *arrays]))
    with zipfile.ZipFile(file, "w", draw(st.sampled_from([0, 8]))) as members:
        for name, values in arrays.items():
            whole = array(values)
            part = draw(mutated(st.just(whole), ANY_BYTES)) if name == damaged else whole
            members.writestr(f"{name}.npy", part)
    return draw(mutated(st.just(file.getvalue()), ANY_BYTES)) if not damaged else file.getvalue()


FRAME = {"speeds": np.array([0.0, 0.1, 0.0, 0.1]), "forces": np.array([0.0, 0.0, 1.0, 1.0])}
TEXTURE = {
    "about": "name: oak\nrate: 1000.0\nunits: {}\nprovenance: {licence: none}\n",
    **FRAME,
    "deviation": np.array([0.0, 0.0, 0.0, 1.0]),
    "lsf": np.tile([0.5, 1.0, 2.0], (4, 1)),
}
TAPS = {"speeds": np.array([0.1, 0.2]), "samples": NOISE.reshape(2, -1), "rate": 1000.0}
AXES = {"data": NOISE.reshape(2, -1), "sample_rate": 1000, "channel_names": ["acc_x", "acc_y"]}
FILTER = {"name": "oak", "sample_rate": 1000.0, "b": [0.5], "a": [1.0, -0.5]}
STRENGTH = [{"ParameterID": "HapticIntensity", "ParameterValue": 0.5}]
CURVE = {
    "ParameterID": "HapticSharpnessControl",
    "Time": 0.0,
    "ParameterCurveControlPoints": [{"Time": 0.1, "ParameterValue": 0.3}],
}
AHAP = {
    "Pattern": [
        {
            "Event": {
                "Time": 0.1,
                "EventType": "HapticContinuous",
                "EventDuration": 0.3,
                "EventParameters": STRENGTH,
            }
        },
        {"Event": {"Time": 0.0, "EventType": "HapticTransient", "EventParameters": STRENGTH}},
        {"ParameterCurve": CURVE},
    ]
}
POINT = {"time": 0.2, "amplitude": 0.4, "emphasis": {"amplitude": 0.9, "frequency": 0.9}}
ENVELOPES = {
    "amplitude": [{"time": 0.0, "amplitude": 0.5}, POINT],
    "frequency": [{"time": 0.0, "frequency": 0.5}],
}
HAPTIC = {"signals": {"continuous": {"envelopes": ENVELOPES}}}
MODEL = {
    "discrete_model": {"sections": [[1, 0, 0, 1, -0.5, 0]], "rate_hz": 1e3, "delay_samples": 1}
}


def wav(dtype: str) -> bytes:
    file = io.BytesIO()
    wavfile.write(file, 20, (50 * NOISE if dtype == "int16" else NOISE / 4).astype(dtype))
    return file.getvalue()


def texture() -> bytes:
    """Return a texture as YAML."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "whole.json"
        path.write_text(json.dumps(FILTER))
        write_texture(path.with_suffix(".yaml"), import_texture(path))
        return path.with_suffix(".yaml").read_bytes()


def heard(path: Path) -> None:
    """Read taps and play one."""
    Tap(read_taps(path), 1000.0)


def imported(path: Path) -> None:
    import_texture(path, 20.0, None if path.suffix in (".xml", ".csv") else 5.0)


def text(whole: bytes) -> st.SearchStrategy[bytes]:
    return mutated(st.just(whole), PIECES) | revalued(whole)


def written(content: Any) -> st.SearchStrategy[bytes]:
    return text(json.dumps(content).encode())


Read = Callable[[Path], object]
KINDS: dict[str, tuple[str, Read, st.SearchStrategy[bytes]]] = {
    "texture, NPZ": ("a.npz", read_texture, zipped(TEXTURE) | other_arrays(TEXTURE)),
    "taps, NPZ": ("a.npz", heard, zipped(TAPS) | other_arrays(TAPS)),
    "acceleration, NPZ": ("a.npz", imported, zipped(AXES) | other_arrays(AXES)),
    "heights, NPY": (
        "a.npy",
        lambda path: read_heights(path, Sampling()),
        mutated(st.just(array(NOISE.reshape(8, 8))), ANY_BYTES),
    ),
    "texture, XML": (
        "a.xml",
        imported,
        text(hatt_file((4, 2), 12).encode()),
    ),
    "filter, JSON": ("a.json", imported, written(FILTER)),
    "pattern, AHAP": ("a.ahap", imported, written(AHAP)),
    "pattern, haptic": ("a.haptic", imported, written(HAPTIC)),
    "model, JSON": ("a.json", read_discrete_model, written(MODEL)),
    "acceleration, CSV": (
        "a.csv",
        imported,
        text(b"t,acc\n" + b"".join(b"%g,%f\n" % (i / 20, value) for i, value in enumerate(NOISE))),
    ),
    "acceleration, WAV": (
        "a.wav",
        imported,
        mutated(st.sampled_from([wav("int16"), wav("float32")]), ANY_BYTES),
    ),
}


@pytest.mark.parametrize("kind", KINDS)
@fuzz_few
@given(st.data())
def test_any_damage_is_refused_in_one_line(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    name, read, contents = KINDS[kind]
    path = tmp_path / name
    path.write_bytes(data.draw(contents))
    with measured():
        accepted(lambda: read(path))


@fuzz_few
@given(text(texture()))
def test_any_damage_to_a_texture_in_yaml_is_refused_in_one_line(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(content)
    with measured():
        accepted(lambda: read_texture(path))


CORNERS = np.array([(0, 0, 0), (10, 0, 0), (0, 10, 0), (0, 0, 10)], "<f4")
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
STL = (
    bytes(80)
    + struct.pack("<I", len(FACES))
    + b"".join(bytes(12) + CORNERS[list(face)].tobytes() + bytes(2) for face in FACES)
)
OBJ = "".join(
    [
        *(f"v {x} {y} {z}\n" for x, y, z in CORNERS),
        *(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES),
    ]
).encode()


@pytest.mark.parametrize(("name", "whole"), [("a.stl", STL), ("a.obj", OBJ)])
@fuzz_few
@given(st.data())
def test_any_damage_to_a_mesh_is_refused_in_one_line(
    tmp_path: Path, name: str, whole: bytes, data: st.DataObject
) -> None:
    pytest.importorskip("trimesh.proximity")
    path = tmp_path / name
    path.write_bytes(data.draw(mutated(st.just(whole), ANY_BYTES)))
    in_child(lambda: accepted(lambda: baked(path, 2e-3, 1e-3)))
