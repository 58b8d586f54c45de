# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's experiment: errors, metrics, and the notes and warnings of its report."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

from haptic_accel.analysis.latency import latest_text
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.metrics import MILLI, AnalysedTrial
from haptic_accel.analysis.writing import Setting, signal_table, write_analysis
from haptic_accel.bags.delivery import Delivery
from haptic_accel.bags.folder import free_name
from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.tables import ResultTable, number
from haptic_accel.core.topics import ANALYSED
from haptic_accel.core.trial import Trial
from haptic_accel.materials.folders import is_recording
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.setup import Setup

EVALUATED = (
    *("nrmse_percent", "bound_percent", "limited_bound_percent", "indistinguishable_percent"),
    *("slope_desired_on_actual", "slope_actual_on_desired", "r2"),
)
"""Metrics of a condition in the JSON file."""

AGES = ("p50", "p99", "max")
"""Quantiles of the age of forces in the JSON file."""

LOST_SHARE = 0.01
"""Fraction of missing samples of a signal, or of late forces, above which there is a warning."""

LATE = "took effect late"
"""Text for forces that act after their due time."""

RUN_NOTES = {
    True: "Every condition ran in lockstep: no ROS, no clock, same numbers for the same seed.",
    False: "Every condition ran through the live graph, and was read back from its bag.",
}
"""Notes on a run in lockstep, and through the live graph."""

RIG_NOTES = {
    "ideal": "The simulated rig is eq. (1) to (3) of the paper with Table I and nothing else: it "
    "has none of the structure, friction and timing of a real rig, so that constant and dynamic "
    "come out below the paper's errors. The order of the controllers is what to compare, not "
    "the value of a cell.",
    "paper": "The simulated rig is eq. (1) to (3) of the paper with Table I and, besides, "
    "mount, delay, friction, gravity, sensors and users as a real one has. Six numbers are fitted "
    "to the paper's Table II and regressions, in the paper's loop (latency:=0, in lockstep): "
    "frequency and damping of the mount, delay, and contact damping of the three surfaces "
    "(docs/virtual_rig.md).",
}
"""Notes on the virtual rigs, by name."""

NETWORK_NOTE = (
    "A network lay between the arms, with the passive coupling. The handle is compared with the "
    "tool's own acceleration at the time that was played: delay is no error, loss is."
)
"""Note on a simulated network."""

AVERAGE_NOTE = (
    "The paper's averages are its own; the plain means of its three surfaces are 80.9 % for "
    "constant and 73.7 % for dynamic."
)
"""Note on the averages of Table II."""


def trial_error(trial: Trial) -> float:
    """Return the error of a trial, %; NaN for a desired acceleration of zero."""
    try:
        return trial.evaluate().nrmse_percent
    except ValueError:
        return math.nan


def lockstep_error(arguments: GraphArguments) -> float:
    """Return the error of a condition in lockstep, %; NaN for a desired acceleration of zero."""
    return trial_error(lockstep_trial(Setup.of(arguments)))


def channel_setting(channel: ChannelParameters | None) -> dict[str, str]:
    """Return the description of a network for a page's settings; empty without a network."""
    if channel is None:
        return {}
    delay, jitter = MILLI * channel.delay, MILLI * channel.jitter
    return {"network": f"{delay:g} +- {jitter:g} ms one way, {100 * channel.loss:g} % lost"}


def lockstep_comparison(analysis: Analysis, expected: Mapping[Path, float]) -> ResultTable | None:
    """Return live errors (lockstep errors in brackets) by controller and surface."""
    cells: dict[str, dict[str, str]] = {}
    for trial in analysis.trials:
        if trial.segment.bag in expected:
            live = number(trial.metrics["nrmse_percent"], 1)
            cell = f"{live} ({expected[trial.segment.bag]:.1f})"
            cells.setdefault(trial.controller, {})[trial.surface] = cell
    surfaces = list(dict.fromkeys(surface for row in cells.values() for surface in row))
    rows = [(name, *(row.get(each, "") for each in surfaces)) for name, row in cells.items()]
    title = "Error (NRMSE) live and, in brackets, in lockstep, %"
    return ResultTable(("controller", *surfaces), rows, title) if rows else None


def trial_metrics(trial: AnalysedTrial, run: Run) -> dict[str, Any]:
    """Return the metrics of a trial of an experiment for a JSON file."""
    metrics: dict[str, Any] = {
        "surface": trial.surface,
        "controller": trial.controller,
        "seed": run.done[trial.segment.bag].seed,
        **{name: trial.metrics[name] for name in EVALUATED},
        "seconds": trial.segment.seconds,
        "latency_samples": trial.segment.latency,
        "granted_samples": trial.segment.granted_delay,
        "after_samples": trial.segment.after,
    }
    if not run.lockstep:
        delivery = trial.segment.delivery
        ages = {label: delivery.age_us[label] for label in AGES if label in delivery.age_us}
        metrics |= {"age_us": ages, "lost": delivery.lost, "missed": delivery.missed}
        metrics["missed_deadlines"] = delivery.deadlines
        metrics["lockstep_nrmse_percent"] = run.expected.get(trial.segment.bag)
    return metrics


def experiment_warnings(analysis: Analysis, *, composed: bool) -> Iterator[str]:
    """Yield warnings about the metrics: missing samples, late forces.

    Warnings of nodes are in the page's notes on single trials.
    """
    found: dict[str, list[tuple[float, str]]] = {}
    longest = -math.inf
    for trial in analysis.trials:
        delivery = trial.segment.delivery
        missing = [
            delivery.lost[topic.name] + delivery.missed[topic.source]
            for topic in ANALYSED
            if topic.name in delivery.lost
        ]
        samples = trial.segment.seconds * trial.segment.rate
        late, missed = _worst(delivery, "missed")
        past, behind = _worst(delivery, "past_tick")
        longest = max(longest, delivery.deadlines.get(late, {}).get("longest_us", -math.inf))
        for what, share in (
            ("samples are missing", max(missing, default=0) / samples),
            (f"{past}s came after their tick", behind),
            (f"{late}s {LATE}", missed),
        ):
            if share > LOST_SHARE:
                found.setdefault(what, []).append((share, f"{trial.surface} / {trial.controller}"))
    for what, trials in found.items():
        share, worst = max(trials)
        is_late = what.endswith(LATE)
        effect = " a hand on a real handle would feel" if is_late else " makes the error larger"
        yield (
            f"In {len(trials)} of {len(analysis.trials)} trials, up to {100 * share:.1f} %"
            f" ({worst}) of the {what}{latest_text(longest) * is_late}, which{effect}."
        )
    if any(what.endswith("after their tick") for what in found):
        yield f"Fewer come too late with {'' if composed else 'composed:=true or '}latency:=4."
    if any(what.endswith(LATE) for what in found):
        yield "haptic-accel doctor looks at the machine, which did not run the nodes in time."


def _worst(delivery: Delivery, count: str) -> tuple[str, float]:
    """Return the kind of force with the largest fraction of a count, and that fraction."""
    shares = {name: each.get(count, 0) / each["due"] for name, each in delivery.deadlines.items()}
    return max(shares.items(), key=itemgetter(1), default=("", 0.0))


@dataclass(frozen=True)
class Run:
    """Completed run of an experiment.

    Attributes
    ----------
    arguments : GraphArguments
        Common arguments of all conditions.
    done : mapping
        Arguments of each condition by bag.
    channel : ChannelParameters or None
        Simulated network, if there was one.
    lockstep : bool
    expected : mapping
        Known lockstep errors of a live run's conditions, %, by bag.
    """

    arguments: GraphArguments
    done: Mapping[Path, GraphArguments]
    channel: ChannelParameters | None
    lockstep: bool
    expected: Mapping[Path, float]

    @property
    def seeds(self) -> list[int]:
        """Seeds of the conditions."""
        return list(dict.fromkeys(each.seed for each in self.done.values()))


def write_experiment(run: Run, analysis: Analysis, folder: Path, *warnings: str) -> Path:
    """Write the report of an experiment to a folder; return its page."""
    defaults = asdict(GraphArguments())
    by_trial = {"controller", "record", "surface"}
    by_trial -= {"surface"} if is_recording(run.arguments.surface) else set()
    settings = (
        {"run": "lockstep" if run.lockstep else "live graph"}
        | channel_setting(run.channel)
        | {
            key: str(value)
            for key, value in asdict(run.arguments).items()
            if value != defaults[key] and key not in by_trial
        }
    )
    notes = [
        RUN_NOTES[run.lockstep],
        AVERAGE_NOTE,
        RIG_NOTES.get(run.arguments.rig, ""),
        NETWORK_NOTE if run.channel else "",
        *warnings,
    ]
    return write_analysis(
        analysis,
        folder,
        setting=Setting(
            "Haptic display of tool contact: the paper's experiment",
            [*filter(None, notes)],
            {**settings, "all others": "defaults"},
            lockstep=lockstep_comparison(analysis, run.expected),
        ),
        files={
            f"signals_{trial.name}.csv": signal_table(trial.segment)
            for trial in analysis.trials
            if run.done[trial.segment.bag].seed == run.seeds[0]
        },
    )


def experiment_metrics(run: Run, analysis: Analysis) -> dict[str, Any]:
    """Return the metrics of an experiment for a JSON file."""
    return {
        "lockstep": run.lockstep,
        "rig": run.arguments.rig,
        "seeds": run.seeds,
        "arguments": asdict(run.arguments),
        "network": asdict(run.channel) if run.channel else None,
        "conditions": [trial_metrics(trial, run) for trial in analysis.trials],
    }


# Conditions


@dataclass(frozen=True)
class RecordedCondition:
    """Condition, and the bag for its recording."""

    bag: Path
    arguments: GraphArguments
    channel: ChannelParameters | None
    lockstep: bool


def recorded_conditions(
    plan: Sequence[GraphArguments], folder: Path, channel: ChannelParameters | None, lockstep: bool
) -> list[RecordedCondition]:
    """Return the conditions with separate bags."""
    several = plan[0].seed != plan[-1].seed
    return [
        RecordedCondition(
            folder / f"{Path(each.surface).stem}_{each.controller}{f'_seed{each.seed}' * several}",
            each,
            channel,
            lockstep,
        )
        for each in plan
    ]


def set_aside(bag: Path) -> None:
    """Rename the bag of a condition whose run was interrupted, or whose process died."""
    if bag.exists():
        folder = bag.parent.parent / "interrupted"
        folder.mkdir(exist_ok=True)
        bag.rename(free_name(folder / bag.name))


def run_lockstep(condition: RecordedCondition) -> str:
    """Run and record one condition in lockstep; return a line with its error."""
    set_aside(condition.bag)
    start = time.time_ns()
    setup = Setup.of(condition.arguments)
    trial = lockstep_trial(setup, channel=condition.channel)
    record_trial(condition.bag, trial, setup, start)
    return condition_line(condition.arguments, trial_error(trial))


def condition_line(arguments: GraphArguments, error: float) -> str:
    """Return the report line of a completed condition, with its error in %."""
    name = f"{Path(arguments.surface).stem} / {arguments.controller} / seed {arguments.seed}"
    return f"{name}: {number(error, 1)} %"
