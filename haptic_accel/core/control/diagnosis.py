# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Name of what differs between a handle and its description, from the ratio of their responses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_accel.core.control.feedback_design import GripRange
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.handle.response import inverse_terms
from haptic_accel.core.model import ComplexArray, FloatArray, MountParameters, handle_model

LOWEST, HIGHEST = 20.0, 450.0
"""Range of the lines, Hz: from where the hand's own motion ends to where textures end."""

LEAST_COHERENCE = 0.7
"""Minimum coherence of a line, or a band; independent noise has 0.2 after a second."""

LEAST_SHARE = 1e-2
"""Minimum density of a line relative to the largest, so that leakage does not count."""

MOST = 0.6
"""Minimum fraction of the level that is in coherent lines."""

FEWEST_LINES = 10
"""Minimum number of lines: three parameters of the grip and the delay are fitted."""

LEAST_EXPECTED = 0.2
"""Minimum expected acceleration over all lines, m/s^2 RMS: three times the noise of the paper's
accelerometer."""

DELAYS = np.arange(-10, 61) * 50e-6
"""Delays that are tried, s."""

UNEXPLAINED = 0.12
"""Relative deviation from the best grip and delay above which a mode is assumed; friction and
noise of the paper's rig leave half of it."""

CLEAR = 2.5
"""Ratio of the deviation without a delay, less the share of dry friction, to that with it from
which on there is one: 1.8 at most for handles as described (simulated rigs)."""

NEGLIGIBLE = 0.015
"""Deviation that counts as an exact fit."""

PULL = 1e-5
"""Weight of the described grip relative to the excitation."""

ORDINARY = GripRange()
"""Hands within the model's tolerance: m_h within 30 %, k_u and b_u within a factor of two. A force
per mass that such a hand explains has no name."""

LEAST_ERROR, RUBBED = 0.05, 0.5
"""Smallest relative error of the fitted mass, and its part per ratio of dry friction to the
force (simulated rigs)."""

NOTICEABLE_DELAY = 0.15e-3
"""Delay in addition to the described one that is named, s. Less delay, which no device has by
itself, is how some hands look in noise, and has no name."""

LOWEST_MODE = 50.0
"""Frequency above which a peak is a mode, Hz; below, the hand's grip has its resonance."""

CAUTION = 2.0
"""Weight of the variance of the estimated response in the limit of the deviation."""

FEWEST_EVALUATIONS = 6.0
"""Minimum number of evaluations for a scale or a delay: more than those that share one or two
taps, whose ratio differs as a whole by chance; a texture has as many after 0.6 s."""

MODE, POLARITY = "mode", "polarity"
"""Kinds of differences that stand out from all hands and delays, however few the evaluations."""

INDEPENDENCE = 0.5
"""Independent evaluations per evaluation (Welch 1967)."""

CLOSE = 0.1
"""Relative change below which a name is kept."""

RAISING = 0.25
"""Time for which the same difference must be found before it is named, s."""

FITTING = 2.0
"""Time without difference after which its name or report ends, s."""


class Difference(NamedTuple):
    """Kind of a difference, its numbers, and a text on both; the kind is empty for none."""

    kind: str
    values: tuple[float, ...]
    text: str


NOTHING = Difference("", (), "")


class Diagnosis:
    """Find the simplest difference that explains the ratio of measured to expected response.

    With the ratio R, the described handle H_0 and a delay tau, eq. (1) and (2) give

        R H_0 (m_h T_1 + b_u T_2 + k_u T_3 + T_4) = exp(-j w tau)

    which is linear in the grip; T are the terms of 1/H. A grip explains any hand, and a wrong
    force or mass as well, as the bearing's term T_4 is small: the force per mass is named if its
    m_h is not that of an ordinary hand. A delay is named if the deviation is much larger without
    it. What neither grip nor delay explains is a mode, at the peak of R.

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
        Named difference; empty if there is none.
    """

    def __init__(self, plant: Plant, rate: float, frequency: FloatArray) -> None:
        self._inside = (frequency >= LOWEST) & (frequency <= min(HIGHEST, 0.45 * rate))
        self._lines = lines = frequency[self._inside]
        handle = plant.handle
        self._grip = np.array([handle.m_h, handle.b_u, handle.k_u])
        terms = inverse_terms(handle, lines) * handle_model(handle).response(lines)
        # Relative to the described grip: the sum of all four is 1.
        self._terms: ComplexArray = terms * np.append(self._grip, 1.0)[:, np.newaxis]
        self._mount = _transmission(plant.mount, lines)
        # Without a low-pass only whole samples of delay show.
        self._shows_delay = plant.bandwidth <= rate
        self._late = np.exp(-2j * np.pi * np.outer(DELAYS, lines))
        self._undelayed = int(np.argmin(np.abs(DELAYS)))
        self.reset()

    def reset(self) -> None:
        """Forget all names."""
        self.difference = ""
        self._named = NOTHING  # the difference as named
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
            Density of the expected acceleration, (m/s^2)^2 per Hz.
        interval : float
            Time since the last estimate, s.
        evaluations : float
            Number of windows that share the power of the estimate, which overlap by three
            quarters: a single tap is in four.
        rubbing : float
            Ratio of dry friction to the force.
        """
        response = response[self._inside]
        coherence, density = coherence[self._inside], density[self._inside]
        step = float(self._lines[1] - self._lines[0]) if len(self._lines) > 1 else 0.0
        if float(density.sum()) * step < LEAST_EXPECTED**2:
            return
        # A line counts by its level, not its power: all of the range shows the handle.
        levels = (density >= LEAST_SHARE * density.max()) * np.sqrt(density)
        weights = (coherence >= LEAST_COHERENCE) * levels
        # Few lines that are coherent by chance have too large a response.
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
        """Name a difference, unless the present name is close enough."""
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
                return NOTHING  # neither clearly a delay nor a mode
            error = max(LEAST_ERROR, float(left[best])) + RUBBED * rubbing
            late = float(DELAYS[best]) * self._shows_delay
            return _named(float(grips[0, best]), late, error)
        peak = np.argmax(np.abs(response * self._mount) * (weights > 0.0))
        frequency = float(self._lines[peak])
        if frequency < LOWEST_MODE:
            return NOTHING
        text = f"a mode near {frequency:.0f} Hz is not described"
        return Difference(MODE, (frequency,), text)

    def _fitted(self, terms: ComplexArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the best grip for each delay, and the relative deviation that it leaves."""
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
    """Return what a relative mass with a relative error, and a delay, s, differ by."""
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
    """Return the motion of a mount over that of the handle."""
    if not mount.frequency:
        return np.ones(len(frequency), dtype=np.complex128)
    ratio = frequency / mount.frequency
    damper = 2j * mount.damping * ratio
    return np.asarray((1.0 + damper) / (1.0 - ratio**2 + damper))
