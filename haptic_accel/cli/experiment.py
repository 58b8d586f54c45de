"""``haptic-accel experiment``: the paper's nine conditions, live or in lockstep."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from haptic_accel.analysis.loading import Analysis, analyse
from haptic_accel.analysis.metrics import AnalysedTrial
from haptic_accel.analysis.page import Setting
from haptic_accel.analysis.writing import defined, signal_table, write_analysis, write_json
from haptic_accel.cli.options import (
    Verb,
    controllers_option,
    json_option,
    lockstep_option,
    out_option,
    word_options,
    words,
)
from haptic_accel.cli.output import results_folder
from haptic_accel.cli.running import StopOnSignal, conclude, progress_bar
from haptic_accel.cli.tables import print_analysis
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, FAILED, INTERRUPTED
from haptic_accel.core.topics import ANALYSED
from haptic_accel.graph.arguments import SIMULATED, GraphArguments, parse_arguments
from haptic_accel.graph.lockstep import lockstep_trial, record_trial
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Supervisor

SURFACES = ("plywood", "text", "vinyl")
"""The paper's surfaces."""

PAPER_CONTROLLERS = ("none", "constant", "dynamic")
"""The paper's conditions."""

EVALUATED = ("nrmse_percent", "slope_desired_on_actual", "slope_actual_on_desired", "r2")
"""Metrics of a condition in the JSON file."""

AGES = ("p50", "p99", "max")
"""Quantiles of the age of forces in the JSON file."""

MOST_SEEDS = 1000

RECORDED = "surface:=recording"
"""Word that a recording implies."""

DURATION = 10.0
"""Default length of a condition, s."""

AROUND = 4.0
"""Estimated time for starting and stopping the graph, s, for the time left."""

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
@lockstep_option
@controllers_option(CONTROLLERS, default=PAPER_CONTROLLERS)
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
    default. A recording takes the place of the surfaces.
    """
    if any(word.startswith("recording:=") for word in words):
        words = [*(word for word in words if word != RECORDED), RECORDED]
    arguments = _with_duration(words)
    _check_seeds(seeds, lockstep)
    _check_devices(arguments, lockstep)
    plan = _plan(words, arguments, seeds, controllers)
    for planned in plan:
        graph(planned)  # everything that can be wrong is found before anything runs
    folder = results_folder(out)
    done: dict[Path, GraphArguments] = {}
    status = DONE
    console = Console()
    try:
        with StopOnSignal() as stop:
            for bag, arguments_of_bag in _run_all(plan, lockstep, folder / "bags", stop, console):
                done[bag] = arguments_of_bag
    except StopRequestedError:
        status = INTERRUPTED
        print(f"interrupted after {len(done)} of {len(plan)} conditions", file=sys.stderr)
    except GraphFailedError as failure:
        status = failure.status
    if done:
        complete = _conclude(done, arguments, lockstep, folder, json_file, console)
        status = status if complete or status != DONE else FAILED
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
) -> Iterator[tuple[Path, GraphArguments]]:
    """Run one condition after the other, with a progress bar; yield the bag of each."""
    several = len({arguments.seed for arguments in plan}) > 1
    with progress_bar(console) as progress:
        bar = progress.add_task("", total=len(plan))
        for index, arguments in enumerate(plan):
            surface = Path(arguments.surface).stem
            name = f"{surface} / {arguments.controller} / seed {arguments.seed}"
            label = f"{index + 1} of {len(plan)}: {name}"
            progress.update(bar, description=label, completed=index)
            if not console.is_terminal:
                console.print(label)

            def asked(index: int = index, started: float = time.monotonic()) -> bool:
                part = (time.monotonic() - started) / (arguments.duration + AROUND)  # noqa: B023
                progress.update(bar, completed=index + min(part, 1.0))
                return stop()

            bag = folder / f"{surface}_{arguments.controller}"
            if several:
                bag = bag.with_name(f"{bag.name}_seed{arguments.seed}")
            if lockstep:
                start = time.time_ns()
                record_trial(bag, lockstep_trial(arguments), arguments, start)
            else:
                _run_live(replace(arguments, bag=str(bag)), asked)
            yield bag, arguments
            if stop():
                raise StopRequestedError
        progress.update(bar, completed=len(plan), description="done")


def _run_live(arguments: GraphArguments, stop: Callable[[], bool]) -> None:
    """Run one condition through the graph, which records it."""
    outcome = Supervisor(graph(arguments)).run(stop)
    if not outcome.first:
        raise StopRequestedError
    status = conclude(outcome)
    if status != DONE:
        raise GraphFailedError(status)


def _conclude(
    done: Mapping[Path, GraphArguments],
    arguments: GraphArguments,
    lockstep: bool,
    folder: Path,
    json_file: Path | None,
    console: Console,
) -> bool:
    """Analyse the bags, print, and write report and JSON; return whether all could be analysed."""
    analysis = analyse(list(done))
    warnings = _warnings(analysis)
    notes = [LOCKSTEP_NOTE if lockstep else LIVE_NOTE, AVERAGE_NOTE]
    notes += [RIG_NOTES[arguments.rig]] if arguments.rig in RIG_NOTES else []
    seeds = list(dict.fromkeys(given.seed for given in done.values()))
    shown = [bag for bag, given in done.items() if given.seed == seeds[0]]
    page = write_analysis(
        analysis,
        folder,
        setting=Setting(
            "Haptic display of tool contact: the paper's experiment",
            [*notes, *warnings],
            _settings(arguments, lockstep),
        ),
        files={
            f"signals_{trial.name}.csv": signal_table(trial.segment)
            for trial in analysis.trials
            if trial.segment.bag in shown
        },
    )
    if json_file:
        content = {
            "lockstep": lockstep,
            "rig": arguments.rig,
            "seeds": seeds,
            "arguments": asdict(arguments),
            "conditions": [
                _metrics(trial, done[trial.segment.bag].seed, lockstep)
                for trial in analysis.trials
            ],
        }
        write_json(defined(content), json_file)
    print_analysis(analysis, None, console)
    for warning in warnings:
        console.print(warning, highlight=False)
    console.print(f"report: {page}", soft_wrap=True, highlight=False)
    return {trial.segment.bag for trial in analysis.trials} == set(done)


def _metrics(trial: AnalysedTrial, seed: int, lockstep: bool) -> dict[str, Any]:
    """Return the metrics of a trial for a JSON file."""
    metrics: dict[str, Any] = {
        "surface": trial.surface,
        "controller": trial.controller,
        "seed": seed,
        **{name: trial.metrics[name] for name in EVALUATED},
        "seconds": trial.segment.seconds,
    }
    if not lockstep:
        delivery = trial.segment.delivery
        ages = {label: delivery.age_us[label] for label in AGES if label in delivery.age_us}
        metrics |= {"age_us": ages, "lost": delivery.lost, "late": delivery.late}
        metrics["missed"] = delivery.missed
    return metrics


def _settings(arguments: GraphArguments, lockstep: bool) -> dict[str, str]:
    shown = {key: str(value) for key, value in asdict(arguments).items() if value != ""}
    for key in ("surface", "controller", "record"):
        del shown[key]
    return {"run": "lockstep" if lockstep else "live graph", **shown}


def _warnings(analysis: Analysis) -> list[str]:
    """Return reasons to doubt the metrics: missing samples, warnings of nodes."""
    warnings = []
    for trial in analysis.trials:
        delivery = trial.segment.delivery
        missing = [
            delivery.lost[topic.name] + delivery.missed[topic.source]
            for topic in ANALYSED
            if topic.name in delivery.lost
        ]
        share = max(missing, default=0) / (trial.segment.seconds * trial.segment.rate)
        name = f"{trial.surface} / {trial.controller}"
        if share > LOST_SHARE:
            warnings.append(
                f"{name}: {100 * share:.1f} % of the samples are missing: the machine was too"
                " busy, and the error is larger for it."
            )
        warnings += [f"{name}: {warning}." for warning in delivery.warnings]
    return warnings
