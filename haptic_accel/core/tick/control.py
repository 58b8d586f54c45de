# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compensation of one sample: filters, controllers' forces, and the channels of the coils."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from haptic_accel.core.tick.guard import (
    LARGEST_ACCELERATION,
    ActuatorGuard,
    TravelEstimator,
    scale_within,
)
from haptic_accel.core.tick.kernels import (
    INFINITE,
    UNKNOWN,
    FloatMatrix,
    add_rows,
    add_scaled,
    dot,
    dots,
    peak,
    row_dot,
)
from haptic_accel.core.tick.watching import Trace

if TYPE_CHECKING:
    from haptic_accel.core.model import FloatArray, Suspension, Vector

SLIP_VELOCITY: float = 3e-3
"""Slip velocity at which 0.76 of the friction is compensated, m/s: below it the predicted slip is
too uncertain for its sign to be used."""

SETTLED: float = 1e-3
"""Negligible change of a position in a bank of inverses."""

DYNAMIC: str = "dynamic"
"""Name of the controller that may replace another one."""

HORIZON: float = 0.05
"""Prediction horizon of the travel, s: a period of the paper's actuator on its spring."""

REVERSION: float = 0.03
"""Time after which half of a predicted travel is expected to be reversed, s. A tool that has met a
surface, for example, bounces and is held by the coupling. (Without this, the predicted travel at
contact in the virtual rig is twice the real one.)
"""

PERSISTING: float = 8e-3
LASTING: float = 16e-3
"""Time for which an input must have kept its sign to be expected to persist, and for how long it
then is, s. A tool that rotates relative to gravity, or is hit by something soft, needs more travel
than its past shows, and late attenuation is harmful; a landing tool bounces within 8 ms."""

TRAVEL_SETTLING: float = 0.1
"""Time for which travel persists after its force, s: five times 2 m_a / b_s (Table I)."""

PREDICTION_RATE: float = 500.0
"""Maximum rate of the prediction, Hz; travel contains little above 100 Hz."""

ATTACK: float = 1.5e-3
"""Time constant of the attenuation, s: users would feel a step of force; late attenuation is
useless."""

RELEASE: float = 0.5
"""Time constant of the return of low frequencies, s: a few periods."""

EXCURSION_FADING: float = 0.06
"""Duration of the crossfade to other taps, s. Two filters differ most in the force for the slow
motion of the hand, up to some 3 Hz; a faster change of that force would be perceptible."""

BLOCKS: int = 8
"""Number of response lengths in the buffer, so that it is rarely moved."""

BEGINNING: float = 3.0
"""Initial position in the bank, 7.5 Hz: while the input's past is unknown, motion of the hand at 1
to 4 Hz must not use up the travel."""

CREST: float = 1.5
"""Crest factor, peak over root mean square, that is assumed for any travel: a sine has 1.41."""

CREST_MEMORY: float = 0.7
"""Time constant of that mean square, s: a few periods of a hand's to-and-fro motion. Otherwise low
frequencies return between two reversals of the hand, and the change of the slow force is
perceptible."""


class SampleFilter:
    """One or two second-order sections, transposed direct form II.

    Parameters
    ----------
    sections : ndarray, shape (1, 6) or (2, 6)
        Rows b0 b1 b2 a0 a1 a2 with a0 = 1, as in `scipy.signal`.
    """

    # Plain floats: for single samples ten times faster than scipy.signal.sosfilt, with equal
    # results. Attributes are faster than a list.

    def __init__(self, sections: FloatMatrix) -> None:
        rows = [[float(each) for each in row] for row in sections]
        rows.append([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])  # no filtering
        self.b0 = self.b1 = self.b2 = self.a1 = self.a2 = 0.0
        self.d0 = self.d1 = self.d2 = self.c1 = self.c2 = 0.0
        self.b0, self.b1, self.b2, _, self.a1, self.a2 = rows[0]
        self.d0, self.d1, self.d2, _, self.c1, self.c2 = rows[1]
        self.first = self.second = self.third = self.fourth = 0.0

    def process(self, value: float) -> float:
        """Filter one sample."""
        middle = self.b0 * value + self.first
        self.first = self.b1 * value - self.a1 * middle + self.second
        self.second = self.b2 * value - self.a2 * middle
        output = self.d0 * middle + self.third
        self.third = self.d1 * middle - self.c1 * output + self.fourth
        self.fourth = self.d2 * middle - self.c2 * output
        return output

    def reset(self) -> None:
        """Reset the state to that for zero past input."""
        self.first = self.second = self.third = self.fourth = 0.0


class SampleWindow:
    """Latest samples of a signal in contiguous memory, newest first.

    Parameters
    ----------
    length : int
        Number of samples; at least one.

    Attributes
    ----------
    past : ndarray
        Memory of the samples.
    """

    # The memory is filled from its end to its beginning; then the samples that are still needed
    # are moved to its end. The latest samples are thus always contiguous, and most are written
    # once.

    def __init__(self, length: int) -> None:
        import numpy as np

        self.length, self.newest = length, length
        self.past: FloatArray = np.zeros(2 * length)

    def push(self, value: float) -> int:
        """Add a sample; return its index in the memory, where older samples follow."""
        newest: int = self.newest - 1
        if newest < 0:
            newest = self.length
            self.past[newest + 1 :] = self.past[: newest - 1]
        self.past[newest] = value
        self.newest = newest
        return newest

    def reset(self) -> None:
        """Set all samples to zero."""
        self.past[:] = 0.0


class SampleConvolution(SampleWindow):
    """Running sum of taps times the latest samples.

    Parameters
    ----------
    taps : ndarray, shape (n,)
        Impulse response; at least one.
    """

    def __init__(self, taps: FloatArray) -> None:
        super().__init__(len(taps))
        self.taps: FloatArray = taps.copy()
        self.products: FloatArray = taps.copy()

    def process(self, value: float) -> float:
        """Filter one sample."""
        return dot(self.taps, self.past, self.push(value), self.products)


class VectorConvolution:
    """Running sum of matrix taps times the latest vectors.

    Parameters
    ----------
    taps : ndarray, shape (3, 3, n)
        Impulse responses; the first index is that of the output.

    Attributes
    ----------
    x, y, z : float
        Output of the last sample.
    """

    # Filled like `SampleWindow`.

    def __init__(self, taps: FloatArray) -> None:
        import numpy as np

        self.length: int = 3 * taps.shape[2]
        rows = taps.transpose(0, 2, 1).reshape(3, self.length)
        self.taps: FloatMatrix = np.ascontiguousarray(rows)
        self.products: FloatMatrix = np.empty((3, self.length))
        self.sums: FloatArray = np.empty(3)
        self.past: FloatArray = np.zeros(2 * self.length)
        self.newest: int = self.length
        self.x = self.y = self.z = 0.0

    def process(self, x: float, y: float, z: float) -> None:
        """Filter one sample."""
        newest: int = self.newest - 3
        past = self.past
        if newest < 0:
            newest = self.length
            past[newest + 3 :] = past[: newest - 3]
        past[newest] = x
        past[newest + 1] = y
        past[newest + 2] = z
        self.newest = newest
        sums = self.sums
        dots(self.taps, past, newest, self.products, sums)
        self.x = float(sums[0])
        self.y = float(sums[1])
        self.z = float(sums[2])

    def fill(self, x: float, y: float, z: float) -> None:
        """Assume a constant past input."""
        self.past[0::3] = x
        self.past[1::3] = y
        self.past[2::3] = z
        self.newest = self.length


class TravelPredictor:
    """Maximum travel of each member of a bank in the next `HORIZON`.

    The prediction assumes that each member has always been in use, and that the input is zero from
    now on. If the input has kept its sign for `PERSISTING`, its smallest magnitude in that time is
    expected to persist for `LASTING` instead. Later travel has a smaller weight (`REVERSION`).

    Parameters
    ----------
    suspension : Suspension
        Parameters of the actuator.
    rate : float
        Samples per second. Above `PREDICTION_RATE` the prediction uses means of several samples.
    """

    # Travels are stored in one row, by time and then by member: the effect of an input is
    # contiguous.

    def __init__(self, suspension: Suspension, rate: float) -> None:
        import numpy as np

        self.every: int = max(1, round(rate / PREDICTION_RATE))
        step = self.every / rate
        self.horizon: int = max(1, round(HORIZON / step))
        self.lasting: int = max(1, round(LASTING / step))
        estimator = TravelEstimator(suspension, 1.0 / step)
        pulse = [1.0] + [0.0] * (max(2, round(TRAVEL_SETTLING / step)) - 1)
        self.per_force = np.array([estimator.observe(each, 0.0) for each in pulse])
        self.size, self.spectrum = 0, self.per_force
        later = np.arange(self.horizon) * (step / REVERSION)
        self.kept: FloatArray = np.asarray(1.0 / (1.0 + later))
        self.latest = [0.0] * max(1, round(PERSISTING / step))

    def expect(self, forces: Any) -> None:
        """Set the response of each member; the predicted travel remains.

        Parameters
        ----------
        forces : ndarray, shape (k, n)
            Force plus the effect of the handle's acceleration after a unit sample, N. The shape
            must not change.
        """
        import numpy as np

        count, length = forces.shape
        spare = -length % self.every
        if spare:
            forces = np.pad(forces, ((0, 0), (0, spare)))
        held = forces.reshape(count, -1, self.every).sum(axis=2)
        total = held.shape[1] + len(self.per_force) - 1
        size = 1 << total.bit_length()
        if size != self.size:
            self.size, self.spectrum = size, np.fft.rfft(self.per_force, size)
        spectrum = np.fft.rfft(held, size) * self.spectrum
        travels = np.ascontiguousarray(np.fft.irfft(spectrum, size)[:, :total].T)
        self.members: int = count
        self.responses: FloatMatrix = travels.reshape(1, -1)
        self.products: FloatArray = np.empty(travels.size)
        lasting = np.cumsum(travels[: self.horizon - 1], axis=0)
        lasting[self.lasting :] -= lasting[: -self.lasting].copy()
        self.held: FloatArray = np.concatenate([np.zeros((1, count)), lasting]).ravel()

    def reset(self) -> None:
        """Clear the past."""
        import numpy as np

        members, length = self.members, len(self.products)
        ahead = self.horizon * members
        self.ahead: FloatArray = np.zeros(BLOCKS * length + ahead)
        self.last: int = BLOCKS * length + ahead - max(length, ahead)
        self.start = self.count = 0
        self.sum = self.persisting = 0.0
        self.latest = [0.0] * len(self.latest)

    def observe(self, value: float) -> bool:
        """Add a sample of the members' input; return True if the prediction has advanced."""
        self.sum += value
        self.count += 1
        if self.count < self.every:
            return False
        value = self.sum / self.every
        self.sum = 0.0
        self.count = 0
        self.start += self.members
        if self.start > self.last:
            left: int = len(self.ahead) - self.start
            self.ahead[:left] = self.ahead[self.start :].copy()
            self.ahead[left:] = 0.0
            self.start = 0
        add_scaled(self.responses, 0, value, self.ahead, self.start, self.products)
        # The input is expected to last only if it persists.
        self.latest.append(value)
        self.latest.pop(0)
        least: float = min(self.latest)
        self.persisting = least if least > 0.0 else min(0.0, max(self.latest))
        return True

    def largest(self, member: int) -> float:
        """Return the largest travel of a member, m."""
        start: int = self.start + member
        held = self.held[member:]
        return peak(self.ahead, start, self.members, held, self.persisting, self.kept)


class ExcursionControl:
    """Selection among inverses with increasing attenuation of low frequencies.

    As in loudspeaker amplifiers (Klippel, J. Audio Eng. Soc. 40, 1992), the travel of the next
    tens of milliseconds is predicted. The first member of the bank within the limit is used, or a
    weighted mean of two members. Attenuation increases at once, so that it is effective at
    contact, and decreases slowly.

    Parameters
    ----------
    taps, motion : ndarray, shape (k, n)
        Inverses from most to least travel, see `InverseBank`.
    coil : Suspension
        Parameters of the actuator.
    limit : float
        Maximum travel, m.
    rate : float
        Samples per second.

    Attributes
    ----------
    taps : ndarray, shape (k, n)
        Present taps of the members, N per m/s^2.
    position : float
        Member in use, from 0 for the first to k - 1 for the last.
    """

    def __init__(
        self, taps: FloatMatrix, motion: FloatMatrix, coil: Suspension, limit: float, rate: float
    ) -> None:
        self.predictor = TravelPredictor(coil, rate)
        self.limit: float = limit
        self.attack = -math.expm1(-1.0 / (ATTACK * rate))
        self.release = -math.expm1(-1.0 / (RELEASE * min(rate, PREDICTION_RATE)))
        self.forgetting = -math.expm1(-1.0 / (CREST_MEMORY * min(rate, PREDICTION_RATE)))
        # Both inputs move the actuator: m_a d'' + b_s d' + k_s d = -f_a - m_a a_h.
        self.following = coil.m_a * motion
        self.fading: int = max(1, round(EXCURSION_FADING * rate))
        self.restart(taps)

    def replace(self, taps: Any) -> None:
        """Crossfade to other taps of the members over `EXCURSION_FADING`.

        The prediction uses the new taps at once. A running crossfade stops at its present mixture.

        Parameters
        ----------
        taps : ndarray, shape (k, n)
        """
        import numpy as np

        self.slope: FloatMatrix = (taps - np.asarray(self.taps)) / self.fading
        self.left = self.fading
        self.predictor.expect(taps + self.following)

    def restart(self, taps: Any) -> None:
        """Clear the past, and use these taps of the members, shape (k, n)."""
        self.taps: FloatMatrix = taps.copy()
        self.members, length = taps.shape
        self.products: FloatArray = taps[0].copy()
        self.window = SampleWindow(length)
        self.left = 0  # samples until the crossfade to other taps ends
        self.predictor.expect(taps + self.following)
        self.predictor.reset()
        self.position = self.target = min(BEGINNING, self.members - 1.0)
        self.squares = [0.0] * self.members

    def process(self, value: float) -> float:
        """Process one sample of the members' input; return the force, N."""
        if self.left:
            self.left -= 1
            add_rows(self.slope, self.taps)
        if self.predictor.observe(value):
            self.choose()
        newest: int = self.window.push(value)
        position = self.position
        missing = self.target - position
        if missing != 0.0:
            position = position + self.attack * missing
            if math.fabs(missing) <= SETTLED:
                position = self.target
            self.position = position
        member: int = int(position)
        share = position - member
        past = self.window.past
        force = row_dot(self.taps, member, past, newest, self.products)
        if share != 0.0:
            more = row_dot(self.taps, member + 1, past, newest, self.products)
            force += share * (more - force)
        return force

    def choose(self) -> None:
        """Move the target at once to a member with less travel if needed, and back slowly."""
        needed = self.needed()
        if needed > self.target:
            self.target = needed
        elif self.target != 0.0:
            self.target += self.release * (needed - self.target)
            if self.target < SETTLED:
                self.target = 0.0

    def needed(self) -> float:
        """Return the first index whose interpolated travel is within the limit, or the last."""
        limit, squares, ahead = self.limit, self.squares, self.predictor.ahead
        for member in range(self.members):
            travel: float = ahead[self.predictor.start + member]
            squares[member] += self.forgetting * (travel * travel - squares[member])
        before: float = 0.0
        for member in range(self.members):
            after: float = max(self.predictor.largest(member), CREST * math.sqrt(squares[member]))
            if after <= limit:
                share: float = (limit - after) / (before - after) if member else 0.0
                return member - share
            before = after
        return float(self.members - 1)


class FrictionCompensation:
    """Compute the force that compensates dry friction, from a prediction of the slip.

    Friction acts between actuator and handle, like the actuator's force. A force f and friction mu
    against the slip v together act as a force f + mu sign(v). The slip is predicted from eq. (1)
    of the paper, assuming that the handle follows the desired acceleration with a delay.

    Parameters
    ----------
    suspension : Suspension
        Parameters of actuator or handle.
    friction : float
        Dry friction, N.
    rate : float
        Samples per second.
    lag : float
        Delay of the handle behind the desired motion when the force acts, in samples. A negative
        delay would need future samples and counts as zero.
    """

    def __init__(
        self, suspension: Suspension, friction: float, rate: float, lag: float = 0.0
    ) -> None:
        whole = int(max(0.0, lag))
        self.friction: float = friction
        self.share: float = max(0.0, lag) - whole
        self.desired = [0.0] * (whole + 2)
        self.slip: TravelEstimator = TravelEstimator(suspension, rate)

    def force(self, actuator_force: float, desired_acceleration: float) -> float:
        """Return the force to add until the next sample, N.

        Parameters
        ----------
        actuator_force : float
            Required actuator force without friction, N.
        desired_acceleration : float
            Latest desired handle acceleration, m/s^2.
        """
        if self.friction == 0.0:
            return 0.0
        desired, slip = self.desired, self.slip
        desired.append(desired_acceleration)
        desired.pop(0)
        earlier: float = desired[0]
        later: float = desired[1]
        before = slip.velocity
        slip.observe(actuator_force, later + self.share * (earlier - later))
        # Mean over the sample, within which the force is constant.
        return -self.friction * math.tanh((before + slip.velocity) / 2 / SLIP_VELOCITY)

    def reset(self) -> None:
        """Return to an actuator at rest in the middle of its travel."""
        self.slip.reset()
        self.desired = [0.0] * len(self.desired)


class Force:
    """Force of one coil for a desired acceleration: a controller's part in each sample."""

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Process a sample of desired and measured handle acceleration; return the force, N."""
        return 0.0

    def applied(self, actuator_force: float) -> None:
        """Receive the force, N, finally sent at this sample: limited, or another controller's."""

    def reset(self) -> None:
        """Return to the state for zero past input."""


class ConstantForce(Force):
    """Force proportional to the desired acceleration.

    Parameters
    ----------
    mass : float
        Factor, kg.
    """

    def __init__(self, mass: float) -> None:
        self.mass: float = mass

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return mass times desired acceleration."""
        return self.mass * desired_acceleration


class FilterForce(Force):
    """Force by a filter of the desired acceleration.

    Parameters
    ----------
    sections : ndarray, shape (n, 6)
        Filter from desired acceleration to force, as for `SampleFilter`.
    """

    def __init__(self, sections: FloatMatrix) -> None:
        self.filter: SampleFilter = SampleFilter(sections)

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force that makes the model accelerate as desired."""
        return self.filter.process(desired_acceleration)

    def reset(self) -> None:
        """Reset the filter."""
        self.filter.reset()


class InverseForce(Force):
    """Extension of the high-pass, bank of inverses, and compensation of dry friction.

    Parameters
    ----------
    sections : ndarray, shape (n, 6)
        Extension.
    excursion : ExcursionControl
    friction : FrictionCompensation

    Attributes
    ----------
    friction_force : float
        Part of the last force that compensates dry friction, N.
    """

    def __init__(
        self, sections: FloatMatrix, excursion: ExcursionControl, friction: FrictionCompensation
    ) -> None:
        self.extension = SampleFilter(sections)
        self.excursion, self.friction = excursion, friction
        self.friction_force = 0.0

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force for the desired acceleration."""
        return self.driven(self.extension.process(desired_acceleration), desired_acceleration)

    def driven(self, extended: float, desired_acceleration: float) -> float:
        """Return the force for the desired acceleration after and before the extension."""
        force = self.excursion.process(extended)
        self.friction_force = self.friction.force(force, desired_acceleration)
        return force + self.friction_force


class AdaptiveForce(InverseForce):
    """Force of an adaptive inverse.

    Attributes
    ----------
    trace : Trace
        Samples for the adaptation.
    sent : float
        Last force that drives the handle, N.
    """

    trace: Trace
    sent: float

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force for the desired acceleration."""
        extended = self.extension.process(desired_acceleration)
        # The force applied one sample ago, and the acceleration measured then.
        self.trace.push(desired_acceleration, measured_acceleration, self.sent, extended)
        return self.driven(extended, desired_acceleration)

    def applied(self, actuator_force: float) -> None:
        """Store the force that drives the handle: applied force minus friction compensation."""
        self.sent = actuator_force - self.friction_force


class FeedbackForce(Force):
    """Feedforward force plus a filtered deviation of the handle from a reference.

    Parameters
    ----------
    feedforward : Force
    foreseen : bool
        True if the reference is the model's response, False if it is the desired acceleration.
    delay : int
        Delay of the reference, in samples.
    fade : float
        Change of the feedback's share per sample while it fades.
    regained : int
        Number of valid samples after which the feedback is faded in again.

    Attributes
    ----------
    high_pass : SampleFilter
        Filter of the deviation.
    model : SampleConvolution
        Impulse response of the handle.
    answer : SampleConvolution
        Impulse response from filtered deviation to force.
    """

    high_pass: SampleFilter
    model: SampleConvolution
    answer: SampleConvolution

    def __init__(
        self, feedforward: Force, foreseen: bool, delay: int, fade: float, regained: int
    ) -> None:
        self.feedforward: Force = feedforward
        self.inverse: InverseForce | None = None
        if isinstance(feedforward, InverseForce):
            self.inverse = feedforward
        self.foreseen, self.fade, self.regained = foreseen, fade, regained
        self.desired = [0.0] * delay
        self.begin()

    def begin(self) -> None:
        """Assume a model at rest, and valid handle samples."""
        self.desired = [0.0] * len(self.desired)
        self.gaps = 0
        # Acceleration of the model at the last tick, latest known deviation, and first deviation,
        # which includes gravity, m/s^2.
        self.expected, self.surprise, self.first = 0.0, 0.0, UNKNOWN
        # Force whose effect the reference includes, and remaining part of the last force, N.
        self.known = self.surplus = 0.0
        self.share = 1.0
        self.valid: int = self.regained  # samples without a gap
        self.distrusted = False  # True after saturation of the sensor

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the sum of feedforward and feedback force."""
        force = self.feedforward.force(desired_acceleration, measured_acceleration)
        # Without latency, the force of the last tick affects this tick's sample, which is received
        # at the next tick. The model's first values are zero for the latency.
        expected = self.expected
        self.expected = self.model.process(self.surplus)
        if not self.foreseen:
            self.desired.append(desired_acceleration)
            expected += self.desired.pop(0)
        surprise = expected - measured_acceleration
        if math.isfinite(surprise):
            if math.isnan(self.first):
                self.first = surprise
            self.surprise = surprise - self.first
            self.valid += 1
        else:
            if self.valid >= self.regained:
                self.gaps += 1
            self.valid = 0
            if math.isinf(measured_acceleration):
                self.distrusted = True
        if self.valid >= self.regained and not self.distrusted:
            self.share = min(1.0, self.share + self.fade)
        else:
            self.share = max(0.0, self.share - self.fade)
        self.known = 0.0 if self.foreseen else force
        force += self.share * self.answer.process(self.high_pass.process(self.surprise))
        self.applied(force)
        return force

    def applied(self, actuator_force: float) -> None:
        """Pass the force finally sent, minus friction compensation, to the model."""
        friction = 0.0
        if self.inverse is not None:
            friction = self.inverse.friction_force
        self.surplus = actuator_force - friction - self.known

    def reset(self) -> None:
        """Reset all filters, and assume valid handle samples."""
        self.feedforward.reset()
        self.high_pass.reset()
        self.model.reset()
        self.answer.reset()
        self.begin()


class ForceFraction:
    """Fraction of the controllers' forces in use.

    The subclass `Authority` determines it.

    Attributes
    ----------
    used : float
        Factor of the forces.
    left_over : float
        Smallest fraction that the actuator's limits left of a force since the last update.
    """

    traces: list[Trace]

    def __init__(self) -> None:
        self.used = self.left_over = 1.0


class InputReduction:
    """Reduction of the tool's three axes to one.

    The subclass `ReductionSwitch` determines it.

    Attributes
    ----------
    idle : bool
        True while the axes are not changed.
    reduces : bool
        True if a reduction is in use, or is prepared.
    alone : float
        Share of driving the coil along z alone: 1 with a reduction, 0 without, between in a
        crossfade.
    """

    def __init__(self) -> None:
        self.idle, self.reduces, self.alone = True, False, 0.0

    def process(self, tool: Vector) -> Vector:
        """Return the input of the coils for a sample of the tool, m/s^2."""
        return tool


class Substitution:
    """Share of a controller's force in use, and the additional force of `dynamic`.

    The subclass `Fallback` determines both.

    Parameters
    ----------
    dynamic : Force
        Controller that may take over.
    step : float
        Change of the shares per sample in a crossfade.
    settling : int
        Number of samples after which the filters of `dynamic` have settled.

    Attributes
    ----------
    requested : float
        Force that the controller requested at the last sample, N.
    hushed : bool
        True while the force has to be zero, also that of a substitute.
    """

    authority: ForceFraction

    def __init__(self, dynamic: Force, step: float, settling: int) -> None:
        self.dynamic: Force = dynamic
        self.step, self.pace, self.settling = step, step, settling
        self.reducible = self.hushed = False
        self.substitute = ""  # name of the substitute
        self.share = 1.0  # share of the controller's force
        self.gain = 0.0  # share of the force of `dynamic`
        self.probing = False  # a part of the controller's force is tried
        self.part = self.requested = 0.0
        self.running = 0  # number of samples that `dynamic` has processed

    def force(self, desired_acceleration: float, requested: float) -> float:
        """Return the force to send instead of the controller's force, N."""
        if self.reducible:
            requested *= self.authority.used
        self.requested = requested
        if self.share == 1.0 and self.gain == 0.0 and not (self.substitute or self.hushed):
            return requested
        self.running += 1
        substituted = self.dynamic.force(desired_acceleration, UNKNOWN)
        share, gain = 1.0, 0.0
        if self.substitute:
            share = self.part if self.probing else 0.0
            gain = 1.0 if self.substitute == DYNAMIC and self.running > self.settling else 0.0
        pace = self.pace
        if self.hushed:
            share, gain, pace = 0.0, 0.0, self.step
        self.share += min(max(share - self.share, -pace), pace)
        self.gain += min(max(gain - self.gain, -pace), pace)
        return self.share * requested + self.gain * substituted


class Stage:
    """Controller with its own high-pass, both started at the same time.

    For a filter with zero state, an earlier constant acceleration is a step. An inverse, which
    extends the high-pass to far lower frequencies, responds to a step with several newtons for
    seconds.

    Parameters
    ----------
    name : str
    controller : Force
    high_pass : SampleFilter
    cancels : SampleFilter, optional
        Filter from the arm's force on the handle to the negated force that cancels it.

    Attributes
    ----------
    rest : float
        Tool's acceleration at rest, mostly gravity, m/s^2.
    desired : float
        Desired acceleration of the last sample, m/s^2.
    cancelling : float
        Part of the last force that cancels a part of the arm's, N.
    """

    def __init__(
        self, name: str, controller: Force, high_pass: SampleFilter, cancels: SampleFilter | None
    ) -> None:
        self.name, self.controller = name, controller
        self.high_pass, self.cancellation = high_pass, cancels
        self.rest = self.desired = self.own = self.cancelling = 0.0

    def process(self, tool: float, measured: float, gain: float, pushed: float) -> float:
        """Return the controller's force, multiplied by the gain.

        The force that cancels a part of the arm's is independent of the desired acceleration: a
        gain above 1 does not increase it. A smaller gain reduces it, so that a gain of 0 leaves no
        force.

        Parameters
        ----------
        tool : float
            Tool acceleration, m/s^2.
        measured : float
            Handle acceleration as it would be at a gain of 1, m/s^2.
        gain : float
        pushed : float
            Part of the arm's force on the handle that is to be cancelled, N.
        """
        desired = self.high_pass.process(tool - self.rest)
        self.desired = gain * desired
        own = self.controller.force(desired, measured)
        self.own = own
        if self.cancellation is None:
            return gain * own
        self.cancelling = min(1.0, gain) * -self.cancellation.process(pushed)
        return gain * own + self.cancelling

    def applied(self, force: float, gain: float) -> None:
        """Pass the force that drives the handle to the controller, converted to a gain of 1."""
        self.controller.applied(force / gain if gain != 0.0 else self.own)

    def reset(self) -> None:
        """Return to the state for zero past input."""
        self.rest = self.cancelling = 0.0
        self.high_pass.reset()
        self.controller.reset()
        if self.cancellation is not None:
            self.cancellation.reset()


class CoilChannel:
    """Force of one coil: its controller, the change to another one, and the gain.

    The subclass `Channel` selects the controllers.

    Parameters
    ----------
    active : Stage
    substitution : Substitution
    trace : Trace
        Samples for supervision and learning.
    guard : ActuatorGuard

    Attributes
    ----------
    gain : float
        Factor of the desired acceleration.
    resting : float
        Weight of a new sample in the mean accelerations.
    listening, fading : int
        Number of samples that a new controller only receives, and of the following crossfade.
    asleep : bool
        True in the idle state, and after a force was not finite: filters with an infinite state
        never recover without a reset.
    tool, measured, handle, pushed : float
        Input of a sample: plausible tool acceleration; handle acceleration along this coil, NaN if
        missing, infinite if saturated; last known handle acceleration, for the limits, m/s^2; part
        of the arm's force on the handle that is to be cancelled, N.
    desired : float
        Desired acceleration, m/s^2. The guard holds the force: requested, and allowed within
        limits.
    withheld : int
        Number of forces that were not computed, or faded in, because the device applied none.
    """

    def __init__(
        self, active: Stage, substitution: Substitution, trace: Trace, guard: ActuatorGuard
    ) -> None:
        self.active, self.substitution = active, substitution
        self.trace, self.guard = trace, guard
        self.follower: Stage | None = None
        self.gain, self.gain_target, self.gain_step = 1.0, 1.0, 0.0
        self.gain_left = 0  # samples until the gain is reached
        self.listening = self.fading = self.listened = self.withheld = 0
        self.asleep, self.muted = True, False
        self.share = 1.0  # share of the force, after the device applied none
        self.resting, self.rest = 0.0, 0.0  # mean tool acceleration, m/s^2
        self.upright = UNKNOWN  # mean handle acceleration, mostly gravity, m/s^2
        self.tool = self.measured = self.handle = self.pushed = 0.0
        self.desired = 0.0

    def request(self) -> None:
        """Compute desired acceleration and force before the actuator's limits; see `settle`."""
        if self.gain_left:
            self.gain_left -= 1
            self.gain = self.gain_target - self.gain_left * self.gain_step
        gain = self.gain
        tool = self.tool
        measured = self.measured
        if math.isfinite(measured):
            upright = measured if math.isnan(self.upright) else self.upright
            self.upright = upright + self.resting * (measured - upright)
        # Controllers compute the force for a gain of 1, so that a change of the gain does not
        # excite them: the product of a changing gain and the desired acceleration has slow
        # components, which an inverse follows up to the actuator's stops.
        if gain == 0.0 or self.gain_left:
            measured = UNKNOWN
        elif gain != 1.0:
            measured = self.upright + (measured - self.upright) / gain
        active: Stage = self.active
        force = active.process(tool, measured, gain, self.pushed)
        desired = active.desired
        self.rest += self.resting * (tool - self.rest)
        if self.follower is not None:
            force = self.crossfaded(force, measured)
            desired = self.active.desired
        if not (math.isfinite(desired) and math.isfinite(force)):
            self.asleep = True
            desired = force = 0.0
        self.desired = desired
        force = self.substitution.force(desired, force)
        if self.muted:
            self.share = 0.0
        elif self.share < 1.0:
            self.share = min(1.0, self.share + 1.0 / self.fading)
        if self.share < 1.0:
            self.withheld += 1
        self.guard.requested = self.share * force

    def crossfaded(self, force: float, measured: float) -> float:
        """Return the force during a crossfade to the follower, which is active afterwards.

        Parameters
        ----------
        force : float
            Force of the active controller, N.
        measured : float
            Handle acceleration as it would be at a gain of 1, m/s^2.
        """
        follower = self.follower
        assert follower is not None
        if not self.listened:
            follower.rest = self.rest
        following = follower.process(self.tool, measured, self.gain, self.pushed)
        self.listened += 1
        share = (self.listened - self.listening) / self.fading
        if share >= 1.0:
            self.take_over(follower)
            return following
        return force + max(0.0, share) * (following - force)

    def take_over(self, stage: Stage) -> None:
        """Use another controller from now on."""

    def settle(self) -> None:
        """Finish a sample with the force that is finally sent."""
        force = self.guard.allowed
        active: Stage = self.active
        substitution: Substitution = self.substitution
        if active.cancellation is not None:
            # The handle responds neither to that part of the arm's force nor to the force that
            # cancels it.
            used = substitution.share * substitution.authority.used
            force -= self.share * used * active.cancelling
        active.applied(force, self.gain)
        if self.follower is not None:
            self.follower.applied(force, self.gain)
        self.trace.push(self.desired, self.measured, force, substitution.requested)


class HandleCompensation:
    """Desired acceleration of a handle and the forces of its coils, for a sample of the tool.

    The subclass `Compensation` builds it, and does all work that is not due in every sample.

    Parameters
    ----------
    coils : list of CoilChannel
        One coil along z, or three coils along x, y and z.
    sections : ndarray, shape (n, 6)
        High-pass of the desired acceleration of three axes.
    handle_range : float
        Maximum acceleration for which the handle's accelerometer is not saturated, m/s^2.
    patience : int
        Number of successive equal samples along z, while a force acts, from which on the handle's
        accelerometer counts as stuck, and its samples as missing. Otherwise a controller would
        learn that the handle does not respond, and request several newtons.

    Attributes
    ----------
    desired_x, desired_y, desired_z : float
        Desired acceleration of the last sample, m/s^2: high-passed tool acceleration times the
        gain; also with a reduction, in all axes of the handle.
    force_x, force_y, force_z : float
        Force of each coil within its limits, N; always finite.
    count_x, count_y, count_z : float
        Part of the arm's force on the handle that is caused by its encoders' rounding, N; due with
        the coils' forces of the next sample.
    rejected : int
        Number of tool samples with a component in use that was not finite or not plausible; they
        count as zero.
    untrusted : int
        Number of handle samples that were missing, or in any component saturated, not finite or
        not plausible.
    due : int
        Count of samples, see `Trace`, at which `adapt` of the subclass next has something to do.
    """

    authority: ForceFraction
    switch: InputReduction
    tool_decoupling: VectorConvolution
    handle_decoupling: VectorConvolution

    def __init__(
        self, coils: list[CoilChannel], sections: FloatMatrix, handle_range: float, patience: int
    ) -> None:
        self.coils = coils
        self.first: CoilChannel = coils[0]
        self.z: CoilChannel = coils[len(coils) - 1]
        self.single = len(coils) == 1
        self.high_passes = [SampleFilter(sections) for _ in coils]
        self.handle_range, self.patience = handle_range, patience
        self.equal = 0  # number of successive equal samples of the handle
        self.judged_alone = False  # only the coil along z, of several
        self.desired_x = self.desired_y = self.desired_z = 0.0
        self.force_x = self.force_y = self.force_z = 0.0
        self.count_x = self.count_y = self.count_z = 0.0
        self.rejected = self.untrusted = self.due = 0
        # First samples since the start; the tool's is mostly gravity.
        self.has_tool = self.has_handle = False
        self.tool_x = self.tool_y = self.tool_z = 0.0
        self.handle_x = self.handle_y = self.handle_z = 0.0
        self.has_seen = False  # True after a trusted sample of the handle

    def compute(
        self, t_x: float, t_y: float, t_z: float, known: bool, h_x: float, h_y: float, h_z: float
    ) -> None:
        """Process one sample of tool and handle acceleration.

        Parameters
        ----------
        t_x, t_y, t_z : float
            Measured tool acceleration, m/s^2. If a component in use is not finite or exceeds
            `LARGEST_ACCELERATION`, all components count as zero. Otherwise one bad sample could
            corrupt the filters or keep the actuator at its limit for seconds.
        known : bool
            False if the handle's sample is missing.
        h_x, h_y, h_z : float
            Handle acceleration of the previous sample, m/s^2, as the present sample may not have
            arrived.
        """
        channel: CoilChannel
        guard: ActuatorGuard
        single: bool = self.single
        # A tool with a single axis may send any values along the others.
        across = is_within(t_x, t_y, 0.0, LARGEST_ACCELERATION)
        if not (across or (single and not self.switch.reduces)) or not (
            math.fabs(t_z) <= LARGEST_ACCELERATION  # also false for NaN
        ):
            self.rejected += 1
            t_x = t_y = t_z = 0.0
        if single:
            h_x = h_y = 0.0
        first: CoilChannel = self.first
        if first.asleep and self.is_still(t_x, t_y, t_z, known, h_x, h_y, h_z):
            self.clear()
            return
        self.take_handle(known, h_x, h_y, h_z)
        self.take_tool(t_x, t_y, t_z)
        for channel in self.coils:
            channel.request()
            if channel.asleep:  # its controller was unstable
                self.reset()
                self.clear()
                return
        self.desired_z = first.desired
        if not single:
            self.desire(t_x, t_y, t_z)
        limited: bool = False
        for channel in self.coils:
            guard = channel.guard
            guard.allowed = guard.within(guard.requested, channel.handle)
            if guard.allowed != guard.requested:
                limited = True
        if limited:
            self.limit()
        for channel in self.coils:
            channel.guard.advance(channel.guard.allowed, channel.handle)
        if not single:
            if first.substitution.reducible:
                self.judge()
            self.force_x = first.guard.allowed
            self.force_y = self.coils[1].guard.allowed
        self.force_z = self.z.guard.allowed
        for channel in self.coils:
            channel.settle()

    def clear(self) -> None:
        """Set the results of a sample in the idle state."""
        self.desired_x = self.desired_y = self.desired_z = 0.0
        self.force_x = self.force_y = self.force_z = 0.0

    def reset(self) -> None:
        """Return to the initial state."""

    def wake(self) -> None:
        """End the idle state of the channels, for a tool at rest."""

    def is_still(
        self, t_x: float, t_y: float, t_z: float, known: bool, h_x: float, h_y: float, h_z: float
    ) -> bool:
        """Return True if all samples so far are equal; end the idle state if two differ."""
        if not self.has_tool:
            self.has_tool, self.tool_x, self.tool_y, self.tool_z = True, t_x, t_y, t_z
        if known and not self.has_handle:
            self.has_handle, self.handle_x, self.handle_y, self.handle_z = True, h_x, h_y, h_z
        moved: bool = t_z != self.tool_z
        if not self.single or self.switch.reduces:
            moved = moved or t_x != self.tool_x or t_y != self.tool_y
        if known and h_x + h_y + h_z == h_x + h_y + h_z:  # a sample with a NaN is ignored
            moved = moved or h_x != self.handle_x or h_y != self.handle_y or h_z != self.handle_z
        if moved:
            self.wake()
        return not moved

    def take_handle(self, known: bool, h_x: float, h_y: float, h_z: float) -> None:
        """Pass a sample of the handle to the channels: decoupled, and unchanged for the limits."""
        z: CoilChannel = self.z
        pushed: bool = self.force_z != 0.0 or self.force_x != 0.0 or self.force_y != 0.0
        self.equal = self.equal + 1 if known and pushed and h_z == z.handle else 0
        trusted: bool = known and is_within(h_x, h_y, h_z, self.handle_range)
        trusted = trusted and self.equal < self.patience
        replacement = UNKNOWN
        if trusted:
            z.handle = h_z
        else:
            self.untrusted += 1
            if known and self.equal == 0 and is_within(h_x, h_y, h_z, LARGEST_ACCELERATION):
                replacement = INFINITE
        if self.single:
            z.measured = h_z if trusted else replacement
            return
        x: CoilChannel = self.coils[0]
        y: CoilChannel = self.coils[1]
        seen: VectorConvolution = self.handle_decoupling
        if trusted:
            x.handle, y.handle = h_x, h_y
            if not self.has_seen:
                # For a decoupling filter with zero past, gravity is a step.
                self.has_seen = True
                seen.fill(h_x, h_y, h_z)
        # If the handle's acceleration is unknown, the last known one is used.
        seen.process(x.handle, y.handle, z.handle)
        x.measured, y.measured, z.measured = replacement, replacement, replacement
        if trusted:
            x.measured, y.measured, z.measured = seen.x, seen.y, seen.z

    def take_tool(self, t_x: float, t_y: float, t_z: float) -> None:
        """Pass a sample of the tool to the channels: decoupled, or reduced to one axis."""
        if not self.switch.idle:
            t_x, t_y, t_z = self.switch.process((t_x, t_y, t_z))
        elif not self.single:
            tool: VectorConvolution = self.tool_decoupling
            tool.process(t_x, t_y, t_z)
            t_x, t_y, t_z = tool.x, tool.y, tool.z
        self.z.tool, self.z.pushed = t_z, self.count_z
        if not self.single:
            self.coils[0].tool, self.coils[0].pushed = t_x, self.count_x
            self.coils[1].tool, self.coils[1].pushed = t_y, self.count_y

    def desire(self, t_x: float, t_y: float, t_z: float) -> None:
        """Set the desired acceleration of three axes, and the forces of the coils in use."""
        gain = self.first.gain  # the same for all axes
        x, y, z = self.high_passes
        self.desired_x = gain * x.process(t_x - self.tool_x)
        self.desired_y = gain * y.process(t_y - self.tool_y)
        self.desired_z = gain * z.process(t_z - self.tool_z)
        others: float = 1.0 - self.switch.alone
        if others != 1.0:
            self.coils[0].guard.requested *= others
            self.coils[1].guard.requested *= others

    def limit(self) -> None:
        """Record that a limit acts, and keep the direction of the force of several coils."""
        channel: CoilChannel
        requested = allowed = 0.0
        for channel in self.coils:
            channel.trace.limited = channel.trace.count
            requested = max(requested, math.fabs(channel.guard.requested))
            allowed = max(allowed, math.fabs(channel.guard.allowed))
        if requested != 0.0:  # otherwise a moving coil is braked
            self.authority.left_over = min(self.authority.left_over, allowed / requested)
        if not self.single:
            scale_within([each.guard for each in self.coils])
            for channel in self.coils:
                # Limit it again, for a coil that must be braked.
                channel.guard.allowed = channel.guard.within(channel.guard.allowed, channel.handle)

    def judge(self) -> None:
        """Pass desired and measured motion of the driven coils to the authority."""
        x: Trace = self.authority.traces[0]
        y: Trace = self.authority.traces[1]
        z: Trace = self.authority.traces[2]
        known: bool = math.isfinite(self.z.measured)
        moved: float = self.z.handle if known else UNKNOWN
        if self.judged_alone:
            # The desired motion of the coil along z is that of its own channel.
            x.push(0.0, 0.0, 0.0, 0.0)
            y.push(0.0, 0.0, 0.0, 0.0)
            z.push(self.z.desired, moved, 0.0, 0.0)
            return
        x.push(self.desired_x, self.coils[0].handle if known else UNKNOWN, 0.0, 0.0)
        y.push(self.desired_y, self.coils[1].handle if known else UNKNOWN, 0.0, 0.0)
        z.push(self.desired_z, moved, 0.0, 0.0)


def is_within(x: float, y: float, z: float, most: float) -> bool:
    """Return True if no component exceeds a limit or is NaN."""
    return math.fabs(x) <= most and math.fabs(y) <= most and math.fabs(z) <= most
