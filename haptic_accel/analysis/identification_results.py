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

"""Results of an identification: parameter file, metrics, and errors against a simulated rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from haptic_accel.analysis.identification_report import ModelError
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.identification.estimate import dft_ratio
from haptic_accel.core.identification.evaluation import Identification, centred, identify_handle
from haptic_accel.core.identification.fit import HandleFit
from haptic_accel.core.identification.stops import Recorded, check_stops, check_travel
from haptic_accel.core.model import ACTUATOR, HandleParameters, Suspension, held
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.trial import RigParameters, run_identification
from haptic_accel.graph.arguments import AVERAGE_GRIP, IdentifyArguments
from haptic_accel.graph.files import parameter_text
from haptic_accel.graph.node_parameters import node_parameters
from haptic_accel.graph.processes import graph_parameters, rig_parameters

INTERVAL = 1.96
"""Half width of a 95 % interval, in standard errors."""


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
    doubt : str
        Reason to doubt the fit, or empty.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    errors : mapping of ModelError
        Errors by model; empty if the true response is unknown.
    """

    found: Identification
    actuator: ActuatorParameters
    latency: int
    band: tuple[float, float]
    doubt: str
    truth: HandleParameters | None = None
    errors: Mapping[str, ModelError] = field(default_factory=dict)

    @property
    def notes(self) -> list[str]:
        """Warnings to the reader of the metrics."""
        return [self.doubt] * bool(self.doubt) + [POOLED_NOTE] * (len(self.found.grips) > 1)

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


POOLED_NOTE = (
    "models of all grips pooled are a compromise between them, the discrete model most of all; for"
    " the best model of one grip, identify that grip alone"
)
"""Note on several grips."""


def evaluate(recorded: Recorded, arguments: IdentifyArguments, free: Sequence[str]) -> Result:
    """Fit the model to recordings.

    Parameters
    ----------
    recorded : mapping
        Trials by the name of the grip.
    arguments : IdentifyArguments
    free : sequence of str
        Parameters of the model to fit.

    Raises
    ------
    RecordingError
        They do not tell the handle's response.
    """
    check_stops(recorded)
    _, known = node_parameters("identifier", graph_parameters(arguments)["identifier"])
    actuator, sensor = known[ACTUATOR], known["accelerometer"]
    found = identify_handle(
        recorded,
        arguments.sweep,
        sensor.range,
        sensor.bandwidth,
        known=HandleParameters(
            m_a=actuator.m_a, k_s=actuator.k_s, b_s=actuator.b_s or HandleParameters.b_s
        ),
        free=free,
    )
    doubts = [
        check_travel(name, trial, grip.fit.handle, actuator.travel)
        for name, grip in found.grips.items()
        for trial in grip.trials
    ]
    lowest, highest = arguments.sweep.start_frequency, 0.9 * arguments.sweep.end_frequency
    band = max(LOWEST_COMPARED, lowest), min(highest, HIGHEST_COMPARED)
    latency = next(iter(recorded.values()))[0].latency
    return Result(found, actuator, latency, band, max(doubts))  # that of the largest travel


def beside_truth(result: Result, arguments: IdentifyArguments, on_arrival: bool) -> Result:
    """Return a result with its errors against the simulated rig that was identified."""
    rig = rig_as_held(arguments)
    errors = model_errors(result.found, rig, arguments.sweep, result.band, on_arrival)
    return replace(result, truth=rig.master.handle, errors=errors)


def rig_as_held(arguments: IdentifyArguments) -> RigParameters:
    """Return the simulated rig with one user's grip, for any seed of the noise."""
    master = rig_parameters(graph_parameters(arguments)).master
    handle = held(master.handle, master.grip, arguments.seed)
    grip = replace(master.grip, variation=0.0, posture=AVERAGE_GRIP)
    return RigParameters(replace(master, handle=handle, grip=grip))


def parameter_file(result: Result, age: float) -> str:
    """Return a ROS parameter file for ``params_file:=FILE`` with the handle and its controllers.

    Parameters
    ----------
    result : Result
        The compensator reports its doubt as a warning.
    age : float
        Age of forces applied on arrival, s. It is part of the delay that a controller compensates,
        but not of the simulated handle's own delay.
    """
    found, fit = result.found, result.found.fit
    # Compensation of a friction that may be zero would only disturb.
    certain = fit.bearing.friction > INTERVAL * fit.standard_errors.get("friction", 0.0)
    friction = float(f"{fit.bearing.friction:.4f}") if certain else 0.0
    handle = _plain({name: getattr(fit.handle, name) for name in ("m_h", "k_u", "b_u")})
    mount = _plain(asdict(fit.mount))
    suspension = {name: getattr(fit.handle, name) for name in own_schema(Suspension)}
    nodes: dict[str, dict[str, Any]] = {
        "/**": {ACTUATOR: _plain(asdict(result.actuator) | suspension)},
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
            "constant": _plain({"mass": fit.handle.m_h}),
            "dynamic": _plain(asdict(found.approximate)),
            "plant": {
                "handle": handle,
                "mount": mount,
                "delay": float(f"{max(0.0, fit.delay):.6f}"),
                "bandwidth": fit.low_pass_frequency,
                "friction": friction,
                "doubt": result.doubt,
            },
        },
    }
    head = (
        "# A handle as identified; use with params_file:=FILE. SI units.\n"
        f"# Band {fit.band[0]:.4g} to {fit.band[1]:.4g} Hz, delay of the hardware"
        f" {fit.delay * 1e6:.0f} us, beside the latency\n# and the loop's own sample, residual"
        f" {fit.residual:.2f} (1: noise alone).\n"
    )
    return head + parameter_text(nodes)


def _plain(values: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(f"{value:.6g}") for name, value in values.items()}


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


def identification_metrics(result: Result) -> dict[str, Any]:
    """Return the metrics of an identification for a JSON file.

    Keys without a model's name refer to the discrete model.
    """
    found, errors = result.found, result.errors
    discrete = errors.get("discrete")
    return {
        **_fit_metrics(found.fit),
        "latency_samples": result.latency,
        "max_magnitude_error_db": discrete.magnitude_db if discrete else None,
        "max_phase_error_deg": discrete.phase_deg if discrete else None,
        "band_hz": list(result.band),
        "physical_model": asdict(errors["physical"]) if errors else None,
        "grips": {name: _fit_metrics(grip.fit) for name, grip in found.grips.items()},
        "approximate_model": asdict(found.approximate),
        "discrete_model": {
            "sections": found.discrete.sections.tolist(),
            "delay_samples": found.discrete.delay_samples,
            "rate_hz": found.discrete.rate,
        },
    }


def _fit_metrics(fit: HandleFit) -> dict[str, Any]:
    return {
        "parameters": {
            name: {
                "value": fit.value(name),
                "standard_error": fit.standard_errors.get(name),
                "unit": given.unit,
            }
            for name, (_, given) in own_schema(HandleParameters).items()
        },
        "delay_s": fit.delay,
        "delay_us": fit.delay * 1e6,
        "delay_standard_error_s": fit.standard_errors.get("delay"),
        "friction_n": fit.bearing.friction,
        "friction_standard_error_n": fit.standard_errors.get("friction"),
        "mount": asdict(fit.mount),
        "residual": fit.residual,
    }
