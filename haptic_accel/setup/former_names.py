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

KEPT = "it is read until the next release"

CHANNEL, CHANNELS = "audio.channel", "audio.channels"
"""Number of the master device's first channel before 0.4, and text of all channels."""

FORMER = {"compensator": frozenset(IN_SAMPLES), "master_device": frozenset({CHANNEL})}
"""Names before 0.4 that a node's parameters may still have in files."""


def present_values(
    values: Mapping[str, Any], rate: object, warn: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Return values by their present names: every delay in samples is a time, in s.

    Parameters
    ----------
    values : mapping
        Values of a node by dotted name.
    rate
        Samples per second of the graph; the default rate in place of what is no rate.
    warn : callable, optional
        Receives one line for each former name.

    Raises
    ------
    ParameterError
        A delay is no whole number of samples, a channel no whole number, or the value is given by
        its present name, too.

    Examples
    --------
    >>> present_values({"inverse.granted_delay": 4, "audio.channel": 3}, 4000.0)
    {'audio.channels': '3', 'inverse.granted_time': 0.001}
    """
    found = dict(values)

    def check(name: str, now: str, known: object, allowed: str) -> None:
        value = values[name]
        if not known:
            raise ParameterError(f"{name} = {shown(str(value))}: must be {allowed}")
        if now in values:
            raise ParameterError(f"{name} = {value}: must be left out, as {now} is given")

    if CHANNEL in values:
        value = found.pop(CHANNEL)
        known = type(value) is int and value > 0
        check(CHANNEL, CHANNELS, known, f"a whole number from 1; or give {CHANNELS}")
        found[CHANNELS] = str(value)
        if warn:
            warn(f"{CHANNEL} = {value} is {CHANNELS} = '{value}'; {KEPT}")
    if not (isinstance(rate, (int, float)) and rate > 0):
        rate = DEFAULT_RATE
    for name in IN_SAMPLES.keys() & values:
        now, value = IN_SAMPLES[name], found.pop(name)
        most = int(LONGEST_GRANTED_TIME * rate)
        known = type(value) is int and 0 <= value <= most
        check(name, now, known, f"a whole number of samples, from 0 to {most}; or give {now} in s")
        found[now] = value / rate
        if warn:
            means = f"{now} = {found[now]:g} s at {rate:g} Hz"
            warn(f"{name} = {value} samples is {means}; {KEPT}")
    return found


def current_values(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return a node's values in a bag, possibly an older one, by their present names.

    Raises
    ------
    ParameterError
        As for `present_values`.
    """
    return present_values(
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
