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

"""Modules of the nodes' executables, in this package, a kit or another package."""

from __future__ import annotations

from contextlib import suppress
from importlib.util import find_spec

from haptic_accel.core.outside import declared, guard

NODES_GROUP = "haptic_accel.nodes"
"""Group of entry points for executables outside the folder of the nodes."""


def node_module(executable: str) -> str:
    """Return the module with the function `main` of an executable; empty for a missing one.

    Raises
    ------
    OutsideError
        Another package declares the executable, and its folder cannot be searched.
    """
    own = f"haptic_accel.nodes.{executable}"
    if find_spec(own):
        declared(NODES_GROUP, [executable])  # says which package tries to take the name
        return own
    with guard(), suppress(ModuleNotFoundError):  # a folder may have been taken away
        entry = declared(NODES_GROUP).get(executable)
        if entry and find_spec(entry.value):
            return entry.value
    return ""
