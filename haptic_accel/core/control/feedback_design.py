# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feedback of the handle's acceleration with a specified margin over a range of grips.

P is the sampled plant of a grip, and B the high-pass of the measurement, which is received one
sample late. G = B z^-1 P is the path from a force to the feedback signal. The controller contains
a model G_0 of G for the middle grip. It feeds the difference between measurement and model through
a convolution Q (internal model control: Morari and Zafiriou, Robust Process Control, 1989). In the
usual form the loop is

    L = K G,  K = Q / (1 - Q G_0),  1 + L = (1 + Q (G - G_0)) / (1 - Q G_0),  S = 1 / (1 + L).

In the factor 1 + Q (G - G_0) all parts are stable. The loop of a grip is stable if and only if the
factor's curve over the unit circle does not encircle zero, whatever K is. The middle grip is
always stable. A limited force causes no difference from the model.

Q is found by numerical optimisation. A gain times 1/P and a low-pass would use up the margin at
frequencies where it reduces no error. Least squares over the expected texture concentrates the
feedback at frequencies where grips matter. The margin is satisfied for each grip and frequency.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from haptic_accel.core.control import inversion
from haptic_accel.core.control.filters import high_pass, high_pass_response, section_response
from haptic_accel.core.handle.mechanics import grid_for
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters
from haptic_accel.core.parameters import Checked, ParameterError, parameter

# scipy.linalg is slow to import: only the design of a filter needs it.

Response = Callable[[FloatArray], ComplexArray]
"""Force over desired acceleration, N per m/s^2, at frequencies in Hz."""

MARGIN = 0.5
"""Minimum distance of the loop from -1. Disturbances are at most doubled; gain margin at least 2,
phase margin at least 0.5 rad."""

MODEL_MEMORY = 0.3
"""Length of the model's impulse response, s; the slowest motion of Table I decays by a factor e in
0.03 s."""

FEEDBACK_MEMORY = 0.05
"""Length of Q, s; four times this length reduces the error by less than 1 %."""

PERCEPTIBLE_FREQUENCY = 500.0
"""Upper frequency of unexpected tool acceleration, Hz; fingertips are hardly sensitive above it
(Bolanowski et al., J. Acoust. Soc. Am. 84, 1988, measured 0.4 to 500 Hz)."""

GRID_STEP = 0.5
"""Frequency resolution, Hz: an eighth of the width of the narrowest resonance of Table I."""

_RESERVE = 0.97  # fraction of the |S| limit in the search, for less final scaling
_PENALTIES = (1.0, 10.0, 100.0, 1000.0)  # weights of |S| above the limit; the error's weight is 1
_STEPS = 12  # steps per penalty
_SETTLED = 1e-3  # relative decrease at which a penalty's search ends
_SHORTEST = 1 / 64  # smallest fraction of a step that is tried
_RIDGE = 1e-9  # relative increase of the normal equations' diagonal, against rounding
_HALVINGS = 12  # bisections of the scaling


@dataclass(frozen=True)
class GripRange(Checked):
    """Grips for which a feedback must be stable: a box around the identified handle."""

    mass: float = parameter(
        0.3, "relative deviation of the handle's mass m_h, either way (assumed)", low=0, high=0.9
    )
    stiffness: float = parameter(
        2.0, "factor by which the grip's k_u may be larger or smaller (assumed)", low=1, high=10
    )
    damping: float = parameter(
        2.0, "factor by which the grip's b_u may be larger or smaller (assumed)", low=1, high=10
    )

    def grips(self, handle: HandleParameters) -> tuple[HandleParameters, ...]:
        """Return the identified handle, then the eight corners of the box around it."""
        corners = itertools.product(
            (1.0 - self.mass, 1.0 + self.mass),
            (1.0 / self.stiffness, self.stiffness),
            (1.0 / self.damping, self.damping),
        )
        h = handle
        grips = (replace(h, m_h=h.m_h * m, k_u=h.k_u * k, b_u=h.b_u * b) for m, k, b in corners)
        return handle, *grips


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop.

    Attributes
    ----------
    modulus : float
        Minimum distance of the loop from -1, min |1 + L|.
    gain : float
        Gain margin as a factor; infinite if no larger gain makes the loop unstable.
    phase : float
        Phase margin in both directions, rad; infinite if the gain never reaches one.
    delay : float
        Additional delay that the loop tolerates, s; infinite if the gain never reaches one.
    """

    modulus: float
    gain: float
    phase: float
    delay: float


def loop_margins(loop: ComplexArray, frequency: FloatArray) -> Margins:
    """Return the margins of a loop transfer function L with negative feedback.

    Parameters
    ----------
    loop : ndarray, shape (n,)
        L at the frequencies.
    frequency : ndarray, shape (n,)
        Increasing frequencies, Hz, fine enough for linear interpolation of the curve.
    """
    gain = [-1.0 / real for real in _real_crossings(loop) if -1.0 < real < 0.0]
    turned, at = _unit_crossings(loop, frequency)
    lag = np.mod(turned, 2 * np.pi)  # from L to -1, clockwise
    return Margins(
        modulus=float(np.abs(1.0 + loop).min()),
        gain=min(gain, default=math.inf),
        phase=float(np.minimum(lag, 2 * np.pi - lag).min(initial=math.inf)),
        delay=float((lag / (2 * np.pi * at)).min(initial=math.inf)),
    )


def _real_crossings(loop: ComplexArray) -> list[float]:
    before, after = loop[:-1], loop[1:]
    (at,) = np.nonzero(before.imag * after.imag < 0)
    part = before.imag[at] / (before.imag[at] - after.imag[at])
    crossings: list[float] = (before.real[at] + part * (after - before).real[at]).tolist()
    # At half the rate every loop is real; a grid ends just before.
    return [*crossings, float(loop[-1].real)]


def _unit_crossings(loop: ComplexArray, frequency: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the angles of -L at gain crossovers, rad, and the frequencies, Hz."""
    with np.errstate(divide="ignore"):
        level = np.log(np.abs(loop))
    (at,) = np.nonzero(level[:-1] * level[1:] <= 0)
    at = at[level[at] != level[at + 1]]
    part = level[at] / (level[at] - level[at + 1])
    point = -(loop[at] + part * (loop[at + 1] - loop[at]))
    return np.angle(point), frequency[at] + part * (frequency[at + 1] - frequency[at])


def encirclements(curve: ComplexArray) -> int | None:
    """Count the encirclements of zero by a curve over the upper half circle and its mirror image.

    Parameters
    ----------
    curve : ndarray, shape (n,) or (m, n)
        Values of a real transfer function at increasing frequencies from near 0 to near half the
        rate. For several curves, the magnitudes of the counts are added.

    Returns
    -------
    int or None
        For one curve, anticlockwise counts are positive: minus the number of zeros outside the
        unit circle, if there are no poles there. None if the curve turns by a right angle or more
        between points, so that the number is undetermined.
    """
    whole = np.concatenate([curve[..., ::-1].conj(), curve, curve[..., -1:].conj()], axis=-1)
    if not np.isfinite(whole).all() or not whole.all():
        return None
    turns = np.angle(whole[..., 1:] / whole[..., :-1])
    if np.abs(turns).max() >= np.pi / 2:
        return None
    counts = np.rint(turns.sum(axis=-1) / (2 * np.pi))
    return int(counts if counts.ndim == 0 else np.abs(counts).sum())


@dataclass(frozen=True)
class GripOutlook:
    """Predicted margins and errors of a feedback for one grip.

    Attributes
    ----------
    handle : HandleParameters
        Handle with this grip.
    margins : Margins
    without, with_feedback : float
        Errors for the design spectrum, as `Prediction.nrmse_percent`.
    """

    handle: HandleParameters
    margins: Margins
    without: float
    with_feedback: float


@dataclass(frozen=True)
class FeedbackDesign:
    """Feedback with its predicted margins and errors.

    Attributes
    ----------
    high_pass : ndarray, shape (2, 6)
        Second-order sections of B, a0 = 1.
    model : ndarray, shape (m,)
        Impulse response of the handle with the middle grip, m/s^2 per N; its first value is one
        sample after the force.
    taps : ndarray, shape (n,)
        Q, N per m/s^2.
    rate : float
        Samples per second.
    margin : float
        Specified distance of the loop from -1.
    share : float
        Factor applied to the best Q for an exact margin; 0 without feedback.
    outlooks : tuple of GripOutlook
        Middle grip first, then the corners of the range.
    """

    high_pass: FloatArray
    model: FloatArray
    taps: FloatArray
    rate: float
    margin: float
    share: float
    outlooks: tuple[GripOutlook, ...]

    @property
    def tightest(self) -> GripOutlook:
        """Grip with the smallest distance from -1."""
        return min(self.outlooks, key=lambda outlook: outlook.margins.modulus)

    @property
    def gain(self) -> float:
        """Largest magnitude of Q, N per m/s^2."""
        grid = grid_for(self.rate, len(self.taps), GRID_STEP)
        return float(np.abs(grid.spectrum(self.taps)).max())

    def loop(self, plant: Plant, frequency: FloatArray) -> ComplexArray:
        """Return the loop transfer function L for a plant at frequencies in Hz, shape (n,)."""
        turned = np.exp(-2j * np.pi * frequency / self.rate)
        measured = section_response(self.high_pass, frequency, self.rate) * turned
        polynomial = np.polynomial.polynomial.polyval
        modelled = measured * turned * polynomial(turned, self.model)
        answer = polynomial(turned, self.taps)
        through = measured * plant.response(frequency, self.rate)
        return np.asarray(answer * through / (1.0 - answer * modelled))

    def summary(self) -> str:
        """Return margins and errors as lines to print."""
        worst = self.tightest.margins
        handle = self.tightest.handle
        lines = [
            f"feedback: at most {self.gain:.3f} N per m/s^2, {100 * self.share:.0f} % of what was "
            f"found best; stated margin {self.margin:.2f} over {len(self.outlooks)} grips",
            f"smallest distance from -1: {worst.modulus:.2f} at m_h = {handle.m_h:.3f} kg, "
            f"k_u = {handle.k_u:.0f} N/m, b_u = {handle.b_u:.1f} N s/m",
            "m_h (kg)  k_u (N/m)  b_u (N s/m)  |1+L|  gain  phase (rad)  delay (ms)"
            "  error (%) without, with",
        ]
        for outlook in self.outlooks:
            h, m = outlook.handle, outlook.margins
            lines.append(
                f"{h.m_h:8.3f}  {h.k_u:9.0f}  {h.b_u:11.1f}  {m.modulus:5.2f}  {m.gain:4.1f}"
                f"  {m.phase:11.2f}  {1e3 * m.delay:10.2f}"
                f"  {outlook.without:17.1f}  {outlook.with_feedback:4.1f}"
            )
        return "\n".join(lines)


def design_feedback(
    plant: Plant,
    rate: float,
    feedforward: Response,
    goal: inversion.Goal = inversion.DEFAULT_GOAL,
    *,
    foreseen: bool = True,
    margin: float = MARGIN,
    grips: GripRange | None = None,
) -> FeedbackDesign:
    """Design the feedback of least error over a range of grips at a specified margin.

    With the tool's spectrum S_t, the high-pass B, the feedforward C and the granted delay D, a
    grip's error is S_t |B|^2 |A + S M|^2. If deviations from the model are fed back (`foreseen`),
    M = (P - P_0) C is the change due to the grip. A = P_0 C - D is then the error of the
    feedforward at the middle grip. Otherwise A = 0 and M = P C - D. The cost is the sum over the
    grips, plus the effect of the accelerometer's noise and the cost of force (`FORCE_COST`). It is
    minimised under |S| <= 1 / margin by Gauss-Newton steps, each a Toeplitz system, with a growing
    penalty on the part of S outside that disc. A final scaling of Q makes the margin exact on the
    grid.

    A feedback that reduces the error at some frequencies increases it at others (Bode's integral).
    Therefore `UNEXPECTED_DENSITY` up to `PERCEPTIBLE_FREQUENCY` is added to the tool's spectrum.
    It costs a twentieth of the improvement on expected textures, and halves the loss on rougher
    ones. The same white density in the measurement keeps Q small where the handle hardly responds.

    Parameters
    ----------
    plant : Plant
        Plant with the grip in the middle of the range.
    rate : float
        Samples per second, more than twice the high-pass' corner.
    feedforward : callable
        Response of the feedforward, from desired acceleration to force.
    goal : Goal
        Delay, spectrum, and corner of the high-pass, which also filters the measurement.
    foreseen : bool
        True to compare the measurement with the model's response to the force; False to compare it
        with the desired acceleration after the granted delay.
    margin : float
        Minimum distance of the loop from -1 at any grip, above 0 and below 1.
    grips : GripRange, optional

    Returns
    -------
    FeedbackDesign
        Feedback; its gain is zero if no stable feedback reduces the error.

    Raises
    ------
    ParameterError
        A parameter is out of range.
    """
    goal.check(rate)
    if not 0.0 < margin < 1.0:
        raise ParameterError(f"margin = {margin:g}: must be above 0 and below 1")
    handles = (grips or GripRange()).grips(plant.handle)
    plants = [replace(plant, handle=handle) for handle in handles]
    problem = _Problem(plants, rate, feedforward, goal, foreseen=foreseen, margin=margin)
    best = problem.search()
    share = problem.share(best)
    taps = share * best
    return FeedbackDesign(
        high_pass=high_pass(goal.high_pass_frequency, rate),
        model=problem.model,
        taps=taps,
        rate=rate,
        margin=margin,
        share=share if taps.any() else 0.0,
        outlooks=tuple(
            GripOutlook(handle, loop_margins(loop, problem.grid.frequency), before, after)
            for handle, loop, before, after in zip(handles, *problem.outlook(taps), strict=True)
        ),
    )


@dataclass(frozen=True)
class _Loops:
    """Loops of all grips with one Q; arrays of shape (grips, n) except `answer`."""

    answer: ComplexArray  # Q
    turned: ComplexArray  # 1 + Q (G - G_0)
    sensitivity: ComplexArray  # S


class _Problem:
    """Grips, feedforward and spectrum on a grid; G of all grips, and the search for Q."""

    def __init__(
        self,
        plants: list[Plant],
        rate: float,
        feedforward: Response,
        goal: inversion.Goal,
        *,
        foreseen: bool,
        margin: float,
    ) -> None:
        length = max(2, round(MODEL_MEMORY * rate))
        self.grid = grid_for(rate, length, GRID_STEP)
        self._length = max(1, round(FEEDBACK_MEMORY * rate))
        self._limit = 1.0 / margin
        frequency, late = self.grid.frequency, self.grid.delay(1)
        passed = high_pass_response(goal.high_pass_frequency, frequency, rate)
        responses = np.stack([plant.response(frequency, rate) for plant in plants])
        # The response to a force starts one sample later, with the model's first value.
        self.model = self.grid.sequence(responses[0])[1 : length + 1]
        self._through = passed * late * responses
        self._modelled = passed * late * late * self.grid.spectrum(self.model)
        force, target = feedforward(frequency), self.grid.delay(goal.granted_delay)
        self._kept = responses[0] * force - target if foreseen else np.zeros_like(force)
        self._fought = responses * force - target - self._kept
        expected = goal.spectrum(frequency) * np.abs(passed) ** 2
        self._expected = expected / expected.sum()
        unexpected = inversion.UNEXPECTED_DENSITY**2 * np.abs(passed) ** 2
        falling = (1.0 + (frequency / PERCEPTIBLE_FREQUENCY) ** 2) ** 3
        power = expected + unexpected / falling
        self._power = power / (len(plants) * power.sum())
        self._noise = inversion.SENSOR_DENSITY**2 / (len(plants) * float(power.sum()))
        self._unexpected = inversion.FORCE_COST**2 * unexpected / (len(plants) * power.sum())
        self._surprise = passed * late * self._fought

    def search(self) -> FloatArray:
        """Return the best Q before the final scaling."""
        taps = np.zeros(self._length)
        for penalty in _PENALTIES:
            for _ in range(_STEPS):
                before = self._cost(taps, penalty)
                taps, after = self._improved(taps, penalty, before)
                if after > (1.0 - _SETTLED) * before:
                    break
        return taps

    def share(self, taps: FloatArray) -> float:
        """Return the largest factor for Q, found by bisection, that satisfies the margin."""
        if self._keeps(taps):
            return 1.0
        return inversion.nearest(lambda share: self._keeps(share * taps), 1.0, 0.0, _HALVINGS)

    def outlook(self, taps: FloatArray) -> tuple[ComplexArray, list[float], list[float]]:
        """Return L of all grips, and their errors in percent without and with feedback."""
        loops = self._loops(taps)
        without = self._errors(np.ones_like(loops.sensitivity))
        return 1.0 / loops.sensitivity - 1.0, without, self._errors(loops.sensitivity)

    def _errors(self, sensitivity: ComplexArray) -> list[float]:
        error = np.abs(self._kept + sensitivity * self._fought) ** 2
        return list(map(float, 100.0 * np.sqrt(error @ self._expected)))

    def _loops(self, taps: FloatArray) -> _Loops:
        answer = self.grid.spectrum(taps)
        turned = 1.0 + answer * (self._through - self._modelled)
        return _Loops(answer, turned, (1.0 - answer * self._modelled) / turned)

    def _keeps(self, taps: FloatArray) -> bool:
        loops = self._loops(taps)
        stable = encirclements(loops.turned) == 0
        return stable and float(np.abs(loops.sensitivity).max()) <= self._limit

    def _cost(self, taps: FloatArray, penalty: float) -> float:
        """Return the cost to minimise; infinite if a grip is unstable."""
        loops = self._loops(taps)
        if encirclements(loops.turned) != 0:
            return math.inf
        sensitivity = loops.sensitivity
        error = np.abs(self._kept + sensitivity * self._fought) ** 2
        error += (
            inversion.FORCE_COST**2 * np.abs(loops.answer * self._surprise / loops.turned) ** 2
        )
        noise = self._noise * np.sum(np.abs(1.0 - sensitivity) ** 2)
        return float(
            np.sum(error @ self._power)
            + np.sum(np.abs(loops.answer / loops.turned) ** 2 @ self._unexpected)
            + noise
            + penalty * np.mean(np.abs(sensitivity - self._nearest(sensitivity)) ** 2)
        )

    def _nearest(self, sensitivity: ComplexArray) -> ComplexArray:
        """Return the nearest sensitivity that satisfies the margin, with a reserve."""
        size = np.abs(sensitivity)
        return np.asarray(sensitivity * np.minimum(1.0, _RESERVE * self._limit / size))

    def _improved(
        self, taps: FloatArray, penalty: float, before: float
    ) -> tuple[FloatArray, float]:
        """Return Q after the longest step that reduces the cost, and the new cost."""
        step, part = self._step(taps, penalty), 1.0
        while part >= _SHORTEST:
            after = self._cost(taps + part * step, penalty)
            if after < before:
                return taps + part * step, after
            part /= 2
        return taps, before

    def _step(self, taps: FloatArray, penalty: float) -> FloatArray:
        from scipy.linalg import solve_toeplitz

        loops = self._loops(taps)
        sensitivity = loops.sensitivity
        reached = -self._through / loops.turned**2  # derivative of S with respect to Q
        force = self._power * np.abs(inversion.FORCE_COST * self._surprise / loops.turned) ** 2
        force += self._unexpected / np.abs(loops.turned) ** 2
        outside = sensitivity - self._nearest(sensitivity)
        held = penalty / sensitivity.size
        # Second and first derivatives of the squares with respect to Q.
        growth = self._power * np.abs(reached * self._fought) ** 2 + force
        growth += (self._noise + held) * np.abs(reached) ** 2
        error = self._kept + sensitivity * self._fought
        fall = self._power * (reached * self._fought).conj() * error + force * loops.answer
        fall += reached.conj() * (held * outside + self._noise * (sensitivity - 1.0))
        column = self.grid.sequence(growth.sum(axis=0))[: self._length]
        column[0] *= 1.0 + _RIDGE
        target = self.grid.sequence(-fall.sum(axis=0))[: self._length]
        return np.asarray(solve_toeplitz(column, target), dtype=np.float64)
