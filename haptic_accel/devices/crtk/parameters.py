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

"""Parameters of arms with CRTK."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from haptic_accel.core.parameters import Checked, ParameterError, parameter

_NAMES = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def _namespace(default: str) -> Any:
    return parameter(default, "full namespace of the arm's topics")


@dataclass(frozen=True)
class CrtkParameters(Checked):
    """Names of the arm's topics, and their time-outs."""

    namespace: str = _namespace("/arm")
    force: str = parameter(
        "servo_cf",
        "topic of the arm's force below its namespace; body/servo_cf for a dVRK, which is told to"
        " take its orientation from the base frame",
    )
    timeout: float = parameter(
        0.1, "time without a position after which there is no sample", "s", 0.005, 10.0
    )
    start_timeout: float = parameter(
        5.0, "longest time to wait for the first position", "s", 0.1, 60.0
    )

    def __post_init__(self) -> None:
        """Check all fields, and that both names are names of ROS.

        Raises
        ------
        ParameterError
            A value is not allowed; the message names it.
        """
        super().__post_init__()
        for name in ("namespace", "force"):
            if not _NAMES.fullmatch(getattr(self, name).strip("/")):
                raise ParameterError(
                    f"{name} = {getattr(self, name)!r}: must be names of letters, digits and _,"
                    " joined by /"
                )

    @property
    def arm(self) -> str:
        """Full name of the namespace."""
        return "/" + self.namespace.strip("/")


@dataclass(frozen=True)
class CrtkMasterParameters(CrtkParameters):
    """Parameters of the master's arm."""

    namespace: str = _namespace("/MTMR")


@dataclass(frozen=True)
class CrtkSlaveParameters(CrtkParameters):
    """Parameters of the slave's arm."""

    namespace: str = _namespace("/PSM1")
