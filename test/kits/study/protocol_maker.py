# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protocols of studies for tests, without a file."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

from haptic_accel.kits.study.protocol import Condition, Consent, Levels, Pair, Protocol


def make_protocol(task: str = "2ifc", surfaces: int = 2, **changes: Any) -> Protocol:
    """Return a protocol of conditions with one surface each, and of pairs of neighbours."""
    conditions = tuple(Condition((("surface", f"s{number}"),)) for number in range(surfaces))
    content: dict[str, Any] = {
        "title": "Test",
        "task": task,
        "question": "Which?",
        "graph": {},
        "factors": {"surface": tuple(each["surface"] for each in conditions)},
        "conditions": conditions,
        "pairs": tuple(Pair(*pair) for pair in pairwise(conditions)),
        "consent": Consent("1", "I agree."),
        "instructions": "Feel.",
        "digest": "0" * 64,
        "source": Path("study.yaml"),
        "content": "",
    }
    return Protocol(**{**content, **changes})


def make_levels(
    values: tuple[float, ...] = (1.1, 1.2, 1.4, 1.8),
    scale: str = "linear",
    surfaces: tuple[str, ...] = ("wood",),
    **changes: Any,
) -> Protocol:
    """Return a protocol whose gain is compared with a gain of 1 on each surface."""
    levels = Levels("gain", 1.0, values, scale)
    pairs = tuple(
        Pair(_condition(1.0, surface), _condition(value, surface), value)
        for surface in surfaces
        for value in values
    )
    conditions = tuple(dict.fromkeys(each for pair in pairs for each in _both(pair)))
    factors = {"gain": (1.0, *values), "surface": surfaces}
    content = {"factors": factors, "conditions": conditions, "pairs": pairs, "levels": levels}
    return make_protocol(**{**content, **changes})


def _condition(gain: float, surface: str) -> Condition:
    return Condition((("gain", gain), ("surface", surface)))


def _both(pair: Pair) -> tuple[Condition, Condition]:
    return pair.reference, pair.comparison
