"""``haptic-accel experiment``: the paper's nine conditions, live or in lockstep."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from haptic_accel.analysis.experiment_report import write_report
from haptic_accel.bags.trials import SIGNALS, Delivery, read_trial
from haptic_accel.cli.options import (
    Verb,
    json_option,
    listed,
    listed_words,
    out_option,
    word_options,
    words,
)
from haptic_accel.cli.output import check_writable, make_folder
from haptic_accel.cli.running import StopOnSignal, conclude
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II, Evaluation, evaluate
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, FAILED, INTERRUPTED
from haptic_accel.core.trial import Trial, run_trial
from haptic_accel.devices.simulated import played
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.node_parameters import node_parameters
from haptic_accel.graph.processes import SIMULATED, graph, graph_parameters, rig_parameters
from haptic_accel.graph.supervisor import Supervisor

SURFACES = ("plywood", "text", "vinyl")
"""The paper's surfaces."""

PAPER_CONTROLLERS = ("none", "constant", "dynamic")
"""The paper's conditions."""

MOST_SEEDS = 1000

DURATION = 10.0
"""Default length of a condition, s."""

AROUND = 4.0
"""What starting and stopping the graph takes, s: an estimate, for the time left."""

REFRESH = 2.0
"""How often the progress bar is drawn, Hz: drawing takes a core from the graph it waits for."""

LOST_SHARE = 0.01
"""Share of a signal's samples that may be missing before the reader is warned."""

LOCKSTEP_NOTE = (
    "Every condition ran in lockstep: no ROS, no clock, the same numbers for the same seed."
)
LIVE_NOTE = (
    "Every condition ran through the live graph, five processes on ROS 2, and was read back "
    "from the bag it recorded."
)
RIG_NOTES = {
    "ideal": "The simulated rig is eq. (1) to (3) of the paper with Table I and nothing else: it "
    "has none of the structure, friction and timing of a real rig, so that constant and dynamic "
    "come out below the paper's errors. The order of the controllers is what to compare, not "
    "the value of a cell.",
    "paper": "The simulated rig is eq. (1) to (3) of the paper with Table I and, besides, "
    "structure, delay, friction, gravity, sensors and users as a real one has; four of its "
    "numbers, and three of its surfaces', are fitted to the paper's table in lockstep "
    "(docs/virtual_rig.md). The live graph "
    "adds the age of its forces, which is part of the delay there.",
}
AVERAGE_NOTE = (
    "The paper's averages are its own; the plain means of its three surfaces are 80.9 % for "
    "constant and 73.7 % for dynamic."
)


@dataclass(frozen=True)
class Condition:
    """One surface under one controller, and what came of it.

    Attributes
    ----------
    trial : Trial
        The signals.
    evaluation : Evaluation
        The paper's figures of them.
    seed : int
        Of texture, noise and user.
    delivery : Delivery or None
        How samples travelled; None in lockstep.
    bag : Path or None
        Where they were recorded.
    """

    trial: Trial
    evaluation: Evaluation
    seed: int = 0
    delivery: Delivery | None = None
    bag: Path | None = None

    @property
    def age_us(self) -> dict[str, float] | None:
        """Age of the forces where applied, us: p50, p99, max."""
        return self.delivery.age_us if self.delivery else None

    @property
    def lost(self) -> dict[str, int] | None:
        """Samples lost, by topic."""
        return self.delivery.lost if self.delivery else None

    @property
    def late(self) -> dict[str, int] | None:
        """Samples late, by topic."""
        return self.delivery.late if self.delivery else None

    def figures(self) -> dict[str, Any]:
        """Return the condition's figures for a JSON file; what is undefined is null."""
        figures: dict[str, Any] = {
            "surface": self.trial.surface,
            "controller": self.trial.controller,
            "seed": self.seed,
            **{key: _defined(value) for key, value in asdict(self.evaluation).items()},
            "seconds": self.trial.seconds,
        }
        if self.delivery:
            figures |= {"age_us": self.age_us, "lost": self.lost, "late": self.late}
            figures["missed"] = self.delivery.missed
        return figures


class StopRequestedError(Exception):
    """The user asked to stop."""


class GraphFailedError(Exception):
    """The graph of a condition failed, which has been shown; its exit status."""

    def __init__(self, status: int) -> None:
        super().__init__(f"status {status}")
        self.status = status


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel experiment --lockstep",
        "haptic-accel experiment --lockstep --seeds 8 --controllers none,dynamic,inverse",
        "haptic-accel experiment surface:=text duration:=5",
    ],
)
@words(GraphArguments)
@click.option(
    "--lockstep", is_flag=True, help="Run without ROS, faster than real time and repeatable."
)
@click.option(
    "--controllers",
    type=listed_words,
    default=listed(PAPER_CONTROLLERS),
    metavar="NAME,NAME,...",
    help=f"Controllers to compare, among {', '.join(CONTROLLERS)}.",
)
@word_options(["rig", "rate", "grip", "recording", "recording_rate"])
@click.option(
    "--seeds", type=int, default=1, help="Number of users and pieces of material, in lockstep."
)
@json_option
@out_option
def experiment(
    words: Sequence[str],
    *,
    lockstep: bool,
    json_file: Path | None,
    out: Path | None,
    seeds: int,
    controllers: Sequence[str],
) -> int:
    """Run the paper's three surfaces under its three controllers.

    Prints Table II beside the paper's, and writes a report with its figures 9, 10 and 11.
    surface and controller restrict the conditions; duration is that of one condition, 10 s by
    default. --recording selects surface:=recording.
    """
    arguments = _with_duration(words)
    _check_seeds(seeds, lockstep)
    _check_devices(arguments, lockstep)
    plan = _plan(words, arguments, seeds, controllers)
    for planned in plan:
        graph(planned)  # everything that can be wrong is found before anything runs
    folder = out or Path("results") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}"
    make_folder(folder)
    if json_file:
        check_writable(json_file)
    done: list[Condition] = []
    status = DONE
    console = Console()
    try:
        with StopOnSignal() as stop:
            for condition in _run_all(plan, lockstep, folder, stop, console):
                done.append(condition)
    except StopRequestedError:
        status = INTERRUPTED
        print(f"interrupted after {len(done)} of {len(plan)} conditions", file=sys.stderr)
    except GraphFailedError as failure:
        status = failure.status
    except ParameterError as error:
        # A bag that cannot be read; what was done before is not lost with it.
        status = FAILED
        print(f"haptic-accel: {error}", file=sys.stderr)
    if done:
        _conclude(done, arguments, lockstep, folder, json_file, console)
    return status


def _check_seeds(seeds: int, lockstep: bool) -> None:
    if not 1 <= seeds <= MOST_SEEDS:
        raise ParameterError(f"seeds = {seeds}: must be from 1 to {MOST_SEEDS}")
    if seeds > 1 and not lockstep:
        raise ParameterError(f"seeds = {seeds}: more than one only with --lockstep")


def _check_devices(arguments: GraphArguments, lockstep: bool) -> None:
    for arm, device in (("master", arguments.master), ("slave", arguments.slave)):
        if lockstep and device != SIMULATED:
            raise ParameterError(f"{arm} = {device!r}: must be {SIMULATED} with --lockstep")


def _with_duration(words: Sequence[str]) -> GraphArguments:
    arguments = parse_arguments(words)
    if not any(word.startswith("duration:=") for word in words):
        return replace(arguments, duration=DURATION)
    if arguments.duration < 1:
        raise ParameterError(
            f"duration = {arguments.duration:g}: must be at least 1 s in an experiment"
        )
    return arguments


def _plan(
    words: Sequence[str], arguments: GraphArguments, seeds: int, controllers: Sequence[str]
) -> list[GraphArguments]:
    """Return the arguments of every condition; bags are named later."""
    for key in ("bag", "record"):
        if any(word.startswith(f"{key}:=") for word in words):
            raise ParameterError(f"{key}: not for an experiment, which records in its folder")
    surfaces = _restricted(words, "surface", arguments.surface, SURFACES)
    for name in controllers:
        if name not in CONTROLLERS:
            known = ", ".join(CONTROLLERS)
            raise ParameterError(f"controllers = {name!r}: must be among {known}")
    controllers = _restricted(words, "controller", arguments.controller, controllers)
    return [
        replace(arguments, surface=surface, controller=controller, seed=arguments.seed + seed)
        for seed in range(seeds)
        for surface in surfaces
        for controller in controllers
    ]


def _restricted(words: Sequence[str], key: str, given: str, every: Sequence[str]) -> list[str]:
    return [given] if any(word.startswith(f"{key}:=") for word in words) else list(every)


def _run_all(
    plan: Sequence[GraphArguments],
    lockstep: bool,
    folder: Path,
    stop: Callable[[], bool],
    console: Console,
) -> Iterator[Condition]:
    """Run one condition after the other, with a bar that says which and how long is left."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console, refresh_per_second=REFRESH) as progress:
        bar = progress.add_task("", total=len(plan))
        for index, arguments in enumerate(plan):
            name = f"{Path(arguments.surface).stem} / {arguments.controller}"
            name += f" / seed {arguments.seed}"
            label = f"{index + 1} of {len(plan)}: {name}"
            progress.update(bar, description=label, completed=index)
            if not console.is_terminal:
                console.print(label)

            def asked(index: int = index, started: float = time.monotonic()) -> bool:
                part = (time.monotonic() - started) / (arguments.duration + AROUND)  # noqa: B023
                progress.update(bar, completed=index + min(part, 1.0))
                return stop()

            yield run_lockstep(arguments) if lockstep else _run_live(arguments, folder, asked)
            if stop():
                raise StopRequestedError
        progress.update(bar, completed=len(plan), description="done")


def run_lockstep(arguments: GraphArguments) -> Condition:
    """Run one condition without ROS."""
    values = graph_parameters(arguments)
    rig = rig_parameters(values)
    around, controllers = node_parameters("compensator", values["compensator"])
    trial = run_trial(
        arguments.controller,
        rig,
        duration=arguments.duration,
        rate=arguments.rate,
        seed=arguments.seed,
        recording=played(rig.slave.recording, arguments.rate),  # type: ignore[attr-defined]
        compensation=around,
        controllers=controllers,
    )
    return Condition(trial, _evaluated(trial), arguments.seed)


def _run_live(arguments: GraphArguments, folder: Path, stop: Callable[[], bool]) -> Condition:
    surface = Path(arguments.surface).stem
    bag = folder / "bags" / f"{surface}_{arguments.controller}"
    arguments = replace(arguments, bag=str(bag))
    outcome = Supervisor(graph(arguments)).run(stop)
    if not outcome.first:
        raise StopRequestedError
    status = conclude(outcome)
    if status != DONE:
        raise GraphFailedError(status)
    around, _ = node_parameters("compensator", graph_parameters(arguments)["compensator"])
    trial, delivery = read_trial(
        bag, surface, arguments.controller, arguments.rate, around.high_pass_frequency
    )
    return Condition(trial, _evaluated(trial), arguments.seed, delivery, bag)


def _evaluated(trial: Trial) -> Evaluation:
    """Evaluate a trial with the paper's shift of one sample."""
    return evaluate(
        trial.desired_acceleration, trial.actual_acceleration, trial.rate, 1 / trial.rate
    )


def _conclude(
    done: Sequence[Condition],
    arguments: GraphArguments,
    lockstep: bool,
    folder: Path,
    json_file: Path | None,
    console: Console,
) -> None:
    seeds = list(dict.fromkeys(condition.seed for condition in done))
    notes = [LOCKSTEP_NOTE if lockstep else LIVE_NOTE, AVERAGE_NOTE]
    notes += [RIG_NOTES[arguments.rig]] if arguments.rig in RIG_NOTES else []
    if len(seeds) > 1:
        notes.append(f"Shown is seed {seeds[0]} of {len(seeds)}; the file of figures has all.")
    warnings = _warnings(done)
    notes += warnings
    index = write_report(
        [condition for condition in done if condition.seed == seeds[0]],
        folder,
        title="Haptic display of tool contact: the paper's experiment",
        settings=_settings(arguments, lockstep),
        paper_table=TABLE_II,
        notes=notes,
        delay=1 / arguments.rate,
    )
    if json_file:
        conditions = [condition.figures() for condition in done]
        content = {
            "lockstep": lockstep,
            "rig": arguments.rig,
            "seeds": seeds,
            "arguments": asdict(arguments),
            "conditions": conditions,
        }
        json_file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    console.print(_table_ii(done))
    console.print(_regression_table(done))
    for warning in warnings:
        console.print(warning, highlight=False)
    console.print(f"report: {index}", soft_wrap=True, highlight=False)


def _settings(arguments: GraphArguments, lockstep: bool) -> dict[str, str]:
    shown = {key: str(value) for key, value in asdict(arguments).items() if value != ""}
    for key in ("surface", "controller", "record"):
        del shown[key]
    return {"run": "lockstep" if lockstep else "live graph", **shown}


def _warnings(done: Sequence[Condition]) -> list[str]:
    """Return what speaks against the figures: samples lost, complaints of nodes."""
    warnings = []
    for condition in done:
        if condition.delivery is None:
            continue
        name = f"{condition.trial.surface} / {condition.trial.controller}"
        delivery = condition.delivery
        lost = max(delivery.lost[t.name] + delivery.missed[t.source] for t in SIGNALS.values())
        share = lost / len(condition.trial.time)
        if share > LOST_SHARE:
            warnings.append(
                f"{name}: {100 * share:.1f} % of the samples are missing: the machine was too"
                " busy, and the error is larger for it."
            )
        warnings += [f"{name}: {warning}." for warning in condition.delivery.warnings]
    return warnings


def _table_ii(done: Sequence[Condition]) -> Table:
    """Return Table II as measured, the paper's beside it."""
    measured: dict[tuple[str, str], list[float]] = {}
    for c in done:
        measured.setdefault((c.trial.surface, c.trial.controller), []).append(
            c.evaluation.nrmse_percent
        )
    surfaces = list(dict.fromkeys(surface for surface, _ in measured))
    controllers = list(dict.fromkeys(controller for _, controller in measured))
    table = Table(title="Table II: error of the handle's acceleration, % (paper's in brackets)")
    table.add_column("controller")
    for surface in (*surfaces, "average"):
        table.add_column(surface, justify="right")
    # The paper's averages are over its own surfaces.
    paper = TABLE_II if tuple(surfaces) == SURFACES else _without_averages(TABLE_II)
    for controller in controllers:
        row = [measured.get((surface, controller), []) for surface in surfaces]
        # Of each seed over the surfaces, as far as all were run.
        average = [fmean(values) for values in zip(*(cell for cell in row if cell), strict=False)]
        cells = zip((*surfaces, "average"), (*row, average), strict=True)
        table.add_row(
            controller,
            *(_cell(values, paper.get((surface, controller))) for surface, values in cells),
        )
    return table


def _regression_table(done: Sequence[Condition]) -> Table:
    """Return slope and R^2 over all surfaces, the paper's beside them."""
    table = Table(title="regression over all surfaces (paper's in brackets)")
    for heading in ("controller", "slope, desired on actual", "slope, actual on desired", "R^2"):
        table.add_column(heading, justify="right" if table.columns else "left")
    # The paper's averages are over its own surfaces.
    complete = {condition.trial.surface for condition in done} == set(SURFACES)
    for controller in dict.fromkeys(c.trial.controller for c in done):
        found = [c.evaluation for c in done if c.trial.controller == controller]
        slope, r2 = REGRESSION.get(controller, (None, None)) if complete else (None, None)
        table.add_row(
            controller,
            _cell([e.slope_desired_on_actual for e in found], slope, digits=2),
            _cell([e.slope_actual_on_desired for e in found], None, digits=2),
            _cell([e.r2 for e in found], r2, digits=2),
        )
    return table


def _without_averages(table: Mapping[tuple[str, str], float]) -> dict[tuple[str, str], float]:
    return {key: value for key, value in table.items() if key[0] != "average"}


def _cell(measured: Sequence[float], paper: float | None, digits: int = 1) -> str:
    """Return mean and, of several, standard deviation; the paper's value behind it."""
    shown = f"{fmean(measured):.{digits}f}" if measured else "-"
    if len(measured) > 1:
        shown += f" ± {stdev(measured):.{digits}f}"
    return shown if paper is None else f"{shown} ({paper:.{digits}f})"


def _defined(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
