"""The last seconds of the graph's signals, what is derived from them, and figures of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.control.filters import (
    HIGH_PASS_FREQUENCY,
    MOTION_SHARE,
    high_pass,
    without_hand_motion,
)
from haptic_accel.core.evaluation.metrics import (
    PAPER_DELAY,
    Evaluation,
    Spectra,
    evaluate,
    spectra,
)
from haptic_accel.core.sampling import NANOSECONDS

FloatArray = npt.NDArray[np.float64]
StampArray = npt.NDArray[np.int64]


LONGEST_WINDOW = 5.0
"""What a page can show, s."""

HIGHEST_RATE = 20e3
"""What fits, Hz."""

SLACK = 1.25
"""Room of a ring over its window, so that what is being read is not what is being overwritten."""

CAPACITY = int(LONGEST_WINDOW * HIGHEST_RATE * SLACK)
"""Samples of a ring."""

STATISTICS_WINDOW = 2.0
"""Over which figures are taken, s: two to four strokes of the hand."""

EDGE = 0.25
"""At each end of the window where the filter without phase is not used, s: it rings for a
period of its corner (5 Hz)."""

GAP = 0.5
"""Silence in the stamps, s, after which a signal counts as begun anew: nodes were restarted."""

HELD = 0.1
"""How long the last force counts, s; then its sender is silent and the device has let go."""

RATE_SAMPLES = 500
"""Samples that tell the rate."""

FEWEST = 50
"""Samples below which there is no rate, and no figures."""

CLOUD_POINTS = 800
"""Most points of the regression cloud: more are not told apart."""


class Ring:
    """The last samples of one signal.

    One thread puts, another reads. A sample is there before it is counted, and readers keep
    away from the oldest, which are next to be overwritten.

    Parameters
    ----------
    capacity : int
        Samples kept; readers get at most `capacity` / `SLACK` of them.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._stamps = np.zeros(capacity, np.int64)
        self._values = np.zeros(capacity)
        self._capacity = capacity
        self._readable = int(capacity / SLACK)
        self.count = 0
        """How many samples were ever put."""

    def put(self, stamp: int, value: float) -> None:
        """Add a sample, its stamp in ns."""
        place = self.count % self._capacity
        self._stamps[place] = stamp
        self._values[place] = value
        self.count += 1

    def extend(self, stamps: StampArray, values: FloatArray) -> None:
        """Add samples, the last of them where there are more than fit."""
        stamps, values = stamps[-self._capacity :], values[-self._capacity :]
        places = np.arange(self.count, self.count + len(stamps)) % self._capacity
        self._stamps[places] = stamps
        self._values[places] = values
        self.count += len(stamps)

    def since(self, count: int) -> tuple[int, StampArray, FloatArray]:
        """Return the samples behind the first `count`, the newest where many are.

        Returns
        -------
        tuple
            What to give as `count` the next time; stamps in ns and values, each of shape (n,).
        """
        end = self.count
        places = np.arange(max(count, end - self._readable, 0), end) % self._capacity
        return end, self._stamps[places], self._values[places]

    def last(self, seconds: float) -> tuple[StampArray, FloatArray]:
        """Return the samples of the last seconds before the newest stamp, in their order."""
        end = self.count
        if not end:
            return self._stamps[:0], self._values[:0]
        oldest = self._stamps[(end - 1) % self._capacity] - int(seconds * NANOSECONDS)
        _, stamps, values = self.since(0)
        # From the last that is older on: after a clock was set back, only what came since.
        older = np.flatnonzero(stamps < oldest)
        first = int(older[-1]) + 1 if len(older) else 0
        return stamps[first:], values[first:]

    @property
    def newest(self) -> int:
        """Stamp of the newest sample, ns; 0 while there is none."""
        return int(self._stamps[(self.count - 1) % self._capacity]) if self.count else 0


@dataclass(frozen=True)
class Setting:
    """What has to be known of a graph to show its signals.

    Attributes
    ----------
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    actuator : ActuatorParameters
        Limits of the actuator, and its suspension for the travel.
    assumed : bool
        Whether these are the defaults, because no compensator has told its own.
    """

    high_pass_frequency: float = HIGH_PASS_FREQUENCY
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    assumed: bool = True


@dataclass(frozen=True)
class Figures:
    """What the last `STATISTICS_WINDOW` says; None where there is too little.

    Attributes
    ----------
    rate : float or None
        Samples per second of the handle's acceleration, Hz.
    evaluation : Evaluation or None
        Error, slopes and R^2, the handle's acceleration shifted back by the paper's delay.
    rms_desired, rms_actual : float or None
        m/s^2.
    age_p50, age_p99 : float or None
        Of the actuator's force, from the tool's sample to its arrival here, s.
    peak_force, peak_travel : float or None
        Largest magnitude, N and m.
    spectra : Spectra or None
        Of desired and actual acceleration.
    desired, actual : ndarray
        At most `CLOUD_POINTS` pairs, m/s^2.
    """

    rate: float | None = None
    evaluation: Evaluation | None = None
    rms_desired: float | None = None
    rms_actual: float | None = None
    age_p50: float | None = None
    age_p99: float | None = None
    peak_force: float | None = None
    peak_travel: float | None = None
    spectra: Spectra | None = None
    desired: FloatArray = field(default_factory=lambda: np.zeros(0))
    actual: FloatArray = field(default_factory=lambda: np.zeros(0))


class Windows:
    """The signals that a page shows.

    Attributes
    ----------
    desired, handle, force, age : Ring
        Filled by who listens: desired acceleration, handle acceleration as measured (m/s^2),
        actuator force (N), and its age on arrival (s).
    actual, travel : Ring
        Derived by `advance`: handle acceleration without gravity and hand motion (m/s^2), and
        the actuator's place between its stops (m).
    """

    def __init__(self, setting: Setting | None = None) -> None:
        self.desired, self.handle, self.force, self.age = Ring(), Ring(), Ring(), Ring()
        self.actual, self.travel = Ring(), Ring()
        self._setting = setting or Setting()
        self._derivation: Derivation | None = None
        self._derived = 0

    @property
    def setting(self) -> Setting:
        """What is known of the graph."""
        return self._setting

    def know(self, setting: Setting) -> None:
        """Take what is known of the graph; another thread may, what is derived follows."""
        self._setting = setting

    def advance(self) -> None:
        """Derive what the newest samples of the handle allow."""
        rate, setting = sampling_rate(self.handle), self._setting
        if rate is None:
            return
        derivation = self._derivation
        if derivation is None or (derivation.rate, derivation.setting) != (rate, setting):
            derivation = self._derivation = Derivation(setting, rate)
        # Up to the newest force, which comes a little later than the sample it acts with.
        limit = self._limit(rate)
        _, stamps, values = self.handle.since(self._derived)
        ready = int(np.searchsorted(stamps, limit, "right")) if limit else len(stamps)
        if not ready:
            return
        self._derived = self.handle.count - (len(stamps) - ready)
        stamps, values = stamps[:ready], values[:ready]
        forces = held(*self.force.last(LONGEST_WINDOW), stamps, rate)
        actual, travel = derivation.derive(stamps, values, forces)
        self.actual.extend(stamps, actual)
        self.travel.extend(stamps, travel)

    def _limit(self, rate: float) -> int | None:
        """Stamp up to which every force is there, ns; None where no force comes."""
        newest = self.force.newest
        if self.handle.newest - newest > HELD * NANOSECONDS or newest == 0:
            return None
        return newest + int(NANOSECONDS / rate / 2)

    def figures(self) -> Figures:
        """Return figures of the last seconds."""
        rate = sampling_rate(self.handle)
        _, ages = self.age.last(STATISTICS_WINDOW)
        _, forces = self.force.last(STATISTICS_WINDOW)
        _, travels = self.travel.last(STATISTICS_WINDOW)
        found: dict[str, Any] = {
            "rate": rate,
            "peak_force": _peak(forces),
            "peak_travel": _peak(travels),
        }
        if len(ages):
            found["age_p50"], found["age_p99"] = (float(q) for q in np.quantile(ages, (0.5, 0.99)))
        if rate is not None:
            found |= self._compared(rate)
        return Figures(**found)

    def _compared(self, rate: float) -> dict[str, Any]:
        """Compare desired and actual acceleration as an evaluation of a bag does."""
        stamps, handle = self.handle.last(STATISTICS_WINDOW + 2 * EDGE)
        actual = without_hand_motion(handle, self._setting.high_pass_frequency, rate)
        edge = int(EDGE * rate)
        shift = math.floor(PAPER_DELAY * rate + 0.5) / rate
        desired, actual = paired(
            *self.desired.last(STATISTICS_WINDOW + 2 * EDGE),
            stamps[edge : len(stamps) - edge],
            actual[edge : len(actual) - edge],
            shift,
            rate,
        )
        if len(desired) < FEWEST:
            return {}
        try:
            found: dict[str, Any] = {"spectra": spectra(desired, actual, rate)}
        except ValueError:  # not finite, or beyond all measure
            return {}
        if desired.any():
            found["evaluation"] = evaluate(desired, actual, rate, delay=0.0)
        return {
            **found,
            "rms_desired": float(np.sqrt(np.mean(desired**2))),
            "rms_actual": float(np.sqrt(np.mean(actual**2))),
            "desired": desired[:: len(desired) // CLOUD_POINTS + 1],
            "actual": actual[:: len(actual) // CLOUD_POINTS + 1],
        }


class Derivation:
    """What is derived from the handle's acceleration, sample after sample.

    The high-pass is causal here: at a third of the corner of the compensator's, it shifts what
    is felt by little, and a page is to show what is now. Figures use the filter without phase.

    Parameters
    ----------
    setting : Setting
    rate : float
        Hz.
    """

    def __init__(self, setting: Setting, rate: float) -> None:
        self.rate, self.setting = rate, setting
        self._sections = high_pass(min(setting.high_pass_frequency * MOTION_SHARE, rate / 4), rate)
        self._estimator = TravelEstimator(setting.actuator, rate)
        self._newest: int | None = None
        self._memory = np.zeros((len(self._sections), 2))

    def derive(
        self, stamps: StampArray, handle: FloatArray, forces: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return acceleration without gravity and hand motion, and travel, of the next samples.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
            ns; n at least 1.
        handle, forces : ndarray, shape (n,)
            m/s^2 and N.
        """
        from scipy import signal

        if not (self._follows(int(stamps[0])) and np.isfinite(self._memory).all()):
            # As if the first sample had been there for ever: gravity makes no step.
            self._memory = signal.sosfilt_zi(self._sections) * handle[0]
            self._estimator.reset()
        self._newest = int(stamps[-1])
        actual, self._memory = signal.sosfilt(self._sections, handle, zi=self._memory)
        sample = self._estimator.sample
        travel = [sample(*pair) for pair in zip(forces.tolist(), handle.tolist(), strict=True)]
        return actual, np.array(travel)

    def _follows(self, stamp: int) -> bool:
        """Whether a sample comes soon after the last."""
        return self._newest is not None and 0 < stamp - self._newest < GAP * NANOSECONDS


def sampling_rate(ring: Ring) -> float | None:
    """Return the rate of a signal from its newest stamps, Hz, to four digits; None if unknown."""
    _, stamps, _ = ring.since(max(ring.count - RATE_SAMPLES, 0))
    if len(stamps) < FEWEST:
        return None
    period = float(np.median(np.diff(stamps)))
    return float(f"{NANOSECONDS / period:.4g}") if period > 0 else None


def held(stamps: StampArray, values: FloatArray, moments: StampArray, rate: float) -> FloatArray:
    """Return a command's value at moments: that of the newest stamp up to half a period later.

    Parameters
    ----------
    stamps, values : ndarray, shape (m,)
        Of the command, stamps in ns and in order.
    moments : ndarray, shape (n,)
        ns.
    rate : float
        Hz.

    Returns
    -------
    ndarray, shape (n,)
        Zero before the first command, and where the newest is older than `HELD`.
    """
    if not len(stamps):
        return np.zeros(len(moments))
    newest = np.searchsorted(stamps, moments + int(NANOSECONDS / rate / 2), "right") - 1
    alive = (newest >= 0) & (moments - stamps[newest] <= HELD * NANOSECONDS)
    return np.where(alive, values[newest], 0.0)


def paired(
    desired_stamps: StampArray,
    desired: FloatArray,
    actual_stamps: StampArray,
    actual: FloatArray,
    shift: float,
    rate: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the samples of two signals that belong together.

    Parameters
    ----------
    desired_stamps, actual_stamps : ndarray, shapes (m,) and (n,)
        ns, in order.
    desired, actual : ndarray, shapes (m,) and (n,)
    shift : float
        How much later an actual sample is than the desired one that it answers, s.
    rate : float
        Hz; what is farther from its place than half a period has no partner.

    Returns
    -------
    tuple of ndarray, each of shape (k,)
        k at most the smaller of m and n.
    """
    if not len(desired_stamps) or not len(actual_stamps):
        return np.zeros(0), np.zeros(0)
    half = int(NANOSECONDS / rate / 2)
    wanted = desired_stamps + int(shift * NANOSECONDS)
    # The first that is not more than half a period early is the nearest, if any is near.
    places = np.searchsorted(actual_stamps, wanted - half)
    found = places < len(actual_stamps)
    found[found] = actual_stamps[places[found]] - wanted[found] < half
    return desired[found], actual[places[found]]


def _peak(values: FloatArray) -> float | None:
    return float(np.max(np.abs(values))) if len(values) else None
