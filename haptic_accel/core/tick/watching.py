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

"""Trace of samples for supervision and learning."""

from __future__ import annotations

import math


class Trace:
    """Latest samples of one coil, or of one controller, for computations that are not of a sample.

    They read it at intervals, in blocks, see `core.control.response_estimation`.

    Attributes
    ----------
    count : int
        Number of samples since the start.
    desired : list of float
        Desired acceleration, m/s^2; newest last, as all signals.
    measured : list of float
        Acceleration of the handle, m/s^2; where it is unknown, that of the sample before.
    force : list of float
        Force that drives the handle, N.
    kept : int
        Number of samples that remain at least; readers raise it.
    drive : list of float
        Input of the controller's convolution, m/s^2, or force that the controller asked for, N.
    missing, saturated : list of float
        Counts at the samples without a measurement, and at those beyond the sensor's range.
    """

    def __init__(self) -> None:
        self.count: int = 0
        self.kept: int = 1
        self.full: int = 1
        self.latest: float = 0.0
        self.desired: list[float] = []
        self.measured: list[float] = []
        self.force: list[float] = []
        self.drive: list[float] = []
        self.missing: list[float] = []
        self.saturated: list[float] = []

    def reset(self) -> None:
        """Forget all samples."""
        self.count = 0
        self.latest = 0.0
        self._trim(0)

    def push(self, desired: float, measured: float, force: float, drive: float) -> None:
        """Add a sample; `measured` is NaN if missing, infinite if its sensor was saturated."""
        if math.isfinite(measured):
            self.latest = measured
        elif math.isnan(measured):
            self.missing.append(self.count)
        else:
            self.saturated.append(self.count)
        self.desired.append(desired)
        self.measured.append(self.latest)
        self.force.append(force)
        self.drive.append(drive)
        self.count += 1
        if self.count >= self.full:
            self._trim(self.kept)

    def _trim(self, kept: int) -> None:
        """Drop all but the latest samples."""
        # As many gaps at most are within these samples.
        signals = self.desired, self.measured, self.force, self.drive
        for each in (*signals, self.missing, self.saturated):
            del each[: max(0, len(each) - kept)]
        self.full = self.count + self.kept
