"""``haptic-accel bench fidelity``: tracking error of each controller, beside its lower bound."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import numpy as np

from haptic_accel.cli.experiment import SURFACES
from haptic_accel.cli.options import controllers_option, json_option, verb
from haptic_accel.cli.output import save
from haptic_accel.cli.running import progress_bar
from haptic_accel.cli.tables import print_table
from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import HandleParameters, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import GripChange
from haptic_accel.graph.arguments import RECORDING, GraphArguments
from haptic_accel.graph.lockstep import lockstep_trial
from haptic_accel.graph.processes import graph, graph_parameters, rig_parameters

DURATION = 8.0
"""Length of a trial with one grip, s."""

CHANGED_AT = 1.0
"""Time at which another hand takes the handle, s; until then it is held with Table I's grip."""

SETTLING = 2.0
"""Time that is not evaluated after a change of grip, s."""

USERS = 3
"""Number of users of the paper's rig."""

CHANGES = 10
"""Number of trials in which the grip changes once a second."""

SPREAD = {"m_h": (0.7, 1.3), "k_u": (0.5, 2.0), "b_u": (0.5, 2.0)}
"""Ranges of random hands relative to Table I: mass uniform, the others logarithmically uniform."""


BOUNDS = {"limited_bound": "bound within limits", "bound": "bound"}
"""Headings of the bounds by name."""

Row = dict[str, Any]
"""Metrics of a trial: a row of the JSON file."""


@dataclass(frozen=True)
class Case:
    """One trial.

    Attributes
    ----------
    condition, grip : str
        Names of the condition and of the grip.
    arguments : GraphArguments
        Rig, rate, input, controller and seed.
    grips : tuple of GripChange
    start : float
        Beginning of the evaluated part, s.
    """

    condition: str
    grip: str
    arguments: GraphArguments
    grips: tuple[GripChange, ...] = ()
    start: float = 0.0


@verb()
@controllers_option(CONTROLLERS, default=CONTROLLERS)
@click.option(
    "--recording",
    "recordings",
    multiple=True,
    metavar="FILE",
    help="CSV or WAV file of a tool acceleration, in place of the simulated surfaces; may be given"
    " many times.",
)
@click.option(
    "--recording-rate",
    "recording_rates",
    multiple=True,
    type=float,
    metavar="HZ",
    help="Sampling rate of each CSV file, or once for all, Hz.",
)
@click.option("--hands", type=click.IntRange(0, 1000), default=50, help="Number of random hands.")
@click.option("--seed", default=1, help="Seed of the random hands.")
@json_option
def fidelity(
    *,
    controllers: Sequence[str],
    recordings: Sequence[str],
    recording_rates: Sequence[float],
    hands: int,
    seed: int,
    json_file: Path | None,
) -> None:
    """Measure the tracking error of all controllers in lockstep.

    Runs both rigs at 1 and 4 kHz, with Table I's grip, with many hands, and with grips that
    change. Prints errors beside the lowest that any causal linear filter could reach.
    """
    inputs = _inputs(recordings, recording_rates)
    cases = list(_cases(controllers, inputs, hands, seed))
    for case in cases[:: len(controllers)]:
        graph(case.arguments)  # so that a wrong file is named before all trials
    rows = []
    with ProcessPoolExecutor() as pool, progress_bar() as bar:
        task = bar.add_task("trials", total=len(cases))
        try:
            for row in pool.map(run_case, cases):
                rows.append(row)
                bar.update(task, advance=1, description=row["condition"])
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    summary = _summary(rows)
    _print(summary)
    save({"rows": rows, "summary": summary}, json_file)


def _inputs(recordings: Sequence[str], rates: Sequence[float]) -> list[GraphArguments]:
    """Return a graph for each acceleration that the tool may measure."""
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
        GraphArguments(surface=RECORDING, recording=file, recording_rate=rate)
        for file, rate in zip(recordings, every, strict=True)
    ]


def hand(seed: int, number: int) -> HandleParameters:
    """Return a random hand within the ranges of `SPREAD`."""
    draw = np.random.default_rng((seed, number)).uniform
    factors = {"m_h": draw(*SPREAD["m_h"])}
    factors |= {name: math.exp(draw(*np.log(SPREAD[name]))) for name in ("k_u", "b_u")}
    average = HandleParameters()
    return replace(average, **{name: getattr(average, name) * f for name, f in factors.items()})


def _cases(
    controllers: Sequence[str], inputs: Sequence[GraphArguments], hands: int, seed: int
) -> Iterator[Case]:
    for rig, rate, grips in (
        ("ideal", 1000.0, ["Table I"]),
        ("ideal", 4000.0, ["Table I"]),
        ("paper", 1000.0, [f"user {user}" for user in range(USERS)]),
    ):
        for each, (user, grip), name in product(inputs, enumerate(grips), controllers):
            arguments = replace(each, rig=rig, rate=rate, controller=name, seed=user)
            yield Case(f"{rig}, {rate / 1e3:g} kHz", grip, arguments)
    seconds = range(round(CHANGED_AT), round(DURATION))
    changed = [((CHANGED_AT, hand(seed, number)),) for number in range(hands)]
    changing = [
        tuple((float(second), hand(seed + 1, 100 * number + second)) for second in seconds)
        for number in range(CHANGES if hands else 0)
    ]
    for condition, grip, changes, start in (
        ("hands", "hand", changed, CHANGED_AT + SETTLING),
        ("grip changes every second", "changing", changing, CHANGED_AT),
    ):
        for (number, given), name in product(enumerate(changes), controllers):
            each = inputs[number % len(inputs)]
            arguments = replace(each, rig="ideal", rate=1000.0, controller=name, seed=number)
            yield Case(condition, f"{grip} {number}", arguments, given, start)


def run_case(case: Case) -> Row:
    """Run one trial and evaluate its part from `start` on."""
    arguments = replace(case.arguments, duration=DURATION)
    rig = rig_parameters(graph_parameters(arguments))
    trial = lockstep_trial(arguments, grips=case.grips)
    first = round(case.start * trial.rate)
    evaluation = trial.evaluate(first)
    handle = held(rig.master.handle, rig.master.grip, arguments.seed)
    if case.grips:
        _, handle = case.grips[-1]
    bound = trial.bounds(rig, handle, first)
    travel = TravelEstimator(rig.master.handle, trial.rate)
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    return {
        "condition": case.condition,
        "rig": arguments.rig,
        "rate_hz": trial.rate,
        "delay_ms": 1e3 * trial.after / trial.rate,
        "input": Path(arguments.recording).stem or arguments.surface,
        "grip": case.grip,
        "controller": arguments.controller,
        "nrmse_percent": evaluation.nrmse_percent,
        "slope_desired_on_actual": evaluation.slope_desired_on_actual,
        "r2": evaluation.r2,
        "bound_percent": bound.causal,
        "limited_bound_percent": bound.limited,
        "force_rms_n": float(np.sqrt(np.mean(trial.actuator_force[first:] ** 2))),
        "travel_peak_mm": 1e3 * max([abs(travel.sample(*pair)) for pair in pairs][first:]),
    }


def _summary(rows: Sequence[Row]) -> list[Row]:
    """Return mean and worst error, and mean bound, by condition and controller."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["condition"], row["controller"]), []).append(row)
    return [
        {
            "condition": condition,
            "controller": controller,
            "mean_percent": fmean(row["nrmse_percent"] for row in found),
            "worst_percent": max(row["nrmse_percent"] for row in found),
            "mean_bound_percent": fmean(row["bound_percent"] for row in found),
            "mean_limited_bound_percent": fmean(row["limited_bound_percent"] for row in found),
            "mean_force_rms_n": fmean(row["force_rms_n"] for row in found),
            "largest_travel_mm": max(row["travel_peak_mm"] for row in found),
            "trials": len(found),
        }
        for (condition, controller), found in groups.items()
    ]


def _print(summary: Sequence[Row]) -> None:
    rows: dict[str, list[Row]] = {}
    for line in summary:
        rows.setdefault(line["condition"], []).append(line)
    cells = [
        (
            condition,
            *(f"{one['mean_percent']:.1f} ({one['worst_percent']:.1f})" for one in lines),
            *(f"{fmean(one[f'mean_{bound}_percent'] for one in lines):.1f}" for bound in BOUNDS),
        )
        for condition, lines in rows.items()
    ]
    headings = (
        "condition",
        *dict.fromkeys(line["controller"] for line in summary),
        *BOUNDS.values(),
    )
    title = "error of the handle, %: mean (worst) over inputs and grips"
    print_table(headings, cells, title=title)
