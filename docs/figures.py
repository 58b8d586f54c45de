# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draws figures of the documentation that come from lockstep trials.

``python docs/figures.py bounds FILE`` draws the trials of a file of ``benchmarks/fidelity.py``
against their bounds, and ``python docs/figures.py excursion`` one landing and one texture of low
frequency with and without excursion control. ``python docs/figures.py blackout`` draws two hosts
while the network between them is gone. ``python docs/figures.py rates FILE`` draws the error over
rate and granted delay, from ``benchmarks/fidelity.py rates``. All write to docs/figures.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure

from haptic_accel.analysis.plots import BLACK, BLUE, GREEN, VERMILION
from haptic_accel.core import topics
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.controllers import Loop
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.model import FloatArray, HandleParameters
from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.tick import TravelEstimator
from haptic_accel.core.trial import Trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial
from haptic_accel.setup.setup import Setup

FOLDER = Path(__file__).parent / "figures"

DRAWN = {
    "none": (BLACK, "_"),
    "dynamic": (VERMILION, "^"),
    "inverse": (BLUE, "x"),
    "adaptive": (GREEN, "o"),
}
"""Controllers of the figure of bounds, as far as they were measured, with colour and marker."""

GRANTED_LOOKS = {0.25: (BLACK, "s"), 0.5: (VERMILION, "^"), 1.0: (GREEN, "o"), 2.0: (BLUE, "x")}
"""Granted delays of the figure of rates, ms, with colour and marker."""

FIRST: dict[str, Any] = {"color": BLUE, "ls": "-"}
SECOND: dict[str, Any] = {"color": VERMILION, "ls": "--"}
"""Lines that differ in colour and dashes, for every colour vision and for print."""

ABOVE: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "frameon": False}
ABOVE |= {"fontsize": "small", "borderaxespad": 0.2}
"""Place of a legend above its panel, where it covers no data."""

GOAL = (1.3, 2.0)
"""Factor and points above the limited bound within which a controller should stay."""

BEFORE, AFTER = 0.1, 0.3
"""Part of a trial that is drawn, before and after the largest travel, s."""

FAST_LANDING = {"master_device": {"simulated.exploration.approach_time": 0.25}}
"""A hand that comes down twice as fast as the virtual rig's: its landings need the control."""

ENDLESS = 1.0
"""Travel limit with which nothing is given up, m."""


NETWORK = ChannelParameters(delay=0.02, jitter=0.01, loss=0.05)
"""Network between two hosts in the figure of blackouts."""

BLACKOUTS = (1.7, 1.78), (2.0, 2.5)
"""Start and end of those blackouts, s: one that is concealed, and one that frees the arms."""

SHOWN = 1.6, 3.6
"""Part that is drawn, s."""


def bounds(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw errors of trials against their limited bound and against that of causal filters."""
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    names = {
        "limited_bound_percent": "bound within the limits of travel and force (%)",
        "bound_percent": "bound of all causal linear filters (%)",
    }
    line = np.geomspace(0.1, 100.0, 100)
    for axes, (name, label) in zip(panels, names.items(), strict=True):
        for controller, (color, marker) in DRAWN.items():
            found = [row for row in rows if row["controller"] == controller]
            errors = [row["nrmse_percent"] for row in found]
            if found:
                look: dict[str, Any] = {"color": color, "marker": marker, "ls": "", "ms": 5}
                look |= {"markerfacecolor": "none", "alpha": 0.7, "label": controller}
                axes.plot([row[name] for row in found], errors, **look)
        axes.plot(line, line, "k-", lw=0.8, label="the bound itself")
        axes.set(xscale="log", yscale="log", xlabel=label)
        axes.grid(alpha=0.3)
    panels[0].plot(line, GOAL[0] * line + GOAL[1], "k--", lw=0.8, label="1.3 x bound + 2")
    panels[0].set(ylabel="error of the handle (%)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=6, frameon=False)
    return figure


def rates(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw errors of `adaptive` on the rig `paper` over the rate, for each granted delay."""
    rows = [row for row in rows if row["rig"] == "paper" and row["controller"] == "adaptive"]
    surfaces = list(dict.fromkeys(row["input"] for row in rows))
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    panels = figure.subplots(1, len(surfaces), sharex=True, sharey=True)
    for axes, surface in zip(panels, surfaces, strict=True):
        for granted, (color, marker) in GRANTED_LOOKS.items():
            # Forces are due one sample after their sample.
            found = sorted(
                (row["rate_hz"] / 1e3, row["nrmse_within_percent"])
                for row in rows
                if row["input"] == surface
                and math.isclose(row["delay_ms"] - 1e3 / row["rate_hz"], granted)
            )
            speed, error = zip(*found, strict=True)
            look: dict[str, Any] = {"color": color, "marker": marker, "ms": 5}
            axes.plot(speed, error, **look, label=f"{granted:g} ms granted")
        axes.set(xscale="log", xlabel="rate of the loop (kHz)", title=surface)
        axes.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    panels[0].set(ylabel="error below 500 Hz (%)")
    panels[0].set_ylim(bottom=0)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=5, frameon=False)
    return figure


class Run(NamedTuple):
    """Signals of a trial: time, s; travel, mm; error and desired acceleration, m/s^2."""

    time: FloatArray
    travel: FloatArray
    error: FloatArray
    desired: FloatArray
    nrmse: float


def run(limited: bool, recording: FloatArray | None) -> Run:
    """Run the inverse on a recording, or a fast landing, with excursion control or without."""
    arguments = GraphArguments(rig="ideal", controller="inverse", surface="plywood", duration=8.0)
    changes = FAST_LANDING if recording is None else {}
    with nullcontext() if limited else patch.object(Loop, "travel_limit", ENDLESS):
        setup = Setup.of(arguments).changed(changes)
        return _signals(lockstep_trial(setup, recording=recording))


def _signals(trial: Trial) -> Run:
    sample = TravelEstimator(HandleParameters(), trial.rate).observe
    pairs = zip(trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True)
    travel = 1e3 * np.array([sample(*pair) for pair in pairs])
    desired = trial.desired_acceleration[: len(trial.time) - trial.after]
    error = trial.actual_acceleration[trial.after :] - desired
    count = len(desired)
    nrmse = trial.evaluate().nrmse_percent
    return Run(trial.time[:count], travel[:count], error, desired, nrmse)


def excursion() -> Figure:
    """Draw travel and error of a landing and of a texture of low frequency."""
    free = 1e3 * ActuatorParameters().travel
    sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
    from fidelity_trials import texture

    figure = Figure(figsize=(9, 5), layout="constrained")
    panels = figure.subplots(2, 2, sharex="col")
    inputs = {
        "fast landing on plywood": None,
        "texture from 8 Hz, 6 m/s$^2$ RMS": texture(8.0, 6.0, 1e3),
    }
    for (above, below), (name, recording) in zip(panels.T, inputs.items(), strict=True):
        runs = {"with": run(True, recording), "without": run(False, recording)}
        free_run = runs["without"]
        inner = slice(0, np.searchsorted(free_run.time, free_run.time[-1] - AFTER))
        peak = free_run.time[np.argmax(np.abs(free_run.travel[inner]))]
        for (label, drawn), style in zip(runs.items(), (FIRST, SECOND), strict=True):
            part = (drawn.time >= peak - BEFORE) & (drawn.time <= peak + AFTER)
            time = drawn.time[part] - peak
            words = f"{label} excursion control, {drawn.nrmse:.1f} %"
            above.plot(time, drawn.travel[part], label=words, **style)
            below.plot(time, drawn.error[part], **style)
        above.hlines([-free, free], -BEFORE, AFTER, colors="k", linestyles=":", label="stops")
        above.set_title(name, pad=52)
        above.set(ylim=(-1.2 * free, 1.2 * free))
        above.legend(**ABOVE)
        below.set(xlabel="time from the largest travel (s)")
        for axes in (above, below):
            axes.grid(alpha=0.3)
    panels[0][0].set(ylabel="travel (mm)")
    panels[1][0].set(ylabel="error of the handle (m/s$^2$)")
    return figure


def blackout() -> Figure:
    """Draw positions, forces, energy and vibration of two hosts through two blackouts."""
    arguments = GraphArguments(rig="ideal", surface="text", duration=4.0)
    trial = lockstep_trial(Setup.of(arguments), channel=NETWORK, blackouts=BLACKOUTS)
    crossing = trial.crossing
    assert crossing is not None
    figure = Figure(figsize=(9, 9), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    place, force, energy, felt = panels
    arms = topics.MASTER, topics.SLAVE
    names, styles = ("master", "slave"), (FIRST, SECOND)
    for side, label, style, account in zip(arms, names, styles, crossing.energy.T, strict=True):
        moved = trial.arms[side.position.name] - trial.arms[side.position.name][0]
        place.plot(trial.time, 1e3 * moved[:, 0], label=label, **style)
        pull = trial.arms[side.arm_force.name]
        force.plot(trial.time, np.linalg.norm(pull, axis=1), label=label, lw=0.9, **style)
        energy.plot(trial.time, 1e3 * account, label=f"account of the {label}", lw=0.9, **style)
    energy.plot(
        trial.time, 1e3 * _given(trial), "k", label="net energy given to both arms", lw=1.5
    )
    energy.axhline(
        2e3 * PassiveParameters().energy,
        color="k",
        ls=":",
        lw=1.2,
        label="most that may be given",
    )
    felt.plot(
        trial.time, trial.tool_acceleration, label="tool, when it is played", lw=1.6, **FIRST
    )
    felt.plot(trial.time, crossing.played, label="played", lw=0.8, color=VERMILION)
    place.set(ylabel="position (mm)")
    force.set(ylabel="motor force (N)")
    energy.set(ylabel="energy (mJ)")
    felt.set(ylabel="acceleration (m/s$^2$)", xlabel="time (s)")
    felt.set(xlim=SHOWN)
    for axes in panels:
        for span in BLACKOUTS:
            axes.axvspan(*span, color="0.9")
        axes.grid(alpha=0.3)
        axes.legend(**ABOVE, ncols=4)
    return figure


def _given(trial: Trial) -> FloatArray:
    """Return the net energy that the motors of both arms have given so far, J."""
    total = np.zeros(len(trial.time))
    for side in (topics.MASTER, topics.SLAVE):
        acting = np.roll(trial.arms[side.arm_force.name], trial.latency, axis=0)
        acting[: trial.latency] = 0.0
        moved = np.diff(trial.arms[side.position.name], axis=0)
        total[1:] += np.cumsum(np.sum(acting[:-1] * moved, axis=1))
    return total


def main() -> None:
    """Draw the figure that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    figures = parser.add_subparsers(dest="name", required=True)
    figures.add_parser("bounds").add_argument("file", type=Path)
    figures.add_parser("rates").add_argument("file", type=Path)
    figures.add_parser("excursion")
    figures.add_parser("blackout")
    given = parser.parse_args()
    if "file" in given:
        draw = {"bounds": bounds, "rates": rates}[given.name]
        drawn = draw(json.loads(given.file.read_text(encoding="utf-8"))["rows"])
    else:
        drawn = {"excursion": excursion, "blackout": blackout}[given.name]()
    drawn.savefig(FOLDER / f"{given.name}.png", dpi=120)


if __name__ == "__main__":
    main()
