# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tracking error of controllers in lockstep, over inputs, hands, grips and rigs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from handle_family import SPREAD, WIDE, hand
from input_family import band_noise, ringing

from haptic_accel import (
    FloatArray,
    GraphArguments,
    HandleParameters,
    ParameterError,
    Setup,
    Trial,
    held,
    lockstep_trial,
)
from haptic_accel.commands import ResultTable, Row
from haptic_accel.controllers import CONTROLLERS
from haptic_accel.core.evaluation.metrics import Band, band_nrmse
from haptic_accel.core.sampling import DEFAULT_RATE, crossfaded
from haptic_accel.core.tables import number as figure
from haptic_accel.core.tick import TravelEstimator
from haptic_accel.core.trial import GripChange
from haptic_accel.materials.recordings import read_recording
from haptic_accel.setup.arguments import SURFACES

DURATION = 8.0
"""Duration of a trial with one grip, s."""

CHANGED_AT = 1.0
"""Time at which another hand takes the handle, s; before, the grip is that of Table I."""

SETTLING = 2.0
"""Time after a change of grip that is not evaluated, s."""

USERS = 3
"""Number of users of the paper's rig."""

CHANGES = 10
"""Number of trials with a grip change each second."""

WINDOW, WINDOW_HOP = 2.0, 0.5
"""Length of the sections of a trial whose errors are compared with those without controller, and
the time from one to the next, s."""

ACCEPTED = 2.0
"""Increase of a section's error over that of no control that does not count, points."""

COMPARABLE = Band(0.0, 500.0)
"""Frequencies whose error compares rates, Hz: half the lowest one. Above, the desired acceleration
is the noise of the tool's sensor."""

FASTER = (1000.0, 2000.0, 4000.0, 8000.0)
"""Rates, Hz."""

GRANTED = (0.25e-3, 0.5e-3, 1e-3, 2e-3)
"""Granted delays, s."""

TEXTURE_LOWS = (8.0, 15.0, 30.0, 60.0)
"""Lower frequencies of textures, Hz."""

TEXTURE_RMS = (0.5, 1.0, 3.0, 6.0)
"""Root mean squares of textures, m/s^2."""

TAP_PEAKS = (5.0, 15.0, 45.0)
"""Peaks of taps, m/s^2: up to the range of the paper's accelerometer."""

RECORDING_RMS = (0.6, 3.0)
"""Root mean squares to which recordings are scaled, m/s^2."""

MODE_FREQUENCIES = (120.0, 180.0, 250.0, 320.0)
"""Frequencies of a mode that is unknown to the controllers, Hz."""

MODE_DAMPINGS = (0.03, 0.05, 0.1, 0.3)
"""Damping ratios of that mode."""

TOLD = 1.0
"""Time in which a controller can detect that mode, which is not evaluated, s."""

GRANT = "granted_time"
"""Parameter of the controllers for the granted delay."""


@dataclass(frozen=True)
class Case:
    """One trial.

    Attributes
    ----------
    condition, input, grip : str
        Names of the condition, of the tool's acceleration and of the grip.
    arguments : GraphArguments
        Rig, rate, input, controller and seed.
    grips : tuple of GripChange
    start : float
        Start of the evaluated part, s.
    recording : ndarray, optional
        Tool acceleration in place of the arguments' one, m/s^2.
    changes : dict
        Additional values for rig and controllers, by node and dotted name.
    """

    condition: str
    input: str
    grip: str
    arguments: GraphArguments
    grips: tuple[GripChange, ...] = ()
    start: float = 0.0
    recording: FloatArray | None = None
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Wanted:
    """User's choice of inputs, hands and seed, and of rig and rate for all conditions."""

    inputs: Sequence[GraphArguments]
    rig: str
    rate: float
    hands: int
    seed: int

    def on(self, rig: str = "ideal", rate: float = DEFAULT_RATE) -> GraphArguments:
        """Return the arguments of a condition's rig, unless the user chose a rig."""
        return GraphArguments(rig=self.rig or rig, rate=self.rate or rate)


def inputs(recordings: Sequence[str], rates: Sequence[float]) -> list[GraphArguments]:
    """Return the graph arguments for each acceleration of the tool."""
    if not recordings:
        return [GraphArguments(surface=surface) for surface in SURFACES]
    every = list(rates) or [0.0]
    if len(every) == 1:
        every *= len(recordings)
    if len(every) != len(recordings):
        raise ParameterError(
            f"recording_rate: given {len(rates)} times, must be once or for each of"
            f" {len(recordings)} recordings"
        )
    return [
        GraphArguments(surface=file, recording_rate=rate)
        for file, rate in zip(recordings, every, strict=True)
    ]


def with_controllers(case: Case, controllers: Sequence[str]) -> Iterator[Case]:
    """Yield a trial per controller; with a granted delay, only for those with that parameter."""
    for name in controllers:
        granted = any(GRANT in value for value in case.changes.get("compensator", ()))
        if not granted or hasattr(CONTROLLERS[name].Parameters, GRANT):
            yield replace(case, arguments=replace(case.arguments, controller=name))


# Inputs


def texture(low: float, rms: float, rate: float) -> FloatArray:
    """Return noise from a frequency in Hz to six times that, at most 400 Hz, m/s^2."""
    samples = round(DURATION * rate)
    found = band_noise(np.random.default_rng(3), samples, low, min(400.0, 6 * low), rate)
    fading_in = np.minimum(np.arange(samples) / (0.2 * rate), 1.0)
    return np.asarray(fading_in * found * (rms / np.std(found)))


def taps(peak: float, rate: float) -> FloatArray:
    """Return taps every 0.3 to 0.7 s: modes of 60 to 300 Hz that decay in 3 to 20 ms, m/s^2."""
    draw = np.random.default_rng(4).uniform
    time = np.arange(round(DURATION * rate)) / rate
    found, begin = np.zeros(len(time)), 0.3
    while begin < DURATION:
        found += ringing(time, begin, draw(60.0, 300.0), 1.0, draw(3e-3, 20e-3))
        begin += draw(0.3, 0.7)
    return np.asarray(found * (peak / np.abs(found).max()))


# Conditions


def _given(case: GraphArguments, around: GraphArguments, seed: int = 0) -> GraphArguments:
    """Return the arguments of an input on a rig."""
    return replace(case, rig=around.rig, rate=around.rate, seed=seed)


def _name(given: GraphArguments) -> str:
    return Path(given.surface).stem


def _rig(around: GraphArguments) -> str:
    return f"{Path(around.rig).stem}, {around.rate / 1e3:g} kHz"


def _surfaces(wanted: Wanted) -> Iterator[Case]:
    rigs = (wanted.on(), wanted.on(rate=4000.0), wanted.on("paper"))
    for around, given in product(dict.fromkeys(rigs), wanted.inputs):
        for user in range(USERS if around.rig == "paper" else 1):
            grip = f"user {user}" if around.rig == "paper" else "Table I"
            yield Case(_rig(around), _name(given), grip, _given(given, around, user))


def _rates(wanted: Wanted) -> Iterator[Case]:
    names = [name for name, kind in CONTROLLERS.items() if hasattr(kind.Parameters, GRANT)]
    rigs = dict.fromkeys(wanted.on(rig, rate) for rig, rate in product(("ideal", "paper"), FASTER))
    for around, seconds, given in product(rigs, GRANTED, wanted.inputs):
        if seconds * around.rate < 1:
            continue  # a sample at least
        changes = {"compensator": {f"{name}.{GRANT}": seconds for name in names}}
        condition = f"{_rig(around)}, {_name(given)}, {1e3 * seconds:g} ms granted"
        arguments = _given(given, around)
        yield Case(condition, _name(given), "user 0", arguments, changes=changes)


def _hands(wanted: Wanted) -> Iterator[Case]:
    yield from _held(wanted, "hands", SPREAD, wanted.hands)


def _wide(wanted: Wanted) -> Iterator[Case]:
    yield from _held(wanted, "wide hands", WIDE, wanted.hands // 2)


def _held(
    wanted: Wanted, condition: str, spread: Mapping[str, tuple[float, float]], count: int
) -> Iterator[Case]:
    for number in range(count):
        grips = ((CHANGED_AT, hand(wanted.seed, number, spread)),)
        yield _changing(wanted, condition, number, grips, CHANGED_AT + SETTLING)


def _grips(wanted: Wanted) -> Iterator[Case]:
    seconds = range(round(CHANGED_AT), round(DURATION))
    for number in range(CHANGES if wanted.hands else 0):
        grips = tuple((float(s), hand(wanted.seed + 1, 100 * number + s)) for s in seconds)
        yield _changing(wanted, "grip changes every second", number, grips, CHANGED_AT)


def _changing(
    wanted: Wanted, condition: str, number: int, grips: tuple[GripChange, ...], start: float
) -> Case:
    given = wanted.inputs[number % len(wanted.inputs)]
    arguments = _given(given, wanted.on(), number)
    return Case(condition, _name(given), f"hand {number}", arguments, grips, start)


def _textures(wanted: Wanted) -> Iterator[Case]:
    for low, rms in product(TEXTURE_LOWS, TEXTURE_RMS):
        yield _played(wanted.on(), "textures", f"{low:g} Hz, {rms:g} m/s^2", texture, low, rms)


def _taps(wanted: Wanted) -> Iterator[Case]:
    for peak in TAP_PEAKS:
        yield _played(wanted.on(), "taps", f"taps, {peak:g} m/s^2", taps, peak)


def _recordings(wanted: Wanted) -> Iterator[Case]:
    for around in dict.fromkeys((wanted.on(), wanted.on("paper"))):
        for given, rms in product(wanted.inputs, RECORDING_RMS):
            samples = read_recording(
                given.surface, given.recording_rate, around.rate, given.recording_column
            )
            samples = crossfaded(samples - np.mean(samples), around.rate)
            condition, name = f"recordings, {_rig(around)}", f"{_name(given)}, {rms:g} m/s^2"
            scaled = samples * (rms / np.std(samples))
            yield Case(
                condition, name, "user 0", _given(GraphArguments(), around), recording=scaled
            )


def _played(
    around: GraphArguments,
    condition: str,
    name: str,
    make: Callable[..., FloatArray],
    *values: float,
) -> Case:
    return Case(condition, name, "Table I", around, recording=make(*values, around.rate))


def _modes(wanted: Wanted) -> Iterator[Case]:
    for number, (frequency, damping) in enumerate(product(MODE_FREQUENCIES, MODE_DAMPINGS)):
        mount = {"simulated.mount.frequency": frequency, "simulated.mount.damping": damping}
        given = wanted.inputs[number % len(wanted.inputs)]
        yield Case(
            "unknown modes",
            _name(given),
            f"{frequency:g} Hz, {damping:g}",
            _given(given, wanted.on()),
            start=TOLD,
            changes={"master_device": mount},
        )


CONDITIONS: dict[str, Callable[[Wanted], Iterator[Case]]] = {
    "surfaces": _surfaces,
    "rates": _rates,
    "hands": _hands,
    "wide": _wide,
    "grips": _grips,
    "textures": _textures,
    "taps": _taps,
    "modes": _modes,
    "recordings": _recordings,
}
"""Trials of each condition, without controllers, by name."""

DEFAULT_CONDITIONS = ["surfaces", "hands", "grips"]
"""Conditions of a run without named ones."""


# Trials


def run_case(case: Case) -> Row:
    """Run one trial and evaluate it from `start` on."""
    arguments = replace(case.arguments, duration=DURATION)
    setup = Setup.of(arguments).changed(case.changes)
    rig = setup.rig()
    trial = lockstep_trial(setup, recording=case.recording, grips=case.grips)
    first = round(case.start * trial.rate)
    evaluation = trial.evaluate(first)
    handle = held(rig.master.handle, rig.master.grip, arguments.seed)
    hands = [changed for _, changed in case.grips if isinstance(changed, HandleParameters)]
    handle = hands[-1] if hands else handle
    bound = trial.bounds(rig, handle, first)
    estimator = TravelEstimator(rig.master.handle, trial.rate)
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    travel = [abs(estimator.observe(*pair)) for pair in pairs][first:]
    return {
        "condition": case.condition,
        "rig": arguments.rig,
        "rate_hz": trial.rate,
        "delay_ms": 1e3 * trial.after / trial.rate,
        "input": case.input,
        "grip": case.grip,
        "controller": arguments.controller,
        "nrmse_percent": evaluation.nrmse_percent,
        "nrmse_within_percent": 100.0 * _within(trial, first),
        "slope_desired_on_actual": evaluation.slope_desired_on_actual,
        "r2": evaluation.r2,
        "indistinguishable_percent": 100.0 * trial.indistinguishable(first),
        "bound_percent": bound.causal,
        "limited_bound_percent": bound.limited,
        "nrmse_by_2_s_percent": list(by_window(trial)),
        "warnings": [list(warned) for warned in trial.warnings],
        "force_rms_n": float(np.sqrt(np.mean(trial.actuator_force[first:] ** 2))),
        "travel_peak_mm": 1e3 * max(travel),
    }


def _within(trial: Trial, first: int) -> float:
    """Return the error within `COMPARABLE`, which does not grow with the rate's noise."""
    (error,) = band_nrmse(*trial.compared(first), trial.rate, [COMPARABLE]).values()
    return error


def by_window(trial: Trial) -> Iterator[float | None]:
    """Yield the error of each `WINDOW` of a trial, %; None for a desired acceleration of zero.

    From the first sample on, whatever part is evaluated: a landing is felt, too.
    """
    length = round(WINDOW * trial.rate)
    hop = round(WINDOW_HOP * trial.rate)
    for begin in range(0, len(trial.time) - length + 1, hop):
        try:
            yield trial.evaluate(begin, begin + length).nrmse_percent
        except ValueError:
            yield None


# Results


def summary(rows: Sequence[Row]) -> list[Row]:
    """Return mean and worst error and share, and mean bounds, by condition and controller."""
    idle = {_key(row): row for row in rows if row["controller"] == "none"}
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["condition"], row["controller"]), []).append(row)
    return [
        {
            "condition": condition,
            "controller": controller,
            "mean_percent": fmean(row["nrmse_percent"] for row in found),
            "worst_percent": max(row["nrmse_percent"] for row in found),
            **_shares(found),
            "mean_bound_percent": fmean(row["bound_percent"] for row in found),
            "mean_limited_bound_percent": fmean(row["limited_bound_percent"] for row in found),
            "mean_force_rms_n": fmean(row["force_rms_n"] for row in found),
            "largest_travel_mm": max(row["travel_peak_mm"] for row in found),
            "above_none_points": max(above := _above(found, idle), default=None),
            "windows_above_none_percent": _share_above(above),
            "trials": len(found),
        }
        for (condition, controller), found in groups.items()
    ]


def _shares(rows: Sequence[Row]) -> Row:
    """Return mean and worst share that a hand could not tell, over the trials that have one."""
    every = [row["indistinguishable_percent"] for row in rows]
    found = [share for share in every if math.isfinite(share)] or [math.nan]
    return {
        "mean_indistinguishable_percent": fmean(found),
        "worst_indistinguishable_percent": min(found),
    }


BOUNDS = {"limited_bound": "limited bound", "bound": "bound"}
"""Headings of the bounds by name."""


def tables(lines: Sequence[Row]) -> Iterator[ResultTable]:
    """Yield a summary's errors and shares, and the comparison with none where it was measured."""
    spread = "mean (worst) over inputs and grips"
    yield _table(
        lines,
        f"error of the handle after the delay granted, %: {spread}",
        lambda line: _spread(line, "percent"),
        [*BOUNDS],
    )
    yield _table(
        lines,
        "vibration whose strength a hand could not tell from the desired one, %: " + spread,
        lambda line: _spread(line, "indistinguishable_percent"),
    )
    yield from filter(None, [comparison_with_none(lines)])


def comparison_with_none(lines: Sequence[Row]) -> ResultTable | None:
    """Return the windows that are worse than no control as a table; None without `none`."""
    lines = [line for line in lines if line["above_none_points"] is not None]
    title = (
        f"largest error of any {WINDOW:g} s above that of none, points"
        f" (share of those above {ACCEPTED:g})"
    )

    def cell(line: Row) -> str:
        return f"{line['above_none_points']:+.1f} ({line['windows_above_none_percent']:.1f} %)"

    return _table(lines, title, cell) if lines else None


def _table(
    lines: Sequence[Row], title: str, cell: Callable[[Row], str], bounds: Sequence[str] = ()
) -> ResultTable:
    """Return a table of conditions by controllers, and mean bounds by condition."""
    rows: dict[str, dict[str, Row]] = {}
    for line in lines:
        rows.setdefault(line["condition"], {})[line["controller"]] = line
    controllers = [name for name in CONTROLLERS if any(name in own for own in rows.values())]
    cells = [
        (
            condition,
            *(cell(own[name]) if name in own else "" for name in controllers),
            *(_mean_bound(own.values(), bound) for bound in bounds),
        )
        for condition, own in rows.items()
    ]
    headings = ("condition", *controllers, *(BOUNDS[bound] for bound in bounds))
    return ResultTable(headings, cells, title)


def _spread(line: Row, name: str) -> str:
    return f"{figure(line[f'mean_{name}'], 1)} ({figure(line[f'worst_{name}'], 1)})"


def _mean_bound(lines: Iterable[Row], bound: str) -> str:
    return figure(fmean(line[f"mean_{bound}_percent"] for line in lines), 1)


def progress(row: Row) -> str:
    """Return a trial's error, bounds and share for a reader, and the first warning."""
    told = "".join(f"; {time:.2f} s: {words}" for time, words in row["warnings"][:1])
    return (
        f"{row['condition']}: {row['input']}, {row['grip']}, {row['controller']}:"
        f" {row['nrmse_percent']:.1f} % after {row['delay_ms']:g} ms granted (limited bound"
        f" {figure(row['limited_bound_percent'], 1)}, bound {figure(row['bound_percent'], 1)}),"
        f" {figure(row['indistinguishable_percent'], 1, ' %')} indistinguishable{told}"
    )


def _key(row: Row) -> tuple[str, str, str]:
    """Return the common properties of trials with different controllers."""
    return row["condition"], row["input"], row["grip"]


def _above(rows: Sequence[Row], idle: Mapping[tuple[str, str, str], Row]) -> list[float]:
    """Return the increase of each window's error over no control, points."""
    name = "nrmse_by_2_s_percent"
    return [
        own - without
        for row in rows
        if _key(row) in idle
        for own, without in zip(row[name], idle[_key(row)][name], strict=True)
        if own is not None and without is not None
    ]


def _share_above(increases: Sequence[float]) -> float | None:
    """Return the fraction of increases beyond `ACCEPTED`, %."""
    if not increases:
        return None
    return 100.0 * fmean(increase > ACCEPTED for increase in increases)
