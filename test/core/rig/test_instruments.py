# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Converters, the accelerometer's noise, and what an arm's motors and encoders do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.coupling.engagement import Engagement, EngagementParameters
from haptic_accel.core.model import ZERO, AccelerometerParameters, FloatArray, Vector
from haptic_accel.core.rig.master_rig import MasterRig
from haptic_accel.core.rig.slave_rig import SlaveRig, SurfaceParameters
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.tick import ArmSample, PositionPositionCoupling
from haptic_accel.core.tick.rigs import (
    RETURN_AFTER,
    Accelerometer,
    Quantizer,
    SimulatedArm,
    encoded,
    limited,
)
from haptic_accel.core.topics import ARMS

# Converters


def test_a_converter_rounds_to_its_steps_and_counts_what_is_beyond() -> None:
    converter = Quantizer(8.0, 4)  # sixteen steps of 1 over 16
    values = (0.0, 0.4, 0.6, -0.6, 1.4, -7.6, 8.0)
    assert [converter.convert(v) for v in values] == [0.0, 0.0, 1.0, -1.0, 1.0, -8.0, 8.0]
    assert converter.saturated == 0
    beyond = (8.1, -9.0, math.inf, -math.inf)
    assert [converter.convert(v) for v in beyond] == [8.0, -8.0, 8.0, -8.0]
    assert converter.saturated == 4


@given(st.floats(0.1, 100.0), st.integers(4, 24), st.floats(-1.0, 1.0))
def test_it_is_off_by_half_a_step_at_the_most(full_scale: float, bits: int, part: float) -> None:
    value = part * full_scale
    converted = Quantizer(full_scale, bits).convert(value)
    step = 2 * full_scale / 2**bits
    assert abs(converted - value) <= step / 2 * (1 + 1e-6)
    assert converted / step == pytest.approx(round(converted / step), abs=1e-6)
    assert Quantizer(full_scale, bits).convert(-value) == -converted


# The accelerometer


def samples(parameters: AccelerometerParameters, count: int, *seeds: int) -> list[float]:
    accelerometer = Accelerometer(parameters, *seeds)
    return [accelerometer.measure(0.0) for _ in range(count)]


@pytest.mark.parametrize(
    ("density", "bandwidth"), [(250e-6 * 9.80665, 500.0), (0.01, 500.0), (0.01, 2000.0)]
)
def test_noise_is_that_of_the_density_through_a_first_order_low_pass(
    density: float, bandwidth: float
) -> None:
    parameters = AccelerometerParameters(noise_density=density, bandwidth=bandwidth, bits=24)
    expected = density * math.sqrt(math.pi / 2 * bandwidth)
    assert parameters.noise == pytest.approx(expected)
    noise = np.array(samples(parameters, 40_000, 1))
    # The standard deviation of n samples is known to one part in sqrt(2 n), of their mean to
    # one in sqrt(n): four times that.
    assert noise.std() == pytest.approx(expected, rel=4 / math.sqrt(80_000))
    assert abs(noise.mean()) < 4 * expected / math.sqrt(40_000)


def test_noise_is_white() -> None:
    noise = np.array(samples(AccelerometerParameters(bits=24), 40_000, 2))
    neighbours = np.corrcoef(noise[1:], noise[:-1])[0, 1]
    assert abs(neighbours) < 4 / math.sqrt(40_000)


def test_the_seed_decides_about_the_noise() -> None:
    parameters = AccelerometerParameters()
    assert samples(parameters, 10, 3) == samples(parameters, 10, 3)
    assert samples(parameters, 10, 3) != samples(parameters, 10, 4)


def test_two_accelerometers_of_one_seed_have_independent_noise() -> None:
    parameters = AccelerometerParameters()
    one, other = samples(parameters, 40_000, 3, 1), samples(parameters, 40_000, 3, 2)
    assert abs(np.corrcoef(one, other)[0, 1]) < 4 / math.sqrt(40_000)


def test_without_noise_only_the_converter_is_left() -> None:
    accelerometer = Accelerometer(AccelerometerParameters(range=8.0, noise_density=0.0, bits=4), 0)
    assert accelerometer.measure(2.4) == 2.0
    assert accelerometer.measure(20.0) == 8.0
    assert accelerometer.saturated == 1


def test_the_paper_s_accelerometer_by_default() -> None:
    parameters = AccelerometerParameters()
    assert parameters.range == pytest.approx(49.0, abs=0.05)
    assert (parameters.bandwidth, parameters.bits) == (500.0, 16)


# The arm


@given(st.floats(-1.0, 1.0))
def test_encoders_have_steps(position: float) -> None:
    assert abs(encoded(position, 55e-6) - position) <= 27.5e-6 * (1 + 1e-6)
    assert encoded(position, 55e-6) / 55e-6 == pytest.approx(round(position / 55e-6), abs=1e-6)
    assert encoded(position, 0.0) == position


@given(st.floats(allow_nan=False))
def test_motors_give_what_they_can(force: float) -> None:
    assert limited(force, 3.3) == min(3.3, max(-3.3, force))


def test_motors_give_nothing_for_nan() -> None:
    assert limited(math.nan, 3.3) == 0.0


RATE = 1000.0
PERIOD = 1 / RATE
ROUGH = SurfaceParameters(stiffness=6e6, friction=0.35, roughness=6e-6, roughness_exponent=1.5)

STROKES = slice(900, 3600)
"""Samples after engaging in which the tool is dragged: after the approach, before the lift."""


class CoupledRigs:
    """Both rigs, coupled as the graph's coupler does it: no force is sent while they are free."""

    def __init__(self, rig: RigParameters) -> None:
        self.master = MasterRig(rig.master, RATE)
        self.slave = SlaveRig(rig.slave, RATE)
        self.engagement = Engagement(EngagementParameters(listeners=0), 0.0)
        for arm in ARMS:
            self.engagement.arm_stopped(arm, False)
        self._coupling = PositionPositionCoupling(rig.coupling)
        self._tick = 0
        self.engaged_at: list[int] = []
        self.origins: list[tuple[Vector, Vector]] = []

    def run(self, seconds: float) -> FloatArray:
        """Let time pass; return the tool's acceleration."""
        return np.array([self._sample() for _ in range(round(seconds * RATE))])

    def _sample(self) -> float:
        now = self._tick * PERIOD
        for rig in (self.master, self.slave):
            rig.advance(now)
        handle, tool = self.master.measure(), self.slave.measure()
        for arm, rig in zip(ARMS, (handle, tool), strict=True):
            sample = ArmSample(round(now * 1e9), rig.position)
            self.engagement.watches[arm].take(now, sample)
        decision = self.engagement.decide(now, 0)
        if decision.release:
            self._coupling.disengage()
            self._apply(ZERO, ZERO)
        if decision.engage:
            self._coupling.engage(handle.position, tool.position)
            self.engaged_at.append(self._tick)
            self.origins.append((handle.position, tool.position))
        if self._coupling.engaged:
            self._apply(*self._coupling.forces(handle.position, tool.position))
        self._tick += 1
        return tool.acceleration

    def _apply(self, on_master: Vector, on_slave: Vector) -> None:
        self.master.apply_arm_force(on_master)
        self.slave.apply_arm_force(on_slave)


def dragging(acceleration: FloatArray, begin: int) -> float:
    """Return the RMS of the tool's acceleration over the strokes after a sample, m/s^2."""
    return float(np.std(acceleration[begin:][STROKES]))


def rough_rigs() -> CoupledRigs:
    rig = RigParameters()
    return CoupledRigs(replace(rig, slave=replace(rig.slave, surface=ROUGH)))


@pytest.fixture(scope="module")
def before() -> float:
    """Return the RMS of the tool's acceleration without any stop, m/s^2."""
    return dragging(rough_rigs().run(4.0), 0)


# In the approach, pressed, dragged, in the lift, and at rest in the air.
@pytest.mark.parametrize("moment", [0.01, 0.4, 0.65, 2.0, 4.3, 4.7])
@pytest.mark.parametrize("stopped", [PERIOD, 3.0])
def test_after_a_stop_the_tool_is_dragged_as_before(
    before: float, moment: float, stopped: float
) -> None:
    rigs = rough_rigs()
    rigs.run(moment)
    rigs.engagement.stop.stop()
    rigs.run(stopped)
    rigs.engagement.stop.stopped = False  # by a release at once, which no rule would allow
    after = rigs.run(5.0)
    _, engaged_again = rigs.engaged_at
    assert rigs.origins[1] == rigs.origins[0], "both arms are where they began"
    assert before > 1.0
    begin = engaged_again - round((moment + stopped) * RATE)
    assert dragging(after, begin) == pytest.approx(before, rel=0.2)


@pytest.mark.parametrize(
    ("force", "every", "held"),
    [
        (0.0, 0.9 * RETURN_AFTER, True),  # a coupling in balance repeats its commands
        (0.5, 1e3, True),
        (0.0, 1.1 * RETURN_AFTER, False),
    ],
)
def test_an_arm_is_put_back_once_it_is_free_of_force_and_commands(
    force: float, every: float, held: bool
) -> None:
    arm = SimulatedArm()
    assert not arm.let_go(1e3), "it was never held"
    for _ in range(100):
        arm.free, arm.silence = not force, 0.0
        assert arm.let_go(every) != held
        assert held or not arm.let_go(every), "once is enough"
