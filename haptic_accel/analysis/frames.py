# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics of bags as data frames, for tables, files and pages, and comparisons of two sides.

CSV output is safe for spreadsheets. These interpret a cell that begins with one of `STARTS` as a
formula, which may run programs or send data, and names in protocols and bags may come from others.
Such texts, and texts that begin with an apostrophe, are prefixed with an apostrophe; removing it
restores the text. Numbers remain unchanged. Lines within a text end with a line feed. See OWASP,
"CSV injection".
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from haptic_accel.analysis.loading import Analysis, analyse
from haptic_accel.analysis.metrics import METRICS, MILLI, VECTOR_METRICS, AnalysedTrial, Shift
from haptic_accel.analysis.segments import Segment, read_segment
from haptic_accel.analysis.traces import named_components
from haptic_accel.core.evaluation import statistics
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II
from haptic_accel.core.parameters import ParameterError

STARTS = (
    *("=", "+", "-", "@", "\t", "\n", "'"),
    *("\N{FULLWIDTH EQUALS SIGN}", "\N{FULLWIDTH PLUS SIGN}"),
    *("\N{FULLWIDTH HYPHEN-MINUS}", "\N{FULLWIDTH COMMERCIAL AT}"),
)
"""First characters of texts that are prefixed with an apostrophe."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", re.ASCII | re.IGNORECASE)


def inert(value: Any) -> Any:
    """Return a cell that spreadsheets do not interpret as a formula.

    Examples
    --------
    >>> inert("=1+1"), inert("-1.5"), inert(-1.5), inert("wood")
    ("'=1+1", '-1.5', -1.5, 'wood')
    """
    if not isinstance(value, str):
        return value
    text = re.sub("\r\n?", "\n", value)  # a carriage return alone would not be quoted
    return f"'{text}" if text.startswith(STARTS) and not _NUMBER.fullmatch(text) else text


def csv_text(frame: pd.DataFrame, separator: str = ",", unknown: str = "") -> str:
    """Return a table as CSV; a named index becomes a column.

    Parameters
    ----------
    frame : DataFrame
    separator, unknown : str
        Text between two cells, and text for an unknown value.
    """
    whole = frame.reset_index() if frame.index.name is not None else frame
    cells = whole.rename(columns=inert)
    for name in cells.columns:
        if not is_numeric_dtype(cells[name]):
            cells[name] = cells[name].map(inert)
    text = cells.to_csv(
        sep=separator, index=False, float_format="%.9g", lineterminator="\n", na_rep=unknown
    )
    return str(text)


AVERAGE = "average"
"""The paper's average over its surfaces, used as a surface of its table."""

PAPER_REGRESSION = {
    "slope_desired_on_actual": {name: slope for name, (slope, _) in REGRESSION.items()},
    "r2": {name: r2 for name, (_, r2) in REGRESSION.items()},
}
"""The paper's averages of the regression over its surfaces, by metric and controller."""

PAPER_SURFACES = frozenset(surface for surface, _ in TABLE_II if surface != AVERAGE)

ORDER = (
    ("none", "constant", "dynamic", "inverse", "feedback", "adaptive"),
    ("plywood", "text", "vinyl"),
)
"""Order of controllers, from the simplest to the best, and of the paper's surfaces."""

_CONDITION = ["controller", "surface"]
_FIRST = ["trial", *_CONDITION, "grip", "pair", "contact"]


def load(*paths: Path | str, shift: str = "granted", apart: bool = False) -> Analysis:
    """Analyse bags.

    Parameters
    ----------
    *paths : Path or str
        Bags, files of bags, or folders to search for bags.
    shift : str
        ``granted`` for latency and granted delay, ``paper`` for one sample, ``measured``, or
        milliseconds.
    apart : bool
        True if the paths are runs to be compared: a trial in several runs then counts in each run.

    Returns
    -------
    Analysis
        Argument of the other functions here; `Analysis.problems` lists missing items.

    Raises
    ------
    ParameterError
        A path does not exist or has no bag, or the shift is malformed.
    """
    return analyse([Path(p) for p in paths], Shift.read(shift), apart=apart)


def trials(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each trial: condition, and all metrics with units in their names."""
    rows = [_row(trial) for trial in analysis.trials]
    return pd.DataFrame(rows, columns=None if rows else _FIRST)


def _row(trial: AnalysedTrial) -> dict[str, Any]:
    segment = trial.segment
    return {
        "trial": _readable(trial.name),
        "controller": trial.controller,
        "surface": trial.surface,
        "grip": segment.condition.grip,
        "pair": ", ".join(segment.pair),
        "contact": trial.contact,
        "bag": _readable(str(segment.bag)),
        "run": segment.run,
        "begin_s": segment.begin,
        "seconds": segment.seconds,
        "rate_Hz": segment.rate,
        "high_pass_Hz": segment.high_pass_frequency,
        "latency_samples": segment.latency,
        "granted_samples": segment.granted_delay,
        "after_samples": round(trial.metrics["shift_ms"] / MILLI * segment.rate, 6),
        **trial.metrics,
        "nrmse_low_percent": trial.error.low,
        "nrmse_high_percent": trial.error.high,
        **{band_column(name): value for name, value in trial.bands.items()},
        "interval": trial.error.method,
        "notes": "; ".join(trial.notes),
    }


def _readable(path: str) -> str:
    """Return a path with ? for undecodable bytes, which pyarrow's tables refuse."""
    return path.encode(errors="replace").decode()


def band_column(band: str) -> str:
    """Return the column name for a band's error, for example ``nrmse_30_60_Hz_percent``."""
    return f"nrmse_{band.replace('-', '_').replace(' ', '_')}_percent"


def vector_metrics(analysis: Analysis) -> list[str]:
    """Return the names of the `VECTOR_METRICS` that at least one trial has."""
    found = {name for trial in analysis.trials for name in trial.metrics}
    return [name for name in VECTOR_METRICS if name in found]


def band_names(analysis: Analysis) -> list[str]:
    """Return the names of all bands."""
    return list(dict.fromkeys(name for trial in analysis.trials for name in trial.bands))


def rank(name: str) -> tuple[int, str]:
    """Return the sort key of a controller or surface."""
    for names in ORDER:
        if name in names:
            return names.index(name), name
    return max(map(len, ORDER)), name


def by_condition(frame: pd.DataFrame) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """Yield controller and surface, and their trials with contact, in the order of `ORDER`."""
    touching = frame[frame.contact.astype(bool)]
    grouped = {(str(c), str(s)): own for (c, s), own in touching.groupby(_CONDITION)}
    yield from sorted(grouped.items(), key=lambda group: ranks(group[0]))


def ranks(condition: tuple[str, str]) -> tuple[tuple[int, str], ...]:
    """Return the sort key of a controller and surface."""
    return tuple(map(rank, condition))


def groups(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each controller and surface, with 95 % intervals over trials.

    The column ``interval`` contains the method of the NRMSE's interval, or the reason for its
    absence. Trials without contact are excluded.
    """
    columns = [*METRICS, *vector_metrics(analysis), *map(band_column, band_names(analysis))]
    rows = []
    for key, own in by_condition(trials(analysis)):
        found = {name: _mean(name, own[name].tolist()) for name in columns}
        row: dict[str, Any] = dict(zip(_CONDITION, key, strict=True)) | {"trials": len(own)}
        row["interval"] = found["nrmse_percent"].method
        for name, interval in found.items():
            row[name] = interval.value
            row[f"{name}_low"], row[f"{name}_high"] = interval.low, interval.high
        rows.append(row)
    return pd.DataFrame(rows, columns=None if rows else _CONDITION)


def _mean(name: str, values: Sequence[float]) -> statistics.Interval:
    """Return the mean of a metric, or of the error in a band, within its range."""
    column = {**METRICS, **VECTOR_METRICS}.get(name, METRICS["nrmse_percent"])
    return statistics.mean_interval(values, within=(column.low, column.high))


# Table II


class Cell(NamedTuple):
    """Error in percent: the value, the ends of its interval, and the paper's value."""

    value: float
    low: float
    high: float
    paper: float | None


@dataclass(frozen=True)
class TableTwo:
    """Table II of the paper, computed from bags.

    Attributes
    ----------
    columns : list of str
        Surfaces, and the average over `common` if there are several.
    common : list of str
        Surfaces with an error for every controller.
    rows : dict
        A cell for each column, by controller.
    counts : dict
        Number of trials of each surface, or its range, by controller.
    methods : str
        Methods of the intervals.
    bounds : dict
        Mean of a bound over a column's trials, by the bound's name; without unknown ones.
    """

    columns: list[str]
    common: list[str]
    rows: dict[str, list[Cell]]
    counts: dict[str, str]
    methods: str
    bounds: dict[str, list[float]]


BOUNDS = ("limited_bound_percent", "bound_percent")
"""Metrics that are bounds of the error, from the higher to the lower."""


def table_two(found: pd.DataFrame) -> TableTwo:
    """Return Table II for groups of trials.

    The average includes only surfaces with an error for every controller, so that controllers are
    comparable. The paper's average is included only if these are the paper's surfaces.
    """
    known = {(row["controller"], row["surface"]): row for row in found.to_dict("records")}
    errors = {key: row["nrmse_percent"] for key, row in known.items()}
    controllers = list(dict.fromkeys(controller for controller, _ in known))
    surfaces = list(dict.fromkeys(surface for _, surface in known))
    common = [
        s
        for s in surfaces
        if all(math.isfinite(errors.get((c, s), math.nan)) for c in controllers)
    ]
    rows = {}
    for controller in controllers:
        cells = []
        for surface in surfaces:
            row = known.get((controller, surface), {})
            value, low, high = (
                row.get(f"nrmse_percent{end}", math.nan) for end in ("", "_low", "_high")
            )
            cells.append(Cell(value, low, high, TABLE_II.get((surface, controller))))
        if len(surfaces) > 1:
            mean = _mean("nrmse_percent", [errors[controller, s] for s in common])
            same = frozenset(common) == PAPER_SURFACES
            paper = TABLE_II.get((AVERAGE, controller)) if same else None
            cells.append(Cell(mean.value, math.nan, math.nan, paper))
        rows[controller] = cells
    return TableTwo(
        surfaces + [AVERAGE] * (len(surfaces) > 1),
        common,
        rows,
        {c: _range([row["trials"] for (own, _), row in known.items() if own == c]) for c in rows},
        "; ".join(dict.fromkeys(row["interval"] for row in known.values())),
        _table_bounds(found, surfaces, common),
    )


def _range(counts: Sequence[int]) -> str:
    """Return the common count, or the range of the counts."""
    return " to ".join(str(each) for each in sorted({min(counts), max(counts)}))


def _table_bounds(
    found: pd.DataFrame, surfaces: Sequence[str], common: Sequence[str]
) -> dict[str, list[float]]:
    """Return each surface's mean bounds over controllers, and for several surfaces their mean."""
    if found.empty:
        return {}
    means = found.groupby("surface")[list(BOUNDS)].mean().reindex(list(surfaces))
    rows = {}
    for name in BOUNDS:
        average = [means[name].reindex(list(common)).mean()] * (len(surfaces) > 1)
        if means[name].notna().any():
            rows[METRICS[name].label] = [*means[name].tolist(), *average]
    return rows


# Further frames for notebooks


def bands(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each trial and band: its NRMSE in percent."""
    rows = [
        (trial.name, trial.controller, trial.surface, band, error)
        for trial in analysis.trials
        for band, error in trial.bands.items()
    ]
    return pd.DataFrame(rows, columns=["trial", *_CONDITION, "band", "nrmse_percent"])


def spectra(analysis: Analysis) -> pd.DataFrame:
    """Return a row for each trial and frequency in Hz: densities in m/s²/√Hz, and coherence."""
    frames = [
        pd.DataFrame({"trial": trial.name, **vars(trial.portrait.spectra)})
        for trial in analysis.trials
        if trial.portrait
    ]
    if not frames:
        return pd.DataFrame()
    return pd.concat(frames, ignore_index=True).rename(columns={"frequency": "frequency_Hz"})


def signals(path: Path | str, number: int = 1) -> pd.DataFrame:
    """Return the samples of one trial of a bag, by time in s.

    Parameters
    ----------
    path : Path or str
        Path of a bag.
    number : int
        Number of the trial within the bag, from 1.

    Returns
    -------
    DataFrame
        Tool, desired and handle acceleration in m/s^2 and actuator force in N, if recorded, by
        topic name. Several axes have a column each, as in ``slave/tool/acceleration_x``.

    Raises
    ------
    ParameterError
        The path is not a bag, or the bag has no such trial.
    """
    return segment_signals(read_segment(Path(path), number))


def segment_signals(segment: Segment) -> pd.DataFrame:
    """Return the samples of a segment by time in s."""
    length = max(map(len, segment.signals.values()))
    time = pd.Index(np.arange(length) / segment.rate, name="time_s")
    return pd.DataFrame(dict(named_components(segment.signals, segment.axes)), index=time)


RUNS = "runs"
"""Comparison of the trials at a first and a second path."""

CONTROLLERS = "controller:"
"""Prefix of two controller names separated by a comma."""


_TESTED = ("effect", "t", "p_t", "p_wilcoxon", "verdict")
"""Fields of `PairedDifference` with the same name in tables and files."""


@dataclass(frozen=True)
class Comparison:
    """Result of comparing two controllers or runs.

    Attributes
    ----------
    first, second : str
        Names of the two sides.
    pairs : DataFrame
        A row for each pair of trials that differ only in the compared property: ``key``, their
        common properties; ``surface``; NRMSE of each side in percent, ``first`` and ``second``.
    unpaired : list of str
        Names of trials without a counterpart or without an error.
    differences : dict of PairedDifference
        Difference of the NRMSE in percent, second minus first, over ``all`` pairs. For several
        surfaces, also over each surface's pairs.
    """

    first: str
    second: str
    pairs: pd.DataFrame
    unpaired: list[str]
    differences: dict[str, statistics.PairedDifference]

    @property
    def frame(self) -> pd.DataFrame:
        """Table with the difference over all surfaces, and for each surface."""
        return pd.DataFrame(
            {
                "first": self.first,
                "second": self.second,
                "surface": surface,
                "pairs": found.n,
                "difference_percent": found.mean.value,
                "low_percent": found.mean.low,
                "high_percent": found.mean.high,
                **{name: getattr(found, name) for name in _TESTED},
            }
            for surface, found in self.differences.items()
        )


def check_comparison(comparison: str, paths: Sequence[Path]) -> None:
    """Reject an impossible comparison before reading bags.

    Raises
    ------
    ParameterError
        The comparison is neither ``runs`` nor ``controller:A,B``, or there are not two runs.
    """
    if comparison == RUNS:
        if len(paths) != 2:
            raise ParameterError(
                f"compare: needs two bags or folders to compare, not {len(paths)}"
            )
        return
    names = comparison.removeprefix(CONTROLLERS).split(",")
    right = comparison.startswith(CONTROLLERS) and len(names) == 2 and all(names)
    if not right or names[0] == names[1]:
        raise ParameterError(
            f"compare = {comparison!r}: leave out to compare two bags or folders, or give two"
            f" controllers: {CONTROLLERS}A,B"
        )


def compared(analysis: Analysis, comparison: str, paths: Sequence[Path] = ()) -> Comparison:
    """Pair trials and test the difference of their errors.

    Two trials form a pair if they have the same surface, grip, and seed or recording; for two runs
    also the same controller. Several of the same kind are paired in their order. If each run has
    one trial, these trials form a pair.

    Parameters
    ----------
    analysis : Analysis
    comparison : str
        ``runs``, or ``controller:A,B``.
    paths : sequence of Path
        Paths specified by the user; for ``runs``, the two to compare.

    Raises
    ------
    ParameterError
        The comparison does not exist.
    """
    check_comparison(comparison, paths)
    frame = trials(analysis)
    key = frame.surface + ", grip " + frame.grip + ", " + frame["pair"]
    if comparison == RUNS:
        sources = np.array([str(trial.source) for trial in analysis.trials])
        names = [str(path) for path in paths]
        sides = [frame.assign(key=key + ", " + frame.controller)[sources == n] for n in names]
        if all(len(side) == 1 for side in sides):
            sides = [side.assign(key="the only trial") for side in sides]
    else:
        names = comparison.removeprefix(CONTROLLERS).split(",")
        sides = [frame.assign(key=key)[frame.controller == name] for name in names]
    errors = [_errors(side, name) for side, name in zip(sides, ("first", "second"), strict=True)]
    pairs = errors[0].merge(errors[1].drop(columns="surface"), on="key").dropna()
    paired = {*pairs.trial_first, *pairs.trial_second}
    surfaces = list(dict.fromkeys(pairs.surface)) if pairs.surface.nunique() > 1 else []
    parts = {"all": pairs} | {surface: pairs[pairs.surface == surface] for surface in surfaces}
    unpaired = [name for side in sides for name in side.trial if name not in paired]
    differences = {
        surface: statistics.paired_difference(part["first"].tolist(), part["second"].tolist())
        for surface, part in parts.items()
    }
    return Comparison(names[0], names[1], pairs, unpaired, differences)


def _errors(side: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return trials and errors of one side; repeated keys have a number appended."""
    again = side.groupby("key").cumcount() + 1
    numbered = [k if n == 1 else f"{k} ({n})" for k, n in zip(side.key, again, strict=True)]
    return pd.DataFrame(
        {
            "key": numbered,
            "surface": side.surface.tolist(),
            f"trial_{name}": side.trial.tolist(),
            name: side.get("nrmse_percent", pd.Series(dtype=float)).tolist(),
        }
    )


def compare(analysis: Analysis, comparison: str, paths: Sequence[Path] = ()) -> pd.DataFrame:
    """Test two controllers or runs; return a row for all surfaces, and one per surface.

    See `compared` for the parameters.
    """
    return compared(analysis, comparison, paths).frame
