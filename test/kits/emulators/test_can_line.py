# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated arms, and the adapter's end of slcan."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.coupling import passive
from haptic_accel.core.parameters import from_flat
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.tick import PositionPositionCoupling
from haptic_accel.devices import simulated
from haptic_accel.devices.can import protocol
from haptic_accel.devices.can.arm import DrivenArm, State
from haptic_accel.devices.can.parameters import CanParameters
from haptic_accel.devices.can.protocol import Frame
from haptic_accel.devices.interface import Device
from haptic_accel.kits.emulators import can_line

ids = st.integers(0, 0x7FF)
frames = st.builds(Frame, ids, st.binary(max_size=8), remote=st.just(False)) | st.builds(
    Frame, ids, st.just(b""), remote=st.just(True)
)


@given(frames)
def test_a_frame_comes_back(frame: Frame) -> None:
    line = can_line.frame_line(frame)
    assert line.endswith(b"\r")
    assert can_line.parse_frame_line(line[:-1]) == frame


def test_lines_are_those_of_the_manual() -> None:
    frame = Frame(0x100, bytes.fromhex("0011223344556677"))
    assert can_line.frame_line(frame) == b"t10080011223344556677\r"
    assert can_line.frame_line(Frame(0x7, b"", remote=True)) == b"r0070\r"


@given(st.binary(max_size=40))
def test_no_line_is_too_strange(line: bytes) -> None:
    frame = can_line.parse_frame_line(line)
    if frame is not None:
        assert 0 <= frame.id <= 0x7FF
        assert len(frame.data) <= 8


@given(st.lists(st.binary(max_size=60), max_size=20), st.lists(frames, min_size=1, max_size=5))
def test_frames_are_found_after_any_bytes_however_cut(
    garbage: list[bytes], wanted: list[Frame]
) -> None:
    adapter = can_line.SlcanAdapter()
    for piece in garbage:
        adapter.receive(piece)
    adapter.receive(b"\rO\r")
    stream = b"".join(map(can_line.frame_line, wanted))
    assert [frame for byte in stream for frame in adapter.receive(bytes([byte]))[0]] == wanted


def test_frames_pass_only_while_it_is_open() -> None:
    adapter = can_line.SlcanAdapter()
    line = can_line.frame_line(Frame(0x21))
    assert adapter.receive(line) == ([], b"\a")
    assert adapter.receive(b"S8\rO\r" + line) == ([Frame(0x21)], b"\r\r\r")
    assert adapter.receive(b"C\r" + line) == ([], b"\r\a")


def test_it_says_who_it_is() -> None:
    assert can_line.SlcanAdapter().receive(b"V\rN\rF\r?\r")[1] == b"V1013\rNHAPT\rF00\r\a"


RATE = 500.0
PERIOD = 1 / RATE
CLOSED = protocol.AxisState.CLOSED_LOOP_CONTROL


def obey(axis: can_line.EmulatedAxis, *orders: protocol.Message, now: float = 0.0) -> None:
    """Let an axis execute orders as they arrive by the bus."""
    for order in orders:
        found = protocol.parse_order(order.frame())
        assert found is not None
        axis.execute(found, now)


def axis(watchdog: float = 0.0) -> can_line.EmulatedAxis:
    return can_line.EmulatedAxis(1, 0.01, watchdog, "0.6")


def armed(watchdog: float = 0.0) -> can_line.EmulatedAxis:
    found = axis(watchdog)
    obey(found, protocol.SetMode(1), protocol.SetState(1, CLOSED), protocol.SetTorque(1, 0.5))
    return found


def heartbeat(of: can_line.EmulatedAxis, now: float) -> protocol.Heartbeat:
    reports = map(protocol.parse_report, of.due(now))
    (beat,) = (each for each in reports if isinstance(each, protocol.Heartbeat))
    return beat


def test_it_has_a_torque_only_in_closed_loop_and_torque_control() -> None:
    one = axis()
    obey(one, protocol.SetTorque(1, 0.5))
    assert one.torque == 0.0
    obey(one, protocol.SetState(1, CLOSED))
    assert one.torque == 0.0
    obey(one, protocol.SetMode(1))
    assert one.torque == 0.5
    obey(one, protocol.SetState(1, protocol.AxisState.IDLE))
    assert one.torque == 0.0


def test_an_axis_reports_at_its_rates_and_once_after_a_stall() -> None:
    one = axis()
    sent = [frame.command for step in range(1000) for frame in one.due(step * 1e-3)]
    assert sent.count(protocol.Command.HEARTBEAT) == 10
    assert sent.count(protocol.Command.ENCODER_ESTIMATES) == 100
    assert len(one.due(60.0)) == 2
    assert one.due(60.0 + 1e-6) == []


def test_silence_makes_it_let_go_with_an_error() -> None:
    one = armed(watchdog=0.05)
    one.due(0.04)
    assert one.torque == 0.5
    obey(one, protocol.EstimatesRequest(1), now=0.04)  # anything feeds it
    one.due(0.08)
    assert one.torque == 0.5
    one.due(0.1)
    assert one.torque == 0.0
    beat = heartbeat(one, 0.5)
    expired = protocol.WATCHDOG_TIMER_EXPIRED["0.6"]
    assert beat == protocol.Heartbeat(1, expired, protocol.AxisState.IDLE)


def test_with_an_error_it_does_not_go_into_closed_loop_until_cleared() -> None:
    one = armed()
    obey(one, protocol.EmergencyStop(1))
    assert one.torque == 0.0
    assert protocol.error_names(heartbeat(one, 0.0).error, "0.6") == "ESTOP_REQUESTED"
    obey(one, protocol.SetState(1, CLOSED))
    assert not one.armed
    obey(one, protocol.ClearErrors(1), protocol.SetState(1, CLOSED))
    assert one.armed


ids, payloads = st.integers(0, 0x7FF), st.binary(max_size=8)
any_frames = st.builds(protocol.Frame, ids, payloads, remote=st.booleans())


def new_slave() -> Device:
    return simulated.SimulatedSlave(simulated.SimulatedSlaveParameters(), RATE, 0)


def new_master() -> Device:
    return simulated.SimulatedMaster(MasterRigParameters(), RATE, 0)


@given(st.lists(any_frames, max_size=30))
@settings(max_examples=25)
def test_no_frame_is_too_strange_for_an_emulated_arm(noise: list[protocol.Frame]) -> None:
    arm = can_line.EmulatedArm(CanParameters(), new_slave(), rate=RATE, watchdog=0.1)
    for step, frame in enumerate(noise):
        arm.receive(frame, step * PERIOD)
        arm.due(step * PERIOD)


class Rigged:
    """The driver's arm and the emulated one, with nothing between."""

    def __init__(self, new_device: Callable[[], Device], seed: int = 0, **values: object) -> None:
        names = {name.replace("__", "."): value for name, value in values.items()}
        parameters = from_flat(CanParameters, names)
        self.now = 0.0
        self.emulated = can_line.EmulatedArm(
            parameters, new_device(), rate=RATE, watchdog=0.05, seed=seed
        )
        self.arm = DrivenArm(parameters, self._send)

    def _send(self, frames: Sequence[protocol.Frame]) -> bool:
        for frame in frames:
            for answer in self.emulated.receive(frame, self.now):
                self.arm.receive(answer, self.now)
        return True

    def step(self, times: int = 1) -> None:
        for _ in range(times):
            self.now += PERIOD
            for frame in self.emulated.due(self.now):
                self.arm.receive(frame, self.now)
            self.arm.update(self.now)


GEARED = {
    "joint1__gear_ratio": 8.0,
    "joint1__direction": -1,
    "joint2__gear_ratio": 5.0,
    "joint2__offset": 0.3,
    "joint3__node_id": 17,
    "joint3__direction": -1,
}


@pytest.mark.parametrize(
    "values",
    [
        {"kinematics": "arm", **GEARED},
        {"kinematics": "arm", "links__elbow": "shoulder", "estimates": "requested"},
        {"kinematics": "planar"},
        {"kinematics": "stage", "stage__axis": "z"},
    ],
    ids=["arm", "requested", "planar", "stage"],
)
def test_coupled_arms_move_together(values: dict[str, object]) -> None:
    """The whole experiment in lockstep: what the hand does at the master the slave's tip does."""
    # Without noise nothing would move: the hand waits for a first force.
    sides = [Rigged(new, seed, **values) for seed, new in enumerate((new_master, new_slave))]
    for side in sides:
        side.step(100)
        side.arm.arm(side.now)
        side.step(100)
        assert side.arm.state is State.ARMED, side.arm.fault
    coupling = PositionPositionCoupling(passive.CouplingParameters())
    tips: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(round(2.0 * RATE)):
        master, slave = (side.arm.read(side.now).position for side in sides)
        if not coupling.engaged:
            coupling.engage(master, slave)
        for side, force in zip(sides, coupling.forces(master, slave), strict=True):
            side.arm.apply(force, side.now)
            side.step()
        tips.append((np.array(master), np.array(slave)))
    moved = np.array(tips) - np.array(tips)[0]
    master, slave = moved[:, 0], moved[:, 1]
    along = [2] if values["kinematics"] == "stage" else [0, 2]
    # 14.7 mm down, of which the surface allows 10; strokes of 80 mm.
    assert master[:, 2].min() == pytest.approx(-0.0145, abs=1e-3)
    assert slave[:, 2].min() == pytest.approx(-0.0105, abs=1e-3)
    for place in along:
        assert np.corrcoef(master[:, place], slave[:, place])[0, 1] > 0.97
    if 0 in along:
        assert np.ptp(slave[:, 0]) > 0.05
    assert all(side.arm.counters()["disarmed"] == 0 for side in sides)


def test_an_arm_that_is_left_alone_is_put_back() -> None:
    side = Rigged(new_slave)
    side.step(100)
    start = side.arm.read(side.now).position
    side.arm.arm(side.now)
    for _ in range(300):
        side.arm.apply((0.5, 0.0, 0.0), side.now)
        side.step()
    assert side.emulated.driven
    assert side.arm.read(side.now).position[0] > start[0] + 0.01
    side.arm.disarm()
    side.step(round(1.2 * RATE))
    assert side.arm.read(side.now).position == pytest.approx(start, abs=1e-4)
    assert not side.emulated.driven


def test_no_push_takes_it_where_it_cannot_be_computed() -> None:
    side = Rigged(new_slave)
    side.step(100)
    side.arm.arm(side.now)
    for _ in range(round(2 * RATE)):
        side.arm.apply((3.0, 0.0, 3.0), side.now)
        side.step()
    assert all(map(np.isfinite, side.arm.read(side.now).velocity))
