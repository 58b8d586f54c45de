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

"""Inverse controller that adapts to the user's grip, and learns surface and handle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from haptic_accel.core.control.controllers.interface import Loop
from haptic_accel.core.control.controllers.inverse import InverseController, InverseParameters
from haptic_accel.core.control.grip_estimation import (
    GRIP,
    AdaptationParameters,
    GripEstimator,
)
from haptic_accel.core.control.inversion.design import (
    DEFAULT_GOAL,
    RIDGE,
    TRAVEL_CORNERS,
    Goal,
    InverseBank,
    NormalEquations,
    assumed_sequences,
    caused_motion,
    design_basis,
    extension,
    travel_cost,
)
from haptic_accel.core.control.inversion.toeplitz import improved
from haptic_accel.core.control.response_estimation import ResponseEstimator
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, handle_model
from haptic_accel.core.parameters import parameter

UNDESCRIBED = 0.2
"""Relative deviation of the response above which the grip estimate is frozen. A mode in the band,
for example, fits no grip and would make the estimate jump. Ordinary hands cause up to 0.1."""


@dataclass(frozen=True)
class AdaptiveParameters(InverseParameters):
    """Parameters of the inverse and of the grip estimator."""

    frozen: bool = parameter(False, "stop the grip estimation and keep the present grip")
    adaptation: AdaptationParameters = field(default_factory=AdaptationParameters)

    def family(self, loop: Loop) -> InverseFamily:
        """Return the inverse for all grips; takes a fraction of a second."""
        return design_family(loop.plant, loop.rate, self.goal(loop))


class AdaptiveController(InverseController):
    """Inverse for the estimated grip, from a_hdes to f_a."""

    Parameters = AdaptiveParameters

    def __init__(self, parameters: AdaptiveParameters, loop: Loop) -> None:
        self._family = parameters.family(loop)
        self._estimator = GripEstimator(loop.plant, loop.rate, parameters.adaptation)
        self._grip = self._estimator.grip
        self._invert_by(self._family.bank(self._grip), parameters, loop)
        self._learner = Learner(self._family, loop.plant, loop.rate, parameters.goal(loop))
        self._applied = 0.0
        self.frozen = parameters.frozen

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force for the desired acceleration."""
        # The force applied one sample ago, and the acceleration measured then.
        self._estimator.observe(self._applied, measured_acceleration)
        extended = self._extension.process(desired_acceleration)
        self._learner.observe(desired_acceleration, extended, self._applied, measured_acceleration)
        return self._driven(extended, desired_acceleration)

    def applied(self, actuator_force: float) -> None:
        """Store the force that drives the handle: applied force minus friction compensation."""
        self._applied = actuator_force - self.friction_force

    def adapt(self) -> None:
        """Execute a part of the estimation; after its last part start to change the filter."""
        if self.frozen:
            return
        estimated = self._estimator.update()
        if estimated and self._learner.deviation < UNDESCRIBED:
            self._grip = self._estimator.grip
        if estimated or self._learner.update(self._grip):
            self._excursion.replace(self._family.taps(self._grip) + self._learner.correction)

    def freeze(self, frozen: bool) -> None:
        """Freeze the present filter, or resume the adaptation to the grip."""
        self.frozen = frozen

    def reset(self) -> None:
        """Clear the filters and the estimated grip."""
        self._estimator.reset()
        self._grip = self._estimator.grip
        self._learner.reset()
        super().reset()
        self._applied = 0.0

    @property
    def warning(self) -> str:
        """Grip parameters at a bound of their range; empty if there are none."""
        ends = self._estimator.at_end
        # Report no grip if none fits.
        if not ends or self._learner.deviation >= UNDESCRIBED:
            return ""
        grip = dict(zip(GRIP, self._grip.tolist(), strict=True))
        parts = (
            f"{name} at its {end} end, {grip[name]:.4g} {GRIP[name]}" for name, end in ends.items()
        )
        return f"grip outside the range of adaptation: {', '.join(parts)}"

    def diagnostics(self) -> dict[str, str]:
        """Return the estimated grip."""
        grip = zip(GRIP.items(), self._grip.tolist(), strict=True)
        return {
            **{f"{name} ({unit})": f"{value:.4g}" for (name, unit), value in grip},
            "grip estimates": str(self._estimator.estimates),
            "designs learnt": str(self._learner.estimates),
            "frozen": str(self.frozen).lower(),
        }


MEMORY = 2.0
"""Time constant of forgetting, in excited time, s: some strokes over a surface."""

WINDOW = 0.5
"""Minimum signal length for one evaluation, s: lines 2 Hz apart."""

WINDOW_PER_MEMORY = 2.0
"""Minimum ratio of `WINDOW` to the length of the convolution solved on these lines."""

LEAST_ACCELERATION = 0.05
"""Minimum root mean square of the desired acceleration for learning, m/s^2: twice the arm's own
motion in the handle's acceleration."""

LEAST_FORCE = 0.01
"""Minimum root mean square of the actuator's force for learning, N."""

LEARNT = 6.0, 12.0
"""Frequencies below which the plant is not learnt, and above which it is learnt fully, Hz: the
hand's own motion is no response to the force."""

PRIOR_WEIGHT = 0.3
"""Weight of the expected spectrum relative to one evaluation; matters only at first."""

TEXTURED = 4.0, 8.0
"""Frequencies below which the spectrum is that of slow motion, and above which that of the
texture, Hz."""

SLOW = 2.5
"""Frequency up to which a hand moves the tool, Hz: strokes to and fro (assumed)."""

SLOW_LINES = 2
"""Number of lines that show the slow motion: 2 and 4 Hz."""

EVER_EXPECTED = 5e-3
"""Fraction of the expected spectrum that always remains, by power."""

CAUTION = 4.0
"""Ratio of a squared deviation to the variance of the estimated response at which half of the
deviation is accepted."""

UNRESOLVED = 0.1
"""Incoherence that few evaluations cannot show."""

NEGLIGIBLE = 1e-2
"""Relative deviation of the plant that is half accepted even if it is certain."""

INDEPENDENCE = 0.5
"""Independent evaluations per evaluation: windows overlap by three quarters (Welch 1967)."""

STEPS = 6
"""Improvement steps per design; the next design continues from the result."""


class Learner:
    """Redesign a bank of inverses for the observed spectrum and plant.

    The spectrum is that of the extended desired acceleration by Welch's method, divided by the
    response of high-pass and extension. (The desired acceleration itself has too little power
    below the high-pass: leakage from above would look like a large slow motion.) The plant is the
    model with the estimated grip, times the ratio of measured to expected response to the applied
    force, line by line. An uncertain ratio is shifted towards 1. Without feedback the ratio has no
    bias. It includes effects without a parameter: a mode of the mount, the describing function of
    friction, another hand.

    Slow motion of the tool is not felt, but needs most of the travel. Its density is learnt as one
    number, as its peak is narrower than the lines. All members of the bank but the first expect
    it: slow motion is tracked less only where travel is short.

    The normal equations differ from the expected ones by the learnt part, which is smooth and
    needs few lines. A few steps from the last solution solve them for all members of the bank
    together. `observe` only stores values; `update` does all computations in parts.

    Parameters
    ----------
    family : InverseFamily
        Inverses for the estimated grip, to which the corrections are added.
    plant : Plant
        Assumed plant.
    rate : float
        Samples per second.
    goal : Goal
        Goal of the family.

    Attributes
    ----------
    correction : ndarray, shape (k, n)
        Corrections to add to the family's taps, N per m/s^2.
    deviation : float
        Relative difference between the handle's response and the model's over the excited lines.
    estimates : int
        Number of redesigns.
    """

    def __init__(self, family: InverseFamily, plant: Plant, rate: float, goal: Goal) -> None:
        self._family = family
        self._handle = plant.handle
        window = max(WINDOW, WINDOW_PER_MEMORY * goal.memory)
        self._tool = ResponseEstimator(rate, MEMORY, window, LEAST_ACCELERATION)
        self._ratio = ResponseEstimator(rate, MEMORY, window, LEAST_FORCE)
        lines = self._tool.frequency[1:]
        self._lines = lines
        self._known = plant.response(lines, rate) / handle_model(plant.handle).response(lines)
        self._equations = NormalEquations(plant.handle, lines, rate, goal)
        self._expected = goal.spectrum(lines)
        self._above = _rising(lines, *LEARNT)
        assumed = plant.response(lines, rate)
        self._assumed_spectra = self._equations.spectra(self._expected, assumed)
        self._textured = _rising(lines, *TEXTURED)
        self._assumed_sequences = assumed_sequences(plant, rate, goal)
        moving = replace(goal, spectrum=lambda lines: goal.spectrum(lines) + slow_motion(lines))
        self._slow_sequences = assumed_sequences(plant, rate, moving) - self._assumed_sequences
        self._travel_costs = np.array([[travel_cost(corner)] for corner in TRAVEL_CORNERS])
        self._giving = np.arange(len(TRAVEL_CORNERS))[:, np.newaxis] > 0  # travel for tracking
        self._work: Iterator[bool] = iter(())
        self.reset()

    def observe(
        self, desired: float, extended: float, actuator_force: float, measured: float
    ) -> None:
        """Store one sample.

        Parameters
        ----------
        desired : float
            Desired acceleration, m/s^2.
        extended : float
            `desired` after the inverse's extension, m/s^2.
        actuator_force : float
            Force that drives the handle, N.
        measured : float
            Handle acceleration measured when that force took effect, m/s^2; NaN if unknown.
        """
        self._tool.observe(desired, extended)
        self._ratio.observe(actuator_force, measured)

    def update(self, grip: FloatArray) -> bool:
        """Execute a part of pending computations; return True after a new correction.

        Parameters
        ----------
        grip : ndarray, shape (3,)
            Present estimate of m_h, b_u and k_u.
        """
        done = next(self._work, None)
        if done is not None:
            return done
        self._tool.update()
        if self._ratio.update() and self._tool.weight:
            self._work = self._redesign(grip)
        return False

    def reset(self) -> None:
        """Discard everything learnt."""
        self._tool.reset()
        self._ratio.reset()
        handle = self._handle
        self._ratio.model[1:] = self._model(np.array([handle.m_h, handle.b_u, handle.k_u]))
        self._work = iter(())
        self.correction = np.zeros_like(self._family.basis[:, 0])
        self.deviation, self.estimates = 0.0, 0

    def _redesign(self, grip: FloatArray) -> Iterator[bool]:
        """Solve for all members of the bank in parts; yield after each part, finally True."""
        model = self._model(grip)
        # Each later evaluation is compared with the model of its time.
        self._ratio.model[1:] = model
        yield False
        ratio = self._certain_ratio()
        excitation = self._ratio.excitation[1:]
        self.deviation = float(np.sqrt(excitation @ np.abs(ratio - 1.0) ** 2 / excitation.sum()))
        yield False
        power, slow = self._spectrum()
        learnt = self._equations.spectra(power, model * ratio)
        yield False
        sequences = self._assumed_sequences + self._sequences(learnt - self._assumed_spectra)
        given = self._family.taps(grip)
        taps = given + self.correction
        yield False
        each = sequences[:, np.newaxis] + self._slow_sequences[:, np.newaxis] * slow * self._giving
        columns = each[0] + self._travel_costs * each[1]
        columns[:, 0] *= 1.0 + RIDGE
        steps = 0
        for better in improved(columns, each[2], taps):
            if better is not None:
                taps = better
                steps += 1
            yield False
            if steps == STEPS:
                break
        self.correction = taps - given
        self.estimates += 1
        yield True

    def _model(self, grip: FloatArray) -> ComplexArray:
        """Return the response of the plant with a grip, m/s^2 per N, on the lines."""
        m_h, b_u, k_u = grip.tolist()
        handle = replace(self._handle, m_h=m_h, b_u=b_u, k_u=k_u)
        return np.asarray(self._known * handle_model(handle).response(self._lines))

    def _spectrum(self) -> tuple[FloatArray, float]:
        """Return the learnt spectrum of the tool and the density of its slow motion.

        Both have the scale of the expected spectrum.
        """
        seen = self._tool.output[1:] / np.abs(self._equations.extended) ** 2
        seen *= float(self._above @ self._expected) / float(self._above @ seen)
        weight = self._tool.weight / (self._tool.weight + PRIOR_WEIGHT)
        more, shape = (seen - self._expected)[:SLOW_LINES], slow_motion(self._lines[:SLOW_LINES])
        slow = weight * max(0.0, float(more @ shape) / float(shape @ shape))
        learnt = self._expected + weight * self._textured * (seen - self._expected)
        return np.asarray(learnt + EVER_EXPECTED * self._expected), slow

    def _certain_ratio(self) -> ComplexArray:
        """Return the ratio of plant to model on the lines, weighted by its certainty."""
        response, coherence = self._ratio.response[1:], self._ratio.coherence[1:]
        independent = max(1.0, INDEPENDENCE * self._ratio.weight)
        unexplained = (1.0 - coherence + UNRESOLVED / independent) / independent
        variance = np.abs(response) ** 2 * unexplained / np.maximum(coherence, 1e-6)
        squared = np.abs(response - 1.0) ** 2
        doubt = CAUTION * variance + NEGLIGIBLE**2
        return np.asarray(1.0 + self._above * squared / (squared + doubt) * (response - 1.0))

    def _sequences(self, spectra: ComplexArray) -> FloatArray:
        """Return the first lags of sequences with these spectra, shape (3, n)."""
        from_zero = np.zeros((len(spectra), len(self._lines) + 1), dtype=np.complex128)
        from_zero[:, 1:] = spectra
        lags = np.fft.irfft(from_zero, 2 * len(self._lines))
        return np.asarray(lags[:, : self._assumed_sequences.shape[1]])


def _rising(frequency: FloatArray, low: float, high: float) -> FloatArray:
    """Return weights that rise linearly from 0 at one frequency to 1 at another."""
    return np.clip((frequency - low) / (high - low), 0.0, 1.0)


def slow_motion(frequency: FloatArray) -> FloatArray:
    """Return the spectrum of a tool that a hand moves, with density 1 at 0 Hz."""
    return np.asarray(1.0 / (1.0 + (frequency / SLOW) ** 6))


@dataclass(frozen=True)
class InverseFamily:
    """Inverses of all grips for each of `TRAVEL_CORNERS`.

    Attributes
    ----------
    sections : ndarray, shape (2, 6)
        Extension, independent of the grip.
    basis : ndarray, shape (k, 4, n)
        Taps to multiply by m_h, b_u, k_u and 1, and to add.
    motion : ndarray, shape (k, n)
        As in `InverseBank`; assumed to be equal for all grips.
    """

    sections: FloatArray
    basis: FloatArray
    motion: FloatArray

    def taps(self, grip: FloatArray) -> FloatArray:
        """Return the taps for a grip.

        Parameters
        ----------
        grip : ndarray, shape (3,)
            m_h, b_u and k_u: kg, N s/m, N/m.

        Returns
        -------
        ndarray, shape (k, n)
        """
        return np.asarray(np.append(grip, 1.0) @ self.basis)

    def bank(self, grip: FloatArray) -> InverseBank:
        """Return the inverses for a grip."""
        return InverseBank(self.sections, self.taps(grip), self.motion)


def design_family(plant: Plant, rate: float, goal: Goal = DEFAULT_GOAL) -> InverseFamily:
    """Design the inverse for all grips of one actuator.

    Parameters, errors
        As for `design_inverse`; the plant has the middle of the expected grips.

    Returns
    -------
    InverseFamily
    """
    basis = design_basis(plant, rate, goal)
    handle = plant.handle
    own = np.array([handle.m_h, handle.b_u, handle.k_u, 1.0]) @ basis
    sections = extension(goal.high_pass_frequency, rate)
    return InverseFamily(sections, basis, caused_motion(plant, rate, own))
