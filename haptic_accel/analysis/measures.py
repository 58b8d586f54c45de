"""The figures of one trial: error, likeness, delay, force, travel, latency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from haptic_accel.analysis.perception import Perception, perceive
from haptic_accel.analysis.plots import Portrait
from haptic_accel.analysis.segments import Stretch
from haptic_accel.analysis.traces import Traces
from haptic_accel.core import topics
from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.control.filters import without_hand_motion
from haptic_accel.core.evaluation.bands import band_nrmse, bands
from haptic_accel.core.evaluation.delay import Delay, estimate_delay, shift_back
from haptic_accel.core.evaluation.metrics import Evaluation, Spectra, evaluate, spectra
from haptic_accel.core.evaluation.statistics import Interval, nrmse_interval
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import IntArray

PERCENT = 100.0

TRAVEL_BEGIN = 0.1
"""Left out of the largest travel, s: the estimate begins in the middle, wherever the actuator is,
and forgets that with the 18 ms of Table I's suspension."""

LATENCY_EDGES = np.geomspace(1e-5, 1.0, 101)
"""Edges of the latency histogram's bins, s: twenty to a decade, 12 % wide."""

PAPER_SHIFT, MEASURED_SHIFT = "paper", "measured"


@dataclass(frozen=True)
class Shift:
    """By how much the actual acceleration is shifted back before it is compared.

    Attributes
    ----------
    kind : str
        ``paper`` for one sample (the paper's 1 ms at its 1 kHz), ``measured`` for each trial's own
        estimated delay, ``fixed`` for `seconds`.
    seconds : float
        Of ``fixed``.
    """

    kind: str = PAPER_SHIFT
    seconds: float = 0.0

    @classmethod
    def read(cls, text: str) -> Shift:
        """Read ``paper``, ``measured``, or a number of milliseconds.

        Raises
        ------
        ParameterError
            It is none of these.
        """
        if text in (PAPER_SHIFT, MEASURED_SHIFT):
            return cls(text)
        try:
            milliseconds = float(text)
        except ValueError:
            milliseconds = math.nan
        if not abs(milliseconds) <= MOST_SHIFT:
            raise ParameterError(
                f"shift = {text!r}: must be paper, measured, or from -{MOST_SHIFT:g} to"
                f" {MOST_SHIFT:g} ms"
            )
        return cls("fixed", milliseconds * 1e-3)

    def of(self, rate: float, delay: Delay) -> float:
        """Return the shift of a trial in s; the paper's where its delay is not known."""
        if self.kind == "fixed":
            return self.seconds
        if self.kind == MEASURED_SHIFT and math.isfinite(delay.seconds):
            return delay.seconds
        return 1.0 / rate

    @property
    def words(self) -> str:
        """The same for a reader."""
        return {
            PAPER_SHIFT: "one sample, as in the paper",
            MEASURED_SHIFT: "the delay measured in each trial",
        }.get(self.kind, f"{1e3 * self.seconds:g} ms")


MOST_SHIFT = 100.0
"""Largest shift that may be asked for, ms."""


@dataclass(frozen=True)
class Force:
    """What the actuator did.

    Attributes
    ----------
    rms, peak : float
        Of its force, N.
    travel : float
        Farthest from its middle, m; NaN where it is not known.
    free : float
        Free travel either way, m.
    """

    rms: float
    peak: float
    travel: float
    free: float


@dataclass(frozen=True)
class Latency:
    """From the stamp of the sample that caused a force to the force's recording.

    Attributes
    ----------
    counts : ndarray of int64
        By the bins of `LATENCY_EDGES`; what lies outside is in the first and the last.
    p50, p99, largest : float
        s.
    """

    counts: IntArray
    p50: float
    p99: float
    largest: float


@dataclass(frozen=True)
class Fidelity:
    """How well the handle followed in a trial.

    Attributes
    ----------
    delay : Delay
        Of actual behind desired, as estimated.
    shift : float
        By which the actual acceleration was shifted back for all that follows, s.
    evaluation : Evaluation
    nrmse : Interval
        A ratio.
    bands : dict
        NRMSE as a ratio by band.
    spectra : Spectra
    perception : Perception or None
        None where it was not asked for.
    portrait : Portrait
        What is drawn of it.
    """

    delay: Delay
    shift: float
    evaluation: Evaluation
    nrmse: Interval
    bands: Mapping[str, float]
    spectra: Spectra
    perception: Perception | None
    portrait: Portrait


@dataclass(frozen=True)
class Measures:
    """What can be said of a trial.

    Attributes
    ----------
    stretch : Stretch
        Without its signals.
    fidelity : Fidelity or None
    force : Force or None
    latency : Latency or None
        None where the bag lacks what it takes.
    traces : Traces
        To look at.
    notes : tuple of str
        What is missing or assumed.
    """

    stretch: Stretch
    fidelity: Fidelity | None
    force: Force | None
    latency: Latency | None
    traces: Traces
    notes: tuple[str, ...]


def measure(stretch: Stretch, shift: Shift | None = None, *, perceptual: bool = True) -> Measures:
    """Return the figures of a stretch.

    Parameters
    ----------
    stretch : Stretch
    shift : Shift, optional
        The paper's by default.
    perceptual : bool
        Whether to score how it feels, which takes longest.
    """
    notes = list(stretch.notes)
    actual = _actual(stretch, notes)
    desired = stretch.signals.get(topics.DESIRED_ACCELERATION.name)
    fidelity = None
    if desired is not None and actual is not None:
        fidelity = _fidelity(desired, actual, stretch.rate, shift or Shift(), perceptual, notes)
    travel = _travel(stretch)
    drawn = {
        "desired": desired,
        "actual": actual,
        "force": stretch.signals.get(topics.ACTUATOR_FORCE.name),
        "travel": travel,
    }
    return Measures(
        stretch.without_signals(),
        fidelity,
        _force(stretch, travel),
        _latency(stretch.delivery.transit),
        Traces.of(
            {name: values for name, values in drawn.items() if values is not None},
            stretch.rate,
            fidelity.shift if fidelity else 0.0,
        ),
        tuple(dict.fromkeys(notes)),
    )


def _actual(stretch: Stretch, notes: list[str]) -> FloatArray | None:
    """Return the handle's acceleration without gravity and the hand's motion."""
    handle = stretch.signals.get(topics.HANDLE_ACCELERATION.name)
    corner = stretch.high_pass_frequency
    if handle is None:
        return None
    if stretch.rate <= 2 * corner:
        notes.append(f"{stretch.rate:g} samples per second are too few for its {corner:g} Hz")
        return None
    return without_hand_motion(handle, corner, stretch.rate)


def _fidelity(
    desired: FloatArray,
    actual: FloatArray,
    rate: float,
    shift: Shift,
    perceptual: bool,
    notes: list[str],
) -> Fidelity | None:
    """Compare two accelerations; None, and why in the notes, where that cannot be done."""
    try:
        delay = estimate_delay(desired, actual, rate)
        seconds = shift.of(rate, delay)
        desired, actual = shift_back(desired, actual, rate, seconds)
        evaluation = evaluate(desired, actual, rate, 0.0)
        spectrum = spectra(desired, actual, rate)
        errors = band_nrmse(desired, actual, rate, bands(rate))
    except ValueError as error:
        notes.append(f"cannot be compared: {error}")
        return None
    if math.isnan(delay.seconds):
        notes.append("no delay stands out: the handle does not follow what is desired")
    perception = perceive(desired, actual, rate) if perceptual else None
    if perception and perception.note:
        notes.append(perception.note)
    return Fidelity(
        delay,
        seconds,
        evaluation,
        nrmse_interval(desired, actual, rate),
        errors,
        spectrum,
        perception,
        Portrait.of(desired, actual, rate, evaluation, spectrum),
    )


def _travel(stretch: Stretch) -> FloatArray | None:
    """Return where the actuator was between its stops at each sample, m."""
    force = stretch.signals.get(topics.ACTUATOR_FORCE.name)
    handle = stretch.signals.get(topics.HANDLE_ACCELERATION.name)
    if force is None or handle is None:
        return None
    sample = TravelEstimator(stretch.suspension, stretch.rate).sample
    return np.array([sample(f, a) for f, a in zip(force.tolist(), handle.tolist(), strict=True)])


def _force(stretch: Stretch, travel: FloatArray | None) -> Force | None:
    force = stretch.signals.get(topics.ACTUATOR_FORCE.name)
    if force is None:
        return None
    begin = round(TRAVEL_BEGIN * stretch.rate)
    farthest = math.nan if travel is None else float(np.max(np.abs(travel[begin:])))
    return Force(
        float(np.sqrt(np.mean(force**2))),
        float(np.max(np.abs(force))),
        farthest,
        stretch.suspension.travel,
    )


def _latency(transit: FloatArray) -> Latency | None:
    if not transit.size:
        return None
    counts, _ = np.histogram(np.clip(transit, LATENCY_EDGES[0], LATENCY_EDGES[-1]), LATENCY_EDGES)
    p50, p99 = np.quantile(transit, [0.5, 0.99]).tolist()
    return Latency(counts.astype(np.int64), p50, p99, float(np.max(transit)))
