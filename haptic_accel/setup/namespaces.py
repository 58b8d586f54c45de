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

"""The namespace of a graph, one argument of every verb and launch file (light to import)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, ParameterError, parameter

_NAMESPACE = re.compile("(/[A-Za-z_][A-Za-z0-9_]*)+")


@dataclass(frozen=True)
class NamespaceArguments(Checked):
    """Namespace."""

    namespace: str = parameter("", "namespace of the graph; empty for the root")

    def __post_init__(self) -> None:
        """Check all fields; the namespace then has a slash before, and none behind."""
        super().__post_init__()
        object.__setattr__(self, "namespace", _absolute(self.namespace))


def _absolute(namespace: str) -> str:
    """Return a namespace with a slash before and none behind; empty for the root."""
    words = namespace.strip("/")
    if words and not _NAMESPACE.fullmatch(f"/{words}"):
        raise ParameterError(
            f"namespace = {namespace!r}: must be letters, digits and _, with / between"
        )
    return words and f"/{words}"
