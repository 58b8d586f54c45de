# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Teleoperation with high-frequency acceleration feedback.

For notebooks: `run_trial` runs a condition of the experiment in lockstep, on a `Rig`, and
`read_bag` reads a recorded one.
"""

from __future__ import annotations

TYPE_CHECKING = False  # an emergency stop must not wait for typing
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.2.0"

_MODULES = {
    "Rig": "haptic_accel.analysis.notebook",
    "read_bag": "haptic_accel.bags.reading",
    "run_trial": "haptic_accel.analysis.notebook",
}
"""Module of each name; loaded with its first use, as nodes import this package, too."""


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
