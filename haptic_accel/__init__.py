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

"""Teleoperation with high-frequency acceleration feedback.

For notebooks and scripts, without ROS: `run_trial` runs a condition of the experiment in lockstep
on a `Rig` and returns a `Trial`; `read_bag` reads a recorded `Bag`; `identify_handle` fits the
handle's model; `design_inverse`, `predict` and `causal_bound` design a controller for an
`IdentifiedPlant` and bound its error.

Examples
--------
>>> from haptic_accel import run_trial
>>> trial = run_trial("dynamic", rig="ideal", surface="text", duration=2.0)
>>> 0.0 < trial.nrmse() < 50.0
True
"""

from __future__ import annotations

TYPE_CHECKING = False  # an emergency stop must not wait for typing
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.3.0"

_MODULES = {
    "Bag": "haptic_accel.bags.reading",
    "IdentifiedPlant": "haptic_accel.core.handle.plant",
    "Rig": "haptic_accel.analysis.notebook",
    "Trial": "haptic_accel.core.trial",
    "causal_bound": "haptic_accel.core.control.inversion.bound",
    "design_inverse": "haptic_accel.core.control.inversion.design",
    "identify_handle": "haptic_accel.core.identification.evaluation",
    "predict": "haptic_accel.core.control.inversion.prediction",
    "read_bag": "haptic_accel.bags.reading",
    "run_trial": "haptic_accel.analysis.notebook",
}
"""Module of each name; loaded with its first use, as nodes import this package, too."""


__all__ = ["__version__", *_MODULES]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
