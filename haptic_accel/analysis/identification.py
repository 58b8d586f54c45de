# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Identification of a handle: its recordings, the fit, parameter file, metrics and true errors."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from haptic_accel.analysis import identification_report as report
from haptic_accel.analysis.identification_report import ModelError
from haptic_accel.analysis.identification_three_axes import ThreeAxisResult
from haptic_accel.bags.delivery import AGE_OF, durations
from haptic_accel.bags.reading import Bag, Signal, read_bag_with_warnings
from haptic_accel.core import topics
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXIS, Axes
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification import three_axes
from haptic_accel.core.identification.estimate import RecordingError, dft_ratio
from haptic_accel.core.identification.evaluation import (
    Identification,
    Tell,
    centred,
    identify_handle,
    stages,
)
from haptic_accel.core.identification.fit import INTERVAL, HandleFit
from haptic_accel.core.identification.multisine import orthogonal_excitation
from haptic_accel.core.identification.stops import (
    LIMITED,
    STOPS_HIT,
    Recorded,
    check_stops,
    check_travel,
)
from haptic_accel.core.identification.three_axes import (
    ThreeAxisIdentification,
    identify_three_axes,
)
from haptic_accel.core.model import ACTUATOR, FloatArray, HandleParameters, Suspension, held
from haptic_accel.core.parameters import ParameterError, own_schema
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, on_grid, places, same_rate
from haptic_accel.core.simulated_identification import master_response, run_identification
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.materials.columns import ACCELERATION, FORCE, Column, Wording
from haptic_accel.materials.recordings import read_columns
from haptic_accel.setup.arguments import AVERAGE_GRIP, IdentifyArguments
from haptic_accel.setup.files import EVERY_NODE
from haptic_accel.setup.setup import Setup

LOWEST_COMPARED = 15.0
"""Frequency below which the compensator's high-pass passes nothing (paper), Hz."""

HIGHEST_COMPARED = 400.0
"""Frequency above which the true response lies in the accelerometer's noise, Hz."""


@dataclass(frozen=True)
class Result:
    """Result of an identification.

    Attributes
    ----------
    found : Identification
    actuator : ActuatorParameters
        Actuator as known before the identification.
    latency : int
        Latency of the recordings, samples.
    band : tuple of float
        Lowest and highest frequency of a comparison with the true response, Hz.
    doubts : sequence of str
        Reasons to doubt the fit, one line each.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    errors : mapping of ModelError
        Errors by model; empty if the true response is unknown.
    """

    found: Identification
    actuator: ActuatorParameters
    latency: int
    band: tuple[float, float]
    doubts: Sequence[str]
    truth: HandleParameters | None = None
    errors: Mapping[str, ModelError] = field(default_factory=dict)

    @property
    def notes(self) -> list[str]:
        """Warnings to the reader of the metrics."""
        return [*self.doubts, *self.found.outliers] + [POOLED_NOTE] * (len(self.found.grips) > 1)

    @property
    def fits(self) -> dict[str, HandleFit]:
        """Fits by column of a table."""
        return report.fits_by_column(self.found)

    @property
    def explained(self) -> str:
        """Sentence on the residual of the fit."""
        return report.explained(self.found)

    def write_report(
        self, folder: Path, sweep: sweeps.SweepParameters, settings: Mapping[str, str]
    ) -> Path:
        """Write the page of the identification; return its path."""
        return report.write_identification_report(
            self.found,
            sweep,
            folder,
            settings=settings,
            truth=self.truth,
            errors=self.errors,
            band=self.band,
            notes=self.notes,
        )

    def sentences(self) -> Iterator[str]:
        """Yield errors against the true response, and the delay of the hardware."""
        for name, error in self.errors.items():
            yield (
                f"{name} model against the true response, {self.band[0]:g} to {self.band[1]:g} Hz:"
                f" at most {error.magnitude_db:.2f} dB and {error.phase_deg:.1f} degrees"
            )
        yield (
            f"delay of the hardware: {self.found.fit.delay * 1e6:.0f} us, in addition to the"
            f" graph's latency of {self.latency} samples"
        )

    def parameters(self, age: float) -> dict[str, dict[str, Any]]:
        """Return the parameters of each node that describe the handle, and its controllers.

        The compensator reports the doubts as a warning.

        Parameters
        ----------
        age : float
            Age of forces applied on arrival, s. A controller compensates it, as part of the delay,
            but it is not part of the simulated handle's own delay.
        """
        found, fit = self.found, self.found.fit
        # Friction that may be zero must not be compensated.
        certain = fit.bearing.friction > INTERVAL * fit.standard_errors.get("friction", 0.0)
        friction = float(f"{fit.bearing.friction:.4f}") if certain else 0.0
        handle = report.plain({name: getattr(fit.handle, name) for name in ("m_h", "k_u", "b_u")})
        mount = report.plain(asdict(fit.mount))
        suspension = {name: getattr(fit.handle, name) for name in own_schema(Suspension)}
        return {
            EVERY_NODE: {ACTUATOR: report.plain(asdict(self.actuator) | suspension)},
            "master_device": {
                "simulated": {
                    "handle": handle,
                    "mount": mount,
                    "drive": {
                        "delay": float(f"{max(0.0, fit.delay - age):.6f}"),
                        "coulomb_friction": friction,
                    },
                }
            },
            "compensator": {
                "constant": report.plain({"mass": fit.handle.m_h}),
                "dynamic": report.plain(asdict(found.approximate)),
                "plant": {
                    "handle": handle,
                    "mount": mount,
                    "delay": float(f"{max(0.0, fit.delay):.6f}"),
                    "bandwidth": fit.low_pass_frequency,
                    "friction": friction,
                    "doubt": "; ".join(self.doubts),
                },
            },
        }

    @property
    def heading(self) -> str:
        """First lines of a parameter file."""
        fit = self.found.fit
        return (
            "# A handle as identified; use with params_file:=FILE. SI units.\n"
            f"# Band {fit.band[0]:.4g} to {fit.band[1]:.4g} Hz, delay of the hardware"
            f" {fit.delay * 1e6:.0f} us, beside the latency\n# and the loop's own sample, residual"
            f" {fit.residual:.2f} (1: noise alone).\n"
        )

    def metrics(self) -> dict[str, Any]:
        """Return the metrics of an identification for a JSON file.

        Keys without a model's name refer to the discrete model.
        """
        found, errors = self.found, self.errors
        discrete = errors.get("discrete")
        return {
            **report.fit_metrics(found.fit),
            "latency_samples": self.latency,
            "max_magnitude_error_db": discrete.magnitude_db if discrete else None,
            "max_phase_error_deg": discrete.phase_deg if discrete else None,
            "band_hz": list(self.band),
            "doubts": list(self.doubts),
            "outliers": {
                name: sum(trial.counters[sweeps.OUTLIERS] for trial in grip.trials)
                for name, grip in found.grips.items()
            },
            "physical_model": asdict(errors["physical"]) if errors else None,
            "grips": {name: report.fit_metrics(grip.fit) for name, grip in found.grips.items()},
            "approximate_model": asdict(found.approximate),
            "discrete_model": {
                "sections": found.discrete.sections.tolist(),
                "delay_samples": found.discrete.delay_samples,
                "rate_hz": found.discrete.rate,
            },
        }


POOLED_NOTE = (
    "models of all grips pooled are a compromise between them, the discrete model most of all; for"
    " the best model of one grip, identify that grip alone"
)
"""Note on several grips."""


def evaluate(
    recorded: Recorded,
    arguments: IdentifyArguments,
    free: Sequence[str],
    tell: Tell = lambda _: None,
) -> Result | ThreeAxisResult:
    """Fit the model to recordings, of three axes if they have three.

    Parameters
    ----------
    recorded : mapping
        Trials by the name of the grip.
    arguments : IdentifyArguments
    free : sequence of str
        Parameters of the model to fit.
    tell : callable
        Called with the name of each of `evaluation_stages` as it begins.

    Raises
    ------
    RecordingError
        The response cannot be determined.
    ParameterError
        A handle with three axes is held with several grips.
    """
    check_stops(recorded)
    _, known = Setup.of(arguments).node("identifier")
    actuator, sensor = known[ACTUATOR], known["accelerometer"]
    sensed = sensor.range, sensor.bandwidth
    handle = HandleParameters(
        m_a=actuator.m_a, k_s=actuator.k_s, b_s=actuator.b_s or HandleParameters.b_s
    )
    latency = next(iter(recorded.values()))[0].latency
    if _has_three_axes(recorded):
        check_one_grip(recorded)
        (trials,) = recorded.values()
        axes = identify_three_axes(
            trials, arguments.sweep, *sensed, known=handle, free=free, tell=tell
        )
        stretched = _coil_travel(axes, actuator.travel)
        return ThreeAxisResult(axes, actuator, latency, [*stretched, *axes.doubts])
    found = identify_handle(recorded, arguments.sweep, *sensed, known=handle, free=free, tell=tell)
    # Of each grip, the doubt on the largest travel.
    travel = [
        max(check_travel(name, each, grip.fit.handle, actuator.travel) for each in grip.trials)
        for name, grip in found.grips.items()
    ]
    doubts = [*filter(None, travel), *found.doubts]
    lowest, highest = arguments.sweep.start_frequency, 0.9 * arguments.sweep.end_frequency
    band = max(LOWEST_COMPARED, lowest), min(highest, HIGHEST_COMPARED)
    return Result(found, actuator, latency, band, doubts)


def evaluation_stages(recorded: Recorded) -> list[str]:
    """Return the names of the stages of `evaluate`, in their order."""
    return three_axes.stages() if _has_three_axes(recorded) else stages(recorded)


def check_one_grip(grips: Collection[str]) -> None:
    """Reject several grips on a handle with three axes.

    Raises
    ------
    ParameterError
        The message contains the grips.
    """
    if len(grips) > 1:
        raise ParameterError(f"grips = {', '.join(grips)}: must be one for three axes")


def _has_three_axes(recorded: Recorded) -> bool:
    return any(trial.actuator_force.ndim == 2 for trials in recorded.values() for trial in trials)


def _coil_travel(found: ThreeAxisIdentification, most: float) -> list[str]:
    """Return a doubt for each coil whose largest estimated travel comes near its stops, m."""
    doubts = []
    for coil, (name, fit) in enumerate(found.fits.items()):
        alone = [
            replace(
                trial,
                actuator_force=trial.actuator_force[:, coil],
                handle_acceleration=trial.handle_acceleration[:, coil],
            )
            for trial in found.trials
        ]
        doubts.append(max(check_travel(f"axis {name}", each, fit.handle, most) for each in alone))
    return [*filter(None, doubts)]


def axes_of(arguments: IdentifyArguments) -> Axes:
    """Return the axes of the handle that is identified."""
    return Axes.parsed(Setup.of(arguments).values["identifier"]["axes"])


def beside_truth(
    result: Result | ThreeAxisResult, arguments: IdentifyArguments, on_arrival: bool
) -> Result | ThreeAxisResult:
    """Return a result with its errors against the simulated rig that was identified."""
    rig = rig_as_held(arguments)
    if isinstance(result, ThreeAxisResult):
        return result.beside_truth(partial(master_response, rig.master), on_arrival)
    errors = model_errors(result.found, rig, arguments.sweep, result.band, on_arrival)
    return replace(result, truth=rig.master.handle, errors=errors)


def rig_as_held(arguments: IdentifyArguments) -> RigParameters:
    """Return the simulated rig with one user's grip, for any seed of the noise."""
    master = Setup.of(arguments).rig().master
    handle = held(master.handle, master.grip, arguments.seed)
    grip = replace(master.grip, variation=0.0, posture=AVERAGE_GRIP)
    return RigParameters(replace(master, handle=handle, grip=grip))


def model_errors(
    found: Identification,
    rig: RigParameters,
    sweep: sweeps.SweepParameters,
    band: tuple[float, float],
    on_arrival: bool,
) -> dict[str, ModelError]:
    """Compare the models with the response of the rig without noise, friction and converters.

    Parameters
    ----------
    found : Identification
    rig : RigParameters
        Simulated rig that was identified.
    sweep : SweepParameters
        Excitation of the comparison.
    band : tuple of float
        Lowest and highest frequency compared, Hz.
    on_arrival : bool
        True if forces took effect on arrival. Their age adds to the rig's own delay and is part of
        the models, so the identified delay is used as the true one.

    Returns
    -------
    dict of ModelError
        Largest errors of the models ``discrete`` and ``physical``.
    """
    master, rate = rig.master, found.discrete.rate
    delay = max(0.0, found.fit.delay) if on_arrival else master.drive.delay
    clean = replace(
        master,
        drive=replace(master.drive, coulomb_friction=0.0, bits=32, delay=delay),
        accelerometer=replace(master.accelerometer, noise_density=0.0, bits=32),
    )
    (trial,) = run_identification(clean, sweep, rate, latency=0)
    force, acceleration = (
        sweeps.kept_repeats(values, sweep, rate)
        for values in (trial.actuator_force, centred(trial.handle_acceleration))
    )
    true = dft_ratio(force, acceleration, rate, band, sweep.repeats - 1)
    errors = {}
    for name, response in (
        ("discrete", found.discrete.response(true.frequency)),
        ("physical", found.fit.response(true.frequency, rate)),
    ):
        ratio = response / true.response
        errors[name] = ModelError(
            float(np.max(np.abs(20 * np.log10(np.abs(ratio))))),
            float(np.max(np.abs(np.angle(ratio))) * (180 / math.pi)),
        )
    return errors


# Recordings

MOST_MISSING = 0.01
"""Largest share of missing samples with which a trial is evaluated (assumed)."""

COLUMNS = {"actuator_force": FORCE, "handle_acceleration": ACCELERATION}
"""Columns of a CSV file; without a unit in the title in N and m/s^2."""


@dataclass
class Recordings:
    """Trials of an identification.

    Attributes
    ----------
    trials : dict
        Trials by the name of the grip.
    age : float
        Mean age of forces without a due time, s.
    left_out : list of RecordingError
        Errors of bags, some of whose trials miss too many samples.
    """

    trials: dict[str, list[sweeps.IdentificationTrial]] = field(default_factory=dict)
    age: float = 0.0
    left_out: list[RecordingError] = field(default_factory=list)


def run_lockstep(arguments: IdentifyArguments) -> list[sweeps.IdentificationTrial]:
    """Run the trials of one grip in lockstep."""
    return run_identification(
        rig_as_held(arguments).master,
        arguments.sweep,
        arguments.rate,
        arguments.seed,
        arguments.trials,
        arguments.latency,
    )


def named(sources: Sequence[str], grip: str) -> Iterator[tuple[str, Path]]:
    """Yield grip and path of each source, ``GRIP=PATH``, or ``PATH`` with the grip given.

    A path may hold a = itself: in its folders, or as the only one of both that exists.

    Raises
    ------
    ParameterError
        Both exist.
    """
    for source in sources:
        name, separator, path = source.partition("=")
        whole = os.path.lexists(source)
        if separator and whole and os.path.lexists(path):
            raise ParameterError(
                f"from = '{source}': must be './{source}' or '{name}=./{path}': both files exist"
            )
        is_path = not separator or whole or "/" in name
        yield (grip, Path(source)) if is_path else (name, Path(path))


def read_recordings(
    places: Iterable[tuple[str, Path]], arguments: IdentifyArguments, recording_rate: float
) -> Recordings:
    """Read trials from bags and CSV files.

    Parameters
    ----------
    places : iterable of tuple
        Grip and path of each.
    arguments : IdentifyArguments
    recording_rate : float
        Sampling rate of CSV files, Hz; 0 for that of their times, or else the graph's.

    Raises
    ------
    ParameterError
        They differ in rate or latency.
    RecordingError
        A bag is not of an identification, or no trial can be evaluated.
    """
    found = Recordings()
    ages = []
    for grip, path in places:
        if os.path.isdir(path):
            bag = read_bag_with_warnings(path)
            trials = _trials(bag, arguments, found.left_out)
            ages.append(_force_age(bag))
        else:
            samples, rate = read_columns(
                path,
                recording_rate,
                [Column((name,), quantity) for name, quantity in COLUMNS.items()],
                Wording("recording_rate", ""),
                arguments.rate,
            )
            force, acceleration = samples.T
            trials = sweeps.find_trials(force, acceleration, arguments.sweep, rate)
        found.trials.setdefault(grip, []).extend(trials)
    every = [trial for trials in found.trials.values() for trial in trials]
    for name, count in (
        ("rates", len({trial.rate for trial in every})),
        ("latencies", len({trial.latency for trial in every})),
    ):
        if count > 1:
            raise ParameterError(f"from: recordings of {count} {name}, must be of one")
    found.age = fmean(ages) if ages else 0.0
    return found


def _trials(
    bag: Bag, arguments: IdentifyArguments, left_out: list[RecordingError]
) -> list[sweeps.IdentificationTrial]:
    """Return the trials of a bag, without those that miss too many samples.

    Raises
    ------
    RecordingError
        No trial is left.
    """
    force, acceleration, missing = _read_excited(bag, arguments.rate)
    sweep, rate = arguments.sweep, arguments.rate
    wanted = sweeps.excitation(sweep, rate)
    if force[:, [axis for axis in range(3) if axis != ACTUATOR_AXIS]].any():
        wanted = orthogonal_excitation(sweep, rate)
    else:
        force, acceleration = force[:, ACTUATOR_AXIS], acceleration[:, ACTUATOR_AXIS]
    found = sweeps.find_trials(force, acceleration, sweep, rate, missing, bag.latency or 0, wanted)
    # The device's counts do not name the trial.
    values = _last_values(bag)
    for trial in found:
        trial.counters.update((key, int(values.get(key, 0))) for key in (STOPS_HIT, *LIMITED))
    most = MOST_MISSING * len(found[0].actuator_force)
    whole = [trial for trial in found if trial.counters[sweeps.SAMPLES_MISSING] <= most]
    if len(whole) < len(found):
        counts = ", ".join(str(trial.counters[sweeps.SAMPLES_MISSING]) for trial in found)
        error = RecordingError(
            f"{bag.path}: {len(found) - len(whole)} of {len(found)} trials left out, as each lacks"
            f" more than {100 * MOST_MISSING:g} % of its samples (missing by trial: {counts});"
            " record again with less load on the machine, which haptic-accel doctor checks, or at"
            " a lower rate",
            {"rate": 0.5},
        )
        if not whole:
            raise error
        left_out.append(error)
    return whole


def _read_excited(bag: Bag, rate: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return actuator force and handle acceleration of an identification's bag.

    Parameters
    ----------
    bag : Bag
        Bag written by the recorder.
    rate : float
        Samples per second of the graph.

    Returns
    -------
    actuator_force, handle_acceleration : ndarray, shape (n, 3)
        N and m/s^2; each force is at the sample that caused it.
    missing : ndarray of bool, shape (n,)
        True for samples missing in the bag, which repeat the previous value.

    Raises
    ------
    RecordingError
        The bag lacks a signal, or has another rate.
    """
    signals = bag.signals
    for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION):
        if topic.name not in signals or len(signals[topic.name].stamps) < 2:
            raise RecordingError(f"{bag.path}: has no {topic.name}")
    stamps = signals[topics.HANDLE_ACCELERATION.name].stamps
    found = NANOSECONDS / float(np.median(np.diff(stamps)))
    if not same_rate(found, rate):
        raise RecordingError(
            f"{bag.path}: {topics.HANDLE_ACCELERATION.name} has {found:.5g} samples per second,"
            f" must have rate = {rate:g} Hz"
        )
    start = int(stamps[0])
    length = round((int(stamps[-1]) - start) / (NANOSECONDS / rate)) + 1
    force, _ = _on_grid(signals[topics.ACTUATOR_FORCE.name], start, rate, length)
    acceleration, seen = _on_grid(signals[topics.HANDLE_ACCELERATION.name], start, rate, length)
    return force, acceleration, ~seen


def _on_grid(
    recorded: Signal, start: int, rate: float, length: int
) -> tuple[FloatArray, BoolArray]:
    """Return the vectors of a signal on a grid, and a mask of its samples."""
    where = places(recorded.stamps, start, rate)
    columns = [on_grid(where, column, length) for column in recorded.values.T]
    return np.stack([values for values, _ in columns], axis=1), columns[0][1]


def _force_age(bag: Bag) -> float:
    """Return the median age of the actuator's forces applied on arrival, s.

    0 for forces with a due time, and without diagnostics of them.
    """
    if bag.latency:
        return 0.0
    values = _last_values(bag)
    return durations(values, f"{AGE_OF} age").get("p50", 0.0) * 1e-6


def _last_values(bag: Bag) -> dict[str, str]:
    """Return the last values in the master device's diagnostics; empty without any."""
    return {said.node: said.values for said in bag.diagnostics}.get("master_device", {})
