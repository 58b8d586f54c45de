# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Diagnosis of differences between a handle and its description, from their response ratio."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_accel.core.control.feedback_design import GripRange
from haptic_accel.core.handle.mechanics import inverse_terms
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, MountParameters, handle_model

LOWEST, HIGHEST = 20.0, 450.0
"""Frequency range, Hz: from the upper end of the hand's own motion to the upper end of
textures."""

LEAST_COHERENCE = 0.7
"""Minimum coherence of a line or band; independent noise has 0.2 after a second."""

LEAST_SHARE = 1e-2
"""Minimum power density of a line relative to the largest, to exclude leakage."""

MOST = 0.6
"""Minimum fraction of the level in coherent lines."""

FEWEST_LINES = 10
"""Minimum number of lines: three parameters of the grip and the delay are fitted."""

LEAST_EXPECTED = 0.2
"""Minimum expected acceleration over all lines, m/s^2 RMS: three times the noise of the paper's
accelerometer."""

DELAYS = np.arange(-10, 61) * 50e-6
"""Candidate delays, s."""

UNEXPLAINED = 0.12
"""Relative deviation from the best grip and delay above which a mode is assumed; friction and
noise of the paper's rig cause half of it."""

CLEAR = 2.5
"""Ratio above which a delay is diagnosed: the deviation without a delay, minus the share of dry
friction, over the deviation with the delay. It is at most 1.8 for handles that match their
description (simulated rigs)."""

NEGLIGIBLE = 0.015
"""Deviation that counts as an exact fit."""

PULL = 1e-5
"""Weight of the pull towards the described grip, relative to the excitation."""

ORDINARY = GripRange()
"""Hands within the model's tolerance: m_h within 30 %, k_u and b_u within a factor of two. A force
per mass that such a hand explains is not reported."""

LEAST_ERROR, RUBBED = 0.05, 0.5
"""Minimum relative error of the fitted mass, and its increase per ratio of dry friction to force
(simulated rigs)."""

NOTICEABLE_DELAY = 0.15e-3
"""Minimum delay, in addition to the described one, that is reported, s. A smaller delay, which no
device has by itself, cannot be told from the effect of some hands in noise."""

LOWEST_MODE = 50.0
"""Frequency above which a peak is a mode, Hz; the resonance of the hand's grip is lower."""

CAUTION = 2.0
"""Weight of the estimated response's variance in the limit of the deviation."""

FEWEST_EVALUATIONS = 6.0
"""Minimum number of evaluations for a scale or a delay. Fewer evaluations may share one or two
taps, whose ratio deviates as a whole by chance; a texture reaches the number after 0.6 s."""

MODE, POLARITY = "mode", "polarity"
"""Kinds of differences that are clear for all hands and delays, even from few evaluations."""

INDEPENDENCE = 0.5
"""Equivalent independent evaluations per overlapping evaluation (Welch 1967)."""

CLOSE = 0.1
"""Relative change below which a reported value is kept."""

RAISING = 0.25
"""Time for which the same difference must be found before it is reported, s."""

FITTING = 2.0
"""Time without a difference after which its report ends, s."""


class Difference(NamedTuple):
    """Kind of a difference, its values, and a text on both; the kind is empty if there is none."""

    kind: str
    values: tuple[float, ...]
    text: str


NOTHING = Difference("", (), "")


class Diagnosis:
    """Find the simplest difference that explains the ratio of measured to expected response.

    With the ratio R, the described handle H_0 and a delay tau, eqs. (1) and (2) give

        R H_0 (m_h T_1 + b_u T_2 + k_u T_3 + T_4) = exp(-j w tau)

    which is linear in the grip; T are the terms of 1/H. A grip explains any hand, and also a wrong
    force or mass, as the bearing's term T_4 is small: the force per mass is reported if its m_h is
    not that of an ordinary hand. A delay is reported if the deviation is much larger without it. A
    deviation that neither grip nor delay explains is a mode, at the peak of R.

    Parameters
    ----------
    plant : Plant
        Described plant.
    rate : float
        Samples per second.
    frequency : ndarray, shape (n,)
        Lines of the ratio, Hz.

    Attributes
    ----------
    difference : str
        Reported difference; empty if there is none.
    """

    def __init__(self, plant: Plant, rate: float, frequency: FloatArray) -> None:
        self._inside = (frequency >= LOWEST) & (frequency <= min(HIGHEST, 0.45 * rate))
        self._lines = lines = frequency[self._inside]
        handle = plant.handle
        self._grip = np.array([handle.m_h, handle.b_u, handle.k_u])
        terms = inverse_terms(handle, lines) * handle_model(handle).response(lines)
        # The terms are relative to the described grip: the sum of all four is 1.
        self._terms: ComplexArray = terms * np.append(self._grip, 1.0)[:, np.newaxis]
        self._mount = _transmission(plant.mount, lines)
        # Without a low-pass, only delays of whole samples are visible.
        self._shows_delay = plant.bandwidth <= rate
        self._late = np.exp(-2j * np.pi * np.outer(DELAYS, lines))
        self._undelayed = int(np.argmin(np.abs(DELAYS)))
        self.reset()

    def reset(self) -> None:
        """Discard all reported differences."""
        self.difference = ""
        self._named = NOTHING  # the reported difference
        self._kind = ""
        self._since = 0.0  # time for which the last kind has been found, s

    def judge(
        self,
        response: ComplexArray,
        coherence: FloatArray,
        density: FloatArray,
        interval: float,
        evaluations: float,
        rubbing: float = 0.0,
    ) -> None:
        """Process a new estimate.

        Parameters
        ----------
        response : ndarray, shape (n,)
            Ratio of measured to expected acceleration, complex.
        coherence : ndarray, shape (n,)
            Coherence of both.
        density : ndarray, shape (n,)
            Power density of the expected acceleration, (m/s^2)^2 per Hz.
        interval : float
            Time since the last estimate, s.
        evaluations : float
            Number of windows that contribute to the power of the estimate. They overlap by three
            quarters: a single tap is in four.
        rubbing : float
            Ratio of dry friction to the force.
        """
        response = response[self._inside]
        coherence, density = coherence[self._inside], density[self._inside]
        step = float(self._lines[1] - self._lines[0]) if len(self._lines) > 1 else 0.0
        if float(density.sum()) * step < LEAST_EXPECTED**2:
            return
        # Lines are weighted by level, not by power, as the whole range describes the handle.
        levels = (density >= LEAST_SHARE * density.max()) * np.sqrt(density)
        weights = (coherence >= LEAST_COHERENCE) * levels
        # Few lines that are coherent by chance have an overestimated response.
        if np.count_nonzero(weights) < FEWEST_LINES or weights.sum() < MOST * levels.sum():
            return
        weights /= weights.sum()
        scatter = 1.0 / np.maximum(coherence, LEAST_COHERENCE) - 1.0
        variance = float(scatter @ weights) / max(1.0, INDEPENDENCE * evaluations)
        found = self._explanation(response, weights, variance, rubbing)
        if found.kind not in ("", MODE, POLARITY) and evaluations < FEWEST_EVALUATIONS:
            return
        self._since = self._since + interval if found.kind == self._kind else 0.0
        self._kind = found.kind
        if self._since >= (RAISING if found.kind else FITTING):
            self._name(found)

    def _name(self, found: Difference) -> None:
        """Report a difference, unless it is close to the reported one."""
        pairs = zip(found.values, self._named.values, strict=False)
        is_close = all(abs(value - named) <= CLOSE * abs(named) for value, named in pairs)
        if found.kind != self._named.kind or not is_close:
            self._named, self.difference = found, found.text

    def _explanation(
        self, response: ComplexArray, weights: FloatArray, variance: float, rubbing: float
    ) -> Difference:
        """Return the simplest explanation of a response with a relative variance and friction."""
        grips, left = self._fitted(self._terms * response, weights)
        best, limit = int(np.argmin(left)), math.sqrt(UNEXPLAINED**2 + CAUTION * variance)
        if left[best] < limit + rubbing:
            if CLEAR * max(left[best], NEGLIGIBLE) + rubbing > left[self._undelayed]:
                best = self._undelayed
            if left[best] >= limit + rubbing:
                return NOTHING  # neither a delay nor a mode is certain
            error = max(LEAST_ERROR, float(left[best])) + RUBBED * rubbing
            late = float(DELAYS[best]) * self._shows_delay
            return _named(float(grips[0, best]), late, error)
        peak = np.argmax(np.abs(response * self._mount) * (weights > 0.0))
        frequency = float(self._lines[peak])
        if frequency < LOWEST_MODE:
            return NOTHING
        return Difference(MODE, (frequency,), f"a mode near {frequency:.0f} Hz is not described")

    def _fitted(self, terms: ComplexArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the best grip for each delay, and the remaining relative deviation."""
        grip, targets = terms[:3], self._late - terms[3]
        weighted = grip.conj() * weights
        matrix, vectors = (weighted @ grip.T).real, (weighted @ targets.T).real
        powers = (np.abs(targets) ** 2) @ weights
        # A texture without low frequencies does not show spring and damper: pull them to 1.
        pull = PULL * matrix.trace()
        factors = np.linalg.solve(matrix + pull * np.eye(3), vectors + pull)
        explained = (factors * (2.0 * vectors - matrix @ factors)).sum(axis=0)
        return factors, np.sqrt(np.maximum(0.0, powers - explained))


def _named(mass: float, late: float, error: float) -> Difference:
    """Return the difference for a relative mass with a relative error, and a delay, s."""
    if mass < 0.0:
        text = "the force acts in the opposite direction: swap the wires of the coil"
        return Difference(POLARITY, (), text)
    least, most = (1.0 - ORDINARY.mass) / (1.0 + error), (1.0 + ORDINARY.mass) * (1.0 + error)
    found = []
    if not least <= mass <= most:
        share = f"{1.0 / mass:.2f} of what is described"
        found.append(("scale", mass, f"the force per mass is {share} (force constant, or mass)"))
    if late > NOTICEABLE_DELAY:
        text = f"the force acts {1e3 * late:.1f} ms later than described"
        found.append(("delay", late, text))
    kinds, values, texts = zip(*found, strict=True) if found else ((), (), ())
    return Difference(" and ".join(kinds), values, ", ".join(texts))


def _transmission(mount: MountParameters, frequency: FloatArray) -> ComplexArray:
    """Return the motion of a mount relative to that of the handle."""
    if not mount.frequency:
        return np.ones(len(frequency), dtype=np.complex128)
    ratio = frequency / mount.frequency
    damper = 2j * mount.damping * ratio
    return np.asarray((1.0 + damper) / (1.0 - ratio**2 + damper))
