"""Online estimation of the user's grip from force and acceleration of the handle."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.inversion.convolution import SampleWindow
from haptic_accel.core.control.inversion.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import Checked, parameter

WINDOW = 0.5
"""Length of signal for one evaluation, s: some periods of the slowest mode of handle and grip."""

LOOKS = 4
"""Number of evaluations per window."""

THINNED_RATE = 1000.0
"""Rate to which faster signals are decimated for evaluation, Hz."""

MOST_MISSING = 0.02
"""Maximum fraction of missing samples in a window; they repeat the value before."""

LOWEST, HIGHEST = 15.0, 250.0
"""Frequency band of the estimate, Hz: above the hand's own motion, below the mount's mode."""

SMALLEST = np.array([0.4, 0.1, 0.05])
LARGEST = np.array([2.5, 6.0, 6.0])
"""Bounds of the estimate as factors of the assumed m_h, b_u and k_u: wider than hands vary."""

PULL = 1e-3
"""Weight of the assumed grip relative to the excitation: it decides what a texture of one
frequency leaves undetermined, as mass and stiffness cannot be distinguished there."""


@dataclass(frozen=True)
class AdaptationParameters(Checked):
    """Parameters of the grip estimator."""

    memory: float = parameter(
        0.4, "time constant of the estimate's forgetting, in excited time", "s", 0.05, 100.0
    )
    least_force: float = parameter(
        0.02,
        "minimum root mean square of the actuator's force within the band for an update",
        "N",
        0.0,
        10.0,
    )


class GripEstimator:
    """Recursive least squares for m_h, b_u and k_u, block by block.

    Eq. (2) of the paper is linear in them. With eq. (1) for the actuator, whose mass, spring and
    bearing are known, and everything between command and sample (hold, delay, mount, low-pass)
    as the ratio P/H of the plant assumed,
    m_a s^2/A F' - m_a (b_s s + k_s)/A A_h = (m_h + b_u/s + k_u/s^2) A_h,
    A = m_a s^2 + b_s s + k_s, F' = (P/H) F. All terms pass one zero-phase band-pass, in which
    integrations do no harm, and are compared behind it.

    A sample only stores two values; all else is done in pieces by `step`.

    Parameters
    ----------
    plant : Plant
        Assumed plant; the estimate starts with its grip.
    rate : float
        Samples per second.
    parameters : AdaptationParameters

    Attributes
    ----------
    grip : ndarray, shape (3,)
        Estimated m_h, b_u and k_u: kg, N s/m, N/m.
    looks : int
        Number of evaluations that updated the estimate.
    """

    def __init__(self, plant: Plant, rate: float, parameters: AdaptationParameters) -> None:
        handle = plant.handle
        self._assumed = np.array([handle.m_h, handle.b_u, handle.k_u])
        thinning = max(1, math.floor(rate / THINNED_RATE))
        self._thinned = 1 << max(6, round(math.log2(WINDOW * rate / thinning)))
        self._length = self._thinned * thinning
        self._hop = self._length // LOOKS
        self._kernels = _kernels(plant, rate, self._length, self._thinned)
        self._force, self._acceleration = SampleWindow(self._length), SampleWindow(self._length)
        self._kept = math.exp(-self._hop / rate / parameters.memory)
        self._least_force = parameters.least_force
        self._work: Iterator[bool] = iter(())
        # Missing samples in the part of the window that is being filled, and in those before.
        self._missing: deque[int] = deque(maxlen=LOOKS)
        self._last = 0.0
        self.reset()

    def sample(self, actuator_force: float, handle_acceleration: float) -> None:
        """Store force (N) and handle acceleration (m/s^2; NaN where unknown) of one sample."""
        if not math.isfinite(handle_acceleration):
            self._missing[-1] += 1
            handle_acceleration = self._last
        self._last = handle_acceleration
        self._force.push(actuator_force)
        self._acceleration.push(handle_acceleration)
        self._samples += 1
        if self._samples % self._hop:
            return
        if self._samples >= self._length and sum(self._missing) <= MOST_MISSING * self._length:
            self._work = self._look()
        self._missing.append(0)

    def step(self) -> bool:
        """Do a piece of the pending work; return True when there is a new estimate."""
        return next(self._work, False)

    def reset(self) -> None:
        """Return to the assumed grip."""
        self.grip = self._assumed.copy()
        self._information = np.zeros((3, 3))
        self._evidence = np.zeros(3)
        self._samples = self.looks = 0
        self._last = 0.0
        self._missing.clear()
        self._missing.append(0)
        self._work = iter(())
        self._force.reset()
        self._acceleration.reset()

    def _look(self) -> Iterator[bool]:
        """Evaluate the latest window; yield between pieces, at last True if it was updated."""
        lines = self._thinned // 2 + 1
        # Gravity is not part of the response, and would be cut off at the window's ends.
        measured = self._acceleration.latest()[::-1]
        measured = measured - measured.mean()
        scale = self._thinned / self._length
        force = np.fft.rfft(self._force.latest()[::-1])[:lines] * scale
        yield False
        acceleration = np.fft.rfft(measured)[:lines] * scale
        yield False
        shown = slice(-(self._thinned // LOOKS), None)  # what no look before has seen

        def passed(kernel: ComplexArray, spectrum: ComplexArray) -> FloatArray:
            return np.asarray(np.fft.irfft(kernel * spectrum)[shown])

        from_force = passed(self._kernels[0], force)
        yield False
        driven = from_force + passed(self._kernels[1], acceleration)
        yield False
        felt = np.empty((3, len(driven)))
        for index, kernel in enumerate(self._kernels[2:]):
            felt[index] = passed(kernel, acceleration) * self._assumed[index]
            yield False
        if float(np.sqrt(np.mean(from_force**2))) >= self._least_force:
            self._learn(felt, driven)
            yield True

    def _learn(self, felt: FloatArray, driven: FloatArray) -> None:
        """Solve for the grip as factors of the assumed one."""
        self._information = self._kept * self._information + felt @ felt.T
        self._evidence = self._kept * self._evidence + felt @ driven
        pull = PULL * float(np.trace(self._information))
        if pull < np.finfo(float).tiny:
            return  # the measured acceleration is zero, as without an accelerometer
        factors = np.linalg.solve(
            self._information + pull * np.eye(3), self._evidence + pull * np.ones(3)
        )
        self.grip = self._assumed * np.clip(factors, SMALLEST, LARGEST)
        self.looks += 1


def _kernels(plant: Plant, rate: float, length: int, thinned: int) -> ComplexArray:
    """Return the transfer functions of the regression's terms on the lines of a window.

    Impulse responses of half a window, so that the newest half of a circular convolution is that
    of the signal; they look as far ahead as back, by a quarter of a window.

    Returns
    -------
    ndarray, shape (5, thinned / 2 + 1)
        Those of the force, of the acceleration in eq. (1), then those of m_h, b_u and k_u.
    """
    fine = 8 * length
    frequency: FloatArray = np.fft.rfftfreq(fine, 1.0 / rate)[1:].astype(np.float64)
    highest = min(HIGHEST, 0.4 * rate * thinned / length)
    band = 1.0 / (1.0 + (LOWEST / frequency) ** 8) / (1.0 + (frequency / highest) ** 8)
    s = 2j * np.pi * frequency
    handle: HandleParameters = plant.handle
    bearing = handle.b_s * s + handle.k_s
    actuator = handle.m_a * s**2 + bearing
    chain = plant.response(frequency, rate) / handle_model(handle).response(frequency)
    responses = np.zeros((5, len(frequency) + 1), dtype=np.complex128)
    responses[:, 1:] = band * np.stack(
        [
            chain * handle.m_a * s**2 / actuator,
            -handle.m_a * bearing / actuator,
            np.ones_like(s),
            1.0 / s,
            1.0 / s**2,
        ]
    )
    half = length // 2
    sequences = np.roll(np.fft.irfft(responses, fine), half // 2, axis=1)[:, :half]
    # Faded out over an eighth at both ends, where little is left of them.
    fading = np.minimum(1.0, np.minimum(np.arange(half) + 1, np.arange(half, 0, -1)) / (half / 8))
    spectra = np.fft.rfft(sequences * fading, length)
    return np.asarray(spectra[:, : thinned // 2 + 1])
