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
"""Construction of the compensation for a handle's coils."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.control.along_axis import AlongAxis
from haptic_accel.core.control.compensation import PLANT, Compensation, CompensationParameters
from haptic_accel.core.control.vector_compensation import VectorCompensation
from haptic_accel.core.handle.matrix_plant import MatrixPlant, read_matrix_plant
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.parameters import Checked, ParameterError
from haptic_accel.core.sampling import LATENCY

VectorLoop: TypeAlias = AlongAxis | VectorCompensation
"""Compensation of a handle with one coil, or with three."""


def build_compensation(
    parameters: CompensationParameters,
    rate: float,
    options: Mapping[str, Checked] | None = None,
    prepared: Sequence[str] = (),
    *,
    latency: int = LATENCY,
) -> VectorLoop:
    """Return the compensation for the axes of the parameters; arguments as for `Compensation`.

    With three axes, the plant's model is the file of an identification with three axes. Without
    one, all axes have the given plant, and none moves another.

    Raises
    ------
    ParameterError
        As for `Compensation`; or there are two axes, or the model has another number of axes.
    """
    if check_axes(parameters, options or {}, rate) == ACTUATOR_AXES:
        along = Compensation(parameters, rate, options, prepared, latency=latency)
        return AlongAxis(along, rate, parameters.reduction)
    return VectorCompensation(
        *(parameters, rate, matrix_plant(options or {}, rate), options, prepared), latency=latency
    )


def check_axes(
    parameters: CompensationParameters, options: Mapping[str, Checked], rate: float
) -> Axes:
    """Return the axes of the parameters after a check that all goes with them.

    Raises
    ------
    ParameterError
        There are two axes, or the plant's model has another number of axes or another rate.
    """
    axes = Axes.parsed(parameters.axes)
    if axes not in (ACTUATOR_AXES, ALL_AXES):
        raise ParameterError(f"axes = {parameters.axes}: must be z, or x, y, z")
    if axes == ALL_AXES:
        matrix_plant(options, rate).check_rate(rate)
    return axes


def matrix_plant(options: Mapping[str, Checked], rate: float) -> MatrixPlant:
    """Return the plant with three axes that the parameters name."""
    plant = options.get(PLANT, Plant())
    assert isinstance(plant, Plant)
    if not plant.model:
        return MatrixPlant.uncoupled(plant, rate)
    found = read_matrix_plant(Path(plant.model))
    x, y, z = (replace(each, coupling=plant.coupling) for each in found.axes)
    return replace(found, axes=(x, y, z))
