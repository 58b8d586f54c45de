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

"""Drivers that other installed packages declare by entry points."""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, cast

from haptic_accel.core.parameters import Checked, one_line, schema
from haptic_accel.devices.interface import Device, DeviceDescription, DeviceError

MASTERS_GROUP, SLAVES_GROUP = "haptic_accel.masters", "haptic_accel.slaves"
"""Groups of entry points: drivers of the master's and of the slave's arm."""

NAME = re.compile(r"[a-z][a-z0-9_]*")
"""Form of a driver's name, which is part of the names of its ROS parameters."""

_LOG = logging.getLogger(__name__)


def with_outside(
    own: Mapping[str, type[Device]], group: str, reserved: Collection[str]
) -> dict[str, type[Device]]:
    """Return drivers by name: this package's, then the other packages' in a group.

    A driver that cannot be loaded is replaced by a class that raises the reason when built, so
    that all other drivers work. A duplicate name keeps its first meaning, with a warning.

    Parameters
    ----------
    own : mapping
        Drivers of this package by name.
    group : str
        Group of entry points.
    reserved : collection of str
        Names that no driver may have, as they have another meaning.
    """
    found = dict(own)
    for each in entry_points(group=group):
        package = each.dist.name if each.dist else "unknown"
        if each.name in found or each.name in reserved or not NAME.fullmatch(each.name):
            reason = "is taken" if NAME.fullmatch(each.name) else "must be like my_arm2"
            _LOG.warning(
                "driver %r of package %s: not used: its name %s", each.name, package, reason
            )
            continue
        found[each.name] = _loaded(each, package, found)
    return found


def _loaded(entry: EntryPoint, package: str, known: Mapping[str, type[Device]]) -> type[Device]:
    """Return a driver's class, or a class that raises the load error."""
    try:
        kind = entry.load()
    except Exception as error:  # a foreign module may raise anything
        return _unusable(f"package {package}: {type(error).__name__}: {one_line(error)}")
    if problem := _problem(kind, known):
        return _unusable(f"package {package}: {entry.value}: {problem}")
    return cast(type[Device], kind)


def _problem(kind: Any, known: Mapping[str, type[Device]]) -> str:
    """Return the reason to refuse a loaded object as a driver; empty for a driver."""
    if not (isinstance(kind, type) and issubclass(kind, Device)):
        return "must be a subclass of Device"
    if missing := sorted(kind.__abstractmethods__):
        return f"must define {', '.join(missing)}"
    described, parameters = kind.description, kind.Parameters
    if not isinstance(described, DeviceDescription):
        return "description must be a DeviceDescription"
    own = {name: each for name, each in known.items() if not each.description.parameters_of}
    for name in described.parameters_of:
        if name not in own:
            return f"description.parameters_of: {name}: must be one of {', '.join(own)}"
    if described.parameters_of:
        parameters = own[described.parameters_of[0]].Parameters
    if not (isinstance(parameters, type) and issubclass(parameters, Checked)):
        return "Parameters must be a Checked dataclass"
    try:
        names = schema(parameters)
        parameters()
    except Exception as error:  # a field of a type that no parameter has, or without a default
        return f"Parameters: {one_line(error)}"
    for name in described.changeable:
        if name not in names:
            return f"description.changeable: {name}: must be one of {', '.join(names)}"
    return ""


def _unusable(reason: str) -> type[Device]:
    """Return a device class that raises a reason when built."""

    def refuse(device: Device, parameters: Any, rate: float, seed: int) -> None:
        raise DeviceError(reason)

    kind: Any = type("UnusableDevice", (Device,), {"__init__": refuse})
    kind.__abstractmethods__ = frozenset()  # none of its methods is ever called
    return cast(type[Device], kind)
