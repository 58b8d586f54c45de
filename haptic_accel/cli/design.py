# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel design``: predicted performance of a controller, without a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.cli.options import json_option, verb, words
from haptic_accel.cli.output import next_command, save
from haptic_accel.cli.tables import print_table
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.compensation import PLANT
from haptic_accel.core.control.controllers.fixed import FeedbackParameters, InverseParameters
from haptic_accel.core.control.controllers.interface import Loop
from haptic_accel.core.control.error_bound import bounds, causal_bound
from haptic_accel.core.control.inversion import ToolSpectrum, measured_spectrum, predict
from haptic_accel.core.model import ACTUATOR, FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tables import Column, ResultTable
from haptic_accel.materials.folders import is_recording
from haptic_accel.materials.recordings import read_recording
from haptic_accel.setup.arguments import GraphArguments, assigned, parse_arguments
from haptic_accel.setup.setup import Setup
from haptic_accel.setup.words import assigned_keys

SHOWN = (10.0, 15.0, 20.0, 30.0, 50.0, 80.0, 120.0, 200.0, 300.0, 400.0)
"""Frequencies whose gain and phase are printed, Hz."""

DESIGNED = ("inverse", "feedback", "adaptive")
"""Controllers whose design depends on a plant."""

RESPONSE = (
    Column("frequency_hz", "frequency", "Hz"),
    Column("gain", "gain", digits=3),
    Column("phase_deg", "phase", "degrees", 1),
)
"""Columns of the table of the response."""

DRAWN = 10.0
"""Length of the random texture for the limits of travel and force, s: as of a trial."""


@verb(
    "haptic-accel design controller:=feedback rate:=4000",
    "haptic-accel design controller:=inverse params_file:=handle.yaml",
    "haptic-accel design surface:=drag.csv recording_rate:=1000",
)
@words(GraphArguments)
@json_option
def design(words: Sequence[str], json_file: Path | None) -> None:
    """Design a controller for compensator.plant and print the prediction.

    Tracking error and its lower bound, force, travel, gain and phase, and margins of the
    feedback. With surface:=FILE the spectrum of a recording replaces the expected one.
    """
    arguments = parse_arguments(words)
    name = arguments.controller if "controller" in assigned_keys(words) else DESIGNED[0]
    if name not in DESIGNED:
        raise ParameterError(f"controller = {name!r}: must be one of {', '.join(DESIGNED)}")
    compensation, options = Setup.of(arguments).node("compensator")
    plant = options[PLANT].coupled().delayed(compensation.latency)
    actuator: ActuatorParameters = options[ACTUATOR]
    loop = Loop(arguments.rate, compensation.high_pass_frequency, plant, actuator.travel)
    parameters: InverseParameters = options[name]
    spectrum: ToolSpectrum = parameters.texture
    if is_recording(arguments.surface):
        samples = read_recording(
            arguments.surface, arguments.recording_rate, loop.rate, arguments.recording_column
        )
        spectrum = measured_spectrum(samples, loop.rate)
    else:
        samples = _drawn(spectrum, loop.rate)
    found = predict(parameters.filter(loop), loop.plant, spectrum)
    granted = parameters.goal(loop).granted_delay
    bound = causal_bound(
        loop.plant,
        loop.rate,
        spectrum,
        granted_delay=granted,
        high_pass_frequency=loop.high_pass_frequency,
    )
    limited = bounds(
        loop.plant,
        loop.rate,
        samples,
        granted_delay=granted,
        high_pass_frequency=loop.high_pass_frequency,
        actuator=actuator,
    ).limited
    frequencies = [frequency for frequency in SHOWN if frequency < found.frequency[-1]]
    nearest = [int(np.argmin(np.abs(found.frequency - frequency))) for frequency in frequencies]
    gains, phases = found.gain[nearest].tolist(), np.degrees(found.phase[nearest]).tolist()
    points = [
        dict(zip((each.key for each in RESPONSE), point, strict=True))
        for point in zip(frequencies, gains, phases, strict=True)
    ]
    title = f"handle over desired acceleration, after the granted delay of {granted} samples"
    print_table(ResultTable.of(RESPONSE, points, title=title, left=0))
    print(
        f"error {found.nrmse_percent:.1f} % after {1e3 * granted / loop.rate:g} ms granted (no"
        f" causal linear filter below {bound:.1f} %, none within limits below {limited:.1f} %),"
        f" force {found.force_rms:.2f} N RMS, travel {1e3 * found.travel_rms:.2f} mm RMS and"
        f" {1e3 * found.landing_travel:.2f} mm after a landing"
    )
    print(f"low frequencies are attenuated for a travel above {1e3 * loop.travel_limit:.2f} mm")
    metrics: dict[str, Any] = {
        "controller": name,
        "rate_hz": loop.rate,
        "latency_samples": loop.latency,
        "granted_samples": granted,
        "nrmse_percent": found.nrmse_percent,
        "bound_percent": bound,
        "limited_bound_percent": limited,
        "force_rms_n": found.force_rms,
        "travel_rms_mm": 1e3 * found.travel_rms,
        "landing_travel_mm": 1e3 * found.landing_travel,
        **{each.key: [each.of(point) for point in points] for each in RESPONSE},
    }
    if isinstance(parameters, FeedbackParameters):
        summary = parameters.design(loop).summary()
        print(summary)
        metrics["feedback"] = summary.splitlines()
    save(metrics, json_file)
    print(next_command("teleop", *assigned(replace(arguments, controller=name))))


def _drawn(spectrum: ToolSpectrum, rate: float) -> FloatArray:
    """Return a random texture with the expected spectrum, m/s^2, equal in each call."""
    white = np.random.default_rng(0).standard_normal(round(DRAWN * rate))
    lines = np.fft.rfftfreq(len(white), 1.0 / rate).astype(np.float64)
    density = spectrum(lines) * rate / 2.0
    return np.asarray(np.fft.irfft(np.fft.rfft(white) * np.sqrt(density), len(white)))
