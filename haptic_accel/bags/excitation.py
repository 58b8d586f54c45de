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

"""Force and acceleration of an identification from its bag."""

from __future__ import annotations

import numpy as np

from haptic_accel.bags.delivery import AGE_OF, durations
from haptic_accel.bags.reading import Bag
from haptic_accel.core import topics
from haptic_accel.core.identification.estimate import RecordingError
from haptic_accel.core.model import FloatArray
from haptic_accel.core.sampling import NANOSECONDS, BoolArray, same_rate


def read_excited(bag: Bag, rate: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return actuator force and handle acceleration of an identification's bag.

    Parameters
    ----------
    bag : Bag
        Bag written by the recorder.
    rate : float
        Samples per second of the graph.

    Returns
    -------
    actuator_force, handle_acceleration : ndarray, shape (n,)
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
    force, _ = signals[topics.ACTUATOR_FORCE.name].on_grid(start, rate, length)
    acceleration, seen = signals[topics.HANDLE_ACCELERATION.name].on_grid(start, rate, length)
    return force, acceleration, ~seen


def force_age(bag: Bag) -> float:
    """Return the median age of the actuator's forces applied on arrival, s.

    0 for forces with a due time, and without diagnostics of them.
    """
    if bag.latency:
        return 0.0
    values = last_values(bag, "master_device")
    return durations(values, f"{AGE_OF} age").get("p50", 0.0) * 1e-6


def last_values(bag: Bag, node: str) -> dict[str, str]:
    """Return the last values in a node's diagnostics; empty without any."""
    return {said.node: said.values for said in bag.diagnostics}.get(node, {})
