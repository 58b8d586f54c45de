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
from typing import Any

from haptic_accel.kits.lerobot.fast_path import FastPath, join, leave, read_arguments
from haptic_accel.kits.lerobot.interface import WrappedArm
from haptic_accel.setup.arguments import SIMULATED

LOG = logging.getLogger(__name__)


class Wrapping(WrappedArm):
    """Device that passes everything on to another, and has the fast path while it is connected.

    Parameters
    ----------
    wrapped
        Device of LeRobot.
    arguments : str
        Arguments of the fast path, ``key:=value``, as for ``haptic-accel teleop``.

    Raises
    ------
    ParameterError
        An argument is not allowed.
    """

    def __init__(self, wrapped: Any, arguments: str) -> None:
        self.wrapped = wrapped
        self._arguments = read_arguments(arguments)
        self._path: FastPath | None = None

    def __getattr__(self, name: str) -> Any:
        """Return an attribute that only the wrapped device has."""
        if name.startswith("_") or name == "wrapped":  # not there before __init__
            raise AttributeError(name)
        return getattr(self.wrapped, name)

    @property
    def is_connected(self) -> bool:
        """True if the wrapped device is, also after the end of the fast path."""
        return self._path is not None and bool(self.wrapped.is_connected)

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
        self._path = path
        LOG.info("fast path: %s", path.remarks)
        if SIMULATED in (self._arguments.master, self._arguments.slave):
            LOG.warning("fast path: simulated; a sound card needs master:=none slave:=none")

    def disconnect(self) -> None:
        """Leave the fast path and disconnect the wrapped device, even if one of them fails."""
        path, self._path = self._path, None
        with ExitStack() as closing:
            closing.callback(self.wrapped.disconnect)
            if path:
                closing.callback(leave, path)

    def tell_problem(self) -> None:
        """Log once that the fast path has failed, if it has: an arm must not stop for it."""
        path = self._path
        if path and not path.is_told and (problem := path.problem):
            path.is_told = True
            LOG.warning("fast path: %s; the arms go on without vibration", problem)
