# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Families of inputs, handles and sensors: what controllers do on random members.

``python benchmarks/families.py`` runs every member with each controller in lockstep: inputs on
handles as described, with one axis and three; handles that differ from their description; and
sensors that are connected to the wrong body. Another ``--seed`` gives other members. Members of
one half are told one by one. Of the other half only counts are told, so that controllers are not
fitted to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

import click
import handle_family
import input_family
import numpy as np
from fidelity_trials import ACCEPTED, WINDOW_HOP, by_window
from handle_family import hand
from input_family import Random, log_uniform
from three_axes import bound as bound_of_three

from haptic_accel import (
    FloatArray,
    GraphArguments,
    HandleParameters,
    ParameterError,
    Plant,
    Setup,
    Trial,
    Vector,
    held,
    lockstep_trial,
)
from haptic_accel.cli.options import controllers_option
from haptic_accel.cli.studies import journal_of
from haptic_accel.commands import (
    ResultTable,
    Row,
    Workers,
    json_option,
    print_table,
    run,
    run_side_by_side,
    save,
    verb,
    workers_options,
)
from haptic_accel.controllers import CONTROLLERS
from haptic_accel.core import build_loop, vector
from haptic_accel.core.rig import Rig
from haptic_accel.core.rig.master_rig import simulated_master
from haptic_accel.core.rig.slave_rig import SlaveRig
from haptic_accel.core.sampling import crossfaded
from haptic_accel.core.simulated_rig import build_parts
from haptic_accel.core.tables import number as figure
from haptic_accel.core.trial import WARNING_CHECK_PERIOD, GripChange
from haptic_accel.devices import Sample
from haptic_accel.materials.recordings import read_recording
from haptic_accel.setup.arguments import SURFACES

SECONDS = 8.0
"""Duration of a trial, s."""

RATE = 1000.0
"""Samples per second."""

RIGS = "ideal", "paper"
THREE_AXES = "three_axis_ideal", "three_axis"

PER_KIND = {"inputs": 3, "hands": 3, "three axes": 3, "handles": 2, "strange": 40, "sensors": 2}
"""Members of each kind, rig and half, by family; of strange handles for all rigs together."""

AFTER = 1.0
"""Time after which windows are counted once more, without the first contact, s."""

GIVEN_UP, REACHABLE = 90.0, 70.0
"""Error of the last two seconds, %, above which a handle counts as given up, and bound below which
it need not be."""

NEAR, NEAR_POINTS = 1.3, 2.0
"""Factor of the limited bound, and points above it, within which an error is near the bound."""

NAMED_BY = 1.5
"""Time by which a difference is to be named, s: a second after the tool has touched."""

CONTACT = 1.0, 4.0
"""Begin and end of the tool's contact of trials with sensors, s."""

SENSOR_SECONDS = 6.0
"""Duration of these trials, s."""

SILENCE = 0.05
"""Time after the tool's contact in which the force is to end, s, and section of which it is the
root mean square."""

FALSE_NAMES = *handle_family.FALSE_NAMES, "run identify"
"""Parts of warnings that a handle as described must not have."""

MISPLACED = "picks up the handle"
"""Part of the warning that only a tool's sensor on the wrong body must have."""

Wiring: TypeAlias = Callable[[Vector, Vector], tuple[Vector, Vector]]
"""Function from what the sensors of handle and tool feel to what is measured as theirs."""


@dataclass(frozen=True)
class Member:
    """Member of a family, for all controllers.

    Attributes
    ----------
    family, kind, name : str
    number : int
        Number in its kind; the odd ones are reported.
    arguments : GraphArguments
    recording : ndarray, optional
        Tool acceleration in place of the arguments' one, m/s^2.
    grips : tuple of GripChange
    changes : dict
        Additional values for rig and controllers, by node and dotted name.
    named : str
        Part of the warning that names the difference; empty if it has no name.
    gains : ndarray, shape (2, 2), optional
        What is measured at handle and tool per acceleration of both.
    """

    family: str
    kind: str
    name: str
    number: int
    arguments: GraphArguments
    recording: FloatArray | None = None
    grips: tuple[GripChange, ...] = ()
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    named: str = ""
    gains: FloatArray | None = None

    @property
    def reported(self) -> bool:
        """True for a member that is told on its own."""
        return bool(self.number % 2)

    @property
    def described(self) -> bool:
        """True for a handle as described, whose names are false."""
        return self.family in ("inputs", "hands", "three axes", RECORDINGS)


# Members


def _arguments(rig: str, seed: int, surface: str = SURFACES[0]) -> GraphArguments:
    return GraphArguments(rig=rig, rate=RATE, seed=seed, surface=surface, duration=SECONDS)


def _inputs(seed: int, count: int) -> Iterator[Member]:
    """Yield each spectrum and each hard input on both rigs with one axis."""
    spectra = list(input_family.SPECTRA)
    for rig, kind in product(RIGS, [*spectra, *input_family.HARD]):
        for number in range(2 * count):
            if kind in spectra:
                # The same spectrum with each envelope in turn.
                drawn = number // 2 * 2 * len(spectra) + spectra.index(kind) + number % 2 * 5
                made = input_family.member(drawn, SECONDS, RATE, seed)
            else:
                made = input_family.hard(kind, number, SECONDS, RATE, seed)
            around = _arguments(rig, number)
            yield Member("inputs", kind, made.name, number, around, made.acceleration)


def _hands(seed: int, count: int) -> Iterator[Member]:
    """Yield handles with one axis in any ordinary hand."""
    for member in _vectors("hands", RIGS, seed, count):
        assert member.recording is not None
        grips = ((0.0, hand(seed, member.number)),)
        yield replace(member, recording=member.recording[:, -1].copy(), grips=grips)


def _three_axes(seed: int, count: int) -> Iterator[Member]:
    yield from _vectors("three axes", THREE_AXES, seed, count)


def _vectors(family: str, rigs: Sequence[str], seed: int, count: int) -> Iterator[Member]:
    for rig, (place, kind) in product(rigs, enumerate(input_family.VECTOR_RMS)):
        for number in range(2 * count):
            drawn = len(input_family.VECTOR_RMS) * number + place
            made = input_family.vector(drawn, SECONDS, RATE, seed)
            around = _arguments(rig, number)
            yield Member(family, kind, made.name, number, around, made.acceleration)


def _handles(seed: int, count: int) -> Iterator[Member]:
    """Yield handles with one difference, on each surface in turn."""
    for rig, kind in product(RIGS, handle_family.KINDS):
        for number in range(2 * count):
            around = _arguments(rig, number, SURFACES[number % len(SURFACES)])
            played = handle_family.member(kind, number, _plant(around), SECONDS, seed)
            yield Member(
                *("handles", kind, played.name, number, around),
                grips=played.grips,
                changes=played.changes,
                named=handle_family.NAMES.get(kind, ""),
            )


def _strange(seed: int, count: int) -> Iterator[Member]:
    """Yield handles with several differences, each fourth one under steady noise."""
    for number in range(2 * count):
        surface = SURFACES[number % len(SURFACES)]
        around = _arguments(RIGS[number // 2 % len(RIGS)], number, surface)
        played = handle_family.strange(number, _plant(around), SECONDS, seed)
        yield Member(
            *("strange", "several differences", played.name, number, around),
            _noise((seed, number), SECONDS, 0.0, SECONDS) if number // 4 % 4 == 0 else None,
            grips=played.grips,
            changes=played.changes,
        )


SENSORS: dict[str, tuple[Callable[[Random], list[list[float]]], str]] = {
    "swapped": (lambda random: [[0.0, 1.0], [1.0, 0.0]], MISPLACED),
    "mixed": (lambda random: [[1.0, 0.0], [random.uniform(0.3, 1.0), 1.0]], MISPLACED),
    "on the handle": (lambda random: [[1.0, 0.0], [1.0, 0.0]], MISPLACED),
    "handle's sign": (lambda random: [[-1.0, 0.0], [0.0, 1.0]], "opposite direction"),
    "handle's gain": (
        lambda random: [[_wrong_gain(random), 0.0], [0.0, 1.0]],
        "the force per mass is",
    ),
    "tool's sign": (lambda random: [[1.0, 0.0], [0.0, -1.0]], ""),
}
"""Functions to what is measured at handle and tool per acceleration of both, and part of the
warning that names it, by kind."""


def _wrong_gain(random: Random) -> float:
    return float(log_uniform(random, 1.3, 3.0) ** random.choice([-1.0, 1.0]))


def _sensors(seed: int, count: int) -> Iterator[Member]:
    for rig, (kind, (draw, named)) in product(RIGS, SENSORS.items()):
        for number in range(2 * count):
            drawn = seed, number, list(SENSORS).index(kind)
            gains = np.array(draw(np.random.default_rng(drawn)))
            name = ", ".join(f"{value:.2g}" for value in gains.ravel())
            around = replace(_arguments(rig, number), duration=SENSOR_SECONDS)
            recording = _noise(drawn, SENSOR_SECONDS, *CONTACT)
            yield Member(
                *("sensors", kind, name, number, around, recording), gains=gains, named=named
            )


RECORDINGS = "recordings"
"""Name of the family of the user's recordings."""

FAMILIES: dict[str, Callable[[int, int], Iterator[Member]]] = {
    "inputs": _inputs,
    "hands": _hands,
    "three axes": _three_axes,
    "handles": _handles,
    "strange": _strange,
    "sensors": _sensors,
}
"""Functions from a seed and a number of members to the members of both halves, by name."""


def recordings(folder: Path, rate: float) -> Iterator[Member]:
    """Yield the recordings of a folder, CSV and WAV, on both rigs; the odd ones are reported."""
    files = sorted(each for each in folder.iterdir() if each.suffix.lower() in (".csv", ".wav"))
    if not files:
        raise ParameterError(f"recordings = {str(folder)!r}: must hold CSV or WAV files")
    for rig, (number, file) in product(RIGS, enumerate(files)):
        samples = read_recording(str(file), 0.0 if file.suffix == ".wav" else rate, RATE, "")
        samples = samples - np.mean(samples)
        # From any place of a long one, so that it begins within a vibration.
        samples = crossfaded(samples[: round(SECONDS * RATE)], RATE)
        yield Member(RECORDINGS, file.suffix[1:], file.stem, number, _arguments(rig, 0), samples)


def _plant(arguments: GraphArguments) -> Plant:
    """Return handle, delay and bandwidth of a rig as described."""
    master = Setup.of(arguments).rig().master
    return Plant(master.handle, delay=master.drive.delay, bandwidth=master.accelerometer.bandwidth)


def _noise(seed: tuple[int, ...], seconds: float, begin: float, end: float) -> FloatArray:
    """Return noise from 15 to 400 Hz with 2 m/s^2 RMS, for a time and zero else."""
    time = np.arange(round(seconds * RATE)) / RATE
    found = input_family.band_noise(np.random.default_rng(seed), len(time), 15.0, 400.0, RATE)
    inside = np.clip((time - begin) / 0.2, 0.0, 1.0) * (time < end)
    return np.asarray(inside * found * (2.0 / np.std(found)))


# Trials


@dataclass(frozen=True)
class Task:
    """A member and the controllers with which it is run."""

    member: Member
    controllers: Sequence[str]


def run_member(task: Task) -> Row:
    """Run all trials of a member."""
    member, ways = task.member, list(task.controllers)
    if member.gains is not None:
        # Without force there is nothing to see.
        ways = ["constant" if way == "none" else way for way in ways]
        found = {way: _sensed(member, way) for way in ways}
        bound = math.nan
    else:
        trials = {way: _trial(member, way) for way in ways}
        bound = _bound(member, next(iter(trials.values())))
        found = {way: _followed(trial) for way, trial in trials.items()}
    return {
        **{name: getattr(member, name) for name in ("family", "kind", "name", "number", "named")},
        "reported": member.reported,
        "described": member.described,
        "rig": member.arguments.rig,
        "limited_bound_percent": bound,
        "controllers": found,
    }


def _setup(member: Member, controller: str) -> Setup[GraphArguments]:
    return Setup.of(replace(member.arguments, controller=controller)).changed(member.changes)


def _trial(member: Member, controller: str) -> Trial:
    return lockstep_trial(
        _setup(member, controller), recording=member.recording, grips=member.grips
    )


def _bound(member: Member, trial: Trial) -> float:
    """Return the least error within the limits of the coils, %."""
    if member.family == "three axes":
        return bound_of_three(replace(member.arguments, controller="inverse"), trial)
    rig, changed = _setup(member, "none").rig(), [grip for _, grip in member.grips]
    handle = held(rig.master.handle, rig.master.grip, member.arguments.seed)
    hands = [each for each in changed if isinstance(each, HandleParameters)]
    return trial.bounds(rig, hands[-1] if hands else handle).limited


def _followed(trial: Trial) -> Row:
    last = round((trial.seconds - 2.0) * trial.rate)
    return {
        "nrmse_percent": trial.evaluate().nrmse_percent,
        "last_percent": trial.evaluate(last).nrmse_percent,
        "nrmse_by_2_s_percent": list(by_window(trial)),
        "warnings": [list(warned) for warned in trial.warnings],
    }


class _Wired(Rig):
    """Rig whose accelerometer is one that feels a mixture of handle and tool."""

    def __init__(self, own: Rig, both: Sequence[Rig], gains: FloatArray) -> None:
        super().__init__(own.motion)
        self._own, self._both, self._gains = own, both, gains

    def read(self, time: float) -> Sample:
        felt = np.array([each.read(time).acceleration for each in self._both])
        return self._own.read(time)._replace(acceleration=vector(self._gains @ felt))


def _sensed(member: Member, controller: str) -> Row:
    """Run a trial with sensors that feel a mixture of handle and tool."""
    assert member.gains is not None
    setup = _setup(member, controller)
    rig, (around, controllers), seed = setup.rig(), setup.node("compensator"), setup.arguments.seed
    around = replace(around, controller=controller)
    rigs = (
        simulated_master(rig.master, RATE, seed),
        SlaveRig(rig.slave, RATE, seed, member.recording),
    )
    devices = {
        arm: _Wired(own, rigs, gains)
        for arm, own, gains in zip(("master", "slave"), rigs, member.gains, strict=True)
    }
    sides, part = build_parts(rig, devices, around, controllers, RATE, setup.arguments.latency)
    loop = build_loop(rig, sides, part)
    rows = np.zeros((round(SENSOR_SECONDS * RATE), 10, 3))
    loop.record(rows)
    told: list[tuple[float, str]] = []
    every = round(WARNING_CHECK_PERIOD * RATE)
    for tick in range(len(rows)):
        loop.step(tick)
        if tick % every == 0:
            told.append((tick / RATE, part.slow.diagnostics()[0]))
    force = rows[round((CONTACT[1] + SILENCE) * RATE) :, 9, 2]
    blocks = force[: len(force) // 50 * 50].reshape(-1, round(SILENCE * RATE))
    when = [time for time, words in told if member.named and member.named in words]
    return {
        "force_after_silence_n": float(np.sqrt(np.mean(blocks**2, axis=1)).max()),
        "named_after_s": when[0] - CONTACT[0] if when else None,
    }


# Results


def above(row: Row, controller: str, than: str, since: float = 0.0) -> list[float]:
    """Return the increases of each window's error over another controller's, points."""
    name = "nrmse_by_2_s_percent"
    own, other = (row["controllers"][each][name] for each in (controller, than))
    pairs = list(zip(own, other, strict=True))[round(since / WINDOW_HOP) :]
    return [one - two for one, two in pairs if one is not None and two is not None]


def summary(rows: Sequence[Row], controller: str) -> Row:
    """Return the counts of a controller over members that have a bound."""
    found = [row["controllers"][controller] for row in rows]
    bounds = [row["limited_bound_percent"] for row in rows]
    errors = [each["nrmse_percent"] for each in found]
    every = [each for row in rows for each in above(row, controller, "none")]
    later = [each for row in rows for each in above(row, controller, "none", AFTER)]
    known = controller == "adaptive" and "inverse" in rows[0]["controllers"]
    named = [
        any(row["named"] in words and at <= NAMED_BY for at, words in each["warnings"])
        for row, each in zip(rows, found, strict=True)
        if row["named"]
    ]
    false = [
        any(
            name in words
            for _, words in each["warnings"]
            for name in (MISPLACED, *(FALSE_NAMES if row["described"] else ()))
        )
        for row, each in zip(rows, found, strict=True)
    ]
    pairs = list(zip(errors, bounds, strict=True))
    return {
        "controller": controller,
        "members": len(rows),
        "mean_percent": float(np.mean(errors)),
        "worst_percent": max(errors),
        "mean_limited_bound_percent": float(np.mean(bounds)),
        "near_bound": sum(error <= NEAR * bound + NEAR_POINTS for error, bound in pairs),
        "median_over_bound": median(error / max(bound, NEAR_POINTS) for error, bound in pairs),
        "windows": len(every),
        "windows_above": sum(each > ACCEPTED for each in every),
        "windows_after": len(later),
        "windows_above_after": sum(each > ACCEPTED for each in later),
        "worst_above_points": max(every),
        "above_inverse_points": max(
            (each for row in rows for each in above(row, controller, "inverse")), default=math.nan
        )
        if known
        else math.nan,
        "given_up": sum(
            each["last_percent"] > GIVEN_UP and bound < REACHABLE
            for each, bound in zip(found, bounds, strict=True)
        ),
        "named": sum(named),
        "nameable": len(named),
        "false_names": sum(false),
    }


def summaries(rows: Sequence[Row]) -> list[Row]:
    """Return the counts by kind and rig of the reported half, and by family of both."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        half = "reported" if row["reported"] else "hidden"
        groups.setdefault((f"{row['family']}, {row['rig']}, {half}", ""), []).append(row)
        if row["reported"]:
            groups.setdefault((f"{row['family']}: {row['kind']}", row["rig"]), []).append(row)
    return [
        {"members of": of, "rig": rig, "by_kind": bool(rig)} | summary(found, controller)
        for (of, rig), found in sorted(groups.items())
        for controller in found[0]["controllers"]
        if controller != "none"
    ]


def table(lines: Sequence[Row], title: str) -> ResultTable:
    """Return counts as a table."""
    headings = (
        *("members of", "controller", "error, mean (worst)", "bound", "near it", "over bound"),
        *("above none", "from 1 s", "worst", "above inverse", "given up", "named", "false"),
    )
    cells = [
        (
            f"{line['members of']}{', ' * bool(line['rig'])}{line['rig']}",
            line["controller"],
            f"{line['mean_percent']:.1f} ({line['worst_percent']:.0f})",
            figure(line["mean_limited_bound_percent"], 1),
            f"{line['near_bound']} of {line['members']}",
            f"{line['median_over_bound']:.1f}",
            f"{line['windows_above']} of {line['windows']}",
            f"{line['windows_above_after']} of {line['windows_after']}",
            f"{line['worst_above_points']:+.0f}",
            figure(line["above_inverse_points"], 1),
            f"{line['given_up']}",
            f"{line['named']} of {line['nameable']}" if line["nameable"] else "",
            f"{line['false_names']}",
        )
        for line in lines
    ]
    return ResultTable(headings, cells, title)


def sensor_summaries(rows: Sequence[Row]) -> list[Row]:
    """Return the largest force after silence, and how soon it is named, by kind and half."""
    groups: dict[tuple[str, str, str], list[tuple[Row, str]]] = {}
    for row in rows:
        for controller, found in row["controllers"].items():
            half = "reported" if row["reported"] else "hidden"
            groups.setdefault((row["kind"], half, controller), []).append((found, row["named"]))
    return [
        {
            "kind": kind,
            "half": half,
            "controller": controller,
            "members": len(found),
            "force_after_silence_n": max(each["force_after_silence_n"] for each, _ in found),
            "nameable": sum(bool(named) for _, named in found),
            "named_in_1_s": sum((each["named_after_s"] or 9.0) <= 1.0 for each, _ in found),
            "named": sum(each["named_after_s"] is not None for each, _ in found),
        }
        for (kind, half, controller), found in groups.items()
    ]


def sensor_table(lines: Sequence[Row]) -> ResultTable:
    """Return the summaries of sensors as a table."""
    cells = [
        (
            line["kind"],
            line["half"],
            line["controller"],
            f"{line['force_after_silence_n']:.2f}",
            f"{line['named_in_1_s']} of {line['nameable']}" if line["nameable"] else "",
            f"{line['named']}" if line["nameable"] else "",
        )
        for line in lines
    ]
    title = f"sensors on the wrong body: largest force from {1e3 * SILENCE:g} ms after the tool's"
    headings = "kind", "half", "controller", "force, N RMS", "named in 1 s", "named"
    return ResultTable(headings, cells, f"{title} contact")


def progress(row: Row) -> str:
    """Return the line on a member of the reported half; empty for the others."""
    if not row["reported"]:
        return ""
    head = f"{row['family']}, {row['rig']}, {row['kind']}, {row['name']}: "
    parts = []
    for controller, found in row["controllers"].items():
        if "force_after_silence_n" in found:
            when = found["named_after_s"]
            named = "not named" if when is None else f"named after {when:.2f} s"
            parts.append(f"{controller} {found['force_after_silence_n']:.2f} N, {named}")
            continue
        worst = max(above(row, controller, "none"), default=0.0)
        told = " ".join(f"{time:.2f} s: {words}" for time, words in found["warnings"][:1])
        parts.append(f"{controller} {found['nrmse_percent']:.1f} % ({worst:+.0f}) {told}".rstrip())
    return f"{head}{'; '.join(parts)}; bound {figure(row['limited_bound_percent'], 1)}"


@verb(
    "python benchmarks/families.py",
    "python benchmarks/families.py --recordings recordings --recording-rate 10000",
    "python benchmarks/families.py strange sensors --members 5 --seed 3 --json figures.json",
)
@click.argument(
    "families", nargs=-1, type=click.Choice([*FAMILIES, RECORDINGS]), metavar="[FAMILY ...]"
)
@controllers_option(CONTROLLERS, default=("none", "dynamic", "inverse", "adaptive"))
@click.option(
    "--recordings",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Folder of CSV and WAV files of tool accelerations, the family recordings.",
)
@click.option(
    "--recording-rate", type=float, default=0.0, metavar="HZ", help="Rate of its CSV files, Hz."
)
@click.option(
    "--members",
    type=click.IntRange(1, 1000),
    show_default="/".join(map(str, PER_KIND.values())),
    help="Number of members of each kind, rig and half.",
)
@click.option("--seed", default=1, help="Seed of all members.")
@workers_options
@json_option
def families(
    *,
    families: Sequence[str],
    controllers: Sequence[str],
    folder: Path | None,
    recording_rate: float,
    members: int | None,
    seed: int,
    workers: Workers,
    json_file: Path | None,
) -> None:
    """Measure controllers on families of inputs, handles and sensors in lockstep.

    Families are inputs (textures, lines, steps, slams, knocks, motion of the hand, landings),
    hands, three axes, handles (with one difference), strange (with several), sensors (on the wrong
    body) and recordings (of the folder); all by default. Prints errors beside the limited bound,
    the windows of two seconds that are worse than without force by more than two points, how much
    worse than inverse adaptive is in any two seconds, the handles that are given up, and what is
    named.
    """
    if "none" not in controllers:
        raise ParameterError("controllers: must contain none, with which others are compared")
    names = list(families) or [*FAMILIES, *([RECORDINGS] if folder else [])]
    found: list[Member] = []
    for name in names:
        if name in FAMILIES:
            found += FAMILIES[name](seed, members or PER_KIND[name])
        elif folder is None:
            raise ParameterError("recordings: needs --recordings FOLDER")
        else:
            found += recordings(folder, recording_rate)
    tasks = [Task(member, controllers) for member in found]
    done, end = run_side_by_side(
        workers, run_member, tasks, "members", progress, journal_of(json_file)
    )
    rows = [done[index] for index in sorted(done)]
    lines = summaries([row for row in rows if row["family"] != "sensors"])
    sensed = sensor_summaries([row for row in rows if row["family"] == "sensors"])
    by_kind = [line for line in lines if line["by_kind"]]
    if lines:
        print_table(table(by_kind, "reported half by kind; errors, %"))
        print_table(table([each for each in lines if not each["by_kind"]], "both halves"))
    if sensed:
        print_table(sensor_table(sensed))
    told = [row for row in rows if row["reported"]]
    save({"rows": told, "summary": lines, "sensors": sensed}, json_file)
    if end:
        raise end


if __name__ == "__main__":
    run(families, "families")
