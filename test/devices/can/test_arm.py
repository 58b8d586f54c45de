# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""When an arm may have torques, and which; without a bus and without a clock."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzing import fuzz, mutated
from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import from_flat
from haptic_accel.devices.can import protocol
from haptic_accel.devices.can.arm import LONGEST_QUEUED, REPEAT_PERIOD, DrivenArm, State
from haptic_accel.devices.can.parameters import CanParameters

STEP = 1e-3  # s
CLOSED, IDLE = protocol.AxisState.CLOSED_LOOP_CONTROL, protocol.AxisState.IDLE
DRV_FAULT = 0x20  # of firmware 0.6


class Bench:
    """An arm whose axes say what the test wants, and what they are told."""

    def __init__(self, **values: Any) -> None:
        names = {name.replace("__", "."): value for name, value in values.items()}
        self.parameters = from_flat(CanParameters, names)
        self.sent: list[protocol.Frame] = []
        self.arm = DrivenArm(self.parameters, self._send)
        self.now = 0.0
        self.errors = dict.fromkeys(self.arm.nodes, 0)
        self.states = dict.fromkeys(self.arm.nodes, IDLE)
        self.silent: set[protocol.Command] = set()
        self.obedient = True

    def _send(self, frames: Sequence[protocol.Frame]) -> bool:
        self.sent += frames
        for frame in frames:
            order = protocol.parse_order(frame)
            if isinstance(order, protocol.SetState) and self.obedient:
                self.states[order.node] = protocol.AxisState(order.state)
            elif order and frame.command == protocol.Command.CLEAR_ERRORS and self.obedient:
                self.errors[order.node] = 0
        return True

    def go_on(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            for node in self.arm.nodes:
                if protocol.Command.ENCODER_ESTIMATES not in self.silent:
                    self.arm.receive(protocol.Estimates(node, 0.1 * node, 0.0).frame(), self.now)
                if protocol.Command.HEARTBEAT not in self.silent:
                    beat = protocol.Heartbeat(node, self.errors[node], self.states[node]).frame()
                    self.arm.receive(beat, self.now)
            self.arm.update(self.now)

    def armed(self) -> Bench:
        self.go_on(0.01)
        self.arm.arm(self.now)
        self.go_on(0.01)
        assert self.arm.state is State.ARMED
        self.sent.clear()
        return self

    def push(self, *force: float) -> list[float]:
        """Apply a force and return the torques that were sent for it."""
        self.sent.clear()
        self.arm.apply((force[0], force[1], force[2]), self.now)
        return torques(self.sent)

    def released(self) -> bool:
        """Return True where every axis was last told no torque, and to be idle."""
        last = {frame.id: protocol.parse_order(frame) for frame in self.sent}
        return all(
            last.get(node << 5 | protocol.Command.SET_INPUT_TORQUE)
            == protocol.SetTorque(node, 0.0)
            and last.get(node << 5 | protocol.Command.SET_AXIS_STATE)
            == protocol.SetState(node, IDLE)
            for node in self.arm.nodes
        )


def torques(frames: Iterable[protocol.Frame]) -> list[float]:
    orders = map(protocol.parse_order, frames)
    return [order.torque for order in orders if isinstance(order, protocol.SetTorque)]


# Arming


def test_arming_tells_each_axis_what_it_is_for() -> None:
    bench = Bench()
    bench.go_on(0.01)
    assert bench.sent == []
    bench.arm.arm(bench.now)
    commands = [frame.command for frame in bench.sent if frame.node == 1]
    assert commands == [
        protocol.Command.SET_CONTROLLER_MODE,
        protocol.Command.SET_INPUT_TORQUE,
        protocol.Command.CLEAR_ERRORS,
        protocol.Command.SET_AXIS_STATE,
    ]
    assert torques(bench.sent) == [0.0] * 3


def test_before_it_is_armed_no_force_goes_out() -> None:
    bench = Bench()
    bench.go_on(0.01)
    assert bench.push(1.0, 0.0, 0.0) == []
    assert bench.arm.counters()["withheld_forces"] == 1


def test_a_heartbeat_of_before_does_not_count() -> None:
    bench = Bench()
    bench.go_on(0.01)
    bench.silent = {protocol.Command.HEARTBEAT}
    bench.arm.arm(bench.now)
    bench.go_on(0.05)
    assert bench.arm.state is State.ARMING


DISOBEDIENT = [(DRV_FAULT, "DRV_FAULT"), (0, "is not in closed loop but in IDLE")]


@pytest.mark.parametrize(("error", "fault"), DISOBEDIENT)
def test_an_axis_that_does_not_obey_is_named(error: int, fault: str) -> None:
    bench = Bench(start_timeout=0.6)
    bench.obedient = False
    bench.go_on(0.01)
    bench.states = {0: CLOSED, 1: CLOSED, 2: IDLE}
    bench.errors[2] = error
    bench.arm.arm(bench.now)
    bench.go_on(0.7)
    assert bench.arm.state is State.DISARMED
    assert bench.arm.fault == f"joint3 (node 2): {fault}"
    assert bench.released()
    tries = sum(frame.id == 2 << 5 | protocol.Command.CLEAR_ERRORS for frame in bench.sent)
    assert tries == (1 if error else 3), "an error that stays is not cleared over and over"


@pytest.mark.parametrize("error", [0, protocol.WATCHDOG_TIMER_EXPIRED["0.6"]])
def test_an_axis_that_does_not_hear_or_whose_watchdog_expires_is_told_again(error: int) -> None:
    bench = Bench()
    bench.go_on(0.01)
    bench.obedient = False
    bench.arm.arm(bench.now)
    bench.errors[1] = error
    bench.go_on(0.1)
    bench.obedient = True
    bench.go_on(0.4)
    assert bench.arm.state is State.ARMED
    assert bench.arm.counters()["disarmed"] == 0


def test_which_axes_are_missing_is_said() -> None:
    bench = Bench(joint2__node_id=9)
    bench.silent = {protocol.Command.HEARTBEAT}
    bench.go_on(0.01)
    bench.arm.receive(protocol.Heartbeat(0, 0, 1).frame(), bench.now)
    assert bench.arm.missing(bench.now) == "joint2 (node 9), joint3 (node 2)"


# Forces

force = st.floats(-1e6, 1e6) | st.floats()


@given(force, force, force, st.sampled_from(["stage", "planar", "arm"]))
@settings(max_examples=25)
def test_no_torque_is_beyond_its_limit(x: float, y: float, z: float, kinematics: str) -> None:
    bench = Bench(kinematics=kinematics, joint1__torque_limit=0.2, joint2__torque_limit=0.0)
    bench.armed()
    limits = [joint.torque_limit for joint in bench.parameters.joints.values()]
    sent = bench.push(x, y, z)
    assert len(sent) == len(limits)
    for torque, limit in zip(sent, limits, strict=True):
        # Single precision rounds.
        assert abs(torque) <= limit * (1 + 1e-6)


def test_nor_is_one_that_overflows_on_its_way() -> None:
    bench = Bench(joint1__gear_ratio=0.01).armed()
    assert bench.push(0.0, 1e308, 0.0) == pytest.approx([0.0] * 3)


def test_a_force_that_is_too_large_keeps_its_direction() -> None:
    weak = Bench(joint1__torque_limit=0.05).armed().push(3.0, 2.0, 1.0)
    strong = Bench().armed().push(3.0, 2.0, 1.0)
    assert max(map(abs, weak)) < max(map(abs, strong))
    ratio = weak[0] / strong[0]
    assert weak == pytest.approx([ratio * torque for torque in strong])
    assert abs(weak[0]) == pytest.approx(0.05)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_force_that_is_no_number_is_none(bad: float) -> None:
    bench = Bench().armed()
    assert bench.push(1.0, bad, 0.0) == [0.0] * 3
    assert bench.arm.counters()["rejected_forces"] == 1


def test_gear_direction_and_offset_count() -> None:
    plain = Bench(kinematics="stage").armed()
    gear = {"joint1__gear_ratio": 5.0, "joint1__direction": -1, "joint1__offset": 0.0}
    geared = Bench(kinematics="stage", **gear).armed()
    expected = [-torque / 5 for torque in plain.push(0.0, 0.0, 2.0)]
    assert geared.push(0.0, 0.0, 2.0) == pytest.approx(expected)
    for bench, turns in ((plain, 1.0), (geared, -5.0)):
        bench.now += 1.0  # turned there meanwhile
        bench.arm.receive(protocol.Estimates(0, turns, turns).frame(), bench.now)
        sample = bench.arm.read(bench.now)
        assert sample.position == pytest.approx((0.0, 0.0, 0.04))
        assert sample.velocity == pytest.approx((0.0, 0.0, 0.04))
        assert sample.acceleration == ZERO
        # The stage moves 0.04 m a turn, so that 2 N are 0.08 J for 2 pi rad.
        joints = bench.arm.joints()
        assert joints.names == ["joint1"]
        assert joints.positions == joints.velocities == pytest.approx([math.tau])
        assert joints.efforts == pytest.approx([0.08 / math.tau])


# Keeping the drives from letting go


def test_zero_is_repeated_while_nobody_commands() -> None:
    bench = Bench().armed()
    bench.go_on(0.1)
    assert len(torques(bench.sent)) == pytest.approx(3 * 0.1 / REPEAT_PERIOD, rel=0.2)
    assert not any(torques(bench.sent))


def test_another_torque_only_whoever_reads_repeats() -> None:
    bench = Bench().armed()
    pushed = bench.push(1.0, 0.0, 0.0)
    bench.sent.clear()
    bench.go_on(0.05)
    assert torques(bench.sent) == [], "a commander that hangs must not seem alive"
    bench.arm.read(bench.now)
    assert torques(bench.sent) == pushed


def test_requested_estimates_are_asked_for_at_each_sample() -> None:
    bench = Bench(estimates="requested")
    bench.go_on(0.02)
    asked = [frame for frame in bench.sent if frame.remote]
    assert {frame.node for frame in asked} == {0, 1, 2}, "or it would never start"
    bench.armed()
    for _ in range(10):
        bench.now += STEP
        bench.arm.read(bench.now)
        bench.arm.update(bench.now)
    assert sum(frame.remote for frame in bench.sent) == 3 * 10


# Letting go

WRONG: dict[str, tuple[str, bool]] = {
    "error": ("joint2 (node 1): DRV_FAULT", False),
    "idle": ("joint2 (node 1): is not in closed loop but in IDLE", False),
    "heartbeat": ("joint1 (node 0): no heartbeat for 0.35 s", True),
    "estimates": ("joint1 (node 0): no estimates for 0.05 s", True),
    "bus": ("the bus has gone", True),
}
each_wrong = pytest.mark.parametrize("what", WRONG)


def go_wrong(bench: Bench, what: str) -> None:
    if what == "error":
        bench.errors[1] = DRV_FAULT
    elif what == "idle":
        bench.states[1] = IDLE
    elif what == "heartbeat":
        bench.silent = {protocol.Command.HEARTBEAT}
    elif what == "estimates":
        bench.silent = {protocol.Command.ENCODER_ESTIMATES}
    else:
        bench.arm.lose()
        bench.silent = {protocol.Command.HEARTBEAT, protocol.Command.ENCODER_ESTIMATES}
    bench.go_on(0.4)


@each_wrong
def test_when_one_axis_is_not_well_all_let_go(what: str) -> None:
    bench = Bench().armed()
    bench.push(1.0, 0.0, 0.0)
    go_wrong(bench, what)
    assert bench.arm.state is State.DISARMED
    assert bench.arm.fault == WRONG[what][0]
    assert bench.released()
    assert bench.arm.torques == (0.0, 0.0, 0.0)
    assert bench.push(1.0, 0.0, 0.0) == []
    assert bench.arm.counters()["disarmed"] == 1


@each_wrong
@pytest.mark.parametrize("rearm", ["auto", "manual"])
def test_torques_come_back_when_asked_or_when_what_was_lost_is_back(what: str, rearm: str) -> None:
    bench = Bench(rearm=rearm).armed()
    bench.push(1.0, 0.0, 0.0)
    go_wrong(bench, what)
    bench.silent.clear()
    if WRONG[what][1]:  # cut off, the axes have let go
        bench.errors[0] = protocol.WATCHDOG_TIMER_EXPIRED["0.6"]
    bench.go_on(0.1)
    by_itself = rearm == "auto" and WRONG[what][1]
    assert (bench.arm.state is State.ARMED) == by_itself
    if not by_itself:
        bench.arm.arm(bench.now)
        bench.go_on(0.1)
    assert bench.arm.state is State.ARMED
    assert bench.arm.fault == ""
    assert bench.arm.torques == (0.0, 0.0, 0.0), "until the next force"


@pytest.mark.parametrize("error", [0, DRV_FAULT])
def test_what_was_disarmed_on_request_or_has_an_error_besides_stays_so(error: int) -> None:
    bench = Bench(rearm="auto").armed()
    bench.arm.lose()
    bench.errors[1] = error
    if not error:
        bench.arm.disarm()
    bench.go_on(0.5)
    assert bench.arm.state is State.DISARMED
    assert bench.released()


def test_an_axis_that_should_be_idle_is_told_so_until_it_is() -> None:
    bench = Bench().armed()
    bench.obedient = False
    bench.arm.disarm()
    bench.sent.clear()
    bench.go_on(0.01)
    assert bench.released()
    bench.obedient = True
    bench.go_on(0.01)
    bench.sent.clear()
    bench.go_on(0.1)
    assert bench.sent == []


def test_what_an_ended_program_left_is_taken_off() -> None:
    bench = Bench()
    bench.obedient = False
    bench.states = dict.fromkeys(bench.arm.nodes, CLOSED)
    bench.go_on(0.01)
    assert bench.released()


def test_when_the_bus_is_back_the_first_thing_is_to_let_go() -> None:
    bench = Bench(rearm="auto").armed()
    bench.push(1.0, 0.0, 0.0)
    bench.arm.lose()
    bench.sent.clear()
    bench.arm.release()
    assert bench.released()


# Whatever comes

heartbeats = st.builds(
    lambda node, error, state: protocol.Heartbeat(node, error, state).frame(),
    st.integers(0, 3),
    st.sampled_from([0, 0, 0, 0, DRV_FAULT, 2**32 - 1]),
    st.sampled_from([CLOSED, CLOSED, CLOSED, CLOSED, IDLE, 255]),
)
estimates = st.builds(
    lambda node, turns, speed: protocol.Estimates(node, turns, speed).frame(),
    st.integers(0, 3),
    st.floats(width=32),
    st.floats(width=32),
)
changed = st.builds(
    lambda frame, data: frame._replace(data=data[:8]),
    heartbeats | estimates,
    mutated(estimates.map(lambda frame: frame.data), st.binary(max_size=3)),
)
ids, payloads = st.integers(0, 0x7FF), st.binary(max_size=8)
anything = st.builds(protocol.Frame, ids, payloads, remote=st.booleans())
passing = st.sampled_from([0.0, 1e-4, 1e-3, 1e-3, 0.06, 0.4])
frames = st.one_of(heartbeats, estimates, changed, anything)
traffic = st.lists(st.tuples(frames, passing, force), max_size=20)


@fuzz
@given(traffic, st.sampled_from(["stage", "planar", "arm"]), st.sampled_from(["auto", "manual"]))
def test_no_frames_lead_to_an_exception_or_an_unlawful_torque(
    came: list[tuple[protocol.Frame, float, float]], kinematics: str, rearm: str
) -> None:
    limited = {"joint1__torque_limit": 0.2, "joint2__torque_limit": 0.0}
    bench = Bench(kinematics=kinematics, rearm=rearm, **limited).armed()
    for frame, seconds, newtons in came:
        bench.now += seconds
        bench.sent.clear()
        bench.arm.receive(frame, bench.now)
        bench.arm.update(bench.now)
        bench.arm.apply((newtons, newtons, -newtons), bench.now)
        sample = bench.arm.read(bench.now)
        assert sample is None or all(map(math.isfinite, (*sample.position, *sample.velocity)))
        assert bench.arm.fault.isprintable()
        assert bench.arm.state is State.ARMED or not any(torques(bench.sent))
        for order in map(protocol.parse_order, bench.sent):
            if isinstance(order, protocol.SetTorque):
                joint = [*bench.parameters.joints.values()][bench.arm.nodes.index(order.node)]
                assert abs(order.torque) <= joint.torque_limit * (1 + 1e-6)
        report = protocol.parse_report(frame)
        if (
            isinstance(report, protocol.Heartbeat)
            and report.node in bench.arm.nodes
            and report.error
        ):
            assert bench.arm.state is not State.ARMED


def test_without_estimates_there_is_no_sample_which_is_counted() -> None:
    bench = Bench().armed()
    assert bench.arm.read(bench.now) is not None
    bench.silent = {protocol.Command.ENCODER_ESTIMATES}
    bench.go_on(0.2)
    assert bench.arm.read(bench.now) is None
    assert bench.arm.counters()["samples_missing"] == 1


OWN, OTHER = (False,), (True,)
"""Estimates of the arm's own drive, and of another."""

PERIODS = st.sampled_from((1e-3, 5e-3, LONGEST_QUEUED))


@given(
    periods=st.lists(PERIODS, min_size=2, max_size=50),
    late=st.lists(st.booleans(), min_size=50, max_size=50),
    amplitude=st.floats(0.0, 2.0),
    frequency=st.floats(0.1, 5.0),
)
def test_no_motion_of_one_motor_is_a_jump(
    periods: list[float], late: list[bool], amplitude: float, frequency: float
) -> None:
    bench = Bench().armed()
    turn = 2 * math.pi * frequency
    bench.arm.receive(protocol.Estimates(0, 0.0, amplitude * turn).frame(), bench.now)
    moved = received = bench.now
    for period, waits in zip(periods, late, strict=False):
        moved += period
        # Frames that wait while this process stands still come at one time.
        received = received if waits else max(received, moved)
        phase = turn * (moved - bench.now)
        motion = amplitude * math.sin(phase), amplitude * turn * math.cos(phase)
        bench.arm.receive(protocol.Estimates(0, *motion).frame(), received)
    assert bench.arm.counters()["position_jumps"] == 0


@given(
    between=st.floats(0.1, 10.0),
    order=st.lists(st.sampled_from((OWN, OTHER + OWN, OTHER * 2 + OWN)), min_size=1),
    period=st.sampled_from((0.5e-3, 1e-3, 5e-3)),
)
def test_two_drives_with_one_node_id_are_refused_and_named(
    between: float, order: list[tuple[bool, ...]], period: float
) -> None:
    bench = Bench().armed()
    at_rest = bench.arm.read(bench.now)
    others = [*itertools.chain(*order), *OTHER, *OWN]
    for jumps, other in zip(itertools.accumulate(others), others, strict=True):
        bench.now += period
        bench.arm.receive(protocol.Estimates(0, between * other, 0.0).frame(), bench.now)
        assert bench.arm.read(bench.now) == (None if jumps else at_rest)
    assert bench.arm.state is State.DISARMED
    assert bench.released()
    assert bench.push(0.2, 0.0, 0.1) == []
    assert bench.arm.fault.startswith("joint1 (node 0): jumped by")
    assert bench.arm.fault.endswith("do two drives have this node id?")
    assert bench.arm.counters()["position_jumps"] == sum(others)
    bench.arm.arm(bench.now)
    bench.now += period
    bench.arm.receive(protocol.Estimates(0, between, 0.0).frame(), bench.now)
    assert bench.arm.state is State.DISARMED


def test_a_motor_that_was_turned_while_it_was_silent_is_no_jump() -> None:
    bench = Bench().armed()
    bench.arm.receive(protocol.Estimates(0, 3.0, 0.0).frame(), bench.now + 0.1)
    assert bench.arm.state is State.ARMED
