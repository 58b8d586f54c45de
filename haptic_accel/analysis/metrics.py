# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics of one trial: error, similarity, delay, force, travel, deadlines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.analysis.segments import Segment
from haptic_accel.analysis.traces import Portrait, Traces
from haptic_accel.bags.delivery import AGE_OF
from haptic_accel.core import topics
from haptic_accel.core.axes import ALL_AXES, NAMES
from haptic_accel.core.control.error_bound import bounds
from haptic_accel.core.control.filters import comparable, without_hand_motion
from haptic_accel.core.control.supervision import supervise
from haptic_accel.core.evaluation import metrics as measures
from haptic_accel.core.evaluation.statistics import Interval, nrmse_interval
from haptic_accel.core.handle.plant import MatrixPlant
from haptic_accel.core.model import AccelerometerParameters, FloatArray
from haptic_accel.core.parameters import ParameterError, read_decimal
from haptic_accel.core.tables import Column
from haptic_accel.core.tick import TravelEstimator

PERCENT = 100.0
"""Percent for a ratio of 1."""

MILLI = 1e3
"""Milliseconds or millimetres per SI unit."""

TRAVEL_BEGIN = 0.1
"""Time at the start of a trial that is excluded from the largest travel, s. The estimate assumes
that the actuator starts in the middle. Its error decays with the 18 ms of Table I's suspension."""

CONTACT = 3 * AccelerometerParameters().noise
"""Minimum RMS of the desired acceleration for a trial with contact, m/s^2: three times the noise
of the paper's accelerometer, and a tenth of the value for its vinyl."""

GRANTED_SHIFT, PAPER_SHIFT, MEASURED_SHIFT = "granted", "paper", "measured"

BEYOND_STOPS = "no travel: its estimate, which is made without stops, lies beyond them"
"""Note on a trial whose estimated travel is impossible."""

SLOPES = ("slope_desired_on_actual", "slope_actual_on_desired")
"""Metrics that are undefined if the signals have almost nothing in common."""

MOST_SHIFT = 100.0
"""Maximum permitted shift, ms."""


METRICS: Mapping[str, Column] = {
    column.key: column
    for column in (
        Column("nrmse_percent", "NRMSE", "%", 1, low=0.0),
        Column("indistinguishable_percent", "indistinguishable", "%", 1, low=0.0, high=PERCENT),
        Column("bound_percent", "bound", "%", 1, low=0.0),
        Column("limited_bound_percent", "limited bound", "%", 1, low=0.0),
        Column("slope_desired_on_actual", "slope, desired on actual", "", 2),
        Column("slope_actual_on_desired", "slope, actual on desired", "", 2),
        Column("r2", "R²", "", 2, low=0.0, high=1.0),
        Column("delay_ms", "delay", "ms", 3),
        Column("delay_correlation", "correlation at it", "", 2, low=0.0, high=1.0),
        Column("shift_ms", "shift", "ms", 3),
        Column("force_rms_N", "force RMS", "N", 2, low=0.0),
        Column("force_peak_N", "force peak", "N", 2, low=0.0),
        Column("travel_mm", "travel used", "mm", 2, low=0.0),
        Column("deadlines_missed_percent", "deadlines missed", "%", 2, low=0.0, high=PERCENT),
        Column("late_time_percent", "time with a late force", "%", 2, low=0.0, high=PERCENT),
        Column("late_longest_ms", "latest force", "ms", 2, low=0.0),
        Column("age_p50_us", "age p50", "µs", 0, low=0.0),
        Column("age_p99_us", "age p99", "µs", 0, low=0.0),
        Column("age_max_us", "age max", "µs", 0, low=0.0),
        Column("lost", "lost", "", 0, low=0.0),
    )
}
"""Metrics by name with unit, as used for columns of tables and files."""


KEPT = {
    "axis": "axis",
    "sum": "sum",
    measures.LIVE_PRINCIPAL: "principal",
    "dft321": "dft321",
    "magnitude": "magnitude",
}
"""Short names of the reductions to one coil, for the metrics of the power they keep."""

VECTOR_METRICS: Mapping[str, Column] = {
    column.key: column
    for column in (
        Column("direction_error_deg", "direction error", "°", 1, low=0.0, high=180.0),
        *(Column(f"nrmse_{axis}_percent", f"NRMSE {axis}", "%", 1, low=0.0) for axis in NAMES),
        *(
            Column(f"kept_{key}_percent", f"one coil, {key}: power", "%", 0, low=0.0)
            for key in KEPT.values()
        ),
    )
}
"""Further metrics of trials with several axes."""


@dataclass(frozen=True)
class Shift:
    """Shift of the actual acceleration before the comparison.

    Attributes
    ----------
    kind : str
        ``granted`` for each trial's latency and granted delay, ``paper`` for one sample (the
        paper's 1 ms at its 1 kHz), ``measured`` for each trial's estimated delay, ``fixed`` for
        `seconds`.
    seconds : float
        Shift of the kind ``fixed``, s.
    """

    kind: str = GRANTED_SHIFT
    seconds: float = 0.0

    @classmethod
    def read(cls, text: str) -> Shift:
        """Read ``granted``, ``paper``, ``measured``, or a number of milliseconds.

        Raises
        ------
        ParameterError
            The text is none of these.
        """
        if text in (GRANTED_SHIFT, PAPER_SHIFT, MEASURED_SHIFT):
            return cls(text)
        try:
            milliseconds = read_decimal(text)
        except ValueError:
            milliseconds = math.nan
        if not abs(milliseconds) <= MOST_SHIFT:
            raise ParameterError(
                f"shift = {text!r}: must be granted, paper, measured, or from"
                f" -{MOST_SHIFT:g} to {MOST_SHIFT:g} ms"
            )
        return cls("fixed", milliseconds * 1e-3)

    def of(self, segment: Segment, delay: measures.Delay) -> float:
        """Return the shift of a trial in s; the granted one if its delay is unknown.

        Raises
        ------
        ValueError
            The latency is needed but unknown.
        """
        if self.kind == "fixed":
            return self.seconds
        if self.kind == MEASURED_SHIFT and math.isfinite(delay.seconds):
            return delay.seconds
        samples = 1 if self.kind == PAPER_SHIFT else segment.after
        if samples is None:
            raise ValueError(
                "its latency is not stated, and cannot be estimated, as the actual acceleration"
                " does not correlate with the desired one; give it by --shift, in ms"
            )
        return samples / segment.rate

    def text(self, segments: Iterable[Segment]) -> str:
        """Return the text that completes "shifted back by"."""
        if self.kind == GRANTED_SHIFT:
            known = (each for each in segments if each.after is not None)
            found = sorted({(each.after or 0, each.rate, each.estimated) for each in known})
            return " or ".join(
                f"{1e3 * samples / rate:g} ms ({samples} sample{'s' * (samples > 1)}"
                f"{', estimated' * estimated})"
                for samples, rate, estimated in found
            )
        return {
            PAPER_SHIFT: "one sample, as in the paper",
            MEASURED_SHIFT: "the delay measured in each trial",
        }.get(self.kind, f"{1e3 * self.seconds:g} ms")


@dataclass(frozen=True)
class AnalysedTrial:
    """A trial with its metrics.

    Attributes
    ----------
    name : str
        Name of its bag, with a number if it is not the bag's first trial; unique.
    source : Path
        Path, as specified by the user, under which the trial was found.
    segment : Segment
        Segment of the bag, without its signals.
    metrics : dict
        Value of each of `METRICS`, and of `VECTOR_METRICS` for several axes; NaN where undefined.
    bands : dict
        NRMSE in percent by band; empty if the accelerations cannot be compared.
    error : Interval
        NRMSE in percent with the interval from pieces of the trial.
    portrait : Portrait or None
        Parts of the compared accelerations for plots.
    traces : Traces
        Signals over time.
    notes : tuple of str
        Assumptions, and missing items.
    contact : bool
        False if the tool touched nothing, so that the error is undefined; true if unknown.
    """

    name: str
    source: Path
    segment: Segment
    metrics: dict[str, float]
    bands: dict[str, float]
    error: Interval
    portrait: Portrait | None
    traces: Traces
    notes: tuple[str, ...]
    contact: bool

    @property
    def controller(self) -> str:
        """Controller of the trial."""
        return self.segment.condition.controller

    @property
    def surface(self) -> str:
        """Surface of the trial."""
        return self.segment.condition.surface


def measure(
    segment: Segment, name: str, source: Path, shift: Shift, *, begin: float | None = None
) -> AnalysedTrial:
    """Return the metrics of a segment.

    Parameters
    ----------
    segment : Segment
    name, source
        See `AnalysedTrial`.
    shift : Shift
    begin : float, optional
        Start of the excerpt of another trial, s, to be used for this trial too.
    """
    notes = list(segment.notes)
    desired = segment.signals.get(topics.DESIRED_ACCELERATION.name)
    force = segment.signals.get(topics.ACTUATOR_FORCE.name)
    actual = actual_acceleration(segment)
    corner = segment.high_pass_frequency
    if actual is None and segment.rate <= 2 * corner:
        notes.append(f"{segment.rate:g} samples per second are too few for its {corner:g} Hz")
    comparison = _Comparison()
    strength = math.nan if desired is None else _rms(desired)
    contact = not strength < CONTACT
    if not contact:
        notes.append(
            f"without contact: the desired acceleration has an RMS of {strength:.2g} m/s², that of"
            f" contact is at least {CONTACT:.2g} m/s²"
        )
    elif desired is not None and actual is not None:
        handle = segment.signals[topics.HANDLE_ACCELERATION.name]
        if segment.latency is None:
            segment = _with_estimated_latency(segment, desired, actual, notes)
        comparison = _compared(desired, handle, segment, shift, notes, begin)
        comparison.metrics.update(_bounds(segment, comparison.shift, notes))
    notes += _deviation(segment)
    travel = _travel(segment)
    signals = {"desired": desired, "actual": actual, "force": force, "travel": travel}
    drawn = {name: values for name, values in signals.items() if values is not None}
    delivery = segment.delivery
    metrics = dict.fromkeys(METRICS, math.nan) | comparison.metrics
    if force is not None:
        metrics["force_rms_N"] = _rms(force)
        metrics["force_peak_N"] = float(np.max(measures.lengths(force)))
    if travel is not None:
        farthest = np.max(np.abs(travel[round(TRAVEL_BEGIN * segment.rate) :]))
        if farthest <= segment.actuator.travel:
            metrics["travel_mm"] = MILLI * float(farthest)
        else:
            notes.append(BEYOND_STOPS)
    if counts := delivery.deadlines.get(AGE_OF):  # not in lockstep
        metrics["deadlines_missed_percent"] = PERCENT * counts["missed"] / counts["due"]
        if delivery.by_clock:
            late = counts["late_s"] * segment.rate / counts["due"]
            metrics["late_time_percent"] = PERCENT * min(1.0, late)
            metrics["late_longest_ms"] = counts["longest_us"] / MILLI
    for label in ("p50", "p99", "max"):
        metrics[f"age_{label}_us"] = delivery.age_us.get(label, math.nan)
    metrics["lost"] = float(sum(delivery.lost.values()))
    traces = Traces.of(drawn, segment.rate, comparison.shift, begin, segment.axes)
    kept, unique = replace(segment, signals={}), tuple(dict.fromkeys(notes))
    compared = comparison.bands, comparison.error, comparison.portrait
    return AnalysedTrial(name, source, kept, metrics, *compared, traces, unique, contact)


def _with_estimated_latency(
    segment: Segment, desired: FloatArray, actual: FloatArray, notes: list[str]
) -> Segment:
    """Return a segment with the latency estimated from its signals, if possible.

    The cross-correlation's delay, in whole samples, equals latency plus granted delay for all
    controllers: phase errors shift it by less than half a sample.
    """
    with suppress(ValueError):  # signals that cannot be compared
        after = measures.estimate_delay(desired, actual, segment.rate).seconds * segment.rate
        if after >= 0:
            latency = max(0, round(after) - segment.granted_delay)
            notes.append(
                f"its latency is not stated: {latency} sample{'s' * (latency != 1)} by the delay"
                " of the actual acceleration"
            )
            return replace(segment, latency=latency, estimated=True)
    return segment


def _rms(values: FloatArray) -> float:
    """Return the root mean square of a signal or, for vectors, of their lengths."""
    return float(np.sqrt(np.mean(measures.lengths(values) ** 2)))


COMPENSATOR = "compensator"
"""Node whose diagnostics report deviations of the handle."""


def _deviation(segment: Segment) -> list[str]:
    """Return the bands and times at which the handle differed from the compensator's plant model.

    A compensator that reports has made this comparison online, with the samples as received. For a
    bag with lost samples and late forces, a new comparison would show too many deviations.
    """
    if COMPENSATOR in segment.delivery.nodes:
        return []
    force = segment.signals.get(topics.ACTUATOR_FORCE.name)
    handle = segment.signals.get(topics.HANDLE_ACCELERATION.name)
    if segment.plant_model is None or force is None or handle is None or handle.ndim > 1:
        return []
    if segment.latency is None:
        return []
    try:
        plant = segment.plant_model.delayed(segment.latency)
        warning, first = supervise(plant, segment.rate, force, handle)
    except ParameterError as error:
        return [f"the handle's response could not be compared: {error}"]
    return [f"{warning} (from {first:.1f} s on)"] if warning else []


def actual_acceleration(segment: Segment) -> FloatArray | None:
    """Return the handle's acceleration without gravity and the hand's motion, m/s^2.

    Return None without the handle's signal, or if its rate is too low for the high-pass.
    """
    handle = segment.signals.get(topics.HANDLE_ACCELERATION.name)
    if handle is None or segment.rate <= 2 * segment.high_pass_frequency:
        return None
    return without_hand_motion(handle, segment.high_pass_frequency, segment.rate)


_NO_ERROR = Interval(math.nan, math.nan, math.nan, 0, "no value")


@dataclass(frozen=True)
class _Comparison:
    """Result of comparing two accelerations; the default is no comparison."""

    metrics: dict[str, float] = field(default_factory=dict)
    shift: float = 0.0
    bands: dict[str, float] = field(default_factory=dict)
    error: Interval = _NO_ERROR
    portrait: Portrait | None = None


def _compared(
    desired: FloatArray,
    handle: FloatArray,
    segment: Segment,
    shift: Shift,
    notes: list[str],
    begin: float | None,
) -> _Comparison:
    """Compare two accelerations; add the reason to the notes if this is impossible."""
    rate, corner = segment.rate, segment.high_pass_frequency
    try:
        delay = measures.estimate_delay(*comparable(desired, handle, corner, rate), rate)
        seconds = shift.of(segment, delay)
        desired, actual = measures.aligned(desired, handle, corner, rate, seconds)
        evaluation = measures.evaluate(desired, actual, rate, 0.0)
        by_axis = {}
        if desired.ndim > 1:
            evaluations = measures.evaluate_axes(desired, actual, rate)
            by_axis = dict(zip(segment.axes.names, evaluations, strict=True))
        portrait = Portrait.of(desired, actual, rate, evaluation, begin, by_axis)
        errors = measures.band_nrmse(desired, actual, rate, measures.bands(rate))
    except ValueError as error:
        notes.append(f"cannot be compared: {error}")
        return _Comparison()
    if math.isnan(delay.seconds):
        notes.append("no delay: the actual acceleration does not correlate with the desired one")
    metrics = asdict(evaluation) | {
        "indistinguishable_percent": PERCENT * measures.indistinguishable(desired, actual, rate),
        "delay_ms": MILLI * delay.seconds,
        "delay_correlation": delay.correlation,
        "shift_ms": MILLI * seconds,
    }
    if not portrait.regressed:
        metrics |= dict.fromkeys(SLOPES, math.nan)
    if by_axis:
        metrics["direction_error_deg"] = measures.direction_error(desired, actual)
        metrics |= {f"nrmse_{axis}_percent": own.nrmse_percent for axis, own in by_axis.items()}
    if segment.axes == ALL_AXES:
        metrics |= {
            f"kept_{KEPT[name]}_percent": PERCENT * power
            for name, power in measures.kept_powers(desired, rate).items()
            if name in KEPT
        }
    own = nrmse_interval(desired, actual, rate)
    low, high = PERCENT * own.low, PERCENT * own.high
    nrmse = replace(own, value=evaluation.nrmse_percent, low=low, high=high)
    by_band = {band: PERCENT * value for band, value in errors.items()}
    return _Comparison(metrics, seconds, by_band, nrmse, portrait)


def _bounds(segment: Segment, shift: float, notes: list[str]) -> dict[str, float]:
    """Return the error bounds of a trial for a shift, s, of at least one sample."""
    tool = segment.signals.get(topics.TOOL_ACCELERATION.name)
    plant = segment.plant
    if tool is None or plant is None or segment.latency is None:
        return {}
    granted = round(shift * segment.rate, 6) - segment.latency
    if granted < 0 or granted % 1:
        return {}
    options: dict[str, Any] = {
        "granted_delay": int(granted),
        "noise": segment.noise,
        "high_pass_frequency": segment.high_pass_frequency,
        "actuator": segment.actuator,
    }
    try:
        if not isinstance(plant, MatrixPlant) and tool.ndim > 1:
            return {}
        found = bounds(plant, segment.rate, tool, **options)
    except ParameterError as error:
        notes.append(f"no bound of the error: {error}")
        return {}
    return {"bound_percent": found.causal, "limited_bound_percent": found.limited}


def _travel(segment: Segment) -> FloatArray | None:
    """Return the position of each axis' actuator between its stops at each sample, m."""
    force = segment.signals.get(topics.ACTUATOR_FORCE.name)
    handle = segment.signals.get(topics.HANDLE_ACCELERATION.name)
    if force is None or handle is None:
        return None
    pairs = zip(measures.components(force), measures.components(handle), strict=True)
    found = [_travel_along(segment, *pair) for pair in pairs]
    return found[0] if force.ndim == 1 else np.column_stack(found)


def _travel_along(segment: Segment, force: FloatArray, handle: FloatArray) -> FloatArray:
    """Return the position of an actuator, m."""
    sample = TravelEstimator(segment.actuator, segment.rate).observe
    # Iterate over arrays directly: lists of their numbers would take four times the memory.
    return np.fromiter(map(sample, force.data, handle.data), np.float64, len(force))
