# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generated damage to what decoders read: `pytest --fuzz 1000000` for a million cases of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st

from haptic_accel.core.parameters import ParameterError

T = TypeVar("T", bytes, str)

ODD_NUMBERS = (
    "1_000",
    "\u0661\u0662",  # 12 in Arabic digits
    "\uff11\uff12",  # in those of full width
    "\u00b2",
    "\u22121",
    "0x10",
    "0b1",
    "1j",
    "1,5",
    "1e",
    "e5",
    "--1",
    "+",
    ".",
    "",
    "nan",
    "inf",
    "-Infinity",
    "1\u00a0",
    "1\0",
    "1" * 500 + "x",
)
"""Texts that are no number in a file, though Python takes some of them for one."""

ODD_TEXTS = (
    *ODD_NUMBERS,
    "\ufeff",
    "\x1b[2J",
    "\u2028",
    "\x85",
    "a" * 3000,
    "\U0001f600",
    "[",
    "{",
)
"""Texts that break parsers, and lines of output."""


def fuzz(test: Callable[..., Any]) -> Callable[..., Any]:
    """Give a property the number of cases that was asked for, and its mark."""
    return pytest.mark.fuzz(settings.get_profile("fuzz")(test))


def mutated(valid: st.SearchStrategy[T], pieces: st.SearchStrategy[T]) -> st.SearchStrategy[T]:
    """Return what is valid, with up to four parts changed, cut out, doubled or inserted.

    Parameters
    ----------
    valid : strategy of bytes or str
    pieces : strategy of bytes or str
        What is inserted, or put in place of something.
    """
    kinds = st.sampled_from(["replace", "cut", "double", "insert", "end"])
    change = st.tuples(kinds, st.integers(0, 999), st.integers(1, 16), pieces)
    return st.builds(_changed, valid, st.lists(change, max_size=4))


def _changed(text: T, changes: list[tuple[str, int, int, T]]) -> T:
    for kind, where, length, piece in changes:
        at = where * (len(text) + 1) // 1000
        before, there, after = text[:at], text[at : at + length], text[at + length :]
        text = {
            "replace": before + piece + after,
            "cut": before + after,
            "double": before + there + there + after,
            "insert": before + piece + there + after,
            "end": before,
        }[kind]
    return text


def accepted(read: Callable[[], object]) -> bool:
    """Return whether something is read; what is refused must be in one line fit for a terminal."""
    try:
        read()
    except ParameterError as error:
        assert str(error).isprintable(), repr(str(error))
        return False
    return True
