# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from haptic_accel.core.actuator import (
    ACTUATOR_TIMEOUT,
    ARM_PEAK_FORCE,
    ARM_TIMEOUT,
    MAX_AGE,
    ActuatorCommandLimits,
    ActuatorParameters,
    MasterSafetyParameters,
)
from haptic_accel.core.axes import ACTUATOR_AXIS, ALL_AXES, along_actuator
from haptic_accel.core.model import LATER, ZERO, Reading, Sample, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.simulated_rig import rig_side
from haptic_accel.core.tick import ACTUATOR, ARM, ArmSample, ArmWork, DeviceSide, SafetyLayer
from haptic_accel.core.tick.device_side import MEMORY, SAMPLE_TIMEOUT
from haptic_accel.core.tick.samples import KEPT

RATE = 1000.0
COIL = ActuatorParameters()
SPEED = 0.1
"""Speed of the arm along each axis, m/s."""


class Rig:
    """An arm that moves evenly, whatever pushes it; keeps the forces that it was given."""

    late = 0
    contact_force = None

    def __init__(self) -> None:
        self.arm: list[Vector] = []
        self.actuator: list[float] = []

    def read(self, time: float) -> Sample:
        return Sample((SPEED * time,) * 3, (SPEED,) * 3, ZERO)

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        if arm_force is not None:
            self.arm.append(arm_force)
        if actuator_force is not None:
            self.actuator.append(actuator_force[ACTUATOR_AXIS])


@pytest.fixture
def rig() -> Rig:
    return Rig()


def side(rig: Rig, latency: int) -> DeviceSide:
    return rig_side(rig, MasterSafetyParameters(hardware=ActuatorParameters()), RATE, latency)


def serve(
    side: DeviceSide, tick: int, arm: Vector | None, actuator: float | None = None
) -> list[ArmSample]:
    side.begin(tick)
    side.read()
    taken = list(side.samples)
    moment = tick * NANOSECONDS / RATE
    if arm is not None:
        side.command(ARM, moment, *arm)
    if actuator is not None:
        side.command(ACTUATOR, moment, *along_actuator(actuator))
    side.apply()
    side.watch()
    return taken


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_force_takes_effect_when_it_is_due(rig: Rig, latency: int) -> None:
    master = side(rig, latency)
    master.command(ARM, 0.0, *ZERO)  # before the first tick
    assert master.forces[ARM].newest == 0
    for tick in range(latency):
        serve(master, tick, (0.0, 0.0, 1.0), 0.2)
        assert (rig.arm, rig.actuator) == ([], [])
    serve(master, latency, (0.0, 0.0, 1.0), 0.2)
    assert (rig.arm, rig.actuator) == ([(0.0, 0.0, 1.0)], [0.2])


def test_no_force_is_more_than_the_safety_layer_allows(rig: Rig) -> None:
    master = side(rig, 0)
    serve(master, 0, (0.0, 0.0, 10 * ARM_PEAK_FORCE), 1e3)
    assert rig.arm[-1] == pytest.approx((0.0, 0.0, ARM_PEAK_FORCE))
    assert 0 < rig.actuator[-1] <= ActuatorParameters().peak_force
    serve(master, 1, (0.0, 0.0, math.nan), math.inf)
    assert rig.arm[-1] == pytest.approx((0.0, 0.0, ARM_PEAK_FORCE))
    assert all(map(math.isfinite, rig.actuator))


def test_a_force_ends_with_its_commands(rig: Rig) -> None:
    master = side(rig, 1)
    last = 5
    for tick in range(last + 1):
        serve(master, tick, (0.0, 0.0, 1.0))
    tick = last
    while rig.arm[-1] != ZERO:
        tick += 1
        serve(master, tick, None)
    # The last command is applied a tick after it was given; its time-out begins then.
    assert (tick - last - 1) / RATE == pytest.approx(ARM_TIMEOUT, abs=1.5 / RATE)


def test_work_is_force_times_displacement(rig: Rig) -> None:
    master = side(rig, 1)
    ticks = 100
    for tick in range(ticks + 1):
        (sample,) = serve(master, tick, (0.5, 1.0, -2.0))
    # From the first tick with force to the last sample.
    way = SPEED * (ticks - 1) / RATE
    assert sample.has_work
    assert sample.work == pytest.approx((0.5 * way, way, -2.0 * way))
    master.take_off()
    assert (rig.arm[-1], rig.actuator) == (ZERO, [0.0])
    (after,) = serve(master, ticks + 1, None)
    assert after.work == pytest.approx(sample.work)


def test_an_arm_that_is_freed_misses_no_command(rig: Rig) -> None:
    master = side(rig, 1)
    first = 10 * round(MAX_AGE * RATE)
    serve(master, first, (0.0, 0.0, 1.0))
    serve(master, first + 1, None)
    assert master.forces[ARM].stamp == first * NANOSECONDS // RATE
    master.free()
    for tick in range(first + 2, first + 100):
        serve(master, tick, None)
    assert rig.arm == [(0.0, 0.0, 1.0), ZERO]
    assert master.forces[ARM].stamp == (first + 1) * NANOSECONDS // RATE
    assert master.safety.warnings() == []
    assert master.deadlines == (2, 0)


class Slow:
    """A device whose samples come late, or never, and that applies forces by its own clock."""

    def __init__(self) -> None:
        self.readings: list[Reading] = []
        self.asked: list[float] = []
        self.written: list[tuple[float, dict[str, Any]]] = []
        self.late = 0

    contact_force = 0.1, 0.2, 0.3

    def read(self, time: float) -> Reading:
        self.asked.append(time)
        return self.readings.pop(0) if self.readings else LATER

    def write(self, time: float, **forces: Any) -> None:
        self.written.append((time, forces))


class Clock:
    """Steady time that stands still until it is set, s."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


STILL = Sample(ZERO, ZERO, ZERO)


LIMITS = MasterSafetyParameters(hardware=ActuatorParameters())


def clocked(
    device: Slow,
    clock: Clock | None,
    rate: float = RATE,
    limits: MasterSafetyParameters = LIMITS,
    **options: Any,
) -> DeviceSide:
    safety = SafetyLayer(limits, rate, ALL_AXES)
    safety.enable(0.0, True)
    return DeviceSide(device, safety, rate, 1, clock, **options)


def test_a_sample_that_comes_later_is_the_one_of_its_tick() -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock)
    for tick in (5, 6):
        part.begin(tick)
        part.read()
        assert part.samples == []
        assert not part.complete
    device.readings = [None, STILL]
    part.read()
    assert [(each.arm, each.tick, each.sample) for each in part.samples] == [(0, 6, STILL)]
    assert part.samples[0].contact is None
    assert device.asked[-2:] == [0.005, 0.006]
    assert (part.unread, part.complete) == (1, True)
    part.wants_contact, device.readings = True, [STILL]
    part.begin(7)
    part.read()
    assert [each.contact for each in part.samples] == [device.contact_force]


class Servo:
    """Control that holds a set-point with an even force."""

    set_point: Vector | None = ZERO

    def force(self, position: Vector, velocity: Vector) -> Vector:
        return (position[0], velocity[1], 0.5)


def test_a_position_is_held_until_a_force_comes_or_the_device_is_stopped() -> None:
    device, clock, servo = Slow(), Clock(), Servo()
    part = clocked(device, clock, servo=servo)

    def tick(number: int) -> list[dict[str, Any]]:
        device.readings, clock.now = (
            [Sample((0.2, 0.0, 0.0), (0.0, 0.3, 0.0), ZERO)],
            number / RATE,
        )
        part.begin(number)
        part.read()
        part.apply()
        written, device.written = device.written, []
        return [forces for _, forces in written]

    held = {ARM: (0.2, 0.3, 0.5)}
    assert [tick(number) for number in range(3)] == [[], [held], [held]]
    part.command(ARM, 2e6, *ZERO)
    assert servo.set_point is None
    assert [tick(3), tick(4)] == [[{ARM: ZERO}], []]
    servo.set_point = ZERO
    part.safety.stop(clock.now, True)
    assert [tick(5), tick(6)] == [[], []]
    assert servo.set_point is None


@pytest.mark.parametrize("rate", [RATE, 20.0])
def test_a_sample_is_waited_for_so_long_and_no_longer(rate: float) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock, rate)
    ticks = max(1, round(SAMPLE_TIMEOUT * rate)) + 10
    for tick in range(ticks):
        part.begin(tick)
        part.read()
        assert part.samples == []
    assert part.unread == 10


def test_a_sample_stays_what_it_is_for_a_while_in_little_memory(rig: Rig) -> None:
    master, kept, ticks = side(rig, 1), round(MEMORY * RATE), range(1500)
    samples = [sample for tick in ticks for sample in serve(master, tick, None)]
    assert [each.tick for each in samples[-kept:]] == [*ticks[-kept:]]
    assert len({id(each) for each in samples}) < 1.5 * kept


@pytest.mark.parametrize("lag", [0.0, 0.01, -0.01])
def test_forces_without_successors_end_where_nothing_is_measured(lag: float) -> None:
    """Passed time counts, whether the clock agrees with the ticks, is behind or ahead."""
    device, clock = Slow(), Clock()
    clock.now = min(0.0, -lag)
    part = clocked(device, clock)
    part.command(ARM, 0.0, *(0.0, 0.0, 0.5))
    part.command(ACTUATOR, 0.0, 0.1, 0.2, 0.3)
    for tick in range(1, 40):
        clock.now = tick / RATE - lag
        part.begin(tick)
        part.read()
        part.apply()
        part.watch()
    times, written = zip(*device.written, strict=True)
    assert written == (
        {ARM: (0.0, 0.0, 0.5), ACTUATOR: (0.1, 0.2, 0.3)},
        {ACTUATOR: ZERO},
        {ARM: ZERO},
    )
    first = 1 / RATE
    assert times == pytest.approx(
        [first, first + ACTUATOR_TIMEOUT, first + ARM_TIMEOUT], abs=1.01 / RATE
    )


@pytest.mark.parametrize(
    ("counted", "deadlines", "longest"),
    [(None, (2, 1), 0.7e-3), ([ACTUATOR], (0, 0), 0.0)],
    ids=["arm", "no arm"],
)
def test_a_force_that_comes_after_its_tick_acts_at_once_and_is_late(
    counted: list[str] | None, deadlines: tuple[int, int], longest: float
) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock, counted=counted)
    part.command(ARM, 9e6, *(0.0, 0.0, 0.5))
    clock.now = 0.010
    part.begin(10)
    part.apply()
    assert device.written == [(0.010, {ARM: (0.0, 0.0, 0.5)})]
    clock.now = 0.0115
    part.begin(11)
    part.apply()
    clock.now = 0.0117
    part.command(ARM, 10e6, *(0.0, 0.0, 0.6))
    part.apply(True)
    assert device.written[1:] == [(0.0117, {ARM: (0.0, 0.0, 0.6)})]
    assert (part.deadlines, part.longest) == (deadlines, pytest.approx(longest))
    told = {"due": "2", "past their tick": "1", "longest lateness (us)": "700", "count": "2"}
    values = {f"arm force {name}": value for name, value in told.items()}
    assert (values.items() <= part.diagnostics().items()) == (counted is None)


@pytest.mark.parametrize("kind", [ARM, ACTUATOR])
def test_a_force_is_late_by_the_time_that_its_write_takes(kind: str) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock, kinds=[kind])
    device.write = lambda time, **forces: setattr(clock, "now", 0.0105)  # type: ignore
    clock.now = 0.010
    part.command(kind, 9e6, *(0.0, 0.0, 0.5))
    for _ in range(2):
        part.begin(10)
        part.apply()
    assert part.longest == pytest.approx(0.5e-3)
    age = part.forces[kind].age
    assert (age.count, age.maximum) == (1, pytest.approx(1.5e-3))


def test_a_force_waits_for_its_tick_though_the_clock_is_far_from_the_last_one() -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock)
    clock.now = 5.0
    part.command(ARM, 5e9, *(0.0, 0.0, 0.5))
    for tick, count in ((5000, 0), (5001, 1)):
        part.begin(tick)
        part.apply()
        assert len(device.written) == count
    part.take_off()
    assert device.written[-1] == (5.0, {ARM: ZERO, ACTUATOR: ZERO})


def test_a_held_force_that_is_too_much_is_replaced_by_what_is_allowed() -> None:
    device, clock = Slow(), Clock()
    small = ActuatorParameters(travel=0.1, thermal_time=0.02)
    limits = replace(LIMITS, actuator=ActuatorCommandLimits(command_timeout=10.0), hardware=small)
    part = clocked(device, clock, limits=limits)
    part.command(ACTUATOR, 0.0, *along_actuator(3.0))
    for tick in range(1, 200):
        clock.now = tick / RATE
        part.begin(tick)
        part.apply()
        part.watch()
    held = [forces[ACTUATOR][ACTUATOR_AXIS] for _, forces in device.written]
    assert held[0] == 3.0
    assert held == sorted(held, reverse=True)
    assert held[-1] == pytest.approx(COIL.continuous_force, rel=0.02)


@pytest.mark.parametrize("framed", [False, True])
def test_an_old_force_reaches_no_device(framed: bool) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock, framed=framed)
    for moment in (clock.now - 1.1 * MAX_AGE, clock.now + 1.1 * MAX_AGE):
        part.command(ARM, moment * NANOSECONDS, *(0.0, 0.0, 0.5))
        part.begin(1)
        part.apply()
    # Nor is one of the future, once its time has come.
    clock.now = 1.2 * MAX_AGE
    part.begin(round(clock.now * RATE))
    part.apply()
    assert device.written == []
    assert part.safety.diagnostics()["arm force outdated"] == "2"


@pytest.mark.parametrize(
    ("looks", "written"), [(0, []), (1, [ZERO]), (2, [(0.0, 0.0, 0.5)])], ids=str
)
def test_a_pause_before_the_write_leaves_no_force(looks: int, written: list[Vector]) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock)
    part.command(ARM, 0.0, *(0.0, 0.0, 0.5))
    part.begin(1)
    # The process is stopped for 8 s after so many looks at the clock, the last before the write.
    moments = iter([0.001] * looks)
    part.clock = lambda: next(moments, 8.0)
    part.apply()
    assert [forces[ARM] for _, forces in device.written] == written


@pytest.mark.parametrize(("kind", "other"), [(ARM, ACTUATOR), (ACTUATOR, ARM)])
def test_a_device_with_a_clock_gets_forces_before_they_are_due(kind: str, other: str) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock, ahead=[kind])
    device.late = 7
    part.command(ARM, 9e6, *ZERO)  # the arms engage: those before do not count
    device.written.clear()
    part.begin(10)
    clock.now = 0.0101
    part.command(other, 10e6, *along_actuator(0.2))
    part.command(kind, 10e6, *along_actuator(0.1))
    assert device.written == [(0.011, {kind: along_actuator(0.1)})]
    device.late += 3
    assert part.deadlines == (3, 3)
    # One that was overtaken is not late by that.
    part.command(kind, 9.6e6, *ZERO)
    part.command(kind, 9e6, *ZERO)
    assert part.forces[kind].past_tick == 1, "due at this tick"


@pytest.mark.parametrize("clock", [Clock(), None])
@pytest.mark.parametrize(("ahead", "moment"), [([ACTUATOR], 0.01), ([], 0.012)])
def test_a_force_that_is_late_for_a_device_acts_at_once_unless_its_clock_tells(
    clock: Clock | None, ahead: list[str], moment: float
) -> None:
    device = Slow()
    part = clocked(device, clock, ahead=ahead, framed=True)
    part.begin(12)
    if clock is not None:
        clock.now = 0.012
    for count in (1, 2):
        part.command(ACTUATOR, 9e6, *along_actuator(0.1))
        assert part.forces[ACTUATOR].past_tick == count
    assert [time for time, _ in device.written] == [moment]


PERIOD = 1e-3


def along_x(value: float) -> Vector:
    return (value, 0.0, 0.0)


def after(work: ArmWork, time: float, position: Vector) -> Vector:
    work.until(time, ArmSample(0, position))
    return work.x, work.y, work.z


def test_the_work_on_a_body_is_its_kinetic_energy() -> None:
    mass, position, velocity = 0.1, 0.0, 0.0
    work = ArmWork()
    for tick in range(1000):
        done = after(work, tick * PERIOD, along_x(position))
        assert done == pytest.approx(along_x(mass * velocity**2 / 2), abs=1e-12)
        force = math.sin(0.1 * tick)
        work.apply(tick * PERIOD, *along_x(force))
        position += velocity * PERIOD + force / mass * PERIOD**2 / 2
        velocity += force / mass * PERIOD


def test_a_late_force_counts_for_what_is_left_of_the_period() -> None:
    work = ArmWork()
    work.until(0.0, ArmSample(0))
    work.apply(0.0, *(1.0, 2.0, 0.0))
    work.apply(0.75 * PERIOD, *(5.0, 0.0, 4.0))
    assert after(work, PERIOD, (8.0, 4.0, -1.0)) == pytest.approx((16.0, 6.0, -1.0))
    assert after(work, 2 * PERIOD, (9.0, 4.0, -1.0)) == pytest.approx((21.0, 6.0, -1.0))


def test_a_sample_may_be_read_after_the_next_forces() -> None:
    work = ArmWork()
    work.until(0.0, ArmSample(0))
    work.apply(0.0, *along_x(1.0))
    work.apply(PERIOD, *along_x(2.0))
    assert after(work, PERIOD, along_x(1.0)) == along_x(1.0)
    assert after(work, 2 * PERIOD, along_x(2.0)) == along_x(3.0)


def test_a_lost_sample_divides_the_way_by_time() -> None:
    work = ArmWork()
    work.until(0.0, ArmSample(0))
    for tick, force in enumerate((1.0, 2.0)):
        work.apply(tick * PERIOD, *along_x(force))
    for place in (math.nan, math.inf):
        work.until(PERIOD, ArmSample(0, along_x(place)))
    assert work.unknown == 2
    assert after(work, 2 * PERIOD, along_x(2.0)) == pytest.approx(along_x(3.0))


def test_a_force_of_a_time_before_the_last_sample_counts_from_there() -> None:
    work = ArmWork()
    for force in (1.0, 3.0):  # again at the same time, in which no force does work
        work.until(PERIOD, ArmSample(0))
        work.apply(PERIOD / 2, *along_x(force))
    assert after(work, 2 * PERIOD, along_x(2.0)) == along_x(6.0)


def test_forces_without_samples_take_no_memory_without_end() -> None:
    work = ArmWork()
    work.until(0.0, ArmSample(0))
    for tick in range(3 * KEPT):
        work.apply(tick * PERIOD, *along_x(1.0))
    kept_of_the_way = after(work, 3 * KEPT * PERIOD, along_x(3.0))
    assert kept_of_the_way == pytest.approx(along_x(1.0))


@pytest.mark.parametrize("kept", [1, 1000])
def test_the_actuator_sags_by_the_gravity_that_its_handle_measures(kept: int) -> None:
    device, clock = Slow(), Clock()
    part = clocked(device, clock)
    for tick in range(1000):
        clock.now = tick / RATE
        # A lost sample is no acceleration of zero.
        device.readings = [Sample(ZERO, ZERO, (2.0, -4.0, 9.81)) if tick < kept else None]
        part.begin(tick)
        part.read()
        part.watch()
    assert part.actuator_limit
    for coil, gravity in zip(part.actuator_limit.coils, (2.0, -4.0, 9.81), strict=True):
        assert coil.travel == pytest.approx(-COIL.m_a * gravity / COIL.k_s, rel=1e-3)
