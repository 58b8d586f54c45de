# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three coils: decoupling, alignment of the axes, and switch between reductions to one axis.

Let the plant be G = K diag(p_x, p_y, p_z), let each force u_j follow its own desired acceleration,
and let D K = K D = I. After filtering by D, the handle's acceleration a and the desired
acceleration d are related axis by axis: (D a)_j = p_j u_j. D is thus placed before the
controllers. After them, it would have to commute with the p_j, which differ. Each controller's
force is that of its coil, with the coil's own heat, travel and friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from haptic_accel.core.axes import NAMES, NO_REDUCTION, along_actuator, live_reduction
from haptic_accel.core.control.channel import FADING, LISTENING, RESTING
from haptic_accel.core.control.diagnosis import FITTING, RAISING
from haptic_accel.core.control.estimation import latest
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_pass_response
from haptic_accel.core.control.inversion import PRIOR, ToolSpectrum
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.handle.mechanics import grid_for
from haptic_accel.core.handle.plant import MatrixPlant
from haptic_accel.core.model import ZERO, FloatArray, Vector
from haptic_accel.core.tick import LARGEST_ACCELERATION, MEASURED, InputReduction

DECOUPLING_LENGTH = 0.2
"""Length of a decoupling filter, s, as of an inverse: twenty times the decay time of a structural
mode at 100 Hz with a damping ratio of 0.15."""

MOST_TAPS = 512
"""Maximum length of a decoupling filter: its equations have three times as many unknowns."""

RIDGE = 1e-4
"""Penalty on the decoupling filter's gain relative to the mean weight: an error below 0.1 % in the
band, and no large gain above it, where hardly any texture is expected."""


def full_decoupling(
    plant: MatrixPlant,
    spectrum: ToolSpectrum = PRIOR,
    high_pass_frequency: float = HIGH_PASS_FREQUENCY,
) -> FloatArray:
    """Design the causal inverse of a plant's coupling K.

    The integral over frequency of S |K D - I|^2 is minimised, where S is the spectrum of the
    desired acceleration. As K has no delay of its own, none is granted. Below the high-pass, where
    no identification shows K, D is unconstrained.

    Parameters
    ----------
    plant : MatrixPlant
    spectrum : callable
        Spectrum of the tool's acceleration.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.

    Returns
    -------
    ndarray, shape (3, 3, n)
        Impulse responses of D at the plant's rate.
    """
    from scipy.linalg import cho_factor, cho_solve

    if plant.coupling.shape[2] == 1:
        return np.asarray(np.linalg.inv(plant.directions)[:, :, np.newaxis])
    length = max(1, min(round(DECOUPLING_LENGTH * plant.rate), MOST_TAPS))
    grid = grid_for(plant.rate, max(length, plant.coupling.shape[2]))
    passed = high_pass_response(high_pass_frequency, grid.frequency, plant.rate)
    weights = spectrum(grid.frequency) * np.abs(passed) ** 2
    response = np.array([[grid.spectrum(each) for each in row] for row in plant.coupling])
    weighted = weights * response.conj()
    gram, sides = (
        np.array([[grid.sequence(each)[:length] for each in row] for row in spectra])
        for spectra in (np.einsum("iaf,ibf->abf", weighted, response), weighted.transpose(1, 0, 2))
    )
    later = np.arange(length)[:, np.newaxis] - np.arange(length)
    # Negative lags of the coils (a, b) are positive lags of (b, a).
    gram = np.where(later >= 0, gram[:, :, abs(later)], gram.transpose(1, 0, 2)[:, :, abs(later)])
    matrix = gram.transpose(0, 2, 1, 3).reshape(3 * length, 3 * length)
    matrix[np.diag_indices_from(matrix)] += RIDGE * matrix.diagonal().mean()
    # Each column of the identity has a right-hand side.
    columns = sides.transpose(0, 2, 1).reshape(3 * length, 3)
    taps = cho_solve(cho_factor(matrix, overwrite_a=True), columns).reshape(3, length, 3)
    return np.ascontiguousarray(taps.transpose(0, 2, 1))


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
        new = np.trace(own[_EXPECTED, _EXPECTED])
        self._squares = (1.0 - share) ** 2 * self._squares + new**2
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


Shaping: TypeAlias = Callable[[Vector], Vector]
"""Function from the tool's acceleration to the input of each coil's compensation, m/s^2."""


class ReductionSwitch(InputReduction):
    """Input of the coils' compensations: the tool's vibration in all axes, or reduced to one.

    A change affects the controllers' input, not the controllers. Like a new controller, a new
    reduction first only receives samples for `LISTENING`, and is then crossfaded over `FADING`.
    Gravity has another component in each reduction. The mean difference is kept as an offset, so
    that the following high-pass sees no step. A running crossfade is completed before another
    starts.

    Parameters
    ----------
    name : str
        `NO_REDUCTION` or one of `LIVE_REDUCTIONS`.
    rate : float
        Samples per second.
    unreduced : callable
        Function that returns the input without reduction.

    Attributes
    ----------
    name : str
        Name of the reduction in use, or of the last selected one.
    active : str
        Name of the reduction in use, also while another one is prepared.

    Examples
    --------
    >>> switch = ReductionSwitch("none", 1000.0, unreduced=lambda tool: tool)
    >>> switch.process((1.0, 2.0, 3.0)), switch.alone
    ((1.0, 2.0, 3.0), 0.0)
    >>> switch.select("sum")
    >>> switch.settle()
    >>> switch.process((1.0, 2.0, 3.0)), switch.alone
    ((0.0, 0.0, 6.0), 1.0)
    """

    def __init__(self, name: str, rate: float, unreduced: Shaping) -> None:
        super().__init__()
        self._rate = rate
        self._shapings: dict[str, Shaping] = {NO_REDUCTION: unreduced}
        self._listening, self._fading = round(LISTENING * rate), max(1, round(FADING * rate))
        self._resting = -math.expm1(-1.0 / (RESTING * rate))
        self._following: str | None = None
        self._difference: Vector | None = None
        self._listened = 0
        self.name = name
        self.settle()

    def select(self, name: str) -> None:
        """Change to another reduction without a jump."""
        self.name, self.reduces = name, {name, self.active} != {NO_REDUCTION}
        if self._following is None or self._listened <= self._listening:
            self._listen()

    def settle(self) -> None:
        """Use the selected reduction at once, before the first sample."""
        self._offset = ZERO
        self._take_over(self.name)

    def process(self, tool: Vector) -> Vector:
        """Return the input for a sample of the tool, m/s^2."""
        if self._unused:
            self._unused(tool)
        value = self._shaped(tool)
        if self._offset is not ZERO:
            value = _plus(value, self._offset)
        return value if self._following is None else self._mixed(value, tool)

    def _mixed(self, value: Vector, tool: Vector) -> Vector:
        """Return the input; crossfade it after the next reduction has received enough samples."""
        assert self._following is not None
        following = self._shapings[self._following](tool)
        self._listened += 1
        if self._listened <= self._listening:
            if all(abs(each) <= LARGEST_ACCELERATION for each in tool):  # also false for NaN
                self._follow(value, following)
            return value
        following = _plus(following, self._difference or ZERO)
        share = (self._listened - self._listening) / self._fading
        if share >= 1.0:
            self._offset = self._difference or ZERO
            self._take_over(self._following)
            return following
        before, after = self._active_alone, float(self._following != NO_REDUCTION)
        self.alone = before + share * (after - before)
        x, y, z = ((1.0 - share) * a + share * b for a, b in zip(value, following, strict=True))
        return x, y, z

    def _follow(self, value: Vector, following: Vector) -> None:
        """Update the mean difference of both inputs, mostly gravity."""
        x, y, z = (a - b for a, b in zip(value, following, strict=True))
        if self._difference is None:
            self._difference = x, y, z
        m_x, m_y, m_z = self._difference
        a = self._resting
        self._difference = m_x + a * (x - m_x), m_y + a * (y - m_y), m_z + a * (z - m_z)

    def _listen(self) -> None:
        """Prepare the selected reduction, unless it is in use."""
        self._following = None if self.name == self.active else self.name
        self._listened, self._difference = 0, None
        self._prepare()

    def _take_over(self, name: str) -> None:
        self.active = name
        self.alone = self._active_alone = float(name != NO_REDUCTION)
        self._listen()

    def _prepare(self) -> None:
        """Build the reductions in use; keep updating a principal direction once it was used."""
        for name in filter(None, (self.active, self._following)):
            if name not in self._shapings:
                self._shapings[name] = _along_z(name, self._rate)
        self._shaped = self._shapings[self.active]
        self.reduces = {self.name, self.active} != {NO_REDUCTION}
        used = self.active, self._following
        self._unused = None if PRINCIPAL in used else self._shapings.get(PRINCIPAL)
        self.idle = used == (NO_REDUCTION, None) and not self._unused and self._offset is ZERO


PRINCIPAL = "principal"
"""Name of the only adaptive reduction."""


def _along_z(name: str, rate: float) -> Shaping:
    """Return the input of a single coil along z."""
    reduced = live_reduction(name, rate)
    return lambda tool: along_actuator(reduced(tool))


def _plus(one: Vector, other: Vector) -> Vector:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]
