# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The device's side of the protocol: what it obeys, when it samples, and which current flows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.devices.serial.protocol import (
    CLOCKS,
    FULL_SCALE,
    VERSION,
    Align,
    ArmRequest,
    Configuration,
    Configure,
    Decoder,
    DisarmRequest,
    Encoder,
    Error,
    ErrorCode,
    Frame,
    FrameType,
    Identify,
    Identity,
    Message,
    Samples,
    ScheduleCurrent,
    SetCurrent,
    State,
    Status,
    encode,
    read_message,
)
from haptic_accel.kits.emulators import serial_line

HANDLE = Identity((1, 0, 0), 0b111, 10_000, 49.0, (0.0, 0.0, 2.75), "handle")
THREE = replace(HANDLE, full_scale_currents=(2.75, 1.0, 0.5))
TOOL = Identity((1, 0, 0), 0b100, 4000, 49.0, (0.0, 0.0, 0.0), "tool")
M = TypeVar("M")


class Host:
    """Talks to a board, without a port."""

    def __init__(self, identity: Identity = HANDLE) -> None:
        self.now = CLOCKS - 10_000  # begins again soon
        self.heard: list[Message] = []
        self.clocks: list[int] = []
        self.room = True
        self._encoder, self._decoder = Encoder(), Decoder()
        self.board = serial_line.Board(identity, self._take)

    def _take(self, data: bytes) -> bool:
        if self.room:
            for frame in self._decoder.feed(data):
                self.heard.append(read_message(frame))
                self.clocks.append(frame.clock)
        return self.room

    def say(self, *messages: Message) -> None:
        for message in messages:
            self.board.receive(self._encoder.encode(message, 0), self.now)

    def wait(self, microseconds: int) -> None:
        for _ in range(microseconds // 1000):
            self.now = (self.now + 1000) % CLOCKS
            self.board.tick(self.now)

    def sample(self, number: int) -> None:
        for index in range(number):
            self.now = (self.now + 250) % CLOCKS
            self.board.send_sample((index, -index, 100 + index), self.now)

    def tick_at(self, time: int) -> int:
        """Take a sample at a time; return the current from then on."""
        self.now = time % CLOCKS
        self.board.send_sample((0, 0, 0), self.now)
        return self.current

    @property
    def current(self) -> int:
        """Current of the only coil, counts."""
        (current,) = self.board.currents
        return current

    def status(self) -> Status:
        """Return a new status."""
        self.wait(serial_line.STATUS_PERIOD)
        return self.all(Status)[-1]

    def all(self, kind: type[M]) -> list[M]:
        return [message for message in self.heard if isinstance(message, kind)]


def armed() -> Host:
    host = Host()
    host.say(ArmRequest(), SetCurrent((1000,)))
    assert host.current == 1000
    return host


def test_it_says_nothing_before_it_is_spoken_to() -> None:
    host = Host()
    host.board.receive(b"AT\r\n\0", host.now)
    host.wait(5 * serial_line.STATUS_PERIOD)
    assert host.heard == []
    host.say(Identify())
    assert host.heard == [HANDLE]
    host.wait(2 * serial_line.STATUS_PERIOD)
    assert len(host.all(Status)) == 2


def test_set_points_are_refused_until_it_is_armed() -> None:
    host = Host()
    host.say(SetCurrent((1000,)))
    assert host.current == 0
    host.say(ArmRequest(), SetCurrent((1000,)), DisarmRequest(), SetCurrent((500,)))
    assert host.current == 0
    assert host.all(Status)[-1].refused == 1


def test_the_current_is_zero_after_5_ms_of_silence_and_comes_back() -> None:
    host = armed()
    host.wait(serial_line.TIMEOUT)
    assert host.current == 1000
    host.wait(1000)
    assert (host.current, host.board.state) == (0, State.TIMED_OUT)
    assert host.all(Status)[-1].timeouts == 1
    host.say(SetCurrent((-7,)))
    assert (host.current, host.board.state) == (-7, State.ARMED)


# Set-points with a due time


def scheduling(rate: int = 1000, start: int = CLOCKS - 10_000) -> Host:
    """Return a host whose board is armed and had its first tick at the start."""
    host = Host()
    host.say(Configure(rate, 4, 1), ArmRequest())
    host.tick_at(start)
    return host


def test_a_set_point_without_a_due_time_acts_at_once_and_discards_the_scheduled() -> None:
    host = scheduling()
    host.say(ScheduleCurrent((7,), (host.now + 1000) % CLOCKS), SetCurrent((0,)))
    assert host.tick_at(host.now + 1000) == 0
    assert host.status().late == 0


DISCARDING = [DisarmRequest(), Configure(1000, 4, 1), Configure(0, 0, 0)]


@pytest.mark.parametrize("discarding", DISCARDING, ids=repr)
def test_nothing_scheduled_outlives_what_ends_it(discarding: Message) -> None:
    host = scheduling()
    host.say(ScheduleCurrent((7,), (host.now + 1000) % CLOCKS), discarding, ArmRequest())
    assert host.tick_at(host.now + 1000) == 0


def test_before_the_first_tick_a_scheduled_set_point_acts_at_once() -> None:
    host = Host()
    host.say(ArmRequest(), ScheduleCurrent((7,), (host.now + 50_000) % CLOCKS))
    assert host.current == 7
    assert host.status().late == 0


def test_what_is_due_too_far_ahead_or_has_no_room_is_refused_and_counted() -> None:
    host = scheduling()
    host.say(ScheduleCurrent((1,), (host.now + serial_line.LONGEST_LEAD + 1) % CLOCKS))
    for place in range(serial_line.ROOM + 3):
        host.say(ScheduleCurrent((place,), (host.now + 1000 * (place + 1)) % CLOCKS))
    host.say(SetCurrent((0,)))
    status = host.status()
    assert (status.refused, status.overflowed) == (1, 3)


def test_a_latency_of_20_samples_trips_no_time_out_and_silence_does() -> None:
    host = scheduling()
    start = host.now
    flowing = []
    for tick in range(1, 100):
        host.wait(1000)
        flowing.append(host.tick_at(start + 1000 * tick))
        host.say(ScheduleCurrent((tick,), (start + 1000 * (tick + 20)) % CLOCKS))
    assert flowing[:20] == [0] * 20
    assert flowing[20:] == list(range(1, 80))
    # Counted from the last that came: what was scheduled before the silence is not applied.
    host.wait(serial_line.TIMEOUT + 1000)
    assert (host.current, host.board.state) == (0, State.TIMED_OUT)
    assert host.tick_at(start + 106_000) == 0


some_leads = st.lists(st.integers(-4000, 20_000), min_size=1, max_size=serial_line.ROOM)


@settings(max_examples=40)
@given(st.integers(0, CLOCKS - 1), some_leads)
def test_at_each_tick_the_newest_that_is_due_acts(start: int, leads: Sequence[int]) -> None:
    host = scheduling(start=start)
    for counts, ahead in enumerate(leads, start=1):
        host.say(ScheduleCurrent((counts,), (start + ahead) % CLOCKS))
    late = [counts for counts, ahead in enumerate(leads, start=1) if ahead <= 500]
    current = late[-1] if late else 0
    assert host.current == current
    for tick in range(1, 22):
        numbered = [(ahead, counts) for counts, ahead in enumerate(leads, start=1)]
        due = [each for each in numbered if 500 < each[0] <= 1000 * tick + 500]
        current = max(due)[1] if due else current
        assert host.tick_at(start + 1000 * tick) == current
    assert host.status().late == len(late)


def test_a_set_point_drives_all_coils_at_once_and_a_stop_ends_all() -> None:
    host = Host(THREE)
    host.say(Configure(1000, 7, 1), ArmRequest(), SetCurrent((1, -FULL_SCALE - 1, 3)))
    assert host.board.currents == (1, -FULL_SCALE, 3)
    host.board.send_sample((0, 0, 0), host.now)
    host.say(ScheduleCurrent((4, 5, 6), (host.now + 1000) % CLOCKS))
    assert host.board.currents == (1, -FULL_SCALE, 3)
    host.now = (host.now + 1000) % CLOCKS
    host.board.send_sample((7, 8, 9), host.now)
    assert host.board.currents == (4, 5, 6)
    assert host.status().currents == (0, 0, 0), "the time-out"
    assert host.all(Samples)[-1].counts == (7, 8, 9)
    host.say(SetCurrent((1, 2, 3)), DisarmRequest())
    assert host.board.currents == (0, 0, 0)


def test_set_points_of_another_number_of_coils_are_refused() -> None:
    host = Host(THREE)
    host.say(ArmRequest(), SetCurrent((1,)), ScheduleCurrent((1, 2), host.now))
    assert [error.code for error in host.all(Error)] == [ErrorCode.LENGTH] * 2
    assert host.board.currents == (0, 0, 0)


# Ticks on the grid of the host


@settings(max_examples=40, deadline=None)
@given(
    rate=st.sampled_from([50, 333, 1000, 4000, 10_000]),
    drift=st.floats(-1e-3, 1e-3),
    phase=st.floats(0, 1),
    start=st.integers(0, CLOCKS - 1),
    lag=st.booleans(),
)
def test_ticks_move_onto_the_grid(
    rate: int, drift: float, phase: float, start: int, lag: bool
) -> None:
    """Also with a timer that takes a new interval over one tick later, as the Teensy's."""
    host = Host()
    host.say(Configure(rate, 4, 1))
    period = 1e6 / rate * (1 + drift)  # us, of the board's clock
    host.say(Align(round(start + phase * period) % CLOCKS, round(1000 * period)))
    time, intervals, distances = float(start), [host.board.period], []
    for _ in range(120):
        host.tick_at(round(time))
        distances.append((time - start - phase * period + period / 2) % period - period / 2)
        intervals.append(host.board.period)
        time += intervals[-2 if lag else -1] / 1000
    assert all(abs(each - 1e3 * period) <= 1e3 * period / 32 + 1 for each in intervals[2:])
    # A board rounds to us, and a grid's period to ns; a half of a tick's period takes 16 steps.
    assert max(map(abs, distances[40:])) < 4


def test_a_grid_of_another_rate_is_refused() -> None:
    host = Host()
    host.say(Align(0, 1_000_000), Configure(1000, 4, 1))
    host.say(Align(0, 1_015_626), Align(0, 984_374), Align(0, 1_015_625))
    assert [error.code for error in host.all(Error)] == [ErrorCode.VALUE] * 3
    assert host.board.period == 1_000_000


@given(st.integers(0, CLOCKS - 1), st.integers(-(2**31), 2**31 - 1))
def test_differences_of_times_hold_where_the_clock_begins_anew(time: int, ahead: int) -> None:
    assert serial_line.difference((time + ahead) % CLOCKS, time) == ahead


# Safety


def test_a_fault_takes_the_current_off_until_it_is_disarmed_and_armed() -> None:
    host = armed()
    host.board.fault(True, host.now)
    host.say(SetCurrent((5,)), ArmRequest(), DisarmRequest())
    assert (host.current, host.board.state) == (0, State.FAULT)
    assert [error.code for error in host.all(Error)] == [ErrorCode.FAULT, ErrorCode.FAULT]
    host.board.fault(False, host.now)
    host.say(SetCurrent((5,)), ArmRequest())
    assert host.board.state is State.FAULT
    host.say(DisarmRequest(), ArmRequest(), SetCurrent((5,)))
    assert host.current == 5


def test_a_host_that_goes_leaves_no_current_and_no_samples() -> None:
    host = armed()
    host.say(Configure(1000, 4, 1))
    host.board.disconnect()
    assert (host.current, host.board.state) == (0, State.DISARMED)
    heard = len(host.heard)
    host.sample(10)
    host.wait(serial_line.STATUS_PERIOD)
    assert len(host.heard) == heard


def test_samples_carry_their_count_their_axes_and_the_time_of_the_first() -> None:
    host = Host()
    host.say(Configure(4000, 0b101, 3))
    assert host.all(Configuration)[-1] == Configuration(4000, 0b101, 3)
    begin = host.now
    host.sample(7)
    first, second = host.all(Samples)
    assert first == Samples(0, 0b101, (0, 100, 1, 101, 2, 102))
    assert (second.index, second.counts[0]) == (3, 3)
    assert [(clock - begin) % CLOCKS for clock in host.clocks[-2:]] == [250, 1000]


def test_samples_begin_anew_when_configured_and_end_with_a_rate_of_zero() -> None:
    host = Host()
    host.say(Configure(1000, 4, 2))
    host.sample(3)
    host.say(Configure(1000, 4, 2))
    host.sample(2)
    assert [samples.index for samples in host.all(Samples)] == [0, 0]
    host.say(Configure(0, 7, 9))
    host.sample(5)
    assert len(host.all(Samples)) == 2
    assert host.all(Configuration)[-1] == Configuration(0, 0, 0)


def test_what_the_port_has_no_room_for_is_counted_and_missing_by_its_numbers() -> None:
    host = Host()
    host.say(Configure(1000, 4, 1))
    host.room = False
    host.sample(5)
    host.room = True
    host.sample(1)
    assert host.all(Samples)[-1].index == 5
    host.wait(serial_line.STATUS_PERIOD)
    assert host.all(Status)[-1].unsent == 5


NOT_OF_THE_TOOL = [
    *(Configure(4001, 4, 1), Configure(49, 4, 1), Configure(1000, 0, 1), Configure(1000, 5, 1)),
    *(Configure(1000, 4, 0), Configure(1000, 4, 118)),
]


@pytest.mark.parametrize(
    ("identity", "frame", "code"),
    [
        (HANDLE, Frame(VERSION + 1, FrameType.ARM, 9, 0, b""), ErrorCode.VERSION),
        (HANDLE, Frame(VERSION, 0x7F, 9, 0, b""), ErrorCode.TYPE),
        (HANDLE, Frame(VERSION, FrameType.STATUS, 9, 0, b""), ErrorCode.TYPE),
        (HANDLE, Frame(VERSION, FrameType.ARM, 9, 0, b"x"), ErrorCode.LENGTH),
        (HANDLE, Frame(VERSION, FrameType.SET_CURRENT, 9, 0, b"x"), ErrorCode.LENGTH),
        (TOOL, Frame(VERSION, FrameType.ARM, 9, 0, b""), ErrorCode.NO_ACTUATOR),
        (TOOL, Frame(VERSION, FrameType.SET_CURRENT, 9, 0, b"\1\0"), ErrorCode.NO_ACTUATOR),
        (TOOL, Frame(VERSION, FrameType.SCHEDULE_CURRENT, 9, 0, bytes(6)), ErrorCode.NO_ACTUATOR),
        *[
            (TOOL, Frame(VERSION, FrameType.CONFIGURE, 9, 0, asked.pack()), ErrorCode.VALUE)
            for asked in NOT_OF_THE_TOOL
        ],
    ],
)
def test_what_cannot_be_is_refused_with_its_reason(
    identity: Identity, frame: Frame, code: ErrorCode
) -> None:
    host = Host(identity)
    host.board.receive(encode(frame), host.now)
    assert host.heard == [Error(code, frame.type, 9)]
    assert (host.board.state, host.board.configuration.rate) == (State.DISARMED, 0)


counts_sent = st.lists(st.integers(-32768, 32767), min_size=1, max_size=3).map(tuple)
bytes_sent = st.one_of(
    st.binary(max_size=300),
    st.builds(
        lambda kind, payload: encode(Frame(VERSION, kind, 0, 0, payload)),
        st.sampled_from(FrameType),
        st.binary(max_size=6),
    ),
    st.builds(lambda counts: Encoder().encode(SetCurrent(counts), 0), counts_sent),
    st.builds(
        lambda counts, due: Encoder().encode(ScheduleCurrent(counts, due % CLOCKS), 0),
        counts_sent,
        st.integers(-20_000, 60_000),
    ),
    st.just(Encoder().encode(Configure(1000, 4, 1), 0)),
    st.just(Encoder().encode(ArmRequest(), 0)),
)


steps_of_bytes = st.lists(st.tuples(bytes_sent, st.integers(0, 8)), max_size=30)


@settings(max_examples=80)
@given(st.sampled_from([HANDLE, THREE, TOOL]), steps_of_bytes)
def test_whatever_comes_the_currents_are_lawful(
    identity: Identity, steps: Sequence[tuple[bytes, int]]
) -> None:
    host = Host(identity)
    for data, milliseconds in steps:
        host.board.receive(data, host.now)
        host.wait(milliseconds * 1000)
        host.board.send_sample((0, 0, 0), host.now)
        currents = host.board.currents
        assert len(currents) == len(identity.coils)
        assert all(abs(current) <= FULL_SCALE for current in currents)
        if any(currents):
            assert host.board.state is State.ARMED
            assert milliseconds * 1000 <= serial_line.TIMEOUT
