# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every rule of the layer, by commands that violate it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from statistics import fmean

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core import actuator as safety
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ACTUATOR_AXIS, ALL_AXES, Axes, along_actuator
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import from_flat
from haptic_accel.core.tick import SafetyLayer, TravelEstimator, limits
from haptic_accel.core.trial import run_trial

RATE = 1000.0
COIL = ActuatorParameters()
PERIOD = 1 / RATE
FRESH = 2e-4
"""Age of a sample when its command comes, s."""


def commanded(
    limit: limits.ArmLimit | limits.ActuatorLimit | None, now: float, age: float, force: Vector
) -> Vector | None:
    """Return the force that a device is given for a command; None for no change."""
    assert limit
    return (limit.x, limit.y, limit.z) if limit.command(now, age, *force) else None


def ticked(layer: SafetyLayer, now: float, handle: Vector | None) -> Vector | None:
    """Pass a tick to the layer; return the actuator's force if it changes."""
    limit = layer.actuator_limit
    assert limit
    layer.arm_limit.expires(now)
    changed = limit.tick(now, handle is not None, *(handle or ZERO))
    return (limit.x, limit.y, limit.z) if changed else None


class Bench:
    """A layer, and the forces that the device behind it holds."""

    def __init__(self, rate: float = RATE, axes: Axes | None = None, **values: object) -> None:
        dotted = {name.replace("__", "."): value for name, value in values.items()}
        self.layer = SafetyLayer(from_flat(safety.MasterSafetyParameters, dotted), rate, axes)
        self.layer.enable(0.0, True)
        self.now = 0.0
        self.arm: Vector = ZERO
        self.actuator = 0.0

    def wait(self, seconds: float) -> None:
        """Let time pass without a tick."""
        self.now += seconds

    def tick(self, acceleration: float | None = 0.0) -> None:
        measured = None if acceleration is None else along_actuator(acceleration)
        actuator, arm = ticked(self.layer, self.now, measured), self.layer.arm_limit
        self.arm = arm.x, arm.y, arm.z
        self.actuator = self.actuator if actuator is None else actuator[ACTUATOR_AXIS]

    def push(self, force: float, age: float = FRESH) -> None:
        """Command the actuator."""
        applied = commanded(self.layer.actuator_limit, self.now, age, along_actuator(force))
        self.actuator = self.actuator if applied is None else applied[ACTUATOR_AXIS]

    def pull(self, force: Vector, age: float = FRESH) -> None:
        """Command the arm."""
        applied = commanded(self.layer.arm_limit, self.now, age, force)
        self.arm = self.arm if applied is None else applied

    def command(self, force: float, age: float = FRESH) -> None:
        """Command the actuator, and the arm along x."""
        self.push(force, age)
        self.pull((force, 0.0, 0.0), age)

    def run(self, forces: Iterable[float]) -> list[float]:
        """Command one force a tick, as a compensator does; return those applied."""
        applied = []
        for force in forces:
            self.tick()
            self.push(force)
            applied.append(self.actuator)
            self.wait(PERIOD)
        return applied

    def value(self, name: str) -> float:
        return float(self.layer.diagnostics()[name])


numbers = st.one_of(
    st.floats(),  # NaN and infinities too
    st.floats(-10.0, 10.0),
)
steps = st.lists(
    st.tuples(
        st.sampled_from(["tick", "push", "pull", "stop", "release", "arm", "off", "on"]),
        st.floats(0.0, 0.02),
        st.tuples(numbers, numbers, numbers),
        st.one_of(st.floats(-safety.MAX_AGE, safety.MAX_AGE), st.floats()),
    ),
    max_size=60,
)


@given(
    steps,
    st.sampled_from([safety.AUTOMATIC, safety.MANUAL]),
    st.sampled_from([0.0, 20.0]),
    st.sampled_from([ACTUATOR_AXES, ALL_AXES]),
)
def test_whatever_comes_only_less_of_it_in_its_direction_is_applied(
    steps: list[tuple[str, float, Vector, float]], recovery: str, slew: float, axes: Axes
) -> None:
    bench = Bench(axes=axes, recovery=recovery, arm__slew_rate=slew, actuator__slew_rate=slew)
    layer, arm, actuator = bench.layer, bench.layer.arm_limit, bench.layer.actuator_limit
    assert actuator
    asked: dict[limits.ForceLimit, Vector] = {arm: ZERO, actuator: ZERO}
    for what, seconds, vector, age in steps:
        bench.wait(seconds)
        if what == "tick":
            ticked(layer, bench.now, vector)
        elif what in ("push", "pull"):
            limit = actuator if what == "push" else arm
            if commanded(limit, bench.now, age, vector):
                asked[limit] = vector if limit is arm else axes.vector(axes.components(vector))
                assert abs(age) <= safety.MAX_AGE or (limit.x, limit.y, limit.z) == ZERO
        elif what in ("stop", "release"):
            layer.stop(bench.now, what == "stop")
        elif what == "arm":
            layer.arm()
        else:
            layer.enable(bench.now, what == "on")
        layer.news(bench.now)
        for limit, force in asked.items():
            held = limit.x, limit.y, limit.z
            if any(held):
                assert not layer.refusal
                most, size = max(map(abs, force)), max(map(abs, held))
                assert size <= min(most * (1 + 1e-15), COIL.peak_force)
                along = [each / most * size for each in force]
                assert held == pytest.approx(along, rel=1e-9, abs=1e-300)
        assert math.hypot(arm.x, arm.y, arm.z) <= safety.ARM_PEAK_FORCE * (1 + 1e-12)
    assert all(
        math.isfinite(float(value)) for name, value in layer.diagnostics().items() if "." in value
    )


within_a_period = st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=3)


@given(st.lists(within_a_period, min_size=1, max_size=5))
def test_heat_stays_below_what_the_coil_bears_whenever_commands_come(
    cycle: list[list[float]],
) -> None:
    time_constant = 0.02
    warming = -math.expm1(-PERIOD / time_constant)
    bench = Bench(actuator__thermal_time=time_constant, actuator__travel=0.1)
    heat = 0.0
    for forces in (cycle * 100)[:100]:
        bench.tick(0.0)
        for force in forces:
            bench.push(force)
            seconds = PERIOD / len(forces)
            bench.wait(seconds)
            share = -math.expm1(-seconds / time_constant)
            heat += share * (bench.actuator**2 - heat)
        # What is allowed is known from tick to tick.
        assert heat <= COIL.continuous_force**2 + warming * COIL.peak_force**2
    bench.tick()
    left = bench.value("actuator force heat left (%)") / 100
    assert (1 - left) * COIL.continuous_force**2 == pytest.approx(heat, rel=0.05, abs=0.02)


def test_a_force_above_its_peak_is_cut_and_keeps_its_direction() -> None:
    bench = Bench()
    bench.push(-50.0)
    assert bench.actuator == -COIL.peak_force
    for force in (1.0, 1.5, 10.0):
        bench.pull((0.6 * force * safety.ARM_PEAK_FORCE, 0.0, 0.8 * force * safety.ARM_PEAK_FORCE))
        assert bench.arm == pytest.approx(
            (0.6 * safety.ARM_PEAK_FORCE, 0.0, 0.8 * safety.ARM_PEAK_FORCE)
        )
    assert bench.value("actuator force limited") == 1
    assert bench.value("arm force limited") == 2


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_counted_and_does_not_feed_the_watchdog(wrong: float) -> None:
    bench = Bench()
    bench.command(1.0)
    for _ in range(3):
        bench.wait(safety.ARM_TIMEOUT / 2)
        bench.push(wrong)
        bench.pull((0.0, wrong, 0.0))
        bench.tick()
    assert (bench.actuator, bench.arm) == (0.0, ZERO)
    assert bench.value("actuator force rejected") == bench.value("arm force rejected") == 3
    assert "arm force not finite" in bench.layer.warnings()
    assert not [said for said in bench.layer.warnings() if "finite" in said], "reported once"


def test_silence_takes_each_force_off_after_its_own_time_and_is_reported_once() -> None:
    bench = Bench()
    bench.command(1.0)
    bench.wait(0.9 * safety.ACTUATOR_TIMEOUT)
    bench.tick()
    assert (bench.actuator, bench.arm) == (1.0, (1.0, 0.0, 0.0))
    bench.wait(0.2 * safety.ACTUATOR_TIMEOUT)
    bench.tick()
    assert (bench.actuator, bench.arm) == (0.0, (1.0, 0.0, 0.0))
    assert bench.layer.warnings() == ["actuator force timed out"]
    bench.wait(safety.ARM_TIMEOUT)
    for _ in range(10):
        bench.tick()
    assert bench.arm == ZERO
    assert bench.layer.warnings() == ["arm force timed out", "actuator force still missing"]
    assert bench.layer.warnings() == ["arm force still missing", "actuator force still missing"]
    assert bench.layer.news(bench.now) == []
    bench.wait(2 * limits.LOGGED_AFTER)
    (arm, actuator) = bench.layer.news(bench.now)
    assert arm == "arm force: none for 20 ms; no force until the next"
    assert actuator == "actuator force: none for 5 ms; no force until the next"
    assert bench.layer.news(bench.now) == []
    bench.push(1.0)
    assert bench.actuator == bench.value("actuator force held (N)") == 1.0
    assert bench.value("arm force held (N)") == 0.0
    assert bench.layer.news(bench.now) == ["actuator force: allowed again"]
    assert bench.layer.news(bench.now) == []
    assert bench.layer.warnings() == ["arm force still missing"]


def test_silence_after_a_force_of_zero_is_none() -> None:
    bench = Bench(recovery=safety.MANUAL)
    for force in (1.0, 0.0):
        bench.command(force)
    bench.wait(10 * safety.ARM_TIMEOUT)
    bench.tick()
    assert bench.layer.warnings() == []
    bench.push(1.0)
    assert bench.actuator == 1.0


def test_a_time_out_is_never_shorter_than_some_periods() -> None:
    slow = 50.0
    bench = Bench(rate=slow)
    bench.push(1.0)
    bench.wait(0.99 * safety.LEAST_PERIODS / slow)
    bench.tick()
    assert bench.actuator == 1.0
    bench.wait(0.02 * safety.LEAST_PERIODS / slow)
    bench.tick()
    assert bench.actuator == 0.0


@pytest.mark.parametrize("age", [1.1 * safety.MAX_AGE, -1.1 * safety.MAX_AGE, math.nan, math.inf])
def test_a_command_out_of_date_gives_zero_until_one_in_date(age: float) -> None:
    bench = Bench()
    bench.command(1.0, math.copysign(safety.MAX_AGE, age))
    assert (bench.actuator, bench.arm) == (1.0, (1.0, 0.0, 0.0))
    bench.command(2.0, age)
    assert (bench.actuator, bench.arm) == (0.0, ZERO)
    assert bench.layer.warnings() == ["arm force out of date", "actuator force out of date"]
    bench.push(1.0)
    assert bench.actuator == 1.0


@pytest.mark.parametrize("recovery", [safety.AUTOMATIC, safety.MANUAL])
def test_arming_while_forces_flow_does_not_hide_the_silence_that_follows(recovery: str) -> None:
    bench = Bench(recovery=recovery)
    bench.command(1.0)
    assert bench.layer.arm() == ""
    bench.wait(safety.ARM_TIMEOUT)
    bench.tick()
    assert (bench.actuator, bench.arm) == (0.0, ZERO)


@pytest.mark.parametrize("stale", [True, False])
def test_where_recovery_is_manual_only_arming_gives_forces_again(stale: bool) -> None:
    bench = Bench(recovery=safety.MANUAL)
    bench.push(2.0, 2 * safety.MAX_AGE)
    assert bench.layer.disarmed == "", "nothing was there to recover from"
    bench.push(1.0)
    if stale:
        bench.push(1.0, 2 * safety.MAX_AGE)
    else:
        bench.wait(safety.ACTUATOR_TIMEOUT)
        bench.tick()
    (line,) = bench.layer.news(bench.now)
    assert line.endswith("no force until armed again")
    bench.command(1.0)
    assert (bench.actuator, bench.arm) == (0.0, (1.0, 0.0, 0.0)), "each for itself"
    assert commanded(bench.layer.actuator_limit, bench.now, FRESH, along_actuator(1.0)) is None
    for rivals in ("/a and /b", ""):
        bench.layer.note_rivals("actuator force", rivals)
        bench.tick()
    assert bench.layer.diagnostics()["forces allowed"] == "false"
    assert bench.layer.warnings()[0].startswith("not armed: actuator force: ")
    assert bench.layer.arm() == ""
    bench.push(1.0)
    assert bench.actuator == 1.0
    assert bench.layer.diagnostics()["forces allowed"] == "true"


def test_no_force_while_stopped_or_not_active() -> None:
    bench = Bench()
    for change, refusing, reason in (
        (bench.layer.stop, True, limits.STOPPED),
        (bench.layer.enable, False, limits.NOT_ACTIVE),
    ):
        change(bench.now, refusing)
        assert commanded(bench.layer.actuator_limit, bench.now, FRESH, along_actuator(1.0)) is None
        assert commanded(bench.layer.arm_limit, bench.now, FRESH, (1.0, 0.0, 0.0)) is None
        assert bench.layer.arm() == bench.layer.refusal == reason
        assert bench.layer.warnings() == [reason]
        bench.wait(1.0)
        bench.tick()
        assert bench.value("actuator force timeouts") == 0
        change(0, not refusing)
        assert commanded(
            bench.layer.actuator_limit, bench.now, FRESH, along_actuator(1.0)
        ) == along_actuator(1.0)


def test_a_force_that_two_nodes_command_is_refused_until_one_does() -> None:
    bench = Bench()
    bench.run([1.0] * 5)
    bench.layer.note_rivals("actuator force", "/a and /b")
    said = "actuator force: no force while it is sent by /a and /b"
    assert bench.layer.news(bench.now) == [], "names may still change"
    assert bench.layer.news(bench.now) == [said]
    assert bench.layer.news(bench.now) == []
    assert not any(bench.run([1.0] * 100))
    assert bench.layer.warnings() == [said], "and no time-out besides"
    assert commanded(bench.layer.arm_limit, bench.now, FRESH, (1.0, 0.0, 0.0)) == (1.0, 0.0, 0.0)
    bench.layer.note_rivals("actuator force", "")
    news = bench.layer.news(bench.now) + bench.layer.news(bench.now)
    assert news == ["actuator force: allowed again: it has one sender"]
    assert all(bench.run([1.0] * 5))


@pytest.mark.parametrize("recovery", [safety.AUTOMATIC, safety.MANUAL])
def test_each_lasting_fault_is_logged_once_at_its_start_and_at_its_end(recovery: str) -> None:
    bench = Bench(recovery=recovery)
    for _ in range(2):
        bench.command(1.0)
        bench.wait(2 * safety.ARM_TIMEOUT)
        bench.tick()
        # A fault that ends by itself is told only where it lasts.
        bench.wait(0.9 * limits.LOGGED_AFTER)
        assert len(bench.layer.news(bench.now)) == (2 if recovery == safety.MANUAL else 0)
        bench.wait(0.2 * limits.LOGGED_AFTER)
        assert len(bench.layer.news(bench.now)) == (0 if recovery == safety.MANUAL else 2)
        assert bench.layer.news(bench.now) == []
        if recovery == safety.MANUAL:
            bench.layer.arm()
        bench.command(1.0)
        assert bench.layer.news(bench.now) == [
            "arm force: allowed again",
            "actuator force: allowed again",
        ]
        assert bench.layer.news(bench.now) == []
    assert bench.value("arm force timeouts") == bench.value("actuator force timeouts") == 2


def test_a_force_that_two_nodes_command_has_no_other_news() -> None:
    bench = Bench()
    bench.push(1.0)
    bench.wait(2 * safety.ACTUATOR_TIMEOUT)
    bench.tick()
    bench.wait(2 * limits.LOGGED_AFTER)
    assert len(bench.layer.news(bench.now)) == 1
    bench.layer.note_rivals("actuator force", "/a and /b")
    bench.tick()
    assert bench.layer.news(bench.now) == [], "not that it is allowed again"
    assert bench.layer.news(bench.now) == [
        "actuator force: no force while it is sent by /a and /b"
    ]
    assert bench.layer.diagnostics()["forces allowed"] == "false"
    bench.layer.note_rivals("actuator force", "")
    assert bench.layer.diagnostics()["forces allowed"] == "true"
    bench.layer.stop(bench.now, True)
    assert bench.layer.diagnostics()["forces allowed"] == "false"


def test_a_faulty_device_holds_no_force_but_has_a_last_one() -> None:
    bench = Bench()
    bench.command(0.5)
    for fault, allowed, suffix in (
        ("", "true", limits.HELD_FORCE),
        ("board disarmed", "false", limits.LAST_FORCE),
    ):
        values = bench.layer.diagnostics(fault)
        assert values["forces allowed"] == allowed
        assert values[f"arm force {suffix}"] == values[f"actuator force {suffix}"] == "0.500"


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_held_force_ends_as_a_second_sender_appears(goes_on: bool) -> None:
    bench = Bench()
    bench.push(1.0)
    bench.layer.note_rivals("actuator force", "/a and /b")
    if goes_on:
        bench.push(1.0)
    else:
        bench.tick()
    assert bench.actuator == 0.0


def test_a_new_layer_has_no_force_and_allows_none() -> None:
    layer = SafetyLayer(safety.MasterSafetyParameters(recovery=safety.MANUAL), RATE)
    assert [layer.stopped, layer.active] == [False, False]
    for now in (1000.0, 1000.5):
        assert ticked(layer, now, None) is None
        assert commanded(layer.actuator_limit, now, FRESH, along_actuator(1.0)) is None
        assert commanded(layer.arm_limit, now, FRESH, (1.0, 0.0, 0.0)) is None
    assert (layer.news(1001.0), layer.warnings()) == ([], [limits.NOT_ACTIVE])
    told = layer.diagnostics()
    assert told["arm force held (N)"] == told["actuator force held (N)"] == "0.000"
    assert told["actuator force heat left (%)"] == "100.0"
    assert told["actuator force travel (mm)"] == "0.00"


def test_a_device_without_an_actuator_gets_no_force_for_one() -> None:
    layer = SafetyLayer(safety.SafetyParameters(), RATE)
    layer.enable(0.0, True)
    assert layer.actuator_limit is None
    assert not [name for name in layer.diagnostics() if "actuator" in name]


def alternating(force: float, count: int) -> list[float]:
    """Return a force at 250 Hz, which moves the actuator little."""
    return [force if index % 4 < 2 else -force for index in range(count)]


def test_a_coil_driven_at_its_peak_ends_at_what_it_bears() -> None:
    bench = Bench(actuator__thermal_time=0.2, actuator__travel=0.1)
    applied = bench.run(alternating(COIL.peak_force, 3000))
    assert applied[:10] == alternating(COIL.peak_force, 10)
    settled = applied[-400:]
    rms = math.sqrt(sum(force * force for force in settled) / len(settled))
    assert rms == pytest.approx(COIL.continuous_force, rel=0.02)
    assert bench.value("actuator force heat left (%)") < 5.0
    assert bench.value("actuator force limited by heat") > 1000
    for _ in range(1000):
        bench.tick()
        bench.wait(PERIOD)
    assert bench.value("actuator force heat left (%)") > 90.0
    # Fed by a sender that hides its peaks between ticks, it would burn without being seen.
    for _ in range(2000):
        bench.tick()
        bench.push(0.0)
        bench.push(COIL.peak_force)
        bench.wait(0.9 * PERIOD)
        bench.push(0.0)
        bench.wait(0.1 * PERIOD)
    assert bench.value("actuator force heat left (%)") < 5.0
    assert bench.value("actuator force limited by heat") > 1500


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_force_that_would_press_the_actuator_on_its_stop_is_held_back(sign: float) -> None:
    bench = Bench()
    bench.run([2.0 * sign] * 2000)
    # There the spring alone holds what is left of the force.
    assert abs(bench.actuator) < 266.0 * COIL.travel * 1.01
    assert abs(bench.value("actuator force travel (mm)")) < 1.05e3 * COIL.travel
    assert bench.value("actuator force limited by travel") > 100
    bench.run([-0.5 * sign])
    assert bench.actuator == -0.5 * sign, "what pulls it back is not touched"


def test_the_layer_knows_where_the_actuator_is_after_a_long_pause() -> None:
    layer, estimator, handle = three(), TravelEstimator(COIL, RATE), (9.81, 4.0, -2.0)
    periods = 1000
    assert layer.actuator_limit
    for tick in range(3):
        ticked(layer, tick * periods * PERIOD, handle)
    for _ in range(2 * periods):
        estimator.observe(0.0, 1.0)
    expected = pytest.approx([each * estimator.travel for each in handle], rel=1e-2)
    assert [coil.travel for coil in layer.actuator_limit.coils] == expected


@pytest.mark.parametrize("axis", range(3))
def test_a_held_force_is_held_back_too(axis: int) -> None:
    layer, held = three(actuator__command_timeout=10.0), [0.0, 0.0, 0.0]
    held[axis] = 3.0
    commanded(layer.actuator_limit, 0.0, FRESH, (held[0], held[1], held[2]))
    for tick in range(200):
        held = [*(ticked(layer, tick * PERIOD, ZERO) or held)]
    assert 0.0 <= held[axis] == sum(held) < 3.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("force", [0.0, 0.1])
def test_a_coil_that_would_have_to_brake_gets_no_more_than_it_is_given(
    force: float, sign: float
) -> None:
    bench = Bench(actuator__command_timeout=10.0)
    bench.push(-sign * force)
    for _ in range(200):
        assert ticked(bench.layer, bench.now, along_actuator(100.0 * sign)) is None
        bench.wait(PERIOD)
    assert bench.value("actuator force held (N)") == force
    assert (bench.value("actuator force limited by travel") > 0) == (force > 0.0)


uneven_ticks = st.lists(
    st.tuples(
        st.integers(1, 5),  # periods
        st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=3),
        st.floats(-5.0, 5.0),
    ),
    min_size=1,
    max_size=20,
)


@given(uneven_ticks)
def test_travel_and_heat_are_those_of_the_forces_between_ticks(
    ticks: list[tuple[int, list[float], float]],
) -> None:
    time_constant, heat = 0.05, 0.0
    bench = Bench(actuator__command_timeout=10.0, actuator__thermal_time=time_constant)
    limit, estimator = bench.layer.actuator_limit, TravelEstimator(COIL, RATE)
    assert limit
    bench.tick()
    for periods, forces, handle in ticks:
        acted = []
        for force in forces:
            bench.push(force)
            acted.append(bench.actuator)
            bench.wait(periods * PERIOD / len(forces))
        bench.tick(handle)
        for _ in range(periods):
            estimator.observe(fmean(acted), handle)
        square = fmean(force * force for force in acted)
        heat -= math.expm1(-periods * PERIOD / time_constant) * (square - heat)
        assert limit.coils[0].travel == pytest.approx(estimator.travel, abs=1e-9)
        assert limit.coils[0].heat == pytest.approx(heat, abs=1e-9)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e300, None])
def test_a_handle_that_measures_nonsense_poisons_nothing(wrong: float | None) -> None:
    bench = Bench()
    bench.tick(wrong)
    bench.wait(PERIOD)
    bench.tick(wrong)
    assert bench.run([1.0]) == [1.0]
    assert math.isfinite(bench.value("actuator force travel (mm)"))


def test_no_force_grows_where_the_layer_was_enabled_after_the_time_of_the_tick() -> None:
    bench = Bench(actuator__slew_rate=100.0, arm__slew_rate=100.0)
    bench.layer.stop(bench.now + PERIOD / 2, True)
    bench.layer.stop(bench.now + PERIOD / 2, False)
    for force in (0.0, 1.0):
        bench.push(force)
        bench.pull((0.0, 0.0, force))
        assert (bench.actuator, bench.arm) == (0.0, ZERO)


def test_a_force_grows_no_faster_than_its_slew_rate_and_falls_at_once() -> None:
    bench = Bench(actuator__slew_rate=100.0, arm__slew_rate=100.0)
    assert bench.run([0.0, 1.0, 1.0]) == pytest.approx([0.0, 0.1, 0.2])
    # Also after a pause: a period's worth at a time.
    bench.wait(3 * PERIOD)
    assert bench.run([1.0, -1.0, 0.0, 0.05]) == pytest.approx([0.3, -0.1, 0.0, 0.05])
    for force, expected in (
        (ZERO, ZERO),
        ((0.0, 3.0, 0.0), (0.0, 0.1, 0.0)),
        ((3.0, 0.0, 0.0), (0.1, 0.0, 0.0)),  # turned: from nothing again
        ((0.05, 0.0, 0.0), (0.05, 0.0, 0.0)),
        ((0.12, 0.0, 0.0), (0.12, 0.0, 0.0)),
        (ZERO, ZERO),
        ((0.6, -0.8, 2.4), (0.3 / 13, -0.4 / 13, 1.2 / 13)),
        ((0.6, -0.8, 2.4), (0.6 / 13, -0.8 / 13, 2.4 / 13)),
    ):
        bench.pull(force)
        assert bench.arm == pytest.approx(expected)
        bench.wait(PERIOD)
    assert bench.value("arm force slewed") == bench.value("actuator force slewed") == 4
    bench.command(1.0, 2 * safety.MAX_AGE)
    bench.wait(PERIOD)
    bench.command(1.0)
    assert (bench.actuator, bench.arm) == (pytest.approx(0.1), pytest.approx((0.1, 0.0, 0.0)))


def test_commands_between_ticks_make_no_force_grow_faster() -> None:
    rate = 1024.0
    bench = Bench(rate=rate, actuator__slew_rate=0.5)
    most = 0.5 / rate
    for wait, force, expected in ((1.0, 1.0, 1.0), (0.0, 1.0, 1.0), (1.0, 2.0 * most, 2.0)):
        bench.wait(wait / rate)
        bench.push(force)
        assert bench.actuator == expected * most
    assert bench.value("actuator force slewed") == 2, "the last was as large as allowed"


def test_what_the_compensator_lets_through_passes_unchanged() -> None:
    for controller in ("constant", "dynamic", "feedback"):
        trial = run_trial(controller, duration=2.0)
        bench = Bench()
        applied = []
        for force, acceleration in zip(
            trial.actuator_force.tolist(), trial.handle_acceleration.tolist(), strict=True
        ):
            bench.tick(acceleration)
            bench.push(force)
            applied.append(bench.actuator)
            bench.wait(PERIOD)
        assert applied == trial.actuator_force.tolist()


# Three coils


def three(**values: object) -> SafetyLayer:
    return Bench(axes=ALL_AXES, **values).layer


@given(st.lists(st.floats(-20.0, 20.0), max_size=50), st.sampled_from([0.0, 500.0]))
def test_of_three_coils_each_is_limited_as_a_single_one(forces: list[float], slew: float) -> None:
    single, layer, held = Bench(actuator__slew_rate=slew), three(actuator__slew_rate=slew), ZERO
    for tick, force in enumerate(forces):
        now = tick * PERIOD
        single.now = now
        single.tick(force)
        single.push(force)
        reduced = ticked(layer, now, (0.0, force, 0.0))
        held = reduced or held
        held = commanded(layer.actuator_limit, now, FRESH, (0.0, force, 0.0)) or held
        assert held == pytest.approx((0.0, single.actuator, 0.0), abs=1e-12)
    assert layer.diagnostics() == single.layer.diagnostics()


def test_a_warm_coil_scales_what_is_held_on_all() -> None:
    layer = three(actuator__thermal_time=0.1, actuator__k_s=1e4)
    held, now = ZERO, 0.0
    for tick in range(1000):
        now = tick * PERIOD
        reduced = ticked(layer, now, ZERO)
        held = reduced or held
        held = commanded(layer.actuator_limit, now, FRESH, (5.0, 1.0, -2.0)) or held
    assert held[0] < 2.3
    assert held == pytest.approx((held[0], held[0] / 5.0, -2.0 * held[0] / 5.0))
    assert float(layer.diagnostics()["actuator force heat left (%)"]) < 10.0
    assert int(layer.diagnostics()["actuator force limited by heat"]) > 900


def test_when_commands_of_three_coils_stop_so_do_all() -> None:
    layer = three()
    ticked(layer, 0.0, ZERO)
    assert commanded(layer.actuator_limit, 0.0, FRESH, (1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    assert ticked(layer, safety.ACTUATOR_TIMEOUT, ZERO) == ZERO
    assert "actuator force timed out" in layer.warnings()


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_force_with_a_bad_component_is_rejected_as_a_whole(wrong: float, axis: int) -> None:
    layer = three()
    force = [1.0, 1.0, 1.0]
    force[axis] = wrong
    assert commanded(layer.actuator_limit, 0.0, FRESH, (force[0], force[1], force[2])) is None
    assert layer.warnings() == ["actuator force not finite"]


@pytest.mark.parametrize("names", ["x", "y", "z", "xy", "xz", "yz"])
def test_a_device_applies_no_force_along_axes_that_it_does_not_have(names: str) -> None:
    layer = Bench(axes=Axes(tuple(names))).layer
    expected = tuple(
        force if axis in names else 0.0 for axis, force in zip("xyz", (1.0, 2.0, 3.0), strict=True)
    )
    assert commanded(layer.actuator_limit, 0.0, FRESH, (1.0, 2.0, 3.0)) == expected
