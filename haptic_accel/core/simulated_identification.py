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

"""Identification of the handle of a virtual rig, in lockstep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from haptic_accel.core.actuator.safety import MasterSafetyParameters
from haptic_accel.core.identification import sweep
from haptic_accel.core.identification.sweep import IdentificationTrial, SweepParameters
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import (
    MasterRigParameters,
    ThreeAxisRig,
    axes_of,
    simulated_master,
)
from haptic_accel.core.sampling import DEFAULT_RATE, LATENCY, NANOSECONDS, check_latency
from haptic_accel.core.simulated_rig import rig_side
from haptic_accel.core.tick import ACTUATOR
from haptic_accel.core.trial import along


def run_identification(
    rig: MasterRigParameters | None = None,
    parameters: SweepParameters | None = None,
    rate: float = DEFAULT_RATE,
    seed: int = 0,
    trials: int = 1,
    latency: int = LATENCY,
) -> list[IdentificationTrial]:
    """Excite the simulated handle in lockstep, without clock, with reproducible results.

    In each sample the rig is read, and the force from `latency` samples before is applied, limited
    by the device's safety layer. It acts until the next sample, so that the acceleration shows it
    at the earliest one sample later. Arm and hand do not move.

    Parameters
    ----------
    rig : MasterRigParameters, optional
        Parameters of the simulated master; default: Table I.
    parameters : SweepParameters, optional
        Parameters of the sweep; default: those of the paper.
    rate : float
        Samples per second.
    seed : int
        Seed of the noise; each trial derives its own.
    trials : int
        Number of trials, each from rest.
    latency : int
        Delay from sample to force, in samples.

    Returns
    -------
    list of IdentificationTrial

    Raises
    ------
    ParameterError
        The number of trials is below 1, the latency is invalid, or the end frequency is not below
        half the rate.
    """
    if trials < 1:
        raise ParameterError(f"trials = {trials}: must be at least 1")
    check_latency(latency)
    rig = rig or MasterRigParameters()
    axes = axes_of(rig)
    exciting = sweep.trial_forces(axes, parameters or SweepParameters(), rate)
    force = np.squeeze(np.concatenate([exciting, np.zeros((latency, len(axes.names)))]))
    return [
        _excite(rig, _trial_seed(seed, index), force, rate, latency) for index in range(trials)
    ]


def master_response(
    rig: MasterRigParameters, frequency: npt.ArrayLike, rate: float, delay: float | None = None
) -> ComplexArray:
    """Return the true response of a simulated master with three coils, m/s^2 per N, (f, 3, 3).

    Parameters
    ----------
    rig : MasterRigParameters
    frequency : array_like, shape (f,)
        Hz.
    rate : float
        Samples per second.
    delay : float, optional
        Delay of the drive in place of the rig's own, s.
    """
    if delay is not None:
        rig = replace(rig, drive=replace(rig.drive, delay=delay))
    master = simulated_master(rig, rate)
    assert isinstance(master, ThreeAxisRig)
    return master.response(frequency, rate)


def _trial_seed(seed: int, trial: int) -> int:
    """Return a seed for a trial, so that trials of adjacent seeds have different noise."""
    return int(np.random.SeedSequence((seed, trial)).generate_state(1)[0])


def _excite(
    rig: MasterRigParameters, seed: int, force: FloatArray, rate: float, latency: int
) -> IdentificationTrial:
    master, axes = simulated_master(rig, rate, seed), axes_of(rig)
    limits = MasterSafetyParameters(hardware=rig.actuator)
    side = rig_side(master, limits, rate, latency, (ACTUATOR,), axes)
    acceleration = np.zeros((len(force), 3))
    for tick, exciting in enumerate(force.reshape(len(force), -1).tolist()):
        side.begin(tick)
        side.read()
        acceleration[tick] = side.samples[0].acceleration
        side.command(ACTUATOR, tick * NANOSECONDS / rate, *axes.vector(exciting))
        side.apply()
        side.watch()
    values: dict[str, str | int] = {**master.counters(), **side.safety.diagnostics()}
    counts = {key: int(values[key]) for key in (*master.counters(), *sweep.LIMITED)}
    return IdentificationTrial(rate, force, along(axes, acceleration), counts, latency)
