"""``haptic-accel bench fidelity``: tracking error of each controller, beside its lower bound."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from haptic_accel.cli.experiment import SURFACES
from haptic_accel.cli.options import Verb, controllers_option, json_option
from haptic_accel.cli.output import save
from haptic_accel.cli.running import progress_bar
from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.control.inversion import Plant, causal_bound, measured_spectrum
from haptic_accel.core.model import HandleParameters, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE
from haptic_accel.core.trial import GripChange, RigParameters, Trial
from haptic_accel.devices.simulated import played
from haptic_accel.graph.arguments import RECORDING, GraphArguments
from haptic_accel.graph.lockstep import lockstep_trial
from haptic_accel.graph.processes import graph_parameters, rig_parameters

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


@dataclass(frozen=True)
class Input:
    """Acceleration that the tool measures.

    Attributes
    ----------
    name : str
    surface : str
        Simulated surface, or `RECORDING`.
    file : str
        Recording, if it is one.
    rate : float
        Sampling rate of the file, Hz.
    """

    name: str
    surface: str
    file: str = ""
    rate: float = 0.0


@dataclass(frozen=True)
class Case:
    """One trial.

    Attributes
    ----------
    condition, rig : str
    rate : float
        Sampling rate, Hz.
    input : Input
    grip : str
        Name of the grip.
    controller : str
    seed : int
    grips : tuple of GripChange
    start : float
        Beginning of the evaluated part, s.
    """

    condition: str
    rig: str
    rate: float
    input: Input
    grip: str
    controller: str
    seed: int = 0
    grips: tuple[GripChange, ...] = ()
    start: float = 0.0

    @property
    def arguments(self) -> GraphArguments:
        """Arguments of the graph that describe the rig."""
        recorded = {}
        if self.input.file:
            recorded = {"recording": self.input.file, "recording_rate": self.input.rate}
        return GraphArguments(
            rig=self.rig,
            rate=self.rate,
            surface=self.input.surface,
            controller=self.controller,
            seed=self.seed,
            **recorded,  # type: ignore[arg-type]
        )


@dataclass(frozen=True)
class Row:
    """Metrics of a trial: a row of the JSON file."""

    condition: str
    rig: str
    rate_hz: float
    delay_ms: float
    input: str
    grip: str
    controller: str
    nrmse_percent: float
    slope_desired_on_actual: float
    r2: float
    bound_percent: float
    force_rms_n: float
    travel_peak_mm: float


@click.command(cls=Verb)
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
@click.option("--hands", type=int, default=50, help="Number of random hands.")
@click.option("--seed", type=int, default=1, help="Seed of the random hands.")
@json_option
def fidelity(
    *,
    controllers: Sequence[str],
    recordings: Sequence[str],
    recording_rates: Sequence[float],
    hands: int,
    seed: int,
    json_file: Path | None,
) -> int:
    """Measure the tracking error of all controllers in lockstep.

    Runs both rigs at 1 and 4 kHz, with Table I's grip, with many hands, and with grips that
    change. Prints errors beside the lowest that any causal linear filter could reach.
    """
    if not 0 <= hands <= 1000:
        raise ParameterError(f"hands = {hands}: must be from 0 to 1000")
    inputs = _inputs(recordings, recording_rates)
    cases = list(_cases(controllers, inputs, hands, seed))
    for case in cases[:: len(controllers)]:  # so that a wrong file is named before all trials
        values = graph_parameters(case.arguments)
        played(rig_parameters(values).slave.recording, case.rate)  # type: ignore[attr-defined]
    rows = _run_all(cases)
    summary = _summary(rows)
    console = Console()
    console.print(_table(summary))
    save({"rows": [asdict(row) for row in rows], "summary": summary}, json_file)
    return DONE


def _inputs(recordings: Sequence[str], rates: Sequence[float]) -> list[Input]:
    if not recordings:
        return [Input(surface, surface) for surface in SURFACES]
    every = list(rates) or [0.0]
    if len(every) == 1:
        every *= len(recordings)
    if len(every) != len(recordings):
        raise ParameterError(
            f"recording_rate: given {len(rates)} times, must be once or for each of"
            f" {len(recordings)} recordings"
        )
    return [
        Input(Path(file).stem, RECORDING, file, rate)
        for file, rate in zip(recordings, every, strict=True)
    ]


def hand(seed: int, number: int, average: HandleParameters) -> HandleParameters:
    """Return a random hand within the ranges of `SPREAD`."""
    draw = np.random.default_rng((seed, number)).uniform
    m_h = draw(*SPREAD["m_h"])
    k_u, b_u = (math.exp(draw(*np.log(SPREAD[name]))) for name in ("k_u", "b_u"))
    return replace(average, m_h=average.m_h * m_h, k_u=average.k_u * k_u, b_u=average.b_u * b_u)


def _cases(
    controllers: Sequence[str], inputs: Sequence[Input], hands: int, seed: int
) -> Iterator[Case]:
    for condition, rig, rate, grips in (
        ("ideal, 1 kHz", "ideal", 1000.0, ["Table I"]),
        ("ideal, 4 kHz", "ideal", 4000.0, ["Table I"]),
        ("paper, 1 kHz", "paper", 1000.0, [f"user {user}" for user in range(USERS)]),
    ):
        for each, (user, grip), name in product(inputs, enumerate(grips), controllers):
            yield Case(condition, rig, rate, each, grip, name, user)

    def other(draw: int, number: int) -> HandleParameters:
        return hand(draw, number, HandleParameters())

    seconds = range(round(CHANGED_AT), round(DURATION))
    changed = [((CHANGED_AT, other(seed, number)),) for number in range(hands)]
    changing = [
        tuple((float(second), other(seed + 1, 100 * number + second)) for second in seconds)
        for number in range(CHANGES if hands else 0)
    ]
    for condition, grip, changes, start in (
        ("hands", "hand", changed, CHANGED_AT + SETTLING),
        ("grip changes every second", "changing", changing, CHANGED_AT),
    ):
        for (number, given), name in product(enumerate(changes), controllers):
            each = inputs[number % len(inputs)]
            label = f"{grip} {number}"
            yield Case(condition, "ideal", 1000.0, each, label, name, number, given, start)


def _run_all(cases: Sequence[Case]) -> list[Row]:
    rows = []
    with ProcessPoolExecutor() as pool, progress_bar() as bar:
        task = bar.add_task("trials", total=len(cases))
        try:
            for row in pool.map(run_case, cases):
                rows.append(row)
                bar.update(task, advance=1, description=row.condition)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return rows


def run_case(case: Case) -> Row:
    """Run one trial and evaluate its part from `start` on."""
    arguments = replace(case.arguments, duration=DURATION)
    rig = rig_parameters(graph_parameters(arguments))
    trial = lockstep_trial(arguments, grips=case.grips)
    first = round(case.start * case.rate)
    evaluation = trial.evaluate(first)
    return Row(
        case.condition,
        case.rig,
        case.rate,
        1e3 / case.rate,
        case.input.name,
        case.grip,
        case.controller,
        evaluation.nrmse_percent,
        evaluation.slope_desired_on_actual,
        evaluation.r2,
        _bound(case, rig, trial, first),
        float(np.sqrt(np.mean(trial.actuator_force[first:] ** 2))),
        _largest_travel(rig, trial, first),
    )


def _bound(case: Case, rig: RigParameters, trial: Trial, first: int) -> float:
    """Return the lowest error that a causal linear filter could reach with this grip, percent."""
    master = rig.master
    handle = case.grips[-1][1] if case.grips else held(master.handle, master.grip, case.seed)
    plant = Plant(handle, master.mount, master.drive.delay, master.accelerometer.bandwidth)
    spectrum = measured_spectrum(trial.tool_acceleration[first:], trial.rate)
    return causal_bound(
        plant,
        trial.rate,
        spectrum,
        noise=master.accelerometer.noise,
        high_pass_frequency=trial.high_pass_frequency,
    )


def _largest_travel(rig: RigParameters, trial: Trial, first: int) -> float:
    """Return the largest travel of the actuator, mm."""
    handle = rig.master.handle
    estimator = TravelEstimator(handle, trial.rate)
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    return 1e3 * max([abs(estimator.sample(*pair)) for pair in pairs][first:])


def _summary(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return mean and worst error, and mean bound, by condition and controller."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.condition, row.controller), []).append(row)
    return [
        {
            "condition": condition,
            "controller": controller,
            "mean_percent": fmean(row.nrmse_percent for row in found),
            "worst_percent": max(row.nrmse_percent for row in found),
            "mean_bound_percent": fmean(row.bound_percent for row in found),
            "mean_force_rms_n": fmean(row.force_rms_n for row in found),
            "largest_travel_mm": max(row.travel_peak_mm for row in found),
            "trials": len(found),
        }
        for (condition, controller), found in groups.items()
    ]


def _table(summary: Sequence[dict[str, Any]]) -> Table:
    controllers = list(dict.fromkeys(line["controller"] for line in summary))
    table = Table(title="error of the handle, %: mean (worst) over inputs and grips")
    table.add_column("condition")
    for name in (*controllers, "bound"):
        table.add_column(name, justify="right")
    for condition in dict.fromkeys(line["condition"] for line in summary):
        lines = {line["controller"]: line for line in summary if line["condition"] == condition}
        cells = [
            f"{lines[name]['mean_percent']:.1f} ({lines[name]['worst_percent']:.1f})"
            for name in controllers
        ]
        bound = fmean(line["mean_bound_percent"] for line in lines.values())
        table.add_row(condition, *cells, f"{bound:.1f}")
    return table
