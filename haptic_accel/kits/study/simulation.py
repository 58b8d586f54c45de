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

"""Simulated studies: sessions of simulated observers, and the power of the planned tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from haptic_accel.kits.study.folder import Study
from haptic_accel.kits.study.log import SESSION, Entries
from haptic_accel.kits.study.observers import SimulatedParticipant, SimulatedRig
from haptic_accel.kits.study.plan import Plan
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.session import Session
from haptic_accel.kits.study.trials import SessionRecord


def simulate_session(protocol: Protocol, log: Entries) -> SessionRecord:
    """Run a session, from where its log ends, with a simulated observer and without delays."""
    begun = log.record
    plan = Plan(protocol, begun.seed, begun.row)
    observer = SimulatedParticipant(protocol, begun.seed)
    rig = SimulatedRig(protocol)
    return Session(protocol, plan, log, rig, observer, sleep=lambda _: None).run()


def simulate_study(protocol: Protocol, participants: int, seed: int) -> list[SessionRecord]:
    """Return the sessions of a study with simulated observers."""
    found = []
    for row, own in enumerate(seeds(participants, seed)):
        log = Entries()
        name = pseudonym(row)
        own_line = {"participant": name, "digest": protocol.digest, "seed": own, "row": row}
        log.add(SESSION, **own_line, simulated=True)
        found.append(simulate_session(protocol, log))
    return found


def write_simulated(study: Study, participants: int, seed: int) -> Iterator[SessionRecord]:
    """Write sessions of simulated observers to a study's folder, and yield them."""
    for row, own in enumerate(seeds(participants, seed)):
        with study.begin(pseudonym(row), own, simulated=True) as log:
            session = simulate_session(study.protocol, log)
            study.note_end(log)
            yield session


def seeds(participants: int, seed: int) -> list[int]:
    """Return the seeds of a study's participants."""
    return [int(each) for each in np.random.SeedSequence(seed).generate_state(participants)]


def pseudonym(row: int) -> str:
    """Return the pseudonym of a simulated observer.

    Examples
    --------
    >>> pseudonym(0)
    'S01'
    """
    return f"S{row + 1:02d}"


@dataclass(frozen=True)
class Power:
    """Share of simulated studies in which a test was significant.

    Attributes
    ----------
    name : str
        Name of the test.
    share, low, high : float
        The share, and its 95 % interval (Wilson).
    """

    name: str
    share: float
    low: float
    high: float


def power(name: str, significant: Iterable[bool]) -> Power:
    """Return the power of a test from its outcomes.

    Examples
    --------
    >>> power("more than chance", [True] * 8 + [False] * 2).share
    0.8
    """
    outcomes = list(significant)
    found = binomtest(sum(outcomes), len(outcomes))
    interval = found.proportion_ci(method="wilson")
    return Power(name, float(found.statistic), float(interval.low), float(interval.high))
