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

"""Plain ASCII decimals in files and on command lines; null for undefined numbers in JSON.

Python's `float` and `int` also accept digits of other scripts, underscores, ``nan`` and ``inf``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

_BLANKS = " \t"
_WHOLE = re.compile(r"[-+]?[0-9]{1,300}")  # fits into a float
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def read_decimal(text: str) -> float:
    """Return a decimal number, with or without exponent; infinity if it is too large.

    Raises
    ------
    ValueError
        The text is no decimal number.
    """
    return float(_matched(_DECIMAL, text))


def read_whole(text: str) -> int:
    """Return a whole number written as decimal digits.

    Raises
    ------
    ValueError
        The text is no whole number, or has more than 300 digits.
    """
    return int(_matched(_WHOLE, text))


def defined(value: Any) -> Any:
    """Return a value for JSON: None instead of a number that is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: defined(inner) for key, inner in value.items()}
    return [defined(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def _matched(pattern: re.Pattern[str], text: str) -> str:
    """Return a text without surrounding blanks; raise `ValueError` if it has another form."""
    bare = text.strip(_BLANKS)
    if not pattern.fullmatch(bare):
        raise ValueError(f"{text[:40]!r}: must be a number")
    return bare
