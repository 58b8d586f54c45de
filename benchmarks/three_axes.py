# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a handle with three coils gains over one coil, in lockstep.

``python benchmarks/three_axes.py`` prints, for both rigs with three coils on the paper's surfaces,
the error of the vector, the median error of its direction, and the share that a hand could not
tell, beside the bound of any causal linear controller. With one coil, the same handle moves by the
coil along z only, whose signal is one of the live reductions of the tool's three axes
(``reduction:=axis``, ``sum`` or ``principal``). With pulses, a device plays without error one sine
a frame, as `pulses.py` reduces the tool's vibration to them.

``--turned`` prints the error, and the time from contact to the first warning, with the handle's
accelerometer turned by ten degrees that nobody has told.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from pulses import played, pulses

from haptic_accel import (
    FloatArray,
    GraphArguments,
    Setup,
    Trial,
    indistinguishable,
    lockstep_trial,
)
from haptic_accel.analysis.plots import BLACK, BLUE, VERMILION
from haptic_accel.core.control.compensation import matrix_plant
from haptic_accel.core.control.error_bound import bounds
from haptic_accel.core.control.filters import high_passed
from haptic_accel.core.evaluation.metrics import aligned, direction_error, evaluate
from haptic_accel.setup.arguments import SURFACES

SECONDS = 10.0
BEGIN = 2.0
"""Time without contact, and of first learning, that is left out, s."""

RIGS = ("three_axis_ideal", "three_axis")

CONDITIONS: dict[str, tuple[str, Mapping[str, Any]]] = {
    "none": ("none", {}),
    "one coil: axis": ("inverse", {"reduction": "axis"}),
    "one coil: sum": ("inverse", {"reduction": "sum"}),
    "one coil: principal": ("inverse", {"reduction": "principal"}),
    "three coils: constant": ("constant", {}),
    "three coils: inverse": ("inverse", {}),
    "three coils: feedback": ("feedback", {}),
    "three coils: adaptive": ("adaptive", {}),
}
"""Controller and parameters of the compensator, by condition."""


TURNED = math.radians(10.0)
"""Angle of an accelerometer that nobody has told, rad."""

CONTACT = 0.5
"""Desired acceleration of a contact, m/s^2."""


class Row(NamedTuple):
    """Result of a condition: error and bound, %, angle, degrees, indistinguishable share, %."""

    error: float
    bound: float
    angle: float
    share: float


def compared(trial: Trial) -> tuple[FloatArray, FloatArray]:
    """Return the tool's vibration in all axes and the handle's, aligned."""
    corner, rate = trial.high_pass_frequency, trial.rate
    desired = high_passed(trial.tool_acceleration, corner, rate)
    delay, first = trial.after / rate, round(BEGIN * rate)
    desired, actual = aligned(desired, trial.handle_acceleration, corner, rate, delay)
    return desired[first:], actual[first:]


def run(rig: str, surface: str, condition: str, least: float = math.nan) -> tuple[Trial, Row]:
    """Run one condition in lockstep; `least` is a bound that is known already, %."""
    controller, changes = CONDITIONS[condition]
    arguments = GraphArguments(
        rig=rig, surface=surface, controller=controller, duration=SECONDS, record=False
    )
    trial = lockstep_trial(Setup.of(arguments).changed({"compensator": changes}))
    desired, actual = compared(trial)
    row = Row(
        evaluate(desired, actual, trial.rate, 0.0).nrmse_percent,
        bound(arguments, trial) if math.isnan(least) else least,
        direction_error(desired, actual),
        100.0 * indistinguishable(desired, actual, trial.rate),
    )
    return trial, row


PULSE_RATES = 30.0, 60.0, 90.0
"""Pulses per second of a loop of teleoperation, a game controller, and virtual reality."""


def pulse_shares(surface: str) -> list[float]:
    """Return the share that a hand could not tell for each of `PULSE_RATES`, %."""
    arguments = GraphArguments(
        rig=RIGS[0], surface=surface, controller="none", duration=SECONDS, record=False
    )
    trial = lockstep_trial(Setup.of(arguments))
    desired, _ = compared(trial)
    shares = []
    for frames in PULSE_RATES:
        actual = played(pulses(desired, trial.rate, frames), trial.rate)
        felt = np.column_stack([actual, np.zeros((len(actual), 2))])
        shares.append(100.0 * indistinguishable(desired[: len(felt)], felt, trial.rate))
    return shares


def turned(rig: str, controller: str, axis: str, angle: float) -> tuple[float, float, str]:
    """Return error from contact on, %, time from contact to a warning, s, and the warning."""
    arguments = GraphArguments(rig=rig, controller=controller, duration=SECONDS, record=False)
    body = {"simulated.body.sensor_rotation": angle, "simulated.body.sensor_axis": axis}
    trial = lockstep_trial(Setup.of(arguments).changed({"master_device": body}))
    touched = np.linalg.norm(trial.desired_acceleration, axis=1) > CONTACT
    first = int(np.argmax(touched))
    told = [(time - first / trial.rate, text) for time, text in trial.warnings if text]
    when, text = told[0] if told else (math.nan, "")
    return trial.evaluate(first).nrmse_percent, when, text


def bound(arguments: GraphArguments, trial: Trial) -> float:
    """Return the least error of any causal linear controller within the coils' limits, %."""
    setup = Setup.of(arguments)
    _, options = setup.node("compensator")
    master = setup.rig().master
    return bounds(
        matrix_plant(options, trial.rate).coupled().delayed(trial.latency),
        trial.rate,
        trial.tool_acceleration[round(BEGIN * trial.rate) :],
        granted_delay=trial.after,
        noise=master.accelerometer.noise,
        actuator=master.actuator,
    ).limited


DRAWN = {"one coil: axis": VERMILION, "three coils: adaptive": BLUE}
"""Conditions whose motion is drawn, and their colours."""

SHOWN = 0.05
"""Duration of the motion that is drawn, s."""


def figure(rows: Mapping[str, Mapping[str, Row]], trials: Mapping[str, Trial]) -> Figure:
    """Draw the errors by rig and condition, and the motion of two conditions in a plane."""
    drawn = Figure(figsize=(10, 4.2), layout="constrained")
    bars, *planes = drawn.subplots(1, 1 + len(DRAWN), width_ratios=[1.6, 1, 1])
    names = [name for name in CONDITIONS if name != "none"]
    height = 0.8 / len(rows)
    looks = zip(rows.items(), (BLUE, VERMILION), strict=False)
    for index, ((rig, found), color) in enumerate(looks):
        places = np.arange(len(names)) + (index - 0.5 * (len(rows) - 1)) * height
        bars.barh(places, [found[name].error for name in names], height, color=color, label=rig)
        bound = float(np.mean([each.bound for each in found.values()]))
        bars.axvline(bound, color=color, ls="--", lw=1.2, label=f"bound, {rig}")
    bars.set_yticks(np.arange(len(names)), names)
    bars.invert_yaxis()
    bars.set(xlabel="error of the vector (%); 100 without force")
    bars.grid(axis="x", alpha=0.3)
    bars.legend(loc="lower right", fontsize="small")
    for axes, (name, color) in zip(planes, DRAWN.items(), strict=True):
        desired, actual = compared(trials[name])
        middle = int(np.argmax(np.abs(desired[:, 0])))
        part = slice(middle, middle + round(SHOWN * trials[name].rate))
        axes.plot(desired[part, 0], desired[part, 2], color=BLACK, lw=1.6, label="tool")
        axes.plot(actual[part, 0], actual[part, 2], color=color, lw=1.2, ls="--", label="handle")
        axes.set(title=name, xlabel="x, along the stroke (m/s$^2$)", aspect="equal")
        axes.set(adjustable="datalim", ylabel="z, normal (m/s$^2$)")
        axes.grid(alpha=0.3)
        axes.legend(loc="lower right", fontsize="small")
    return drawn


def main() -> None:
    """Print the table, and draw the figure if a file is given."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--rigs", nargs="+", default=RIGS)
    parser.add_argument("--surfaces", nargs="+", default=SURFACES)
    parser.add_argument("--turned", action="store_true", help="print the second table only")
    parser.add_argument("--figure", type=Path, help="PNG file to draw")
    given = parser.parse_args()
    if given.turned:
        for rig, controller in product(given.rigs, ("inverse", "adaptive")):
            for axis, angle in product("xyz", (TURNED, -TURNED)):
                error, when, text = turned(rig, controller, axis, angle)
                degrees = f"{math.degrees(angle):+.0f} degrees about {axis}"
                print(f"{rig:18} {controller:9} {degrees}: {error:5.1f} % {when:5.2f} s {text}")
        return
    print("mean over the surfaces: error %, its bound %, direction degrees, not told apart %")
    means: dict[str, dict[str, Row]] = {rig: {} for rig in given.rigs}
    trials: dict[str, Trial] = {}
    least: dict[tuple[str, str], float] = {}  # nearly the same for all conditions
    for rig in given.rigs:
        for condition in CONDITIONS:
            runs = []
            for surface in given.surfaces:
                runs.append(run(rig, surface, condition, least.get((rig, surface), math.nan)))
                least[rig, surface] = runs[-1][1].bound
            mean = means[rig][condition] = Row(*np.mean([row for _, row in runs], axis=0))
            trials[condition] = runs[0][0]
            values = " ".join(f"{value:7.2f}" for value in mean)
            print(f"{rig:18} {condition:30} {values}", flush=True)
    rows = np.mean([pulse_shares(surface) for surface in given.surfaces], axis=0)
    for frames, share in zip(PULSE_RATES, rows, strict=True):
        print(f"{'any':18} {f'{frames:g} pulses a second':30} {share:31.2f}")
    if given.figure:
        figure(means, trials).savefig(given.figure, dpi=120)


if __name__ == "__main__":
    main()
