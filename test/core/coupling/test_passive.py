# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The coupling of two arms over a network and its account of energy."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from two_arms import free, wall

from haptic_accel.core.coupling import passive
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.network import Channel, ChannelParameters
from two_sides import UNLIMITED, Instant, Packet, Side, run

RATE = 1000.0
RICH = passive.PassiveParameters(energy=1.0)  # the account of which limits nothing
POOR = passive.PassiveParameters()


def engaged(parameters: passive.PassiveParameters = RICH, latency: int = 0) -> passive.PassiveHalf:
    half = passive.PassiveHalf(parameters, RATE, latency)
    half.engage()
    return half


def act(half: passive.PassiveHalf) -> None:
    """Let a half make a first force, which is zero."""
    half.force(ZERO, ZERO, ZERO, ZERO, 0.0)


# Law


@pytest.fixture
def half() -> passive.PassiveHalf:
    """Return a half that is engaged."""
    return engaged()


def test_a_fresh_peer_pulls_with_the_papers_stiffness() -> None:
    force = engaged().force(ZERO, ZERO, (0.002, 0.0, -0.004), ZERO, 0.0)
    assert force == pytest.approx((0.5, 0.0, -1.0))


@pytest.mark.parametrize(
    ("age", "stiffness", "damping"),
    # With the force's own millisecond: B = K A / 2 up to 3 N s/m, then K = 2 B / A.
    [(0.009, 250.0, 1.25), (0.059, 100.0, 3.0), (0.149, 40.0, 3.0)],
)
def test_stiffness_and_damping_are_those_that_the_age_bears(
    age: float, stiffness: float, damping: float
) -> None:
    half = engaged()
    force = half.force(ZERO, (0.1, 0.0, 0.0), (0.0, 0.002, 0.0), ZERO, age)
    assert (half.stiffness, half.damping) == pytest.approx((stiffness, damping))
    assert force == pytest.approx((-0.1 * damping, 0.002 * stiffness, 0.0))


def test_stiffness_falls_at_once_and_rises_slowly(half: passive.PassiveHalf) -> None:
    for age, expected in ((0.009, 250.0), (0.599, 10.0)):
        half.force(ZERO, ZERO, ZERO, ZERO, age)
        assert half.stiffness == pytest.approx(expected)
    for _ in range(500):
        half.force(ZERO, ZERO, ZERO, ZERO, 0.009)
    assert half.stiffness <= 10.0 + 0.5 * 250.0
    for _ in range(3000):
        half.force(ZERO, ZERO, ZERO, ZERO, 0.009)
    assert half.stiffness == pytest.approx(250.0)


def test_one_late_packet_in_a_thousand_changes_nothing_for_long(half: passive.PassiveHalf) -> None:
    for tick in range(4000):
        age = 0.1 if tick == 1000 else 0.009
        half.force(ZERO, ZERO, ZERO, ZERO, age)
    assert half.stiffness == pytest.approx(250.0)


def test_arms_that_engage_again_forget_how_late_data_was(half: passive.PassiveHalf) -> None:
    for age in (math.inf, 0.599):
        half.force(ZERO, ZERO, ZERO, ZERO, age)
    assert half.stiffness == pytest.approx(0.6, abs=0.3)
    half.disengage()
    half.engage()
    half.force(ZERO, ZERO, ZERO, ZERO, 0.009)
    assert half.stiffness == pytest.approx(250.0)


def test_stiffness_and_damping_rise_from_zero_within_the_rise_time() -> None:
    half = passive.PassiveHalf(RICH, RATE, 0)
    half.engage(rise_time=0.1)
    forces = [
        half.force(ZERO, (0.1, 0.0, 0.0), (0.0, 0.002, 0.0), ZERO, 0.009) for _ in range(150)
    ]
    steps = [math.dist(*pair) for pair in itertools.pairwise([ZERO, *forces])]
    # K = 250 N/m at 2 mm, B = K A / 2 at 0.1 m/s: 0.5 N and 0.125 N after 100 samples.
    assert forces[99] == pytest.approx((-0.125, 0.5, 0.0))
    assert forces[-1] == pytest.approx(forces[99])
    assert steps[:100] == pytest.approx([math.hypot(0.125, 0.5) / 100] * 100)


# Set-point


def test_the_slaves_half_leads_a_moving_set_point_and_no_other() -> None:
    speed, age = 0.1, 0.05
    for leads, expected in ((False, 0.0), (True, passive.LEAD)):
        half = passive.PassiveHalf(RICH, RATE, 0, leads=leads)
        half.engage()
        for tick in range(1000):  # at its set-point, which moves
            at = (speed * tick / RATE, 0.0, 0.0)
            force = half.force(at, ZERO, at, (speed, 0.0, 0.0), age)
        led = (expected - passive.SMOOTHING) * (age + 0.001) * speed
        assert force[0] == pytest.approx(half.stiffness * led, rel=0.03)


def test_a_jump_of_the_set_point_is_smoothed_within_a_fraction_of_the_age() -> None:
    half = engaged()
    forces = [half.force(ZERO, ZERO, (0.001, 0.0, 0.0), ZERO, 0.05)[0]]
    forces += [half.force(ZERO, ZERO, (0.003, 0.0, 0.0), ZERO, 0.05)[0] for _ in range(50)]
    assert forces == sorted(forces)
    assert forces[5] == pytest.approx(half.stiffness * (0.003 - 0.002 / math.e), rel=0.1)


# Account


def test_what_the_arm_is_given_is_missing_in_the_account(half: passive.PassiveHalf) -> None:
    half.force(ZERO, ZERO, (0.004, 0.0, 0.0), ZERO, 0.0)  # 1 N
    before = half.energy
    half.force((0.001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0)
    assert before - half.energy == pytest.approx(1.0 * 0.001)


def test_a_force_counts_when_it_acts() -> None:
    half = engaged(latency=1)
    half.force(ZERO, ZERO, (0.004, 0.0, 0.0), ZERO, 0.0)
    half.force((0.001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0)
    assert half.energy == 1.0
    half.force((0.003, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0)
    assert 1.0 - half.energy == pytest.approx(1.0 * 0.002)


def test_the_work_that_a_device_reports_is_what_counts(half: passive.PassiveHalf) -> None:
    half.force(ZERO, ZERO, (0.004, 0.0, 0.0), ZERO, 0.0, work=7.0)
    half.force((0.001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0, work=7.0003)
    assert 1.0 - half.energy == pytest.approx(0.0003)


def test_a_device_that_counts_anew_gives_no_energy(half: passive.PassiveHalf) -> None:
    half.force(ZERO, ZERO, ZERO, ZERO, 0.0, work=7.0)
    half.force((0.0001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0, work=0.0)
    assert half.energy <= 1.0 + 3.3 * 0.0001
    half.force((0.0001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0, work=7.0)
    assert half.energy == pytest.approx(1.0, abs=1e-3)


def test_samples_that_are_missing_give_no_energy(half: passive.PassiveHalf) -> None:
    half.force(ZERO, ZERO, (0.004, 0.0, 0.0), ZERO, 0.0)  # 1 N
    half.force((-0.1, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0)  # and 0.1 m against it, in a sample
    assert half.energy <= 1.0 + 1.0 * passive.SPEED_MARGIN / RATE


def test_part_of_what_damping_takes_is_burnt(half: passive.PassiveHalf) -> None:
    half.force(ZERO, (0.1, 0.0, 0.0), ZERO, ZERO, 0.009)  # 1.25 N s/m
    before = half.energy
    half.force((0.0001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.009)
    assert half.energy - before == pytest.approx(passive.KEPT * 0.125 * 0.0001)


def test_energy_above_the_ceiling_is_the_peers() -> None:
    giver, taker = engaged(POOR), engaged(POOR)
    act(taker)
    for step in range(200):  # pushed against its force, then left alone
        at = (-0.0004 * min(step, 100), 0.0, 0.0)
        giver.force(at, ZERO, (0.01, 0.0, 0.0) if step < 100 else at, ZERO, 0.0)
    assert giver.energy == pytest.approx(POOR.energy * passive.CEILING)
    assert giver.shipped > 0.0
    taker.receive(giver.shipped)
    assert taker.energy == pytest.approx(min(POOR.energy * passive.CEILING, 2e-3 + giver.shipped))
    had = taker.energy
    for old in (giver.shipped, 0.0, giver.shipped / 2, math.nan, math.inf):
        taker.receive(old)
    assert taker.energy == had


def test_an_empty_account_gives_no_force_and_no_jump() -> None:
    half = engaged(POOR)
    x, forces = 0.0, []
    for _ in range(1000):  # a set-point that pulls the arm along for ever
        force = half.force((x, 0.0, 0.0), ZERO, (x + 0.01, 0.0, 0.0), ZERO, 0.0)
        forces.append(force[0])
        x += 0.0003
    assert forces == sorted(forces, reverse=True)
    assert 0.0 <= forces[-1] < 1e-3
    assert half.energy >= 0.0


# Restarts


def test_engaging_again_grants_nothing(half: passive.PassiveHalf) -> None:
    half.force(ZERO, ZERO, (0.01, 0.0, 0.0), ZERO, 0.0)
    half.force((0.001, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0)
    left = half.energy
    half.disengage()
    assert half.force((0.3, 0.0, 0.0), ZERO, ZERO, ZERO, 0.0) == ZERO
    half.engage()
    half.force((0.5, 0.0, 0.0), ZERO, (0.5, 0.0, 0.0), ZERO, 0.0)
    assert half.energy <= left


def test_a_half_that_restarted_lives_on_what_the_other_shares() -> None:
    veteran, newcomer = engaged(POOR), engaged(POOR)
    act(veteran)
    veteran.new_session()
    newcomer.new_session()
    newcomer.receive(veteran.shipped)
    act(newcomer)
    assert newcomer.energy == veteran.energy == POOR.energy / 2


def test_a_half_that_restarted_is_granted_nothing_where_the_other_has_nothing() -> None:
    veteran, newcomer = engaged(POOR), engaged(POOR)
    act(veteran)
    for _ in range(100):
        veteran.new_session()
    newcomer.receive(veteran.shipped)
    act(newcomer)
    assert 0.0 < newcomer.energy < 1e-11
    assert veteran.energy > -1e-9


def test_two_halves_that_meet_first_keep_what_they_were_granted() -> None:
    half = engaged(POOR)
    half.new_session()
    half.new_session()
    half.receive(0.0)
    act(half)
    assert (half.energy, half.shipped) == (POOR.energy, 0.0)


# Whatever comes in

anything = st.tuples(*[st.floats()] * 3)


@given(anything, st.tuples(*[anything] * 3), st.floats(), st.none() | st.floats())
def test_whatever_comes_in_the_force_is_finite_and_limited(
    position: Vector, others: tuple[Vector, Vector, Vector], age: float, work: float | None
) -> None:
    half = engaged(POOR, latency=1)
    for at in (ZERO, position, ZERO):
        force = half.force(at, *others, age, work)
        assert math.hypot(*force) <= 3.3 * (1 + 1e-12)
        assert math.isfinite(half.energy)


# Both in one process


def test_the_pair_acts_as_a_spring_between_the_arms() -> None:
    pair = passive.PassivePair(replace(RICH, scale=2.0), RATE)
    assert pair.forces((0.1, 0.0, 0.0), ZERO) == (ZERO, ZERO)
    pair.engage((0.1, 0.0, 0.0), ZERO)
    assert pair.engaged
    on_master, on_slave = pair.forces((0.101, 0.0, 0.0), (0.0, 0.004, 0.0))
    assert on_master == pytest.approx((-0.25, 0.5, 0.0))
    assert on_slave == pytest.approx((0.5, -1.0, 0.0))
    pair.disengage()
    assert pair.forces((0.101, 0.0, 0.0), ZERO) == (ZERO, ZERO)


def test_another_scale_moves_no_arm() -> None:
    pair = passive.PassivePair(RICH, RATE)
    pair.engage(ZERO, ZERO)
    at = (0.1, 0.0, 0.0)
    pair.forces(at, at)
    pair.change(replace(RICH, scale=3.0), 500)
    for force in pair.forces(at, at):
        assert force == pytest.approx(ZERO, abs=1e-9)


# Over a network


class Trial:
    """A random network, hand, wall and course of events; whatever it does is in its seed."""

    duration = 0.8

    def __init__(self, seed: int) -> None:
        self.random = chance = random.Random(seed)
        self.parameters = passive.PassiveParameters(
            stiffness=chance.choice([50.0, 250.0, 2000.0]),
            local_damping=chance.choice([0.3, 3.0, 10.0]),
            max_force=chance.choice([0.5, 3.3, 10.0]),
        )
        self.networks = Channel[Packet](*self.network()), Channel[Packet](*self.network())
        self.latency = chance.choice([0, 1, 3])
        self.prepared = False

    def network(self) -> tuple[ChannelParameters, int, list[tuple[float, float]]]:
        chance = self.random
        delay = chance.choice([0.0, 0.02, 0.1, 0.5]) * chance.random()
        parameters = ChannelParameters(
            delay,
            chance.choice([0.0, delay * chance.random()]),
            chance.choice([0.0, 0.1, 0.9, 1.0]) * chance.random(),
            chance.choice([0.0, chance.random()]),
        )
        dark = chance.random() * self.duration
        return parameters, chance.randrange(2**32), [(dark, dark + chance.choice([0.0, 0.2]))]

    def run(self) -> Iterator[Instant]:
        chance = self.random
        swings = [
            (0.05 * chance.random() / f, 2 * math.pi * f, 6.28 * chance.random())
            for f in (chance.uniform(0.5, 8.0) for _ in range(3))
        ]

        def path(time: float) -> Vector:
            x, y, z = (
                size * (math.sin(omega * time + phase) - math.sin(phase))
                for size, omega, phase in swings
            )
            return x, y, z

        around = chance.choice([free, wall(chance.uniform(100, 5000), chance.uniform(-0.01, 0.0))])
        args = self.parameters, self.networks, path, around, self.duration, self.event
        return run(*args, self.latency, chance.choice([0.0, 3.0]))

    def event(self, _: float, master: Side, slave: Side) -> None:
        chance = self.random
        if not self.prepared:
            self.prepared = True
            for side in (master, slave):
                side.reports_work = chance.random() < 0.7
                side.limit(chance.choice([0.2, 3.0]) if side.reports_work else UNLIMITED)
                side.age_factor = chance.choice([0.0, 1.0])  # a wrong one costs comfort only
                side.speed_noise = chance.choice([0.0, 0.2])
        if chance.random() > 0.01:
            return
        side, other = chance.sample([master, slave], 2)
        match chance.randrange(5):
            case 0 if other.half.engaged:  # one of both halves lives on
                side.start()
            case 1 if side.reports_work:
                side.stopped = not side.stopped
            case 2:
                side.half.disengage()
            case 3:
                stiffness = chance.choice([20.0, 250.0, 5000.0])
                side.half.change(replace(self.parameters, stiffness=stiffness))
            case 4:
                side.channel.parameters = self.network()[0]


def worst(trial: Trial) -> float:
    """Return the most net energy that a trial gave, J, after a look at its forces."""
    most = 0.0
    for instant in trial.run():
        most = max(most, instant.given)
        for force in instant.forces:
            assert math.hypot(*force) <= trial.parameters.max_force * (1 + 1e-12)
    return most


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32))
def test_no_network_makes_the_coupling_give_more_than_was_granted(seed: int) -> None:
    trial = Trial(seed)
    assert worst(trial) <= 2 * trial.parameters.energy + 1e-9


@pytest.mark.slow
def test_a_thousand_networks_do_not_either() -> None:
    for seed in range(1000):
        trial = Trial(seed)
        assert worst(trial) <= 2 * trial.parameters.energy + 1e-9, seed
