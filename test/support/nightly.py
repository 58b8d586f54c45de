# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parametrizations that `make test` runs in part."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def rest_slow(values: Iterable[Any], now: int = 1) -> list[Any]:
    """Return the values of a parametrization with all but the first few marked slow.

    Parameters
    ----------
    values : iterable
        Values, or tuples of several.
    now : int
        Number of those that are not slow.
    """
    cases = [each if isinstance(each, tuple) else (each,) for each in values]
    slow = [pytest.param(*case, marks=pytest.mark.slow) for case in cases[now:]]
    return [*(pytest.param(*case) for case in cases[:now]), *slow]
