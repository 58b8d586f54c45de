# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coverage of identified intervals on random rigs of known parameters.

Run as ``python benchmarks/identification_coverage.py``. Each rig is identified with the paper's
sweep in lockstep. A table gives, for each kind of rig and each parameter, how often the 95 %
interval contains the true value.

``--three-axes`` identifies random handles with three coils instead, around ``three_axis``, as
``identify rig:=three_axis`` does: with smaller amplitudes where the default ones are too strong. A
table gives the largest error of the response, and what is doubted.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from input_family import log_uniform

from haptic_accel import (
    GraphArguments,
    HandleParameters,
    MasterRigParameters,
    MountParameters,
    Setup,
    SweepParameters,
    identify_handle,
    run_identification,
)
from haptic_accel.analysis.identification_result import plant_error
from haptic_accel.cli.identify import LESS, SMALLEST_SHARE
from haptic_accel.commands import ResultTable, print_table
from haptic_accel.core.axes import NAMES
from haptic_accel.core.handle.three_axis import CoilMounting, SensorMounts
from haptic_accel.core.identification.estimate import SMALLER, RecordingError
from haptic_accel.core.identification.fit import INTERVAL, HandleFit
from haptic_accel.core.identification.sweep import IdentificationTrial, check_stops
from haptic_accel.core.identification.three_axes import COMPARED, identify_three_axes
from haptic_accel.core.rig.master_rig import SimulatedMasterParameters
from haptic_accel.core.trial import master_response
from haptic_accel.setup.arguments import IdentifyArguments

KINDS = ("ideal", "paper")
"""Rigs of config/rigs around which the random ones lie."""

SPREAD = {"m_a": 0.3, "k_s": 0.3, "b_s": 0.5, "m_h": 0.5, "k_u": 0.5, "b_u": 0.5}
"""Largest relative deviation of the handle's parameters; both signs have the same factor."""

MOUNT_SPREAD = {"frequency": 0.3, "damping": 0.5}
"""Largest relative deviation of the mount's parameters, if it has a mode."""

NOISE = (0.02, 3.0)
"""Range of the accelerometer's noise, m/s^2, logarithmically uniform."""

LONGEST_DELAY = 1e-3
"""Largest delay of the drive, s; half of the rigs have none."""

LARGEST_FRICTION = 0.05
"""Largest dry friction of rigs that have any, N."""

CLOCK = 1e-5
"""Step of the simulated drive's delay, s."""

RATE = 1000.0
"""Samples per second."""


def main() -> None:
    """Identify random rigs; print a line on each and a table at the end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=100, help="rigs of each kind (default: 100)")
    parser.add_argument("--first", type=int, default=0, help="first index of a rig (default: 0)")
    parser.add_argument("--trials", type=int, default=4, help="trials of each rig (default: 4)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--three-axes", action="store_true", help="handles with three coils")
    given = parser.parse_args()
    if given.three_axes:
        for index in range(given.first, given.first + given.rigs):
            print(f"rig {index}: {three_axes_outcome(index)}", flush=True)
        return
    conditions = [
        (kind, index, given.trials)
        for index in range(given.first, given.first + given.rigs)
        for kind in KINDS
    ]
    outcomes = []
    with ProcessPoolExecutor(given.jobs) as pool:
        try:
            for outcome in pool.map(_outcome, conditions):
                outcomes.append(outcome)
                print(outcome.line, flush=True)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
    print_table(coverage(outcomes))


@dataclass(frozen=True)
class Outcome:
    """Identification of one rig.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    index : int
        Index of the rig.
    noise : float
        Accelerometer's noise, m/s^2.
    refused : str
        Reason of a refusal; empty if there is a result.
    doubts : tuple of str
        Stated doubts.
    errors : dict of str to float
        Error of each identified parameter, in half widths of its interval.
    """

    kind: str
    index: int
    noise: float
    refused: str = ""
    doubts: tuple[str, ...] = ()
    errors: dict[str, float] = field(default_factory=dict)

    @property
    def line(self) -> str:
        """Description for a terminal, with the parameters whose interval misses the truth."""
        missed = (f"{name} {error:+.2f}" for name, error in self.errors.items() if abs(error) > 1)
        said = self.refused or "; ".join(self.doubts)
        return f"{self.kind} {self.index}, noise {self.noise:.2f}: {', '.join(missed)} | {said}"


def random_rig(kind: str, index: int) -> MasterRigParameters:
    """Return the master of a random rig; the same for the same arguments.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    index : int
        Index of the rig.
    """
    random = np.random.default_rng((KINDS.index(kind), index))

    def varied(value: float, spread: float) -> float:
        return value * math.exp(math.log1p(spread) * random.uniform(-1.0, 1.0))

    master = Setup.of(GraphArguments(rig=kind)).rig().master
    handle = {name: varied(getattr(master.handle, name), w) for name, w in SPREAD.items()}
    mount = {name: varied(getattr(master.mount, name), w) for name, w in MOUNT_SPREAD.items()}
    delay = random.uniform(0.0, LONGEST_DELAY) * random.integers(2)
    friction = random.uniform(0.0, LARGEST_FRICTION) if master.drive.coulomb_friction else 0.0
    noise = log_uniform(random, *NOISE)
    density = noise / math.sqrt(math.pi / 2 * master.accelerometer.bandwidth)
    return replace(
        master,
        handle=replace(master.handle, **handle),
        grip=replace(master.grip, variation=0.0),
        mount=replace(master.mount, **mount) if master.mount.frequency else master.mount,
        drive=replace(master.drive, delay=round(delay / CLOCK) * CLOCK, coulomb_friction=friction),
        accelerometer=replace(master.accelerometer, noise_density=density),
    )


TILT, OFFSET = math.radians(20.0), 7e-3
"""Largest tilt of a coil, rad, and largest offset of a coil or of the sensor from its place, m."""


def random_three_axis_rig(index: int) -> SimulatedMasterParameters:
    """Return the master of a random rig with three coils; the same for the same index."""
    random = np.random.default_rng((78, index))
    master = Setup.of(GraphArguments(rig="three_axis")).rig().master
    assert isinstance(master, SimulatedMasterParameters)

    def drawn(most: float) -> float:
        return float(most * random.uniform(-1.0, 1.0))

    def varied(value: float, factor: float) -> float:
        return value * math.exp(drawn(math.log(factor)))

    tilts = {f"tilt_{axis}": drawn(TILT) for axis in NAMES}
    offsets = {f"offset_{axis}": drawn(OFFSET) for axis in NAMES}
    x, y, z = (drawn(OFFSET) for _ in NAMES)
    mounts = {
        axis: MountParameters(varied(each.frequency, 1.4), varied(each.damping, 2.0))
        for axis, each in vars(master.mounts).items()
    }
    handle = replace(
        master.handle,
        m_h=master.handle.m_h * random.uniform(0.7, 1.3),
        k_u=varied(master.handle.k_u, 2.0),
        b_u=varied(master.handle.b_u, 2.0),
    )

    class Mounted(SimulatedMasterParameters):
        """Master whose coils are mounted at random."""

        coils = CoilMounting(**tilts, **offsets)

    return replace(
        Mounted(**vars(master)),
        handle=handle,
        grip=replace(master.grip, variation=0.0),
        body=replace(master.body, sensor_x=x, sensor_y=y, sensor_z=master.body.sensor_z + z),
        mounts=SensorMounts(**mounts),
    )


def three_axes_outcome(index: int) -> str:
    """Identify a random rig with three coils; return its error and doubts, or the refusal."""
    rig, share = random_three_axis_rig(index), 1.0
    given = IdentifyArguments.from_specified(rig="three_axis")
    known = HandleParameters(m_a=rig.handle.m_a, k_s=rig.handle.k_s, b_s=rig.handle.b_s)
    sensed = rig.accelerometer.range, rig.accelerometer.bandwidth
    while True:
        sweep = replace(
            given.sweep,
            start_amplitude=share * given.start_amplitude,
            end_amplitude=share * given.end_amplitude,
        )
        trials = run_identification(rig, sweep, RATE, index, given.trials)
        try:
            check_stops({"average": trials})
            found = identify_three_axes(trials, sweep, *sensed, known=known)
        except RecordingError as reason:
            share *= LESS
            if reason.factors != SMALLER or share < SMALLEST_SHARE:
                return f"refused: {reason}"
        else:
            break
    low, high = COMPARED
    lines = found.response.frequency
    lines = lines[(lines >= low) & (lines <= high)]
    error = plant_error(found.plant.response(lines, RATE), master_response(rig, lines, RATE))
    return (
        f"{100 * share:.0f} % of the amplitudes, {error.magnitude_db:.2f} dB,"
        f" {error.phase_deg:.1f} degrees; {'; '.join(found.doubts) or 'no doubt'}"
    )


def identified(rig: MasterRigParameters, trials: Sequence[IdentificationTrial]) -> Outcome:
    """Identify a rig from its trials, with its true actuator and accelerometer as known."""
    noise = rig.accelerometer.noise
    recorded = {"average": trials}
    try:
        check_stops(recorded)
        found = identify_handle(
            recorded,
            SweepParameters(),
            rig.accelerometer.range,
            rig.accelerometer.bandwidth,
            known=HandleParameters(m_a=rig.handle.m_a, k_s=rig.handle.k_s),
        )
    except RecordingError as reason:
        return Outcome("", 0, noise, refused=str(reason))
    errors = dict(_errors(found.fit, rig))
    return Outcome("", 0, noise, doubts=tuple(found.doubts), errors=errors)


def _errors(fit: HandleFit, rig: MasterRigParameters) -> Iterator[tuple[str, float]]:
    """Yield each identified parameter and its error in half widths of its interval.

    A mount's mode that the rig does not have counts as an infinite error, and so does one that
    is missing without a doubt.
    """
    if bool(rig.mount.frequency) != bool(fit.mount.frequency):
        yield "mount_frequency", math.inf if fit.mount.frequency else -math.inf
    for name, value in _true(rig).items():
        if name in fit.standard_errors:
            yield name, (fit.value(name) - value) / (INTERVAL * fit.standard_errors[name])


def _true(rig: MasterRigParameters) -> dict[str, float]:
    """Return the true values of all parameters that can be identified."""
    mount = MOUNT_SPREAD if rig.mount.frequency else {}
    return {
        **{name: getattr(rig.handle, name) for name in SPREAD},
        "delay": rig.drive.delay,
        "friction": rig.drive.coulomb_friction,
        **{f"mount_{name}": getattr(rig.mount, name) for name in mount},
    }


def coverage(outcomes: Sequence[Outcome]) -> ResultTable:
    """Return the share of intervals that contain the truth, among results without a doubt.

    Returns
    -------
    ResultTable
        A row for each kind: numbers of rigs, refusals and doubts, then a percentage for each
        parameter.
    """
    sure = [each for each in outcomes if not (each.refused or each.doubts)]
    names = list(dict.fromkeys(name for each in outcomes for name in each.errors))
    rows = []
    for kind in KINDS:
        rigs = [each for each in outcomes if each.kind == kind]
        cells = []
        for name in names:
            inside = [
                abs(each.errors[name]) <= 1.0
                for each in sure
                if each.kind == kind and name in each.errors
            ]
            cells.append(f"{100 * float(np.mean(inside)):.0f}" if inside else "")
        refused = sum(bool(each.refused) for each in rigs)
        doubted = sum(bool(each.doubts) for each in rigs)
        rows.append([kind, f"{len(rigs)}", f"{refused}", f"{doubted}", *cells])
    headings = ("kind", "rigs", "refused", "doubted", *names)
    return ResultTable(headings, rows, "intervals that contain the truth (%)", left=1)


def _outcome(condition: tuple[str, int, int]) -> Outcome:
    kind, index, trials = condition
    rig = random_rig(kind, index)
    recorded = run_identification(rig, SweepParameters(), RATE, index, trials, latency=0)
    return replace(identified(rig, recorded), kind=kind, index=index)


if __name__ == "__main__":
    main()
