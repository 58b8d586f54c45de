# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Energy, stability and error of the coupling of two hosts over simulated networks, in lockstep.

``python benchmarks/coupling_over_networks.py`` prints a row for each law and network.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from two_arms import ENGAGING, RATE, Instant, TwoArms, free, press, stroke, wall

from haptic_accel import (
    ChannelParameters,
    GraphArguments,
    PassiveParameters,
    Setup,
    Vector,
    lockstep_trial,
)
from haptic_accel.cli.studies import journal_of
from haptic_accel.commands import (
    Column,
    ResultTable,
    Row,
    Workers,
    json_option,
    print_table,
    run,
    run_side_by_side,
    save,
    verb,
    workers_options,
)

DURATION = 7.0
"""Length of a contact, and of strokes in free space, s."""

CHANGE_TIME = 3.0
"""Time at which a network becomes another without warning, s."""

RESTING = 0.5
"""Time at the end in which the slave should rest on the wall, s."""

VIBRATION = GraphArguments(rig="ideal", surface="text", duration=6.0)
"""Trial whose acceleration is evaluated."""

SETTLED = 1000
"""Samples that are not evaluated: playout gets to know the network."""

TRIALS = 50
"""Number of random networks."""

TRIAL_DURATION = 1.0
"""Length of each beyond `ENGAGING`, s."""


CHANGES = 0.01
"""Probability that one of both directions becomes another in a sample."""


@dataclass(frozen=True)
class Condition:
    """Coupling law on a network, which may suddenly replace another."""

    law: str
    network: ChannelParameters
    before: ChannelParameters | None = None


def over(one_way: float, jitter: float = 0.0, loss: float = 0.1) -> ChannelParameters:
    """Return a network by one-way delay and jitter, ms, and loss."""
    return ChannelParameters(one_way / 1e3, jitter / 1e3, loss)


NEAR, FAR, FARTHEST = over(6.25, 1.25), over(62.5, 12.5), over(250.0, 50.0)

CONDITIONS = [
    Condition("spring", over(0.0, loss=0.0)),
    Condition("passive", over(0.0, loss=0.0)),
    *(Condition(law, NEAR) for law in ("spring", "damped", "passive")),
    *(Condition(law, over(25.0, 5.0)) for law in ("damped", "passive")),
    *(Condition(law, FAR) for law in ("damped", "passive")),
    *(Condition(law, FAR, NEAR) for law in ("damped", "passive")),
    Condition("passive", over(200.0, 50.0), NEAR),
    Condition("passive", FARTHEST, NEAR),
    Condition("passive", over(100.0, 50.0)),
    Condition("damped", over(20.0, 10.0)),
    *(Condition("passive", over(20.0, 10.0, loss)) for loss in (0.0, 0.01, 0.05, 0.1)),
]


def measure(item: Condition | int) -> Row | float:
    """Return a condition's row, or `random_energy` for a seed."""
    return random_energy(item) if isinstance(item, int) else row(item)


def row(condition: Condition) -> Row:
    """Return the metrics of a condition."""
    contact, strokes = (_run(condition, *around) for around in ((press, wall()), (stroke, free)))
    end = round(-RESTING * RATE)
    found, before = condition.network, condition.before
    lag = [math.dist(at.master, at.slave) ** 2 for at in strokes[round(CHANGE_TIME * RATE) :]]
    return {
        "law": condition.law,
        "one_way_ms": 1e3 * found.delay,
        "jitter_ms": 1e3 * found.jitter,
        "loss": found.loss,
        "before_one_way_ms": 1e3 * before.delay if before else None,
        "energy_out_mj": 1e3 * max(at.given for at in contact),
        "end_speed_m_s": max(at.slave_speed for at in contact[end:]),
        "free_error_mm": 1e3 * math.sqrt(sum(lag) / len(lag)),
        **(
            {"nrmse_percent": None, "indistinguishable_percent": None}
            if before
            else _vibration(condition)
        ),
    }


def _run(
    condition: Condition,
    path: Callable[[float], Vector],
    around: Callable[[Vector, Vector], Vector],
) -> list[Instant]:
    parameters = PassiveParameters(law=condition.law)
    arms = TwoArms(parameters, condition.before or condition.network, path, around)
    found = []
    for at in arms.move(DURATION):
        found.append(at)
        if len(found) == CHANGE_TIME * RATE:
            for channel in arms.hosts.channels:
                channel.parameters = condition.network
    return found


def _vibration(condition: Condition) -> Row:
    """Return error and share of the handle against the played acceleration."""
    trial = lockstep_trial(Setup.of(VIBRATION), channel=condition.network, law=condition.law)
    return {
        "nrmse_percent": trial.evaluate(SETTLED).nrmse_percent,
        "indistinguishable_percent": 100.0 * trial.indistinguishable(SETTLED),
    }


def random_energy(seed: int) -> float:
    """Return the largest net energy on random networks, relative to the granted energy."""
    chance = random.Random(seed)

    def some() -> ChannelParameters:
        delay = chance.choice([0.0, 0.02, 0.1, 0.5]) * chance.random()
        loss = chance.choice([0.0, 0.1, 0.9]) * chance.random()
        return ChannelParameters(delay, delay * chance.random(), loss, chance.random())

    parameters = PassiveParameters(
        stiffness=chance.choice([50.0, 250.0, 2000.0]),
        local_damping=chance.choice([0.3, 3.0, 10.0]),
    )
    dark = ENGAGING + TRIAL_DURATION * chance.random()
    blackouts = [(dark, dark + 0.3 * chance.random())]
    network = some()
    swings = [(0.05 * chance.random() / f, 2 * math.pi * f) for f in (0.7, 2.0, 5.0)]

    def path(time: float) -> Vector:
        x, y, z = (size * math.sin(omega * time) for size, omega in swings)
        return x, y, z

    around = chance.choice([free, wall(chance.uniform(100, 5000), chance.uniform(-0.01, 0.0))])
    arms = TwoArms(parameters, network, path, around, seed, blackouts)
    most = 0.0
    for at in arms.move(ENGAGING + TRIAL_DURATION):
        most = max(most, at.given)
        if chance.random() < CHANGES:
            chance.choice(arms.hosts.channels).parameters = some()
    return most / (2 * parameters.energy)


def progress(found: Row | float) -> str:
    """Return a condition's metrics for a reader; empty for a random network."""
    if isinstance(found, float):
        return ""
    error = found["nrmse_percent"]
    return (
        f"{found['law']}: {_network(found)}: {found['energy_out_mj']:.2f} mJ,"
        f" {found['end_speed_m_s']:.4f} m/s, {found['free_error_mm']:.2f} mm"
        + (f", {error:.1f} %" if error is not None else "")
    )


def _network(found: Row) -> str:
    """Return a condition's network for a reader."""
    sudden = f" after {found['before_one_way_ms']:g}" if found["before_one_way_ms"] else ""
    times = f"{found['one_way_ms']:g} ± {found['jitter_ms']:g} ms{sudden}"
    return f"{times}, {100 * found['loss']:g} %"


COLUMNS = (
    Column("law", "law"),
    Column("", "network, loss", value=_network),
    Column("energy_out_mj", "energy", "mJ", 1),
    Column("end_speed_m_s", "end speed", "m/s", 4),
    Column("free_error_mm", "free", "mm", 2),
    Column("nrmse_percent", "NRMSE", "%", 1),
    Column("indistinguishable_percent", "indistinguishable", "%", 1),
)
"""Columns of the table."""


@verb(
    "python benchmarks/coupling_over_networks.py",
    "python benchmarks/coupling_over_networks.py --json network.json",
)
@workers_options
@json_option
def coupling_over_networks(*, workers: Workers, json_file: Path | None) -> None:
    """Measure the coupling of two hosts over simulated networks, in lockstep.

    Two arms of 0.1 kg, a hand at the master, and at the slave a wall of 3 kN/m or nothing: net
    energy that the motors gave, speed at the end with the hand at rest, and error between the arms
    at 100 mm/s; error of the vibration at its own delay, and the share whose strength a hand could
    not tell. Then random networks, hands and walls: the most energy relative to what the coupling
    is granted.
    """
    items = [*CONDITIONS, *range(TRIALS)]
    found, end = run_side_by_side(
        workers, measure, items, "conditions", progress, journal_of(json_file)
    )
    worst = [result for result in found.values() if isinstance(result, float)]
    rows = [result for result in found.values() if not isinstance(result, float)]
    print_table(ResultTable.of(COLUMNS, rows, title="two arms on two hosts"))
    if worst:
        print(f"{len(worst)} random networks: at most {max(worst):.2f} of the energy granted")
    most = max(worst, default=None)
    save({"trials": len(worst), "worst_energy_over_bound": most, "rows": rows}, json_file)
    if end:
        raise end


if __name__ == "__main__":
    run(coupling_over_networks, "coupling_over_networks")
