# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Strategies for damaged files: texts, arrays, and archives of arrays."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from hypothesis import strategies as st

from fuzzing import mutated

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


ODD_NUMBERS = ("0", "-1", "1", "2.5", "60", "9999", "1e-300", "1e300", "1e999", "9" * 400)
ODD_VALUES = (*ODD_NUMBERS, '"x"', "")
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
    odd = st.sampled_from(ODD_ARRAYS)
    others = draw(st.dictionaries(st.sampled_from([*arrays]), odd, max_size=3))
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


def text(whole: bytes) -> st.SearchStrategy[bytes]:
    return mutated(st.just(whole), PIECES) | revalued(whole)


def written(content: Any) -> st.SearchStrategy[bytes]:
    return text(json.dumps(content).encode())
