# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Alignment of the axes: response of each axis to the forces of the other axes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.control.diagnosis import FITTING, RAISING
from haptic_accel.core.control.response_estimation import latest
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import MEASURED

BLOCK = 0.016
"""Time between updates, s: a period of 60 Hz."""

POWER_MEMORY = 0.3
"""Time constant of the running powers, s: with `RAISING`, a result within a second."""

CORNER = 20.0
"""Corner of the high-pass of order 2 that removes gravity and the hand's motion, Hz: the lowest
frequency at which the handle shows its response to the force."""

LEAST_EXPECTED = 0.2
"""Minimum expected acceleration of all axes together, m/s^2 RMS: ten times the arm's own motion
and noise."""

LEAST_CROSS = 0.1
"""Minimum cross-axis response that is reported, relative to all motion: that of a sensor rotated
by 7 degrees. Noise and friction of the paper's rig, a seventh of the motion, appear as a third of
this value after 0.1 s of averaging (assumed bandwidth: 100 Hz)."""

ROTATION_SHARE = 0.7
"""Fraction of the cross-axis response's power that a rotation must explain in order to be
reported."""

RESOLVED = 1e-3
"""Minimum power of an expected direction relative to all three. Excitation along a single
direction shows no cross-axis response, as free gains of aligned axes explain any motion."""

SETTLING = 0.1
"""Time after a limit of the coils or saturation of the sensor during which motion is not
evaluated, s: after a collision with a stop, the handle comes to rest within this time."""

FEWEST_BLOCKS = 8.0
"""Minimum effective number of blocks in the running powers for an evaluation. A texture yields up
to 37; a single tap yields one or two, whose directions may agree by chance."""

CHANCE = 1.25
"""Fraction of the unexplained motion that other coils explain by chance, times the number of
blocks: twice the two free parameters of an axis over three independent samples of a block (100
Hz)."""

CLOSE = 2.0
"""Change of an angle below which the reported angle is kept, degrees."""

_FITS = 3  # number of iterations, each of which fits the gains and then the rotation


class Alignment:
    """Monitor of the response of each axis to the forces of the others.

    After decoupling, the axis of each coil moves only by that coil's force, by an amount that
    depends on the hand. A response to other coils that no gain of the axis explains shows that the
    axes differ from the identified ones: the accelerometer was rotated, or a coil is bent. Each
    axis has a free gain, so a different hand is not a fault.

    Parameters
    ----------
    rate : float
        Samples per second.
    coils : sequence of ResponseSupervisor
        Expected response of each axis to its own force, and its decoupled acceleration.

    Attributes
    ----------
    warning : str
        Description of the fault; empty if there is none.
    """

    def __init__(self, rate: float, coils: Sequence[ResponseSupervisor]) -> None:
        # Imported here, as scipy.signal is slow to import, and most nodes have no controller.
        from scipy import signal

        self._period = 1.0 / rate
        self._length = max(1, round(BLOCK * rate))
        self._settling = round(SETTLING * rate)
        corner = min(CORNER, 0.4 * rate)
        self._sections = np.asarray(signal.butter(2, corner, "high", fs=rate, output="sos"))
        self._filtered = signal.sosfilt
        self._coils, self._trace = coils, coils[0].trace
        self.reset()

    def reset(self) -> None:
        """Discard all samples and reported faults."""
        self._last_count = 0  # count of the last block
        self._rest: FloatArray | None = None
        self._state = np.zeros((len(self._sections), 6, 2))
        self._powers = np.zeros((6, 6))
        self._squares = 0.0  # running sum of the blocks' squared shares in the power
        self._over = self._under = 0.0
        self._angle = math.nan
        self.warning = ""

    def update(self) -> int:
        """Evaluate the axes if a block is complete; return the samples left to the next block."""
        trace = self._trace
        length = min(trace.count - self._last_count, trace.stored)
        if length >= self._length:
            self._look(length)
        return self._last_count + self._length - trace.count

    def _look(self, length: int) -> None:
        trace = self._trace
        expected = [coil.expected(length) for coil in self._coils]
        measured = [latest(coil.trace, MEASURED, length) for coil in self._coils]
        block = np.concatenate([expected, measured])
        # Saturation of the sensor counts like a limit of the actuator.
        held = max([trace.limited, *trace.saturated[-1:]])
        is_clean = held + self._settling <= self._last_count
        self._last_count = trace.count
        if self._rest is None:
            self._rest = block[:, :1]
        block, self._state = self._filtered(self._sections, block - self._rest, zi=self._state)
        if not is_clean:
            return
        time = block.shape[1] * self._period
        share = -math.expm1(-time / POWER_MEMORY)
        own = share * (block @ block.T / block.shape[1])
        self._powers = (1.0 - share) * self._powers + own
        self._squares = (1.0 - share) ** 2 * self._squares + np.trace(
            own[_EXPECTED, _EXPECTED]
        ) ** 2
        expected, moved = (np.trace(self._powers[part, part]) for part in (_EXPECTED, _MOVED))
        blocks = expected**2 / max(self._squares, np.finfo(float).tiny)
        if blocks < FEWEST_BLOCKS:
            self._over = 0.0
        elif expected >= LEAST_EXPECTED**2 and moved >= LEAST_EXPECTED**2:
            self._judge(time, blocks)

    def _judge(self, time: float, blocks: float) -> None:
        powers = self._powers
        total = float(np.trace(powers[_MOVED, _MOVED]))
        own = powers[_MOVED, _EXPECTED]
        gained = float(np.sum(_gains(own, powers) * own.diagonal()))
        explained = _explained(own, powers[_EXPECTED, _EXPECTED])
        cross = (explained - gained) / total
        found = cross >= LEAST_CROSS**2 + CHANCE * (1.0 - explained / total) / blocks
        self._over = self._over + time if found else 0.0
        self._under = 0.0 if found else self._under + time
        if self._over >= RAISING:
            rotation, turned = _rotation(powers)
            self._name(rotation if turned - gained >= ROTATION_SHARE * cross * total else None)
        elif self._under >= FITTING:
            self.warning, self._angle = "", math.nan

    def _name(self, rotation: FloatArray | None) -> None:
        if rotation is None:
            self._angle = math.nan
            self.warning = "axes do not match the identification: run identify"
            return
        angle = math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(rotation) - 1.0) / 2.0))))
        if abs(angle - self._angle) < CLOSE:
            return
        self._angle = angle
        turned = (rotation - rotation.T)[(2, 0, 1), (1, 2, 0)]
        main = int(np.argmax(np.abs(turned)))
        self.warning = (
            f"the handle's accelerometer is rotated by {angle:.0f} degrees, mostly about"
            f" {NAMES[main]}: run calibrate"
        )


_EXPECTED, _MOVED = slice(0, 3), slice(3, 6)


def _gains(cross: FloatArray, powers: FloatArray) -> FloatArray:
    """Return the gain of each axis that best explains the axis's own motion."""
    own = powers.diagonal()[_EXPECTED]
    return np.asarray(cross.diagonal() / np.maximum(own, np.finfo(float).tiny))


def _explained(cross: FloatArray, expected: FloatArray) -> float:
    """Return the power of the motion that all expected accelerations together explain."""
    values, vectors = np.linalg.eigh(expected)
    seen = values >= RESOLVED * values.sum()
    return float(np.sum((cross @ vectors[:, seen]) ** 2 / values[seen]))


def _rotation(powers: FloatArray) -> tuple[FloatArray, float]:
    """Return the rotation of the sensor that, with a free gain per axis, explains most motion.

    For fixed gains, the rotation is the solution of Wahba's problem (SIAM Rev. 7, 1965), by the
    method of Kabsch (Acta Cryst. A32, 1976).

    Returns
    -------
    rotation : ndarray, shape (3, 3)
    explained : float
        Power of the explained motion, (m/s^2)^2.
    """
    cross = powers[_MOVED, _EXPECTED]
    rotation = np.eye(3)
    for _ in range(_FITS):
        gains = _gains(rotation.T @ cross, powers)
        left, _, right = np.linalg.svd(cross * gains)
        sign = np.linalg.det(left @ right)
        rotation = left @ np.diag([1.0, 1.0, sign]) @ right
    turned_back = rotation.T @ cross
    return rotation, float(np.sum(_gains(turned_back, powers) * turned_back.diagonal()))
