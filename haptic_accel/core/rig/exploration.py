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

"""Scripted hand: motion set-points for exploring a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import Checked, parameter

TABLE_STEP = 1e-3
"""Step of the velocity table, s; the hand's velocity is linear between entries."""


@dataclass(frozen=True)
class ExplorationParameters(Checked):
    """Cycle of the scripted hand: approach, press, strokes back and forth, lift."""

    height: float = parameter(0.010, "height of the hand above the surface at rest", "m", 0.0, 0.1)
    approach_time: float = parameter(
        0.6, "time of the hand's approach to the surface, and of its lift", "s", 0.1, 10.0
    )
    press_depth: float = parameter(
        0.0047,
        "depth of the hand's set-point below the surface: about 1 N through the coupling's"
        " 250 N/m and the grip's 1500 N/m in series",
        "m",
        0.0,
        0.1,
    )
    stroke_speed: float = parameter(0.1, "speed of a stroke along the surface", "m/s", 0, 1.0)
    stroke_length: float = parameter(0.08, "length of a stroke along the surface", "m", 0.001, 1.0)
    turn_time: float = parameter(0.15, "time of the turn between two strokes", "s", 0.02, 5.0)
    strokes: int = parameter(4, "number of strokes before the tool is lifted", low=1, high=1000)
    pause: float = parameter(0.2, "rest of the hand after each lift", "s", 0.0, 60.0)


class Exploration:
    """Position and velocity of the hand along the surface (x) and its normal (z).

    The velocity is tabulated and linear between the entries. The position is its exact integral,
    as required by mechanics with piecewise constant hand acceleration.
    """

    def __init__(self, parameters: ExplorationParameters) -> None:
        velocity = _cycle(parameters)
        increments = (velocity[:-1] + velocity[1:]) * (TABLE_STEP / 2)
        position = np.vstack([np.zeros(2), np.cumsum(increments, axis=0)])
        position[:, 1] += parameters.height
        self._table = np.hstack([position, velocity]).tolist()
        self._last = len(self._table) - 1

    @property
    def period(self) -> float:
        """Length of a cycle, s; each cycle starts at the end of the last."""
        return self._last * TABLE_STEP

    def at(self, time: float) -> tuple[float, float, float, float]:
        """Return x, z in m and their velocities in m/s at a time in s; at rest before 0."""
        position = max(0.0, time / TABLE_STEP) % self._last
        index = int(position)
        part = position - index
        x, z, v_x, v_z = self._table[index]
        _, _, next_x, next_z = self._table[index + 1]
        dv_x, dv_z = (next_x - v_x) * part, (next_z - v_z) * part
        elapsed = part * TABLE_STEP
        return (
            x + (v_x + dv_x / 2) * elapsed,
            z + (v_z + dv_z / 2) * elapsed,
            v_x + dv_x,
            v_z + dv_z,
        )


def _cycle(parameters: ExplorationParameters) -> FloatArray:
    """Return the velocities (x, z) of one cycle at the table's times."""
    travel = parameters.height + parameters.press_depth
    down = _minimum_jerk(parameters.approach_time, -travel)
    strokes = _strokes(parameters)
    still = np.zeros(_points(parameters.pause))
    along = np.concatenate([np.zeros(len(down)), strokes, np.zeros(len(down)), still, [0.0]])
    normal = np.concatenate([down, np.zeros(len(strokes)), -down, still, [0.0]])
    return np.stack([along, normal], axis=1)


def _minimum_jerk(duration: float, distance: float) -> FloatArray:
    """Return minimum-jerk velocities (Flash and Hogan 1985), without the last point."""
    points = _points(duration)
    s = np.arange(points) / points
    velocity = s**2 * (1 - s) ** 2
    return np.asarray(distance * velocity / (velocity.sum() * TABLE_STEP))


def _strokes(parameters: ExplorationParameters) -> FloatArray:
    """Return the velocities of strokes back and forth with smooth turns, ending at the start."""
    turn = _points(parameters.turn_time)
    ramp = (1 - np.cos(np.pi * np.arange(turn) / turn)) / 2
    # A stroke's two half turns are cosine-shaped and cover 2/pi of the distance at full speed.
    cruise_time = parameters.stroke_length / max(parameters.stroke_speed, 1e-3)
    cruise = _points(max(0.0, cruise_time - parameters.turn_time * 2 / np.pi))
    profile = [ramp, np.ones(cruise)]
    direction = 1.0
    for _ in range(parameters.strokes - 1):
        profile.append(direction * (1 - 2 * ramp))
        direction = -direction
        profile.append(direction * np.ones(cruise))
    profile.append(direction * (1 - ramp))
    velocity = np.concatenate(profile)
    if parameters.strokes % 2:
        # An odd number of strokes ends at the far side: return without relevant pressure.
        velocity = np.concatenate([velocity, -velocity])
    # Remove the rounding of the ramps, so that the hand does not drift from cycle to cycle.
    return np.asarray(parameters.stroke_speed * (velocity - velocity.mean()))


def _points(duration: float) -> int:
    return round(duration / TABLE_STEP)
