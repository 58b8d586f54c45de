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

"""Names of parameters and arguments before 0.2, which are read in 0.2 for the last time.

Those in bags are always read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.core.warning import warn_once

FORMER = {
    **{"can_serial.arm.": "can.", "can_serial.handle.": "serial."},
    **{"crtk_serial.arm.": "crtk.", "crtk_serial.handle.": "serial."},
}
"""Beginnings of former names, and of those in their place."""

FORMER_WORDS = ("recording", "scene")
"""Former arguments whose value is that of ``surface`` now."""

RECORDED = "surface:=recording"
"""Word that came with a recording."""


def current_names(values: Mapping[str, Any]) -> dict[str, str]:
    """Return the present name of each given parameter, by the name under which it was given.

    Parameters
    ----------
    values : mapping
        Values by dotted name.

    Raises
    ------
    ParameterError
        A parameter has different values under two names.
    """
    names = {name: _current(name) for name in values}
    given = {now: name for name, now in names.items()}
    for name, now in names.items():
        if name != given[now] and values[name] != values[given[now]]:
            raise ParameterError(
                f"{name} = {shown(str(values[name]))}: must be {shown(str(values[given[now]]))},"
                f" as {given[now]} is: both are {now} now"
            )
    return names


def warning_of(names: Iterable[str]) -> str:
    """Return the warning about former names among some names; empty without any."""
    begun = {old for name in names for old in FORMER if name.startswith(old)}
    text = ", ".join(f"{old}* is {new}* now" for old, new in FORMER.items() if old in begun)
    return text and f"{text}; the former names are read until the next release"


def current_words(words: Iterable[str], known: Iterable[str]) -> list[str]:
    """Return ``key:=value`` words with present keys, after a warning about former keys.

    Parameters
    ----------
    words : iterable of str
    known : iterable of str
        Present keys.
    """
    words = list(words)
    unknown = set(FORMER_WORDS).difference(known) if "surface" in known else ()
    former = [word for word in words if word.partition(":=")[0] in unknown]
    for word in former:
        key = word.partition(":=")[0]
        warn_once(f"{key}:= is surface:= now; the former word is read until the next release")
    now = [f"surface:={value}" for word in former if (value := word.partition(":=")[2])]
    dropped = [*former, *([RECORDED] if now else [])]
    return [*(word for word in words if word not in dropped), *now]


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
    old = next(filter(name.startswith, FORMER), "")
    return FORMER.get(old, "") + name.removeprefix(old)
