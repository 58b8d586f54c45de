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

"""Wrapping of a LeRobot device together with the fast path."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from typing import Any, Generic, TypeVar

from haptic_accel.kits.lerobot.fast_path import FastPath, join, leave, read_arguments
from haptic_accel.kits.lerobot.interface import Wrapped
from haptic_accel.setup.arguments import SIMULATED

LOG = logging.getLogger(__name__)

D = TypeVar("D", bound=Wrapped)


class Wrapping(Generic[D]):
    """Device that passes everything on to another, and has a fast path while it is connected.

    Parameters
    ----------
    wrapped : Wrapped
        Device of LeRobot.
    arguments : str
        Arguments of the fast path, ``key:=value``, as for ``haptic-accel teleop``.

    Attributes
    ----------
    wrapped : Wrapped

    Raises
    ------
    ParameterError
        An argument is not allowed.
    """

    def __init__(self, wrapped: D, arguments: str) -> None:
        self.wrapped = wrapped
        self._arguments = read_arguments(arguments)
        self._path: FastPath | None = None
        self._told = False

    def __getattr__(self, name: str) -> Any:
        """Return an attribute that only the wrapped device has, such as cameras."""
        if name.startswith("_") or name == "wrapped":  # not there before __init__
            raise AttributeError(name)
        return getattr(self.wrapped, name)

    @property
    def action_features(self) -> dict[str, Any]:
        """Keys and types of the wrapped device's actions."""
        return self.wrapped.action_features

    @property
    def is_connected(self) -> bool:
        """True if the wrapped device is, also after the end of the fast path."""
        return self._path is not None and self.wrapped.is_connected

    @property
    def is_calibrated(self) -> bool:
        """True if the wrapped device is."""
        return self.wrapped.is_calibrated

    def calibrate(self) -> None:
        """Calibrate the wrapped device."""
        self.wrapped.calibrate()

    def configure(self) -> None:
        """Configure the wrapped device."""
        self.wrapped.configure()

    def connect(self, calibrate: bool = True) -> None:
        """Start the fast path, or join it, and connect the wrapped device, or do neither.

        Raises
        ------
        ParameterError, DeviceError
            The fast path does not start, or runs with other arguments.
        """
        with ExitStack() as opened:
            # First, as an arm that is connected, and let go of again, falls.
            path = join(self._arguments)
            opened.callback(leave, path)
            self.wrapped.connect(calibrate)
            opened.pop_all()
        self._path, self._told = path, False
        LOG.info("fast path: %s", "; ".join(path.remarks))
        if SIMULATED in (self._arguments.master, self._arguments.slave):
            LOG.warning("fast path: simulated; master:=none slave:=none is for a sound card")

    def disconnect(self) -> None:
        """Leave the fast path and disconnect the wrapped device, even if one of them fails."""
        path, self._path = self._path, None
        with ExitStack() as closing:
            closing.callback(self.wrapped.disconnect)
            if path:
                closing.callback(leave, path)
                self._silence(path)

    def _silence(self, path: FastPath) -> None:
        """Undo what this device asked of the fast path: nothing by default."""

    def _tell_problem(self) -> bool:
        """Return whether the fast path has failed; log that once."""
        problem = self._path.problem if self._path else ""
        if problem and not self._told:
            self._told = True
            LOG.warning("fast path: %s; the arms go on without vibration", problem)
        return bool(problem)
