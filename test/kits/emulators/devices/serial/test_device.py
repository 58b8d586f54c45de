# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drivers through real pseudo-terminals: samples, forces, and everything that goes wrong."""

from __future__ import annotations

import itertools
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import fuzz, mutated
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.model import ZERO
from haptic_accel.devices import DeviceError, Sample
from haptic_accel.devices.interface import LATER
from haptic_accel.devices.serial import protocol
from haptic_accel.devices.serial.device import SerialDevice, SerialMaster, SerialSlave
from haptic_accel.devices.serial.link import ARMED
from haptic_accel.kits.emulators.ports import DROP, GARBAGE, STALL, UNPLUG, PseudoTerminal
from running import PATIENCE, wait_until

HANDLE = protocol.Identity((1, 2, 3), 0b100, 5000, 49.0, (0.0, 0.0, 2.75), "handle-1")
TOOL = replace(HANDLE, full_scale_currents=ZERO, serial_number="tool-1")
RATE = 1000.0

Make = Callable[..., Any]


def tick(ahead: float = 0.0) -> float:
    """Return the grid point nearest to some time from now."""
    return round((time.monotonic() + ahead) * RATE) / RATE


def feel(device: SerialDevice) -> float:
    """Return the acceleration at a tick that has just passed."""
    sample = device.read(tick(-0.005))
    return sample.acceleration[ACTUATOR_AXIS] if isinstance(sample, Sample) else math.nan


def align(device: SerialDevice) -> None:
    """Wait until the board samples on the grid."""
    wait_until(lambda: device.counters()["aligned"] == 1, "alignment")


def push(device: SerialDevice, board: Any, force: float, current: float) -> None:
    """Command a force again and again, as a graph does, until its current flows."""

    def flows() -> bool:
        for _ in range(25):
            device.write(time.monotonic(), actuator_force=along_actuator(force))
            if board.current == pytest.approx(current, abs=2e-4):
                return True
            time.sleep(0.002)
        return False

    wait_until(flows, f"{current} A")


@pytest.fixture
def board(bench: Make) -> Any:
    return bench()


@pytest.fixture
def device(board: Any, connect: Make) -> SerialDevice:
    """Return a driver that is connected to the board."""
    return connect(board)  # type: ignore[no-any-return]


# Samples and forces


def test_samples_come_calibrated(board: Any, connect: Make) -> None:
    board.hold(10.0)
    nominal = connect(board)
    wait_until(lambda: feel(nominal) == pytest.approx(10.0, abs=2e-3), "nominal samples")
    sample = read(nominal, tick())
    assert sample is None or sample[:2] == (ZERO, ZERO)
    assert "board handle-1, firmware 1.2.3" in nominal.remark
    nominal.close()
    counts = round(10.0 / 49.0 * protocol.FULL_SCALE)
    calibrated = connect(board, calibration__gain=-0.001, calibration__offset=87.0)
    right = pytest.approx(-0.001 * (counts - 87))
    wait_until(lambda: feel(calibrated) == right, "calibrated samples")


CYCLE = 40
"""Ticks after which the emulated acceleration repeats itself."""


def phase(time: float) -> float:
    """Return a time in the emulator, s, as periods of a cycle."""
    return time * RATE % CYCLE


def apart(one: float, other: float) -> float:
    """Return the distance of two phases, periods."""
    return abs((one - other + CYCLE / 2) % CYCLE - CYCLE / 2)


def read(device: SerialDevice, due: float) -> Sample | None:
    """Return the sample of a tick, for which it waits as a node does."""
    deadline = time.monotonic() + PATIENCE
    while (reading := device.read(due)) is LATER:
        assert time.monotonic() < deadline, "no sample came"
        time.sleep(1e-4)
    return reading


@pytest.mark.parametrize("drift", [0.0, 5e-4])
def test_each_tick_gets_the_sample_that_was_taken_at_it(
    bench: Make, connect: Make, drift: float
) -> None:
    board = bench(drift=drift)
    board.measure = phase
    device = connect(board, kind=SerialSlave)
    align(device)
    first = tick()
    samples = {place: read(device, first + place / RATE) for place in range(1000)}
    along = {place: sample.acceleration for place, sample in samples.items() if sample}
    phases = {place: acceleration[ACTUATOR_AXIS] for place, acceleration in along.items()}
    # An emulator that the machine stops for a tenth of a second leaves samples out.
    assert len(phases) > 700
    for place in phases.keys() & {place - 1 for place in phases}:
        assert apart(phases[place + 1], phases[place] + 1) < 0.1
    assert device.counters()["samples_missing"] == len(samples) - len(phases)


def test_a_force_acts_in_the_tick_at_which_it_is_due(board: Any, device: SerialDevice) -> None:
    board.measure = phase
    align(device)
    first, step, latency, number = tick(), 0.01, 20, 200  # N, samples
    phases = {}
    for place in range(number):
        sample = read(device, first + place / RATE)
        if sample:
            phases[place] = sample.acceleration[ACTUATOR_AXIS]
        due = place + latency
        device.write(first + due / RATE, actuator_force=along_actuator(step * due))
    wait_until(lambda: board.current == 0.0, "no current")
    # The current says at which tick it was due, its time at which one it acted.
    acted = [(round(2.4 * current / step), time) for time, current in board.driven if current]
    right = sum(apart(phase(time), phases.get(due, math.nan)) < 0.01 for due, time in acted)
    # Those that were due after the last read have no phase to compare with.
    compared = sum(due in phases for due, _ in acted)
    assert compared >= 10
    # The board tells its count in its next status.
    wait_until(lambda: compared - right <= device.late, "others are counted as late")
    assert device.late == device.counters()["set_points_late"]


def test_a_force_that_is_due_now_discards_what_was_scheduled(
    board: Any, device: SerialDevice
) -> None:
    align(device)
    for ahead in range(20):
        device.write(tick(0.05 + ahead / RATE), actuator_force=along_actuator(1.2))
    device.write(time.monotonic(), actuator_force=along_actuator(0.6))
    wait_until(lambda: device.counters()["board_timeouts"] >= 1, "the time-out")
    time.sleep(0.1)
    assert [current for _, current in board.driven] == pytest.approx([0.25, 0.0], abs=1e-3)
    assert device.late == 0


def test_a_board_of_another_rate_gives_its_newest_sample(board: Any, connect: Make) -> None:
    device = connect(board, kind=SerialSlave, rate=4000, samples_per_frame=4)
    assert device.read(time.monotonic() - 1.0) is None, "nothing was taken as early"
    wait_until(lambda: not math.isnan(feel(device)), "samples")
    held = device.counters()["samples_held"]
    begin = time.monotonic() - 1.0
    device.read(begin)
    assert device.counters()["samples_held"] == held + 1
    board.hold(1.0)
    wait_until(lambda: feel(device) > 0.5, "the step")


def test_a_force_becomes_a_current_within_full_scale(board: Any, device: SerialDevice) -> None:
    push(device, board, 1.2, 0.5)  # 2.4 N/A
    push(device, board, -2.4, -1.0)
    push(device, board, 1000.0, 2.75)
    push(device, board, -1000.0, -2.75)
    for no_force in (math.nan, math.inf, -math.inf):
        push(device, board, 1.2, 0.5)
        push(device, board, no_force, 0.0)
    assert device.counters()["set_points_limited"] >= 5


def test_swapped_wires_are_a_negative_constant(board: Any, connect: Make) -> None:
    push(connect(board, actuator__force_constant=-4.8), board, 2.4, -0.5)


def test_silence_takes_the_current_off(board: Any, device: SerialDevice) -> None:
    push(device, board, 1.2, 0.5)
    wait_until(lambda: board.current == 0.0, "no current")
    told = protocol.State.TIMED_OUT
    wait_until(lambda: device.counters()["board_state"] == told, "the board saying so")
    assert device.counters()["board_timeouts"] >= 1
    push(device, board, 1.2, 0.5)


def test_closing_leaves_no_current_and_no_samples(
    board: Any, device: SerialDevice, built: Make
) -> None:
    push(device, board, 1.2, 0.5)
    device.close()
    assert board.emulated.board.state is protocol.State.DISARMED
    assert board.current == 0.0
    assert board.emulated.rate == 0
    device.close()
    device.write(time.monotonic(), actuator_force=along_actuator(1.0))
    assert device.arm() is False
    built(SerialMaster, port=board.path).close()


def test_a_device_can_be_opened_again(board: Any, device: SerialDevice) -> None:
    push(device, board, 1.2, 0.5)
    device.close()
    device.open()
    wait_until(lambda: not math.isnan(feel(device)), "samples")
    push(device, board, 1.2, 0.5)


LEFT = [(signal.SIGKILL, protocol.State.DISARMED), (signal.SIGSTOP, protocol.State.TIMED_OUT)]


@pytest.mark.parametrize(("number", "left"), LEFT)
def test_a_killed_or_frozen_driver_leaves_no_current(
    board: Any, number: signal.Signals, left: protocol.State
) -> None:
    code = (
        "import sys, time\n"
        "from haptic_accel.devices.serial.device import SerialMaster\n"
        "device = SerialMaster(SerialMaster.Parameters(port=sys.argv[1]), 1000.0, 0)\n"
        "device.open()\n"
        "while True:\n"
        "    device.write(time.monotonic(), actuator_force=(0.0, 0.0, 2.4)); time.sleep(0.001)\n"
    )
    driver = subprocess.Popen([sys.executable, "-c", code, board.path])
    wait_until(lambda: board.current == pytest.approx(1.0, abs=1e-4), "a current")
    os.kill(driver.pid, number)
    wait_until(lambda: board.current == 0.0, "no current")
    wait_until(lambda: board.emulated.board.state is left, left.name)
    driver.kill()
    driver.wait()


# What goes wrong on the way


class HostileBoard:
    """A board that connects as it should, and then says anything.

    Parameters
    ----------
    link : Path
        Symbolic link to make to its port.
    lets_go : bool
        True if it says that it lets go once it is armed and gets no set-point.
    """

    def __init__(self, link: Path, *, lets_go: bool = True) -> None:
        self._lets_go = lets_go
        self._port = PseudoTerminal(link)
        self._writing = threading.Lock()
        self._marks = itertools.count(1)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._answer)
        self._thread.start()

    def say_last(self, wire: bytes, state: protocol.State, device: SerialDevice) -> None:
        """Send any bytes and then a state, and wait until that has arrived."""
        mark = next(self._marks)
        self._write(wire + protocol.DELIMITER)

        def arrived() -> bool:
            self._write(protocol.Encoder().encode(status_of(state, mark), 0))
            self._ending.wait(2e-4)
            return device.counters().get("board_damaged") == mark

        assert any(arrived() for _ in range(20_000)), device.problem

    def end(self) -> None:
        """Unplug it for good."""
        self._ending.set()
        self._thread.join()
        self._port.unplug()

    def _answer(self) -> None:
        decoder, encoder = protocol.Decoder(), protocol.Encoder()
        answer: protocol.Message
        while not self._ending.wait(1e-3):
            self._write(encoder.encode(protocol.Error(protocol.ErrorCode.VALUE, 0, 0), 0))
            for frame in decoder.feed(self._port.read() or b""):
                match protocol.read_message(frame):
                    case protocol.Identify():
                        answer = HANDLE
                    case protocol.Configure() as wanted:
                        answer = protocol.Configuration(*vars(wanted).values())
                    case protocol.ArmRequest():
                        answer = status_of(protocol.State.ARMED, 0)
                        if self._lets_go:
                            self._write(encoder.encode(answer, 0))
                            answer = status_of(protocol.State.TIMED_OUT, 0)
                    case _:
                        continue
                self._write(encoder.encode(answer, 0))

    def _write(self, data: bytes) -> None:
        with self._writing:
            self._port.write(data)


@pytest.fixture
def hostile(tmp_path: Path, built: Make) -> Iterator[tuple[HostileBoard, SerialDevice]]:
    """Give a hostile board, and a driver that is connected to it."""
    board = HostileBoard(tmp_path / "port")
    device = built(SerialMaster, port=str(tmp_path / "port"))
    device.open()
    yield board, device
    device.close()
    board.end()


def test_a_board_that_would_hold_a_current_for_ever_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, built: Make
) -> None:
    monkeypatch.setattr("haptic_accel.devices.serial.link.ANSWER", 0.5)
    board = HostileBoard(tmp_path / "port", lets_go=False)
    device = built(SerialMaster, port=str(tmp_path / "port"))
    with pytest.raises(DeviceError, match="stays armed without set-points: flash firmware"):
        device.open()
    device.close()
    board.end()


def status_of(state: protocol.State, mark: int) -> protocol.Status:
    """Return a status that its count of damaged frames tells from others."""
    return protocol.Status(state, (0,), 0, mark, 0, 0, 0, 0, 0, 0)


byte = st.integers(0, 255)
count = st.integers(0, 2**32 - 1)
counts16 = st.integers(-protocol.FULL_SCALE - 1, protocol.FULL_SCALE)
said = st.one_of(
    st.builds(protocol.Samples, count, st.just(0b100), st.tuples(counts16, counts16)),
    st.builds(protocol.Samples, byte, st.sampled_from([0b100, 0b10]), st.tuples(counts16)),
    st.builds(protocol.Status, st.sampled_from(protocol.State), st.tuples(counts16), *[count] * 8),
    st.builds(protocol.Error, st.sampled_from(protocol.ErrorCode), byte, byte),
    st.builds(protocol.Configuration, st.integers(0, 2**16 - 1), byte, byte),
    st.just(replace(HANDLE, full_scale_currents=(0.0, 0.0, 1e-40), serial_number="other")),
    st.sampled_from([protocol.ArmRequest(), protocol.SetCurrent((7,))]),
)
said_frames = st.builds(
    lambda message, version, sequence, clock: protocol.encode(
        protocol.Frame(version, message.TYPE, sequence, clock, message.pack())
    ),
    said,
    st.sampled_from([protocol.VERSION, protocol.VERSION, protocol.ONE_COIL, 1]),
    st.integers(0, 2**16 - 1),
    count,
)
said_wire = mutated(st.lists(said_frames, max_size=6).map(b"".join), st.binary(max_size=300))


@fuzz
@given(said_wire, st.sampled_from(protocol.State), st.floats())
def test_whatever_a_board_sends_is_borne(
    hostile: tuple[HostileBoard, SerialDevice], wire: bytes, state: protocol.State, force: float
) -> None:
    board, device = hostile
    board.say_last(wire, state, device)
    refused = device.counters()["set_points_refused"]
    device.write(time.monotonic() + 0.01, actuator_force=along_actuator(force))
    assert state in ARMED or device.counters()["set_points_refused"] == refused + 1
    sample = device.read(tick())
    assert not isinstance(sample, Sample) or math.isfinite(sample.acceleration[ACTUATOR_AXIS])
    assert device.problem.isprintable()


def test_damage_is_counted_and_borne(board: Any, device: SerialDevice) -> None:
    board.hold(10.0)

    def damaged() -> bool:
        for fault in (GARBAGE, DROP):
            board.inject(fault, 0.1)
        device.write(time.monotonic(), actuator_force=along_actuator(1.2))
        status = device.counters()
        assert status["connected"], device.problem
        return min(status["frames_damaged"], status["board_damaged"]) >= 3

    wait_until(damaged, "damage on both ways")
    assert device.counters()["frames_lost"] > 0
    wait_until(lambda: feel(device) == pytest.approx(10.0, abs=2e-3), "right samples")
    push(device, board, 1.2, 0.5)


def test_a_board_that_was_gone_has_no_current_until_it_is_armed(
    board: Any, device: SerialDevice
) -> None:
    push(device, board, 1.2, 0.5)
    board.inject(UNPLUG, 0.5)
    wait_until(lambda: not device.counters()["connected"], "being gone")
    device.write(time.monotonic(), actuator_force=along_actuator(1.2))
    assert device.arm() is False
    assert "unplugged" in device.problem or "no such port" in device.problem
    wait_until(lambda: device.read(tick()) is None, "no sample")
    wait_until(lambda: device.counters()["connected"] == 1, "being back")
    wait_until(lambda: "not armed since the board was gone" in device.problem, "the reason")
    assert device.counters()["reconnects"] == 1
    for _ in range(50):
        device.write(time.monotonic(), actuator_force=along_actuator(1.2))
        time.sleep(0.002)
        assert board.current == 0.0
    board.hold(10.0)
    wait_until(lambda: feel(device) == pytest.approx(10.0, abs=2e-3), "samples again")
    assert device.arm() is None
    push(device, board, 1.2, 0.5)
    assert device.problem == ""


def test_a_driver_that_may_arms_again_by_itself(board: Any, connect: Make) -> None:
    device = connect(board, rearm="auto")
    push(device, board, 1.2, 0.5)
    board.inject(UNPLUG, 0.1)
    wait_until(lambda: device.counters()["reconnects"] == 1, "being back")
    push(device, board, 1.2, 0.5)


def test_a_board_that_says_nothing_is_gone(board: Any, device: SerialDevice) -> None:
    push(device, board, 1.2, 0.5)
    board.inject(STALL, 1.6)
    wait_until(lambda: "silent" in device.problem, "the silence")
    assert board.current == 0.0
    wait_until(lambda: device.counters()["connected"] == 1, "being back")
    assert device.counters()["armed"] == 0


def test_a_short_stall_costs_samples_and_no_more(board: Any, device: SerialDevice) -> None:
    push(device, board, 1.2, 0.5)
    board.inject(STALL, 0.05)
    wait_until(lambda: device.counters()["board_timeouts"] >= 1, "the time-out")
    push(device, board, 1.2, 0.5)
    assert device.counters()["reconnects"] == 0


def test_another_board_in_its_place_is_refused(
    bench: Make, board: Any, device: SerialDevice
) -> None:
    board.end()
    bench(replace(HANDLE, serial_number="other"))
    wait_until(lambda: "board other must be handle-1" in device.problem, "the refusal")
    assert not device.counters()["connected"]


# What is told when it cannot be opened


@pytest.mark.parametrize(
    ("kind", "identity", "values", "told"),
    [
        (SerialMaster, TOOL, {}, "board tool-1 has no actuator"),
        (SerialSlave, TOOL, {"calibration__axis": "x"}, "does not have the requested axis"),
        (SerialSlave, TOOL, {"rate": 6000}, "takes 5000 samples per second at most, not 6000"),
        (SerialSlave, TOOL, {"calibration__board": "mine"}, "must be mine, to which the"),
    ],
)
def test_a_board_that_does_not_fit_is_refused(
    bench: Make,
    connect: Make,
    kind: type[SerialDevice],
    identity: protocol.Identity,
    values: Any,
    told: str,
) -> None:
    board = bench(identity)
    with pytest.raises(DeviceError, match=told) as raised:
        connect(board, kind, **values)
    assert str(raised.value).startswith(board.path)
    # The port is free again for one that fits.
    connect(board, SerialSlave)


@pytest.mark.usefixtures("older")
def test_a_board_with_protocol_2_goes_on_as_before(board: Any, device: SerialDevice) -> None:
    board.hold(10.0)
    wait_until(lambda: feel(device) == pytest.approx(10.0, abs=2e-3), "samples")
    push(device, board, 1.2, 0.5)
    board.inject(UNPLUG, 0.2)
    wait_until(lambda: device.counters()["reconnects"] == 1, "being back")
    assert device.counters()["frames_wrong"] == 0


@pytest.mark.usefixtures("device")
def test_a_port_that_is_open_is_busy(board: Any, connect: Make) -> None:
    with pytest.raises(DeviceError, match=f"{board.path}: busy: another program has it open"):
        connect(board)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_a_missing_permission_is_told(board: Any) -> None:
    terminal = os.path.realpath(board.path)
    os.chmod(terminal, 0o600)
    code = (
        "import os, sys\n"
        "from haptic_accel.devices.interface import DeviceError\n"
        "from haptic_accel.devices.serial.link import Port\n"
        "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "try: Port(sys.argv[1])\n"
        "except DeviceError as error: print(error)\n"
    )
    said = subprocess.check_output([sys.executable, "-c", code, terminal], text=True)
    assert said.startswith(f"{terminal}: no permission: join the group dialout")
