# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The trace of a device, held against what is promised for every moment."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

from chaos.traced_node import ACTUATOR, ARM, OPENED, RECORD, TICK
from haptic_accel.core import actuator
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.tick.limits import FORCE_ROUNDING

PEAKS = {ARM: actuator.ARM_PEAK_FORCE, ACTUATOR: ActuatorParameters.peak_force}
TIMEOUTS = {ARM: actuator.ARM_TIMEOUT, ACTUATOR: actuator.ACTUATOR_TIMEOUT}

GRACE = 1.5
"""Periods by which a force may outlast its time-out: it ends with a tick, which may be early."""


@dataclass
class Held:
    """A force that a device holds: its size, N, and the time of its last command, s.

    Attributes
    ----------
    given : float
        Steady time of its last command, s.
    times : list of float
        Steady times at which it was given, s, zero excepted.
    """

    force: float = 0.0
    since: float = 0.0
    given: float = 0.0
    times: list[float] = field(default_factory=list)


class DeviceTrace:
    """Follows the trace of one device, and fails where it breaks a promise.

    Silence is counted in the times of ticks, which the safety layer sees, also where a process
    catches up with ticks it missed: so no promise is broken where the machine stands still. The
    layer times a force that came late by the clock, so it must be silent by the clock as well.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self._path = path
        self._period = 1 / rate
        self._read = 0
        self._ticked = self._ticked_at = self._now = 0.0
        self.held = {kind: Held() for kind in PEAKS}
        """Forces that the device holds, by kind."""

    def follow(self) -> None:
        """Read what is new."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            file.seek(self._read)
            data = file.read()
        self._read += len(data)
        for kind, moment, time, *force in RECORD.iter_unpack(data):
            if kind == OPENED:
                self._now = self._ticked = 0.0
                for held in self.held.values():
                    held.force = 0.0
                continue
            self._now = max(self._now, time)
            if kind == TICK:
                self._check_silence()
                self._ticked, self._ticked_at = self._now, moment
            else:
                self._take(kind, moment, math.hypot(*force))

    def _take(self, kind: int, moment: float, force: float) -> None:
        assert force <= PEAKS[kind] * (1 + FORCE_ROUNDING), (self._path.name, kind, force)
        held = self.held[kind]
        held.force, held.since, held.given = force, self._now, moment
        if force:
            held.times.append(moment)

    def _check_silence(self) -> None:
        """Look whether a force without commands ended with the tick before, at the latest."""
        for kind, held in self.held.items():
            allowed = max(TIMEOUTS[kind], actuator.LEAST_PERIODS * self._period)
            silence = min(self._ticked - held.since, self._ticked_at - held.given)
            assert not held.force or silence <= allowed + GRACE * self._period, (
                f"{self._path.name}: force of kind {kind}, {held.force} N, held for"
                f" {silence * 1e3:.1f} ms from {held.since:.4f} s, given at {held.given:.4f} s"
            )
