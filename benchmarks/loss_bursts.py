# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling over bursts of losses in one direction: ``python benchmarks/loss_bursts.py``.

A hand strokes with the master; the slave is free and has no friction. Lockstep, without ROS.
"""

from __future__ import annotations

import json
import math
import random

import click
from two_arms import ENGAGING, RATE, TwoArms, free, stroke

from haptic_accel import ChannelParameters, PassiveParameters
from haptic_accel.core import ZERO
from haptic_accel.core.topics import ARMS

NETWORK = ChannelParameters(delay=0.02, jitter=0.01, loss=0.05)
"""Both directions between bursts."""

LOST = ChannelParameters(loss=1.0)

BURST = 0.1, 0.5
"""Shortest and longest burst, s: from the time-out of the coupling on."""

BETWEEN = 4.0, 8.0
"""Shortest and longest time from a burst to the next, s."""

RECOVERY = 3.0
"""Time after a burst and an engagement from which the distance between the arms counts, s. In a
gap the arms part by up to 100 mm, and then approach each other at 50 mm/s."""

AFTER_ENGAGING = 1.0
"""Time from an engagement in which force steps count, s."""


def measure(seconds: float, seed: int) -> dict[str, float]:
    """Return the metrics of the coupling over random bursts.

    Returns
    -------
    dict
        bursts, engagements : numbers of bursts, and of engagements of the master.
        distance_mm : largest distance between the arms from `RECOVERY` after a burst and an
        engagement to the next burst.
        last_distance_mm : distance at the last of these samples.
        force_step_n : largest change of an arm's force from a sample to the next, in the second
        after an engagement.
        energy_out_mj : largest net energy that the motors gave to both arms.
    """
    chance = random.Random(seed)
    arms = TwoArms(PassiveParameters(), NETWORK, stroke, free, seed)
    hosts = arms.hosts
    forces, counts, since = (
        dict.fromkeys(ARMS, ZERO),
        dict.fromkeys(ARMS, 0),
        dict.fromkeys(ARMS, 0),
    )
    begins, ends = ENGAGING + BETWEEN[0], math.inf
    bursts = disturbed = 0
    distance = last_distance = largest_step = energy = 0.0
    for tick, at in enumerate(arms.move(seconds)):
        now = tick / RATE
        energy = max(energy, at.given)
        if now >= begins:
            bursts += 1
            chance.choice(hosts.channels).parameters = LOST
            begins, ends = math.inf, now + chance.uniform(*BURST)
        if begins == math.inf:
            disturbed = tick
        if now >= ends:
            for channel in hosts.channels:
                channel.parameters = NETWORK
            begins, ends = now + chance.uniform(*BETWEEN), math.inf
        if not all(half.engagement.engaged for half in hosts.couplings.values()):
            disturbed = tick
        if tick - disturbed > RECOVERY * RATE:
            last_distance = math.dist(at.master, at.slave)
            distance = max(distance, last_distance)
        for arm, half in hosts.couplings.items():
            commands = hosts.loops[arm].commands
            (_, _, force), before = (
                next(commands[-1].each) if commands else (0, 0, ZERO),
                forces[arm],
            )
            forces[arm] = force
            if half.engagement.count != counts[arm]:
                counts[arm], since[arm] = half.engagement.count, tick
            if half.engagement.engaged and tick - since[arm] <= AFTER_ENGAGING * RATE:
                largest_step = max(largest_step, math.dist(force, before))
    return {
        "seconds": seconds,
        "bursts": bursts,
        "engagements": counts[ARMS[0]],
        "distance_mm": 1e3 * distance,
        "last_distance_mm": 1e3 * last_distance,
        "force_step_n": largest_step,
        "energy_out_mj": 1e3 * energy,
    }


@click.command()
@click.option("--seconds", type=click.FloatRange(10.0), default=60.0, help="Simulated time, s.")
@click.option("--seed", type=int, default=0, help="Seed of bursts and network.")
def loss_bursts(*, seconds: float, seed: int) -> None:
    """Print the metrics of the coupling over random bursts of losses in one direction."""
    click.echo(json.dumps(measure(seconds, seed), indent=2))


if __name__ == "__main__":
    loss_bursts()
