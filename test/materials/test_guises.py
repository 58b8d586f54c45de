# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One recording and one solid in many forms: the same figures, or one line with the reason."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import fuzz_few
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.recordings import read_samples
from recordings import write_wav

RATE = 500.0
TIME = np.arange(600) / RATE
NOISE = np.random.default_rng(5).normal(size=len(TIME))
SIGNAL = 20.0 * np.sin(2 * np.pi * 170.0 * TIME) + 2.0 * NOISE
"""Acceleration, m/s^2."""

FULL_SCALE = 49.0

# CSV

G = 9.80665
TITLES = {
    **{"acceleration": 1.0, "acc [m/s\u00b2]": 1.0, "accel_m_s2": 1.0, "a [g]": G, "accel_g": G},
    **{"acc_mg": G / 1000, "acceleration (mm/s^2)": 1e-3, "a / (m/s^2)": 1.0},
}
TIMES = {"time": 1.0, "Zeit (s)": 1.0, "Time [ms]": 1e-3, "micros": 1e-6, "stamp (ns)": 1e-9}
CONTRADICTIONS = ("rate", "back", "unit", "decimal", "word")
ENCODINGS = {"utf-8": "", "utf-8-sig": "", "utf-16": "", "utf-16-be": "\ufeff"}


@st.composite
def tables(draw: st.DrawFn) -> tuple[bytes, float, str]:
    """CSV files of the signal, the rate stated beside them, and what contradicts in them."""
    wrong = draw(st.sampled_from(["", "", "", *CONTRADICTIONS]))
    separator = "," if wrong == "decimal" else draw(st.sampled_from(",;\t"))
    commas = wrong == "decimal" or (separator != "," and draw(st.booleans()))
    title = draw(st.sampled_from([*TITLES]))
    values = [repr(value) for value in (SIGNAL / TITLES[title]).tolist()]
    title = "acc [V]" if wrong == "unit" else title
    if wrong == "word":
        values[draw(st.integers(0, len(values) - 1))] = draw(st.sampled_from(["x", "-", "1.2.3"]))
    columns = [(title, values)]
    kept = draw(st.booleans()) or wrong in ("rate", "back")
    if kept:
        name = draw(st.sampled_from([*TIMES]))
        times = (draw(st.sampled_from([0.0, 17.0])) + TIME) / TIMES[name]
        if wrong == "back":
            at = draw(st.integers(1, len(times) - 1))
            times[at:] -= 2 * (times[at] - times[0])
        columns.insert(draw(st.integers(0, 1)), (name, [f"{time:.12g}" for time in times]))
    for extra in draw(
        st.lists(st.sampled_from(["speed", "note", "x y"]), unique=True, max_size=2)
    ):
        columns.insert(draw(st.integers(0, len(columns))), (extra, ["7"] * len(values)))
    if draw(st.booleans()):
        columns.insert(0, ("", [str(number) for number in range(len(values))]))  # an index
    if wrong != "decimal" and draw(st.booleans()):
        columns.append(("", [""] * len(values)))  # a separator at the end of each line
    commas = commas and (wrong == "decimal" or len(columns) > 1)
    quote = draw(st.sampled_from(["", '"']))
    rows = [separator.join(f"{quote}{name}{quote}" for name, _ in columns)]
    cells = zip(*(texts for _, texts in columns), strict=True)
    rows += [separator.join(row).replace(".", "," if commas else ".") for row in cells]
    rows = draw(st.sampled_from([[], ["# drag"], [""]])) + rows
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    encoding = draw(st.sampled_from([*ENCODINGS]))
    stated = draw(st.sampled_from([0.0, RATE])) if kept else RATE
    if wrong == "rate":
        stated = draw(st.sampled_from([RATE / 2, 2 * RATE, 1.01 * RATE]))
    return (ENCODINGS[encoding] + end.join(rows) + end).encode(encoding), stated, wrong


@fuzz_few
@given(tables())
def test_a_csv_file_is_read_alike_in_any_form(
    tmp_path: Path, table: tuple[bytes, float, str]
) -> None:
    content, stated, wrong = table
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    if wrong:
        with pytest.raises(ParameterError) as refused:
            read_samples(path, stated)
        assert str(path) in str(refused.value)
    else:
        samples, rate = read_samples(path, stated)
        assert rate == RATE
        assert samples == pytest.approx(SIGNAL, rel=1e-12, abs=1e-12)


# WAV

ROUNDING = {"uint8": 2**-7, "int16": 2**-15, "int24": 2**-23, "int32": 2**-31, "float32": 2**-24}


def chunk(name: bytes, content: bytes, padding: bytes = b"\0") -> bytes:
    return name + struct.pack("<I", len(content)) + content + padding * (len(content) % 2)


@fuzz_few
@given(
    st.sampled_from([*ROUNDING, "float64"]),
    st.integers(1, 4).flatmap(lambda count: st.tuples(st.just(count), st.integers(1, count))),
    st.lists(
        st.tuples(
            st.sampled_from([b"LIST", b"bext"]),
            st.binary(max_size=9),
            st.sampled_from([b"\0", b""]),
        ),
        max_size=3,
    ),
    st.sampled_from(["right", "unknown", "largest"]),
    st.sampled_from([0.0, RATE, RATE, 2 * RATE]),
)
def test_a_wav_file_is_read_alike_in_any_form(
    tmp_path: Path,
    encoding: str,
    channels: tuple[int, int],
    others: Sequence[tuple[bytes, bytes, bytes]],
    size: str,
    stated: float,
) -> None:
    count, own = channels
    relative = np.zeros((len(SIGNAL), count))
    relative[:, own - 1] = SIGNAL / FULL_SCALE
    write_wav(buffer := io.BytesIO(), int(RATE), relative, encoding)
    whole = buffer.getvalue()
    body = whole[8:12] + b"".join(chunk(*other) for other in others) + whole[12:]
    path = tmp_path / "a.wav"
    sizes = {"right": len(body), "unknown": 0, "largest": 2**32 - 1}
    path.write_bytes(b"RIFF" + struct.pack("<I", sizes[size]) + body)
    if stated > RATE:
        with pytest.raises(ParameterError, match=f"must be 0 or 500 Hz as {path} says"):
            read_samples(path, stated, str(own), FULL_SCALE)
        return
    samples, rate = read_samples(path, stated, str(own), FULL_SCALE)
    assert rate == RATE
    assert samples == pytest.approx(SIGNAL, abs=FULL_SCALE * ROUNDING.get(encoding, 1e-15))


# Meshes

Triangles = FloatArray


def box_of(low: float, high: float, side: float) -> Triangles:
    """Return the triangles of a box with faces outwards, shape (12, 3, 3), mm."""
    corners = np.array(
        [(x, y, z) for x in (low, high) for y in (-side, side) for z in (-side, side)]
    )
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    split = [triangle for a, b, c, d in faces for triangle in ((a, b, c), (a, c, d))]
    return corners[np.array(split)].astype(float)


SOLID = np.concatenate([box_of(-20, 10, 8), box_of(0, 24, 12)])
"""Two bodies that overlap."""


def binary_stl(triangles: Triangles) -> bytes:
    faces = [bytes(12) + each.astype("<f4").tobytes() + bytes(2) for each in triangles]
    return bytes(80) + struct.pack("<I", len(triangles)) + b"".join(faces)


def ascii_stl(triangles: Triangles) -> bytes:
    faces = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in each)
        + "endloop\nendfacet\n"
        for each in triangles
    ]
    return ("solid a\n" + "".join(faces) + "endsolid a\n").encode()


def obj(triangles: Triangles) -> bytes:
    vertices = triangles.reshape(-1, 3)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {at + 1} {at + 2} {at + 3}" for at in range(0, len(vertices), 3)]
    return "\n".join(lines).encode()


FORMS = {"binary.stl": binary_stl, "ascii.stl": ascii_stl, "a.obj": obj}
SPACING = 4e-3


@fuzz_few
@given(
    st.sampled_from([*FORMS]),
    st.permutations(range(len(SOLID))),
    st.lists(st.integers(0, 2), min_size=len(SOLID), max_size=len(SOLID)),
    st.booleans(),
    st.sampled_from([1.0, 1e-3, 1e-2]),
)
def test_a_mesh_is_read_alike_in_any_form(
    tmp_path: Path,
    form: str,
    order: Sequence[int],
    turns: Sequence[int],
    inwards: bool,
    scale: float,
) -> None:
    pytest.importorskip("trimesh.proximity")
    from haptic_accel.materials.mesh_baking import baked

    turned = np.array(
        [np.roll(each, turn, axis=0) for each, turn in zip(SOLID, turns, strict=True)]
    )
    triangles = turned[list(order)][:, :: -1 if inwards else 1] * 1e-3 / scale
    path = tmp_path / form
    path.write_bytes(FORMS[form](triangles))
    grid, corner, remark = baked(path, SPACING, scale)
    assert ("inwards" in remark) == inwards
    assert grid.shape == (16, 11, 11)
    assert corner == pytest.approx([-0.028, -0.02, -0.02], abs=1e-8)
    places = corner + SPACING * np.moveaxis(np.indices(grid.shape), 0, -1).reshape(-1, 3)
    one, other = (
        np.max(np.abs(places - middle) - half, axis=1)
        for middle, half in (
            (np.array([-0.005, 0, 0]), np.array([0.015, 0.008, 0.008])),
            (np.array([0.012, 0, 0]), np.array([0.012, 0.012, 0.012])),
        )
    )
    inside = np.minimum(one, other)
    clear = np.abs(inside) > 1e-6
    assert np.array_equal((grid.ravel() < 0)[clear], (inside < 0)[clear])
    deep = inside < 0
    assert grid.ravel()[deep] == pytest.approx(inside[deep], abs=1e-7)
