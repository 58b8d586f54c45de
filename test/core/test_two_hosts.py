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

"""Two hosts in lockstep: what a network between them does to vibration, force and energy."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from haptic_accel.core import topics
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.coupling.position_position import CouplingParameters
from haptic_accel.core.network.channel import ChannelParameters
from haptic_accel.core.sampling import RELEASED
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import Crossing, Trial, run_trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup

SETTLED = 1000
"""Samples after which playout knows the network."""


def textured() -> RigParameters:
    return Setup.of(GraphArguments(rig="ideal", surface="text")).rig()


@lru_cache
def trial(
    channel: ChannelParameters | None = None, blackouts: tuple[tuple[float, float], ...] = ()
) -> Trial:
    return run_trial(
        "inverse", textured(), duration=4.0, seed=3, channel=channel, blackouts=blackouts
    )


def crossing(of: Trial) -> Crossing:
    assert of.crossing
    return of.crossing


def nrmse(of: Trial) -> float:
    return of.evaluate(SETTLED).nrmse_percent


def given(of: Trial) -> float:
    """Return the greatest net energy that the motors of both arms gave, J."""
    total = np.zeros(len(of.time) - 1)
    for arm in (topics.MASTER, topics.SLAVE):
        force, place = of.arms[arm.arm_force.name], of.arms[arm.position.name]
        acting = np.roll(force, of.latency, axis=0)
        acting[: of.latency] = 0.0
        total += np.sum(acting[:-1] * np.diff(place, axis=0), axis=1)
    return float(np.cumsum(total).max())


def test_a_network_without_delay_is_as_one_host() -> None:
    one, two = trial(), trial(ChannelParameters())
    met = crossing(two).kinds.index("true")
    assert met == 2, "a packet of each host, and one that answers it"
    assert set(crossing(two).kinds[met:]) == {"true"}
    assert crossing(two).age[met:] == pytest.approx(1 / two.rate)
    played = two.tool_acceleration.astype(np.float32)
    assert np.array_equal(crossing(two).played[met:], played[met:])
    assert nrmse(two) == pytest.approx(nrmse(one), abs=1.0)


@pytest.mark.parametrize(("loss", "points"), [(0.0, 1.0), (0.01, 2.0), (0.05, 4.0), (0.1, 8.0)])
def test_what_is_lost_costs_little_and_what_is_late_a_few_milliseconds(
    loss: float, points: float
) -> None:
    network = ChannelParameters(delay=0.02, jitter=0.01, loss=loss)
    found = trial(network)
    assert nrmse(found) <= nrmse(trial(ChannelParameters(delay=0.02))) + points
    assert np.quantile(crossing(found).age[SETTLED:], 0.99) <= network.delay + 5.1e-3


def test_through_a_blackout_the_arms_are_free_and_afterwards_coupled_again() -> None:
    blackout = 2.0, 3.0
    found = trial(ChannelParameters(delay=0.02), (blackout,))
    forces = np.abs(found.arms[topics.SLAVE.arm_force.name]).max(axis=1)
    free = (found.time > blackout[0] + 0.021 + RELEASED) & (found.time < blackout[1])
    assert forces[found.time < blackout[0]].max() > 0.1
    assert forces[free].max() == 0.0
    assert forces[found.time > blackout[1] + 0.2].max() > 0.1
    felt = np.abs(np.diff(crossing(found).played[free]))
    assert felt.max() == 0.0
    assert given(found) <= 2 * PassiveParameters().energy


def test_the_slave_moves_in_its_own_scale() -> None:
    rig = RigParameters(coupling=CouplingParameters(scale=2.0))
    found = run_trial("none", rig, duration=1.0, channel=ChannelParameters(delay=0.005))
    master, slave = (
        np.ptp(found.arms[arm.position.name][:, 0]) for arm in (topics.MASTER, topics.SLAVE)
    )
    assert slave == pytest.approx(2.0 * master, rel=0.3)  # the tool lags on its spring
