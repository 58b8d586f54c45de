"""Where a model of a surface comes from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Provenance:
    """Where a model comes from, and what may be done with it."""

    source: str = ""
    licence: str = ""
    author: str = ""
    calibration: str = ""
