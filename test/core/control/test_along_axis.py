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
"""Tests of the compensation of one coil in vectors."""

from haptic_accel.core.control.along_axis import AlongAxis
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.model import ZERO, Vector

AROUND = CompensationParameters("constant")
SAMPLES: list[tuple[Vector, Vector | None]] = [
    (ZERO, ZERO),
    ((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
    ((4.0, 5.0, 6.0), None),
]


def test_other_components_count_for_nothing() -> None:
    stream, alone = AlongAxis(Compensation(AROUND, 1000.0), 1000.0), Compensation(AROUND, 1000.0)
    for tool, handle in SAMPLES:
        desired, force = alone.process(tool[2], handle[2] if handle else None)
        assert stream.process(tool, handle) == ((0.0, 0.0, desired), (0.0, 0.0, force))


def test_a_reduction_chooses_what_is_rendered() -> None:
    stream = AlongAxis(Compensation(AROUND, 1000.0), 1000.0, "sum")
    alone = Compensation(AROUND, 1000.0)
    for tool, handle in SAMPLES:
        desired, force = alone.process(sum(tool), handle[2] if handle else None)
        assert stream.process(tool, handle) == ((0.0, 0.0, desired), (0.0, 0.0, force))


def test_the_gain_is_that_of_the_only_coil() -> None:
    stream, alone = AlongAxis(Compensation(AROUND, 1000.0), 1000.0), Compensation(AROUND, 1000.0)
    stream.set_gain(0.5)
    alone.set_gain(0.5)
    for tool, handle in SAMPLES:
        desired, force = alone.process(tool[2], handle[2] if handle else None)
        assert stream.process(tool, handle) == ((0.0, 0.0, desired), (0.0, 0.0, force))
