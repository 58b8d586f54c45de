# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The coupling of the arms as a spring and a damper between two motions."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.coupling.passive import CouplingParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.tick import PairCoupling, PositionPositionCoupling

positions = st.tuples(*[st.floats(-0.5, 0.5)] * 3)
velocities = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
Motion = tuple[Vector, Vector, Vector, Vector]
motions = st.tuples(positions, positions, velocities, velocities)  # of master and slave
unlimited = 100.0  # N, far above what these positions give with soft springs
gains = st.floats(0.0, 50.0)


def coupled(
    master: Vector = ZERO, slave: Vector = ZERO, **parameters: float
) -> PositionPositionCoupling:
    coupling = PositionPositionCoupling(CouplingParameters(**parameters))
    coupling.engage(master, slave)
    return coupling


def within_limit(*forces: Vector) -> bool:
    return all(math.hypot(*force) < 0.99 * unlimited for force in forces)


def dot(one: Vector, other: Vector) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


# Engaging


@given(positions, positions, st.floats(0.1, 10.0), gains)
def test_engaging_anywhere_gives_no_force(
    master: Vector, slave: Vector, scale: float, damping: float
) -> None:
    coupling = coupled(master, slave, scale=scale, damping=damping)
    assert coupling.forces(master, slave) == (ZERO, ZERO)


@given(positions, positions, velocities, velocities)
def test_without_engaging_there_is_no_force(
    master: Vector, slave: Vector, master_velocity: Vector, slave_velocity: Vector
) -> None:
    coupling = PositionPositionCoupling(CouplingParameters(damping=1.0))
    assert not coupling.engaged
    arguments = master, slave, master_velocity, slave_velocity
    assert coupling.forces(*arguments) == (ZERO, ZERO)
    coupling.engage(ZERO, ZERO)
    assert coupling.engaged
    coupling.disengage()
    assert not coupling.engaged
    assert coupling.forces(*arguments) == (ZERO, ZERO)


def test_the_interface_couples_arms_without_a_force() -> None:
    coupling = PairCoupling()
    told = [coupling.engaged]
    coupling.engage(ZERO, ZERO)
    told.append(coupling.engaged)
    coupling.disengage()
    assert [*told, coupling.engaged] == [False, True, False]
    assert (coupling.stiffness, coupling.scale) == (0.0, 1.0)
    assert coupling.forces((0.001, 0.0, 0.0), ZERO) == (ZERO, ZERO)


def test_engaging_again_starts_from_there() -> None:
    coupling = coupled()
    assert coupling.forces((0.001, 0.0, 0.0), ZERO) != (ZERO, ZERO)
    coupling.engage((0.001, 0.0, 0.0), ZERO)
    assert coupling.forces((0.001, 0.0, 0.0), ZERO) == (ZERO, ZERO)


# The spring


def test_the_papers_stiffness_pulls_both_arms_together() -> None:
    # 0.25 N/mm, the master 2 mm ahead in x and 4 mm behind in z
    on_master, on_slave = coupled().forces((0.002, 0.0, -0.004), ZERO)
    assert on_master == pytest.approx((-0.5, 0.0, 1.0))
    assert on_slave == pytest.approx((0.5, 0.0, -1.0))
    on_master, on_slave = coupled().forces(ZERO, (0.0, 0.003, 0.0))
    assert on_master == pytest.approx((0.0, 0.75, 0.0))
    assert on_slave == pytest.approx((0.0, -0.75, 0.0))


@given(positions, positions, positions, gains, gains)
def test_each_arm_has_its_own_stiffness(
    master: Vector, slave: Vector, moved: Vector, k_m: float, k_sl: float
) -> None:
    coupling = coupled(master, slave, k_m=k_m, k_sl=k_sl, max_force=unlimited)
    ahead = np.subtract(moved, master)
    on_master, on_slave = coupling.forces(moved, slave)
    assert on_master == pytest.approx(tuple(-k_m * ahead), abs=1e-9)
    assert on_slave == pytest.approx(tuple(k_sl * ahead), abs=1e-9)


@given(motions, gains, gains)
def test_equal_gains_act_and_react(motion: Motion, stiffness: float, damping: float) -> None:
    coupling = coupled(k_m=stiffness, k_sl=stiffness, damping=damping, max_force=unlimited)
    on_master, on_slave = coupling.forces(*motion)
    if within_limit(on_master, on_slave):
        assert on_master == pytest.approx(tuple(-f for f in on_slave), abs=1e-9)


@given(positions, st.floats(0.1, 10.0))
def test_a_slave_that_moved_scale_times_as_far_is_where_it_belongs(
    master: Vector, scale: float
) -> None:
    slave = (scale * master[0], scale * master[1], scale * master[2])
    on_master, on_slave = coupled(scale=scale, max_force=unlimited).forces(master, slave)
    assert on_master == pytest.approx(ZERO, abs=1e-9)
    assert on_slave == pytest.approx(ZERO, abs=1e-9)


# Scaling


@given(positions, positions, st.floats(0.1, 10.0), gains, gains)
def test_each_arm_is_driven_by_the_error_in_its_own_measure(
    master: Vector, slave: Vector, scale: float, k_m: float, k_sl: float
) -> None:
    coupling = coupled(k_m=k_m, k_sl=k_sl, scale=scale, max_force=unlimited)
    on_master, on_slave = coupling.forces(master, slave)
    for axis in range(3):
        wanted_of_master = slave[axis] / scale
        wanted_of_slave = master[axis] * scale
        if within_limit(on_master):
            force = k_m * (wanted_of_master - master[axis])
            assert on_master[axis] == pytest.approx(force, abs=1e-9)
        if within_limit(on_slave):
            force = k_sl * (wanted_of_slave - slave[axis])
            assert on_slave[axis] == pytest.approx(force, abs=1e-9)


@given(motions, st.floats(0.2, 5.0), st.floats(1.0, 20.0), st.floats(1.0, 20.0))
def test_the_spring_neither_makes_nor_loses_scaled_power(
    motion: Motion, scale: float, k_m: float, k_sl: float
) -> None:
    master, slave, master_velocity, slave_velocity = motion
    # Motion is scaled by `scale` and force, from slave to master, by k_m / (k_sl scale), so
    # that power is scaled by their quotient. Counted so, what the arms get is what the spring
    # E = k_m d^2 / 2 between them gives off. Scale 1 with equal stiffness is energy itself.
    coupling = coupled(k_m=k_m, k_sl=k_sl, scale=scale, max_force=unlimited)
    on_master, on_slave = coupling.forces(master, slave)
    power_scale = k_m / (k_sl * scale**2)
    power = dot(on_master, master_velocity) + power_scale * dot(on_slave, slave_velocity)
    gap = np.subtract(master, np.divide(slave, scale))
    gap_velocity = np.subtract(master_velocity, np.divide(slave_velocity, scale))
    if within_limit(on_master, on_slave):
        assert power == pytest.approx(-k_m * float(gap @ gap_velocity), abs=1e-6)


# Damping


@given(velocities, velocities, st.floats(0.2, 5.0), gains)
def test_damping_is_on_the_difference_of_velocities_and_takes_power(
    master_velocity: Vector, slave_velocity: Vector, scale: float, damping: float
) -> None:
    coupling = coupled(damping=damping, scale=scale, max_force=unlimited)
    on_master, on_slave = coupling.forces(ZERO, ZERO, master_velocity, slave_velocity)
    slip = np.subtract(master_velocity, np.divide(slave_velocity, scale))
    if within_limit(on_master, on_slave):
        assert on_master == pytest.approx(tuple(-damping * slip), abs=1e-9)
        assert on_slave == pytest.approx(tuple(scale * damping * slip), abs=1e-9)
        power = dot(on_master, master_velocity) + dot(on_slave, slave_velocity) / scale**2
        assert power <= 1e-9


# The limit


@given(positions, st.floats(0.1, 10.0))
def test_the_limit_shortens_a_force_and_keeps_its_direction(master: Vector, limit: float) -> None:
    on_master, on_slave = coupled(max_force=limit).forces(master, ZERO)
    wanted = 250.0 * np.array(master)
    length = math.hypot(*wanted)
    expected = wanted if length <= limit else wanted * (limit / length)
    assert on_master == pytest.approx(tuple(-expected), abs=1e-9)
    assert on_slave == pytest.approx(tuple(expected), abs=1e-9)
    assert math.hypot(*on_master) <= limit * (1 + 1e-12)


def test_the_limit_is_that_of_a_phantom_omni_by_default() -> None:
    on_master, _ = coupled().forces((0.3, 0.0, -0.4), ZERO)
    assert on_master == pytest.approx((-0.6 * 3.3, 0.0, 0.8 * 3.3))


anything = st.tuples(*[st.floats()] * 3)


@given(st.tuples(*[anything] * 4), st.floats(0.0, 10.0))
def test_whatever_comes_in_the_forces_are_finite_and_limited(
    motion: Motion, damping: float
) -> None:
    for force in coupled(damping=damping).forces(*motion):
        assert math.hypot(*force) <= 3.3 * (1 + 1e-12)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_position_that_is_not_finite_gives_no_force(bad: float, axis: int) -> None:
    position = [0.001, 0.001, 0.001]
    position[axis] = bad
    x, y, z = position
    assert coupled().forces((x, y, z), ZERO) == (ZERO, ZERO)
    assert coupled().forces(ZERO, (x, y, z)) == (ZERO, ZERO)


# Other gains while the arms are coupled

fades = st.integers(1, 400)
gain_sets = st.builds(
    CouplingParameters,
    k_m=st.floats(0.0, 500.0),
    k_sl=st.floats(0.0, 500.0),
    damping=gains,
    scale=st.floats(0.1, 10.0),
    max_force=st.floats(0.0, 10.0),
)


def ahead(position: Vector, velocity: Vector, time: float) -> Vector:
    x, y, z = (p + time * v for p, v in zip(position, velocity, strict=True))
    return x, y, z


@given(st.tuples(gain_sets, gain_sets), motions, fades)
def test_forces_change_by_what_motion_and_the_fade_demand(
    sets: tuple[CouplingParameters, CouplingParameters], motion: Motion, samples: int
) -> None:
    (old, new), period = sets, 0.001
    master, _, master_velocity, slave_velocity = motion
    coupling = PositionPositionCoupling(old)
    coupling.engage(ZERO, ZERO)
    forces = [coupling.forces(master, ZERO, master_velocity, slave_velocity)]
    coupling.change(new, samples)
    for sample in range(1, samples + 3):
        at = ahead(master, master_velocity, period * sample)
        slave = ahead(ZERO, slave_velocity, period * sample)
        forces.append(coupling.forces(at, slave, master_velocity, slave_velocity))
    least, most = sorted((old.scale, new.scale))
    stiffness = max(old.k_m, new.k_m, old.k_sl, new.k_sl)
    damping = max(old.damping, new.damping)
    step = (most / least) ** (1 / samples) - 1  # of the scale, relative
    slip = math.hypot(*master_velocity) + math.hypot(*slave_velocity) / least
    lag = math.hypot(*master) + (samples + 2) * period * slip
    change = (
        stiffness * period * slip
        + damping * slip * step
        + (abs(new.k_m - old.k_m) + abs(new.k_sl - old.k_sl)) / samples * lag
        + abs(new.damping - old.damping) / samples * slip
    )
    scaled = most * (change + step * (stiffness * lag + damping * slip))
    limit = abs(new.max_force - old.max_force) / samples
    for before, after in itertools.pairwise(forces):
        for one, other, bound in zip(before, after, (change, scaled), strict=True):
            assert math.dist(one, other) <= bound + limit + 1e-9


@given(gain_sets, gain_sets, positions, positions, fades)
def test_what_was_faded_in_holds_from_then_on(
    old: CouplingParameters, new: CouplingParameters, lag: Vector, moved: Vector, samples: int
) -> None:
    coupling, expected = PositionPositionCoupling(old), PositionPositionCoupling(new)
    for each in (coupling, expected):
        each.engage(ZERO, ZERO)
    coupling.change(new, samples)
    for _ in range(samples):
        coupling.forces(lag, ZERO)
    slave = ahead(ZERO, moved, new.scale)
    for at in (lag, ahead(lag, moved, 1.0)):
        forces = coupling.forces(at, slave)
        for one, other in zip(forces, expected.forces(at, slave), strict=True):
            assert one == pytest.approx(other, abs=1e-6)


@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0), positions, fades)
def test_another_scale_moves_no_arm_that_follows(
    old: float, new: float, master: Vector, samples: int
) -> None:
    coupling = coupled(scale=old)
    slave = ahead(ZERO, master, old)
    coupling.change(CouplingParameters(scale=new), samples)
    for _ in range(samples + 1):
        for force in coupling.forces(master, slave):
            assert force == pytest.approx(ZERO, abs=1e-9)


def test_a_change_of_a_change_begins_where_that_was() -> None:
    coupling = coupled()
    lag = (0.001, 0.0, 0.0)
    coupling.change(CouplingParameters(k_m=150.0), 4)
    felt = [-coupling.forces(lag, ZERO)[0][0] for _ in range(3)]
    coupling.change(CouplingParameters(k_m=375.0), 2)
    felt += [-coupling.forces(lag, ZERO)[0][0] for _ in range(4)]
    assert felt == pytest.approx([0.25, 0.225, 0.2, 0.175, 0.275, 0.375, 0.375])


def test_free_arms_are_coupled_with_the_gains_of_then() -> None:
    coupling = PositionPositionCoupling(CouplingParameters())
    coupling.change(CouplingParameters(k_m=100.0), 500)
    coupling.engage(ZERO, ZERO)
    assert coupling.forces((0.001, 0.0, 0.0), ZERO)[0] == pytest.approx((-0.1, 0.0, 0.0))


def test_a_position_that_is_not_finite_spoils_no_change() -> None:
    coupling = coupled()
    coupling.change(CouplingParameters(k_m=100.0), 2)
    for _ in range(5):
        assert coupling.forces((math.nan, 0.0, 0.0), ZERO) == (ZERO, ZERO)
    for force in (-0.25, -0.175, -0.1, -0.1):
        on_master, _ = coupling.forces((0.001, 0.0, 0.0), ZERO)
        assert on_master == pytest.approx((force, 0.0, 0.0))
