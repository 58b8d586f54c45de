# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse controller that adapts to the user's grip, and learns surface and handle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.control import estimation, inversion
from haptic_accel.core.control.authority import REDUCED
from haptic_accel.core.control.controllers.fixed import InverseController, InverseParameters
from haptic_accel.core.control.controllers.interface import Loop
from haptic_accel.core.control.estimation import GRIP, AdaptationParameters, GripEstimator
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, grip_denominator, handle_model
from haptic_accel.core.parameters import parameter
from haptic_accel.core.tick import AdaptiveForce, Trace

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


class AdaptiveController(AdaptiveForce, InverseController):
    """Inverse for the estimated grip, from a_hdes to f_a."""

    Parameters = AdaptiveParameters

    def __init__(self, parameters: AdaptiveParameters, loop: Loop) -> None:
        self._family = parameters.family(loop)
        self.trace, self.sent = Trace(), 0.0
        trace, adaptation = self.trace, parameters.adaptation
        self._estimator = GripEstimator(trace, loop.plant, loop.rate, adaptation)
        self._grip = self._estimator.grip
        self._invert_by(self._family.bank(self._grip), parameters, loop)
        self._learner = Learner(trace, self._family, loop.plant, loop.rate, parameters.goal(loop))
        self.frozen = parameters.frozen

    def adapt(self) -> int:
        """Execute a part of the estimation; after its last part start to change the filter."""
        if self.frozen:
            return estimation.NEVER
        estimator, learner = self._estimator, self._learner
        estimated = estimator.update()
        if estimated and learner.deviation < UNDESCRIBED:
            self._grip = estimator.grip
        if estimated or learner.update(self._grip):
            self.excursion.replace(self._family.taps(self._grip) + learner.correction)
        return min(estimator.left, learner.left)

    def judged(self, fitting: float, fraction: float) -> None:
        """Forget the response faster while the force is harmful, as the handle has changed."""
        self._learner.hasten(fraction)

    def freeze(self, frozen: bool) -> None:
        """Freeze the present filter, or resume the adaptation to the grip."""
        self.frozen = frozen

    def reset(self) -> None:
        """Reset the filters and the estimated grip."""
        self.trace.reset()
        self._estimator.reset()
        self._grip = self._estimator.grip
        self._learner.reset()
        super().reset()
        self.sent = 0.0

    @property
    def warning(self) -> str:
        """Response that is not learnt, or grip parameters at a bound; empty if there are none."""
        if self._learner.is_hidden:
            return (
                f"the handle's response is not learnt in {NOT_LEARNT:g} s of contact, as the force"
                f" explains {100 * self._learner.explained:.0f} % of its motion"
            )
        ends = self._estimator.at_end
        # Report no bound if no grip fits.
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


FORGETTING_TIME = 2.0
"""Time constant of forgetting, in excited time, s: a few strokes over a surface."""

HASTY = 0.15
"""Minimum memory of the plant relative to `FORGETTING_TIME`: a few independent evaluations."""

SHORTEST_WINDOW = 0.5
"""Minimum signal length for one evaluation, s: lines 2 Hz apart."""

LAGS_PER_WINDOW = 2.0
"""Ratio of the longest lag of the tool's autocorrelation to `SHORTEST_WINDOW`: lines 0.5 Hz
apart."""

WINDOW_PER_MEMORY = 2.0
"""Minimum ratio of `SHORTEST_WINDOW` to the length of the convolution solved on these lines."""

LEAST_ACCELERATION = 0.05
"""Minimum root mean square of the desired acceleration for learning, m/s^2: twice the arm's own
motion in the handle's acceleration."""

LEAST_FORCE = 1e-6
"""Root mean square of the actuator's force below which it counts as zero, N. The coherence shows
whether a force is measurable above the noise."""

EXPECTED_SURPRISE = 1.1
"""Value of `surprise` up to which the handle counts as unchanged; above it, the memory decreases
with the third power of their ratio."""

NOT_LEARNT = 4.0
"""Duration of a reduced force after which the response counts as not learnt, s of excitation."""

LEARNT = 6.0, 12.0
"""Frequencies below which the plant is not learnt, and above which it is learnt fully, Hz: the
hand's own motion is not a response to the force."""

PRIOR_WEIGHT = 1.0
"""Weight of the expected spectrum, as a number of evaluations, each of an eighth of a second."""

EVER_EXPECTED = 5e-3
"""Fraction of the expected spectrum that always remains, by power."""

FIRST_EXPECTED = 4.0
"""This fraction while the plant is not known: a filter for a narrow spectrum needs an accurate
plant."""

CAUTION = 4.0
"""Ratio of a squared deviation to the variance of the estimated response at which half of the
deviation is accepted."""

MOTION = 6e-5
"""Density of motion that the force does not cause, (m/s^2)^2/Hz: 0.02 to 0.04 m/s^2 RMS over 40 Hz
by the arm, and as much by dry friction. Lines with a smaller expected density show no response: by
chance, a few of many lines would have a small ratio, and the filter would be large there."""

UNRESOLVED = 0.1
"""Incoherence that cannot be detected from few evaluations."""

NEGLIGIBLE = 1e-2
"""Relative deviation of the plant of which half is accepted even if it is certain."""

STEPS = 6
"""Improvement steps per design; the next design continues from the result."""


class Learner:
    """Redesign a bank of inverses for the observed spectrum and plant.

    The tool's spectrum is that of the exact autocorrelation of the convolution's input. A windowed
    spectrum would smear the slow motion of the hand, which is imperceptible, but needs most of the
    travel. The plant is the model with the estimated grip, times the ratio of measured to expected
    response to the applied force, line by line. An uncertain ratio is shifted towards 1. Without
    feedback the ratio has no bias. It includes effects without a parameter: a mode of the mount,
    the describing function of friction, another hand.

    The normal equations need the autocorrelation up to the length of the convolution and the
    memory of handle and actuator. A few steps from the last solution solve them for all members of
    the bank together. `update` does all computations in parts.

    Parameters
    ----------
    trace : Trace
        Desired acceleration, the same after the inverse's extension (`drive`), force that drives
        the handle, and acceleration measured when that force took effect.
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

    def __init__(
        self, trace: Trace, family: InverseFamily, plant: Plant, rate: float, goal: inversion.Goal
    ) -> None:
        self.trace, self._family = trace, family
        self._handle = plant.handle
        window = max(SHORTEST_WINDOW, WINDOW_PER_MEMORY * goal.memory)
        self._ratio = estimation.ChangeEstimator(trace, rate, FORGETTING_TIME, window, LEAST_FORCE)
        interval, longest = self._ratio.interval, LAGS_PER_WINDOW * window
        self._tool = estimation.AutocorrelationEstimator(
            trace, rate, FORGETTING_TIME, interval, longest, LEAST_ACCELERATION
        )
        lags = len(self._tool.sequence)
        lines: FloatArray = np.fft.rfftfreq(2 * lags, 1.0 / rate).astype(np.float64)
        lines[0] = 0.01 * lines[1]  # the responses are not defined at 0 Hz
        self._lines = lines
        # The tool's spectrum has a multiple of the ratio's lines.
        every = lags // (len(self._ratio.frequency) - 1)
        self._every = slice(every, None, every)
        model = handle_model(plant.handle)
        self._known = plant.response(lines, rate) / model.response(lines)
        self._s = 2j * np.pi * lines
        self._numerator = np.polyval(model.numerator, self._s)
        self._equations = inversion.NormalEquations(plant.handle, lines, rate, goal)
        self._expected, self._unexpected = map(
            _spectrum, inversion.expected_input(rate, goal, lags)
        )
        self._above = np.interp(lines, LEARNT, (0.0, 1.0))
        tool = (
            1.0 / np.abs(inversion.extended_response(goal.high_pass_frequency, lines, rate)) ** 2
        )
        self._tool_power = self._above * tool
        self._expected_power = float(self._tool_power @ self._expected)
        self._taps = family.basis.shape[2]
        costs = [inversion.travel_cost(corner) for corner in inversion.TRAVEL_CORNERS]
        self._travel_costs = np.array(costs)[:, np.newaxis]
        self._work: Iterator[bool] | None
        self.reset()

    @property
    def left(self) -> int:
        """Number of samples until `update` has something to do."""
        return 1 if self._work else min(self._ratio.left, self._tool.left)

    def update(self, grip: FloatArray) -> bool:
        """Execute a part of pending computations; return True after a new correction.

        Parameters
        ----------
        grip : ndarray, shape (3,)
            Present estimate of m_h, b_u and k_u.
        """
        if self._work:
            done = next(self._work, True)
            self._work = None if done else self._work
            return done
        # Both take four parts: the ratio is known before the redesign starts.
        self._ratio.update()
        if self._tool.update():
            self._work = self._redesign(grip)
        return False

    def reset(self) -> None:
        """Discard everything learnt."""
        self._ratio.memory = FORGETTING_TIME
        self._used_at = 0  # estimates of the ratio when the force was last not reduced
        self._fraction = 1.0  # latest fraction of the force
        self._tool.reset()
        self._ratio.reset()
        described = self._known * handle_model(self._handle).response(self._lines)
        self._ratio.model[1:] = described[self._every]
        self._work = None
        self.correction = np.zeros_like(self._family.basis[:, 0])
        self.deviation, self.estimates = 0.0, 0

    def hasten(self, fraction: float) -> None:
        """Shorten the memory of the plant, down to `HASTY`, for the fraction of the force in use.

        The memory stays long while the handle moves as learnt: a small force takes long to be
        measurable above the noise. Otherwise, samples with more force lose the weight of their
        larger power.
        """
        ratio = self._ratio
        unchanged = 0.0
        if ratio.weight > estimation.FEW:
            unchanged = min(1.0, (EXPECTED_SURPRISE / ratio.surprise) ** 3)
            if 0.0 < fraction < self._fraction:
                ratio.fade((fraction / self._fraction) ** (2.0 * (1.0 - unchanged)))
        self._fraction = fraction
        ratio.memory = FORGETTING_TIME * max(HASTY + (1.0 - HASTY) * fraction, unchanged)
        if fraction >= REDUCED:
            self._used_at = ratio.estimates

    @property
    def is_hidden(self) -> bool:
        """True if the force has been reduced for long because the plant is not learnt."""
        return (self._ratio.estimates - self._used_at) * self._ratio.interval > NOT_LEARNT

    @property
    def explained(self) -> float:
        """Fraction of the handle's power that the force explains."""
        ratio = self._ratio
        total = max(float(ratio.output.sum()), estimation.TINY)
        return float(ratio.coherence @ ratio.output / total)

    def _redesign(self, grip: FloatArray) -> Iterator[bool]:
        """Solve for all members of the bank in parts; yield after each part, finally True."""
        model = self._model(grip)
        # Each later evaluation is compared with the model of its time.
        self._ratio.model[1:] = model[self._every]
        yield False
        if self._ratio.weight:
            ratio = self._certain_ratio()
            excitation = self._ratio.excitation[1:]
            deviation = excitation @ np.abs(ratio - 1.0) ** 2 / excitation.sum()
            self.deviation = math.sqrt(deviation)
            model = model * np.interp(self._lines, self._ratio.frequency[1:], ratio)
        yield False
        spectra = self._equations.spectra(self._driven(), self._unexpected, model)
        yield False
        sequences = np.fft.irfft(spectra)[:, : self._taps]
        family_taps = self._family.taps(grip)
        taps = family_taps + self.correction
        yield False
        columns = sequences[0] + self._travel_costs * sequences[1]
        columns[:, 0] *= 1.0 + inversion.RIDGE
        steps = 0
        for better in inversion.improved(columns, sequences[2], taps):
            if better is not None:
                taps = better
                steps += 1
            yield False
            if steps == STEPS:
                break
        self.correction = taps - family_taps
        self.estimates += 1
        yield True

    def _model(self, grip: FloatArray) -> ComplexArray:
        """Return the response of the plant with a grip, m/s^2 per N, on the lines."""
        denominator = grip_denominator(self._handle, *grip.tolist())
        return np.asarray(self._known * (self._numerator / np.polyval(denominator, self._s)))

    def _driven(self) -> FloatArray:
        """Return the spectrum of the convolution's input, with the expected spectrum's scale."""
        seen = _spectrum(self._tool.sequence)
        scale = self._expected_power / float(self._tool_power @ seen)
        weight = self._tool.weight / (self._tool.weight + PRIOR_WEIGHT)
        kept = EVER_EXPECTED if self._ratio.weight else FIRST_EXPECTED
        driven = (1.0 - weight + kept) * self._expected + weight * scale * seen
        # After a pause, small negative densities may remain.
        return np.maximum(driven, EVER_EXPECTED * self._expected)

    def _certain_ratio(self) -> ComplexArray:
        """Return the ratio of plant to model on the lines, weighted by its certainty."""
        response, coherence = self._ratio.response[1:], self._ratio.coherence[1:]
        independent = max(1.0, estimation.INDEPENDENCE * self._ratio.weight)
        unexplained = (1.0 - coherence + UNRESOLVED / independent) / independent
        variance = np.abs(response) ** 2 * unexplained / np.maximum(coherence, 1e-6)
        squared = np.abs(response - 1.0) ** 2
        uncertainty = CAUTION * variance + NEGLIGIBLE**2
        excitation = np.maximum(self._ratio.excitation[1:], estimation.TINY)
        moved = MOTION / excitation / independent
        shown = np.maximum(0.0, 1.0 - CAUTION * moved / np.maximum(squared, NEGLIGIBLE**2))
        accepted = self._above[self._every] * shown * squared / (squared + uncertainty)
        return np.asarray(1.0 + accepted * (response - 1.0))


def _spectrum(sequence: FloatArray) -> FloatArray:
    """Return the spectrum of an autocorrelation from lag zero on, shape (n + 1,) for n lags."""
    both = np.concatenate([sequence, [0.0], sequence[:0:-1]])
    return np.asarray(np.fft.rfft(both).real)


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

    def bank(self, grip: FloatArray) -> inversion.InverseBank:
        """Return the inverses for a grip."""
        return inversion.InverseBank(self.sections, self.taps(grip), self.motion)


def design_family(
    plant: Plant, rate: float, goal: inversion.Goal = inversion.DEFAULT_GOAL
) -> InverseFamily:
    """Design the inverse for all grips of one actuator.

    Parameters, errors
        As for `design_inverse`; the plant has the middle of the expected grips.

    Returns
    -------
    InverseFamily
    """
    basis = inversion.design_basis(plant, rate, goal)
    handle = plant.handle
    own = np.array([handle.m_h, handle.b_u, handle.k_u, 1.0]) @ basis
    sections = inversion.extension(goal.high_pass_frequency, rate)
    return InverseFamily(sections, basis, inversion.tap_responses(plant, rate, own))
