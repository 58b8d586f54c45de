"""The figures of trials and of groups as rows, the same for every output."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from haptic_accel.analysis.loading import AnalysedTrial
from haptic_accel.analysis.measures import PERCENT, Fidelity, Measures
from haptic_accel.core.evaluation.statistics import Interval, mean_interval

MILLI, MICRO = 1e3, 1e6
"""Milliseconds, millimetres or microseconds in the SI unit."""


@dataclass(frozen=True)
class Figure:
    """One figure of a trial.

    Attributes
    ----------
    label, unit : str
        For a reader.
    digits : int
        After the point.
    of : callable
        Returns it from the measures of a trial; NaN where it is not known.
    """

    label: str
    unit: str
    digits: int
    of: Callable[[Measures], float]


def _of_fidelity(get: Callable[[Fidelity], float]) -> Callable[[Measures], float]:
    return lambda measures: get(measures.fidelity) if measures.fidelity else math.nan


def _of_perception(name: str) -> Callable[[Measures], float]:
    def get(fidelity: Fidelity) -> float:
        return float(getattr(fidelity.perception, name)) if fidelity.perception else math.nan

    return _of_fidelity(get)


def _of_force(name: str, scale: float = 1.0) -> Callable[[Measures], float]:
    return lambda m: scale * float(getattr(m.force, name)) if m.force else math.nan


def _of_latency(name: str) -> Callable[[Measures], float]:
    return lambda m: MICRO * float(getattr(m.latency, name)) if m.latency else math.nan


def _of_age(label: str) -> Callable[[Measures], float]:
    return lambda m: m.stretch.delivery.age_us.get(label, math.nan)


FIGURES: Mapping[str, Figure] = {
    "nrmse_percent": Figure("NRMSE", "%", 1, _of_fidelity(lambda f: PERCENT * f.nrmse.value)),
    "slope_desired_on_actual": Figure(
        "slope, desired on actual",
        "",
        2,
        _of_fidelity(lambda f: f.evaluation.slope_desired_on_actual),
    ),
    "slope_actual_on_desired": Figure(
        "slope, actual on desired",
        "",
        2,
        _of_fidelity(lambda f: f.evaluation.slope_actual_on_desired),
    ),
    "r2": Figure("R²", "", 2, _of_fidelity(lambda f: f.evaluation.r2)),
    "delay_ms": Figure("delay", "ms", 3, _of_fidelity(lambda f: MILLI * f.delay.seconds)),
    "delay_correlation": Figure(
        "correlation at it", "", 2, _of_fidelity(lambda f: f.delay.correlation)
    ),
    "shift_ms": Figure("shift", "ms", 3, _of_fidelity(lambda f: MILLI * f.shift)),
    "st_sim": Figure("ST-SIM", "", 3, _of_perception("st_sim")),
    "spqi": Figure("SPQI", "", 3, _of_perception("spqi")),
    "force_rms_N": Figure("force RMS", "N", 2, _of_force("rms")),
    "force_peak_N": Figure("force peak", "N", 2, _of_force("peak")),
    "travel_mm": Figure("travel used", "mm", 2, _of_force("travel", MILLI)),
    "latency_p50_us": Figure("latency p50", "µs", 0, _of_latency("p50")),
    "latency_p99_us": Figure("latency p99", "µs", 0, _of_latency("p99")),
    "latency_max_us": Figure("latency max", "µs", 0, _of_latency("largest")),
    "age_p50_us": Figure("age p50", "µs", 0, _of_age("p50")),
    "age_p99_us": Figure("age p99", "µs", 0, _of_age("p99")),
    "age_max_us": Figure("age max", "µs", 0, _of_age("max")),
    "lost": Figure("lost", "", 0, lambda m: float(sum(m.stretch.delivery.lost.values()))),
    "late": Figure("late", "", 0, lambda m: float(sum(m.stretch.delivery.late.values()))),
}
"""By name with unit, as columns of files have it."""


@dataclass(frozen=True)
class Group:
    """The trials of one controller on one surface."""

    controller: str
    surface: str
    trials: tuple[AnalysedTrial, ...]

    def interval(self, name: str) -> Interval:
        """Return a figure of the group with its interval: over trials, or within the only one."""
        if name == "nrmse_percent" and len(self.trials) == 1:
            fidelity = self.trials[0].measures.fidelity
            if fidelity:
                own = fidelity.nrmse
                ends = PERCENT * own.value, PERCENT * own.low, PERCENT * own.high
                return Interval(*ends, own.n, own.method)
        return mean_interval([FIGURES[name].of(t.measures) for t in self.trials])

    def bands(self) -> dict[str, Interval]:
        """Return the error in percent by band."""
        found = [t.measures.fidelity.bands for t in self.trials if t.measures.fidelity]
        names = dict.fromkeys(name for bands in found for name in bands)
        return {
            name: mean_interval([PERCENT * bands.get(name, math.nan) for bands in found])
            for name in names
        }

    def typical(self) -> AnalysedTrial:
        """Return the trial whose error is nearest the median: the one to be shown."""
        errors = [FIGURES["nrmse_percent"].of(t.measures) for t in self.trials]
        order = sorted(range(len(errors)), key=lambda i: (math.isnan(errors[i]), errors[i]))
        known = sum(not math.isnan(error) for error in errors)
        return self.trials[order[max(known - 1, 0) // 2]]


def groups(trials: Sequence[AnalysedTrial]) -> list[Group]:
    """Sort trials by controller and surface, in the order of `ORDER` as far as named there."""
    keys = dict.fromkeys((trial.controller, trial.surface) for trial in trials)
    return [
        Group(
            controller,
            surface,
            tuple(t for t in trials if (t.controller, t.surface) == (controller, surface)),
        )
        for controller, surface in sorted(keys, key=lambda key: (rank(key[0]), rank(key[1])))
    ]


ORDER = (
    ("none", "constant", "dynamic", "inverse", "feedback", "adaptive"),
    ("plywood", "text", "vinyl"),
)
"""Controllers from the plainest to the best, and the paper's surfaces in its order."""


def rank(name: str) -> tuple[int, str]:
    """Return by what controllers, and surfaces, are ordered."""
    for names in ORDER:
        if name in names:
            return names.index(name), name
    return max(map(len, ORDER)), name


def trial_row(trial: AnalysedTrial) -> dict[str, Any]:
    """Return all figures of a trial by column; NaN where there is none."""
    measures, stretch = trial.measures, trial.measures.stretch
    fidelity = measures.fidelity
    low, high = (fidelity.nrmse.low, fidelity.nrmse.high) if fidelity else (math.nan, math.nan)
    return {
        "trial": trial.name,
        "controller": trial.controller,
        "surface": trial.surface,
        "grip": stretch.condition.grip,
        "pair": ", ".join(stretch.pair),
        "bag": str(stretch.bag),
        "begin_s": stretch.begin,
        "seconds": stretch.seconds,
        "rate_Hz": stretch.rate,
        "high_pass_Hz": stretch.high_pass_frequency,
        **{name: figure.of(measures) for name, figure in FIGURES.items()},
        "nrmse_low_percent": PERCENT * low,
        "nrmse_high_percent": PERCENT * high,
        **{
            band_column(name): PERCENT * value
            for name, value in (fidelity.bands.items() if fidelity else ())
        },
        "notes": "; ".join(measures.notes),
    }


def group_row(group: Group) -> dict[str, Any]:
    """Return all figures of a group by column, each with the ends of its interval."""
    row: dict[str, Any] = {
        "controller": group.controller,
        "surface": group.surface,
        "trials": len(group.trials),
        "interval": group.interval("nrmse_percent").method,
    }
    for name in FIGURES:
        row |= _columns(name, group.interval(name))
    for name, interval in group.bands().items():
        row |= _columns(band_column(name), interval)
    return row


def _columns(name: str, interval: Interval) -> dict[str, float]:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}


def band_column(band: str) -> str:
    """Return the column of a band's error, as ``nrmse_30_60_Hz_percent``."""
    return f"nrmse_{band.replace('-', '_').replace(' ', '_')}_percent"
