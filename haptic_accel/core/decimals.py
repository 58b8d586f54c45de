# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers in files and on command lines: plain decimals in ASCII, and null for none in JSON.

Python's own `float` and `int` also take digits of other scripts, underscores, ``nan`` and ``inf``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

_BLANKS = " \t"
_WHOLE = re.compile(r"[-+]?[0-9]{1,300}")  # which a float can hold
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def read_decimal(text: str) -> float:
    """Return a number written as a decimal, with an exponent or without; infinity if too large.

    Raises
    ------
    ValueError
        It is none.
    """
    return float(_matched(_DECIMAL, text))


def read_whole(text: str) -> int:
    """Return a whole number written as decimal digits.

    Raises
    ------
    ValueError
        It is none, or has more than 300 digits.
    """
    return int(_matched(_WHOLE, text))


def defined(value: Any) -> Any:
    """Return a value for JSON, which has no number that is not finite: None in place of it."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: defined(inner) for key, inner in value.items()}
    return [defined(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def _matched(pattern: re.Pattern[str], text: str) -> str:
    """Return a text without blanks around it; raise `ValueError` if it has another form."""
    bare = text.strip(_BLANKS)
    if not pattern.fullmatch(bare):
        raise ValueError(f"{text[:40]!r}: must be a number")
    return bare
