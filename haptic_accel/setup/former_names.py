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

"""Former names of parameters and arguments, as in older bags; those of 0.3 in files, too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from haptic_accel.core.control.inversion.design import LONGEST_GRANTED_TIME
from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.core.sampling import DEFAULT_RATE

BEGINNINGS = {
    **{"can_serial.arm.": "can.", "can_serial.handle.": "serial."},
    **{"crtk_serial.arm.": "crtk.", "crtk_serial.handle.": "serial."},
}
"""Beginnings of names before 0.2, and of those in their place."""

IN_SAMPLES = {
    f"{controller}.granted_delay": f"{controller}.granted_time"
    for controller in ("adaptive", "feedback", "inverse")
}
"""Delays of the compensator that were numbers of samples before 0.4, and times in their place."""


def in_time(
    values: Mapping[str, Any], rate: object, warn: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Return values in which every delay in samples is a time, in s.

    Parameters
    ----------
    values : mapping
        Values of the compensator by dotted name.
    rate
        Samples per second of the graph; the default rate in place of what is no rate.
    warn : callable, optional
        Receives one line for each delay in samples.

    Raises
    ------
    ParameterError
        A delay is no whole number of samples, or is given as a time, too.

    Examples
    --------
    >>> in_time({"inverse.granted_delay": 4}, 4000.0)
    {'inverse.granted_time': 0.001}
    """
    found = dict(values)
    if not (isinstance(rate, (int, float)) and rate > 0):
        rate = DEFAULT_RATE
    for name in IN_SAMPLES.keys() & values:
        now, value = IN_SAMPLES[name], found.pop(name)
        most = int(LONGEST_GRANTED_TIME * rate)
        if not (type(value) is int and 0 <= value <= most):
            allowed = f"must be a whole number of samples, from 0 to {most}; or give {now} in s"
            raise ParameterError(f"{name} = {shown(str(value))}: {allowed}")
        if now in values:
            raise ParameterError(f"{name} = {value}: must be left out, as {now} is given")
        found[now] = value / rate
        if warn:
            means = f"{now} = {found[now]:g} s at {rate:g} Hz"
            warn(f"{name} = {value} samples is {means}; it is read until the next release")
    return found


def current_values(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return a node's values in a bag, possibly an older one, by their present names.

    Raises
    ------
    ParameterError
        As for `in_time`.
    """
    return in_time(
        {_current(name): value for name, value in recorded.items()}, recorded.get("rate")
    )


def current_arguments(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments in a bag, possibly an older one, by their present names."""
    now = dict(recorded)
    if "config" in now:
        now.setdefault("params_file", now["config"])
    if recorded.get("slave") == "virtual" and "scene" in recorded:
        now["surface"] = recorded["scene"]
    elif recorded.get("surface") == "recording":
        now["surface"] = recorded.get("recording")
    if not now.get("surface"):
        now.pop("surface", None)
    return now


def _current(name: str) -> str:
    """Return a parameter's present name."""
    old = next(filter(name.startswith, BEGINNINGS), "")
    return BEGINNINGS.get(old, "") + name.removeprefix(old)
