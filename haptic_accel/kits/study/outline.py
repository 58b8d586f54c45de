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

"""Outline of a study: what it asks of a participant."""

from __future__ import annotations

import math

from haptic_accel.kits.study.plan import Plan
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.tasks import TASKS

ANSWERING, CHANGING = 3.0, 1.0
"""Time to answer, and to change to the next condition, s (assumed)."""


def expected_trials(protocol: Protocol) -> int:
    """Return the largest number of trials, with practice and catch trials, without repetitions."""
    return Plan(protocol, seed=0, row=0).trials


def expected_minutes(protocol: Protocol) -> float:
    """Return the expected duration of all trials, without breaks, min."""
    stimuli, timing = TASKS[protocol.task].stimuli, protocol.timing
    presenting = stimuli * (CHANGING + timing.seconds) + (stimuli - 1) * timing.gap
    return expected_trials(protocol) * (presenting + ANSWERING) / 60


def describe(protocol: Protocol) -> list[str]:
    """Return lines that describe a study before its first participant."""
    participants, trials = protocol.rules.participants, expected_trials(protocol)
    most = "" if protocol.procedure.kind == "constant" else "at most "
    presented = [f"{each.reference} against {each.comparison}" for each in protocol.pairs]
    tests = [f"test {each.name}: {each.measure} {each.condition}" for each in protocol.tests]
    return [
        f"{protocol.title} (version {protocol.digest[:12]})",
        f"{protocol.task}, {protocol.procedure.kind}, order {protocol.order.kind}",
        f"{most}{trials} trials, about {math.ceil(expected_minutes(protocol))} min without breaks,"
        f" {participants} participants",
        *(presented or map(str, protocol.conditions)),
        *tests,
    ]
