# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ALL_AXES, along_actuator
from haptic_accel.core.model import ZERO
from haptic_accel.core.network import Channel, ChannelParameters
from haptic_accel.kits.link.endpoint import (
    DUPLICATE_WINDOW,
    LARGEST_JUMP,
    LIFETIME,
    MOST_SAMPLES,
    PACKET_PERIOD,
    PROBLEM_TIME,
    REFUSED,
    RENEW_AFTER,
    UNHEARD,
    Admission,
    ClockOffset,
    Endpoint,
    Motion,
    Packet,
    Session,
    State,
    unpack,
)
from nightly import rest_slow

SECOND = 1_000_000_000


def run(
    clock: ClockOffset,
    seconds: int,
    offset: float = 0.0,
    drift: float = 0.0,
    away: float = 0.02,
    back: float = 0.02,
    jitter: float = 0.0,
    start: int = 0,
) -> int:
    """Exchange 50 packets a second between two clocks; return the own time at the end, ns."""
    chance = random.Random(2)
    now = start
    for step in range(50 * seconds):
        now = start + step * SECOND // 50
        there = round(now + SECOND * (away + jitter * chance.random()))
        peer = there + round(SECOND * offset + drift * there)
        arrived = round(there + SECOND * (1e-3 + back + jitter * chance.random()))
        clock.add(now, peer, peer + SECOND // 1000, arrived)
    return now


def test_nothing_is_known_before_an_exchange() -> None:
    clock = ClockOffset()
    assert (clock.offset(5), clock.bound) == (0.0, math.inf)


@pytest.mark.parametrize("offset", [-3.0, 0.0, 1234.5])
def test_equal_ways_give_the_offset_and_half_a_round_trip_is_its_bound(offset: float) -> None:
    clock = ClockOffset()
    now = run(clock, 5, offset)
    assert clock.offset(now) == pytest.approx(offset, abs=1e-8)
    assert clock.bound == pytest.approx(0.02, abs=1e-8)


def test_unequal_ways_err_by_half_their_difference_and_within_the_bound() -> None:
    clock = ClockOffset()
    now = run(clock, 30, away=0.03, back=0.01)
    assert clock.offset(now) == pytest.approx(0.01, abs=1e-6)
    assert abs(clock.offset(now)) <= clock.bound


@pytest.mark.parametrize("held_up", [0.03, 0.3])
def test_what_holds_up_one_way_for_seconds_stays_within_the_bound(held_up: float) -> None:
    clock = ClockOffset()
    now = 0
    for second in range(20):
        now = run(clock, 1, back=0.02 + held_up * (second > 14), start=second * SECOND)
    assert abs(clock.offset(now)) <= clock.bound
    assert clock.bound < 0.06


def test_jitter_is_left_out() -> None:
    clock = ClockOffset()
    now = run(clock, 60, offset=0.5, jitter=0.02)
    assert clock.offset(now) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_drift_is_followed(drift: float) -> None:
    clock = ClockOffset()
    now = run(clock, 100, drift=drift)
    assert clock.drift == pytest.approx(drift, rel=0.02)
    ahead = now + 10 * SECOND
    assert clock.offset(ahead) == pytest.approx(drift * ahead / SECOND, abs=1e-4)


def test_a_clock_that_is_set_is_measured_anew() -> None:
    clock = ClockOffset()
    now = run(clock, 60, offset=0.0)
    now = run(clock, 4, offset=1.0, start=now)
    assert clock.offset(now) == pytest.approx(1.0, abs=1e-6)


def test_an_exchange_during_which_a_clock_was_set_back_counts_for_nothing() -> None:
    clock = ClockOffset()
    clock.add(SECOND, SECOND, SECOND, SECOND // 2)
    clock.add(SECOND, SECOND, SECOND // 2, 2 * SECOND)
    assert clock.bound == math.inf


RATE = 1000.0
TICK = 1_000_000


class Hosts:
    """Two hosts whose clocks differ, joined by two channels."""

    def __init__(
        self, channel: ChannelParameters, clock_offset: float = 0.0, seed: int = 1
    ) -> None:
        self.ends = {"master": Endpoint("master", RATE, 11), "slave": Endpoint("slave", RATE, 22)}
        self.ahead = {"master": 0, "slave": round(clock_offset * 1e9)}
        self.channels = {
            side: Channel[bytes](channel, seed + i) for i, side in enumerate(self.ends)
        }
        self.state = State()
        self.tick = 1000

    @property
    def now(self) -> float:
        return self.tick / RATE

    def system(self, side: str) -> int:
        return self.tick * TICK + self.ahead[side]

    def run(self, seconds: float) -> Iterator[Packet]:
        """Let time pass; yield what the master admits."""
        for _ in range(round(seconds * RATE)):
            self.tick += 1
            for side, end in self.ends.items():
                system = self.system(side)
                if side == "slave":
                    end.sampled(system, along_actuator(float(self.tick)))
                x = self.tick / 1e6
                motion = Motion(system, (x, 0.0, -x), (1.0, 0.0, 0.0))
                if data := end.outgoing(self.state, motion, x, self.now, system):
                    self.channels[side].send(data, self.now)
            for side, end in self.ends.items():
                (other,) = set(self.ends) - {side}
                for data in self.channels[other].arrived(self.now):
                    packet = end.incoming(data, self.now, self.system(side))
                    if packet and side == "master":
                        yield packet


def test_a_packet_leaves_every_period_and_at_once_when_the_state_changes() -> None:
    end = Endpoint("slave", RATE, 1)
    state, sent = State(), []
    for tick in range(1000):
        if tick == 501:
            state = State(stopped=True, stops=1)
        if end.outgoing(state, Motion(), 0.0, tick / RATE, tick * TICK):
            sent.append(tick)
    assert len(sent) == pytest.approx(1.0 / PACKET_PERIOD, abs=2)
    assert {500, 501} <= set(sent)


def test_at_a_low_rate_a_packet_leaves_for_each_sample_however_often_it_is_asked() -> None:
    end = Endpoint("slave", 250.0, 1)
    asked = range(1000)
    sent = [tick for tick in asked if end.outgoing(State(), Motion(), 0.0, tick / RATE, tick)]
    assert len(sent) == pytest.approx(250, abs=2)


@pytest.mark.parametrize("clock_offset", rest_slow([-3.0, 0.0, 0.25]))
def test_ages_are_those_of_the_channel_whatever_the_clocks_say(clock_offset: float) -> None:
    hosts = Hosts(ChannelParameters(delay=0.02), clock_offset)
    *_, last = hosts.run(15.0)
    master = hosts.ends["master"]
    assert master.fresh(hosts.now, 0.01)
    # There, waiting for the next packet, back, and waiting for the next one here.
    age = master.round_trip_age(hosts.now)
    assert 0.04 - 1e-9 <= age <= 0.04 + 2 * PACKET_PERIOD + 2 / RATE
    assert master.delay == pytest.approx(0.02, abs=1e-3)
    assert 0.02 - 1e-3 <= master.age(hosts.system("master")) <= 0.02 + PACKET_PERIOD + 1e-3
    offset = master.clock.offset(hosts.system("master"))
    assert offset == pytest.approx(clock_offset, abs=1e-3)
    assert last.position == (last.shipped, 0.0, -last.shipped)
    warned = " ".join(master.problems(hosts.system("master"), hosts.now).values())
    assert ("chrony" in warned) == (clock_offset != 0.0)


def test_the_age_of_what_is_known_grows_through_a_blackout() -> None:
    hosts = Hosts(ChannelParameters(delay=0.01))
    list(hosts.run(1.0))
    channel = hosts.channels["slave"]
    before = hosts.ends["master"].round_trip_age(hosts.now)
    channel.parameters = replace(channel.parameters, loss=1.0)
    list(hosts.run(0.5))
    master = hosts.ends["master"]
    assert not master.fresh(hosts.now, 0.1)
    assert master.round_trip_age(hosts.now) == pytest.approx(before + 0.49, abs=5e-3)


def test_every_sample_arrives_although_packets_are_lost() -> None:
    hosts = Hosts(ChannelParameters(delay=0.01, jitter=0.005, loss=0.1))
    found: dict[int, float] = {}
    for packet in hosts.run(5.0):
        assert len(packet.samples) <= MOST_SAMPLES
        for number, value in enumerate(packet.samples, packet.first):
            assert found.setdefault(number, value) == value
    # Sample n was measured at tick n, and has the tick as its value.
    assert all(number == value for number, value in found.items())
    missing = set(range(min(found), max(found))) - set(found)
    assert len(missing) <= 2
    assert hosts.ends["master"].session.loss == pytest.approx(0.1, abs=0.03)


def test_samples_of_packets_that_were_overtaken_are_played() -> None:
    hosts = Hosts(ChannelParameters(delay=0.05, jitter=0.05))
    playout = hosts.ends["master"].playout
    for _ in range(3000):
        list(hosts.run(1 / RATE))
        playout.play(hosts.now)
    assert hosts.ends["master"].session.out_of_order > 1000
    assert playout.counts["concealed"] < 0.03 * 3000


def test_a_sample_that_is_missing_or_no_number_begins_a_new_run() -> None:
    end = Endpoint("slave", RATE, 1)
    for tick, value in enumerate([1.0, 2.0, 3.0, math.nan, 5.0, 6.0]):
        end.sampled(tick * TICK, along_actuator(value))
    packet = unpack(sent(end))
    assert (packet.first, packet.samples) == (4, (5.0, 6.0))


def sent(end: Endpoint, shipped: float = 0.0, now: float = 0.0) -> bytes:
    data = end.outgoing(State(), Motion(), shipped, now, 0)
    assert data
    return data


def test_another_rate_is_refused() -> None:
    fast, slow = Endpoint("master", 1000.0, 1), Endpoint("slave", 500.0, 2)
    assert slow.incoming(sent(fast), 0.0, 0) is None
    assert [*slow.problems(0, 0.0)] == ["the peer has rate:=1000: must be 500 Hz as here"]
    assert slow.peer is None


def test_a_peer_that_starts_again_is_known_afresh() -> None:
    hosts = Hosts(ChannelParameters(delay=0.01), clock_offset=2.0)
    list(hosts.run(2.0))
    hosts.ends["slave"] = Endpoint("slave", RATE, 33)
    list(hosts.run(2.0))
    master = hosts.ends["master"]
    assert master.peer
    assert (master.peer.session, master.session.restarts) == (33, 1)
    assert master.shipped == master.peer.shipped > 0
    assert master.round_trip_age(hosts.now) < 0.05


def test_energy_for_the_run_before_is_not_received() -> None:
    sender, receiver = Endpoint("slave", RATE, 1), Endpoint("master", RATE, 2)
    receiver.incoming(sent(sender, 0.5), 0.0, 0)
    assert receiver.shipped == 0.0
    sender.incoming(sent(receiver), 0.0, 0)
    receiver.incoming(sent(sender, 0.1, 1.0), 1.0, 0)
    assert receiver.shipped == 0.1


shares = st.floats(0.0, 1.0)
channels = st.builds(ChannelParameters, st.floats(0.0, 0.5), st.floats(0.0, 0.3), shares, shares)


@settings(max_examples=25)
@given(channels, st.integers(0, 1000))
def test_whatever_the_network_does_only_newer_packets_count(
    channel: ChannelParameters, seed: int
) -> None:
    hosts = Hosts(channel, seed=seed)
    sequence, shipped = 0, 0.0
    for packet in hosts.run(0.5):
        assert packet.sequence > sequence
        assert packet.shipped >= shipped  # none before both have met
        sequence, shipped = packet.sequence, packet.shipped
        age = hosts.ends["master"].round_trip_age(hosts.now)
        assert age >= max(0.0, 2 * (channel.delay - channel.jitter)) - 1e-9


EXTREME = 2**63 - 1

LIES: dict[str, dict[str, object]] = {
    "stops": {"stops": 2**32 - 1, "stopped": True},
    "engagement": {"engagement": 2**32 - 1},
    "sequence": {"sequence": EXTREME},
    "session": {"session": 99},
    "sent": {"sent": -EXTREME},
    "echo": {"echo": EXTREME, "echo_sent": EXTREME},
    "echo_sent": {"echo_sent": EXTREME},
    "echo_received": {"echo_received": EXTREME, "sent": EXTREME},
    "stamp": {"stamp": -EXTREME},
    "position": {"position": (1e300, -1e300, 1e6)},
    "velocity": {"velocity": (1e300, 0.0, 0.0)},
    "shipped": {"shipped": 1e300},
    "owing": {"shipped": -1e300},
    "rate": {"rate": 1e-300},
    "first": {"first": EXTREME},
    "past": {"first": -EXTREME},
    "soon": {"first": (1_000_000 + 900), "samples": (1e6,) * MOST_SAMPLES},
    "samples": {"samples": (1e6,) * MOST_SAMPLES},
}


def lie(data: bytes, **values: object) -> bytes:
    """Return a packet as its sender would make it if it were wrong about some of its fields."""
    packet = unpack(data)
    return packet._replace(**{"sequence": packet.sequence + 1, **values}).pack()  # type: ignore[arg-type]


@pytest.mark.parametrize("name", rest_slow(LIES, now=4))
def test_no_single_packet_ends_or_spoils_a_session_for_good(name: str) -> None:
    hosts = Hosts(ChannelParameters(delay=0.005, jitter=0.002), clock_offset=0.5)
    master, slave = hosts.ends["master"], hosts.ends["slave"]
    playout = master.playout
    list(hosts.run(5.0))
    assert master.peer
    master.incoming(lie(master.peer.pack(), **LIES[name]), hosts.now, hosts.system("master"))
    concealed = 0
    for tick in range(round(6.0 * RATE)):
        list(hosts.run(1 / RATE))
        late = playout.play(hosts.now).kind not in ("true", "repaired")
        concealed += late and tick > 4 * RATE
    assert concealed < 0.02 * RATE
    for end, other in ((master, slave), (slave, master)):
        assert end.fresh(hosts.now, 0.01)
        assert end.round_trip_age(hosts.now) < 0.02
        assert other.peer
        assert end.shipped == pytest.approx(hosts.tick / 1e6, abs=0.01 + 1e-5)
    offset = master.clock.offset(hosts.system("master"))
    assert offset == pytest.approx(0.5, abs=3e-3)


def test_a_clock_ahead_by_an_hour_that_drifts_costs_nothing() -> None:
    hosts = Hosts(ChannelParameters(0.01, 0.005, 0.05, 0.05), clock_offset=3600.0)
    playout = hosts.ends["master"].playout
    for tick in range(round(20 * RATE)):
        hosts.ahead["slave"] += (tick % 2) * 1000  # 500 ppm
        list(hosts.run(1 / RATE))
        playout.play(hosts.now)
    heard = sum(playout.counts[kind] for kind in ("true", "repaired"))
    assert heard > 0.97 * 20 * RATE
    for end in hosts.ends.values():
        assert end.fresh(hosts.now, 0.05)
        assert end.round_trip_age(hosts.now) < 0.05
        assert end.session.renewals == 0
    master = hosts.ends["master"]
    assert master.clock.offset(hosts.system("master")) == pytest.approx(3600.01, abs=0.01)
    assert master.clock.drift == pytest.approx(5e-4, rel=0.1)


def test_a_tool_with_three_axes_is_played_with_three() -> None:
    slave = Endpoint("slave", RATE, 2, ALL_AXES)
    master = Endpoint("master", RATE, 1)
    for tick in range(1000, 1010):
        now, system = tick / RATE, tick * TICK
        slave.sampled(system, (float(tick), -2.0, 3.0))
        for sender, receiver in ((slave, master), (master, slave)):
            if data := sender.outgoing(State(), Motion(), 0.0, now, system):
                receiver.incoming(data, now, system)
    assert master.playout.play(now) == ((float(tick), -2.0, 3.0), "true")


OWN = 5
NEWEST, OVERTAKEN, HANDSHAKE = Admission.NEWEST, Admission.OVERTAKEN, Admission.HANDSHAKE


def packet(sequence: int, session: int = 7, side: str = "slave", answers: int = OWN) -> Packet:
    return Packet(
        *(side, session, sequence, 0, answers, 0, 0, 0, True, False, False, False, 0, 0, 0),
        *(ZERO, ZERO, 0.0, 1e3, 0, ()),
    )


@pytest.fixture
def session() -> Session:
    return Session("master", OWN)


def test_a_peer_on_the_own_side_is_refused(session: Session) -> None:
    assert session.admits(packet(1, side="master"), 1.0) is Admission.REFUSED
    assert session.problem(1.0) == "both hosts are side:=master: one must be the other"
    assert session.unusable(1.0, 0.1) == REFUSED
    assert session.problem(1.1 + PROBLEM_TIME) == ""
    assert session.unusable(1.2, 0.1) == ""
    assert session.peer == 0


def test_a_packet_that_does_not_answer_the_own_session_only_makes_its_sender_known(
    session: Session,
) -> None:
    assert session.admits(packet(1, answers=0), 1.0) is HANDSHAKE
    assert session.admits(packet(2, answers=OWN + 1), 1.0) is HANDSHAKE
    assert session.unusable(1.0, 0.1) == UNHEARD
    assert (session.peer, session.received) == (0, 0)
    assert session.admits(packet(3), 1.1) is NEWEST
    assert session.admits(packet(9, session=8, answers=0), 1.2) is Admission.REFUSED
    assert session.admits(packet(9, answers=0), 1.2) is Admission.REFUSED


def test_a_second_peer_is_refused_while_the_first_lives(session: Session) -> None:
    assert session.admits(packet(1, session=7), 1.0) is NEWEST
    assert session.admits(packet(1, session=8), 1.0 + 0.9 * LIFETIME) is Admission.REFUSED
    assert session.problem(1.5) == "second peer with side:=slave: end one of the two"
    assert session.admits(packet(2, session=7), 1.0 + 0.95 * LIFETIME) is NEWEST
    assert session.admits(packet(2, session=8), 1.0 + 1.9 * LIFETIME) is Admission.REFUSED
    assert (session.refused, session.restarts, session.peer) == (2, 0, 7)


def test_a_peer_that_starts_again_is_admitted_and_its_former_run_never_more(
    session: Session,
) -> None:
    session.admits(packet(100, session=7), 1.0)
    assert session.admits(packet(1, session=8), 1.1 + LIFETIME) is NEWEST
    assert (session.restarts, session.peer) == (1, 8)
    assert session.admits(packet(101, session=7), 2.0) is Admission.REFUSED
    assert session.admits(packet(102, session=7), 1000.0) is Admission.REFUSED
    assert session.admits(packet(2, session=8), 1001.0) is NEWEST


def test_a_peer_whose_cable_was_out_goes_on(session: Session) -> None:
    session.admits(packet(1), 1.0)
    assert session.admits(packet(1001), 2.0) is NEWEST
    assert session.admits(packet(1001 + 3_600_000), 3602.0) is NEWEST
    assert session.restarts == 0


def test_a_packet_far_ahead_makes_none_old_that_follows(session: Session) -> None:
    session.admits(packet(1), 1.0)
    for ahead in (2**63 - 1, 10_000):
        assert session.admits(packet(ahead), 1.001) is Admission.REFUSED
    assert session.problem(1.001) == "packet with a number far ahead of the last"
    assert session.admits(packet(2), 1.002) is NEWEST
    assert (session.lost, session.renewals) == (0, 0)


def test_a_peer_that_is_heard_in_vain_is_met_in_a_new_session(session: Session) -> None:
    session.admits(packet(2**63 - 1), 1.0)
    now, number = 1.0, 1
    while session.own == OWN:
        now, number = now + 1e-3, number + 1
        assert session.admits(packet(number), now) is Admission.REFUSED
    assert now == pytest.approx(1.0 + RENEW_AFTER, abs=0.01)
    assert session.admits(packet(number + 1), now) is HANDSHAKE
    fresh = packet(number + 2, answers=session.own)
    assert session.admits(fresh, now) is NEWEST
    assert session.renewals == 1


def test_a_number_ahead_within_reason_holds_a_slow_peer_up_no_longer_either(
    session: Session,
) -> None:
    session.admits(packet(1), 1.0)
    session.admits(packet(900), 1.02)  # at 50 packets a second 18 s ahead
    now, number = 1.02, 2
    while session.admits(packet(number, answers=session.own), now) is not NEWEST:
        now, number = now + 0.02, number + 1
    assert now < 1.1 + RENEW_AFTER


def test_a_peer_that_was_followed_returns_in_a_new_session_after_the_other_has_gone(
    session: Session,
) -> None:
    session.admits(packet(1, session=7), 1.0)
    session.admits(packet(1, session=8), 2.0)
    for tick in range(2000):
        session.admits(packet(tick, session=7), 3.0 + tick / 1e3)
    assert session.admits(packet(3000, session=7, answers=session.own), 5.0) is NEWEST


def test_packets_again_after_a_long_silence_do_not_end_the_session(session: Session) -> None:
    session.admits(packet(1), 1.0)
    assert session.admits(packet(1), 1.0 + 2 * RENEW_AFTER) is Admission.REFUSED
    assert session.admits(packet(2), 2.0 + 2 * RENEW_AFTER) is NEWEST
    assert session.own == OWN


@given(st.integers(1, 1000), st.lists(st.integers(1 - DUPLICATE_WINDOW, 300), max_size=200))
def test_packets_in_any_order_and_number_are_used_once_and_counted(
    first: int, aheads: list[int]
) -> None:
    session = Session("master", OWN)
    assert session.admits(packet(first), 1.0) is NEWEST
    seen, arrivals = {first}, 1
    for ahead in aheads:
        sequence = max(seen) + ahead
        if sequence < first:
            continue
        expected = Admission.REFUSED
        if sequence not in seen:
            expected = NEWEST if ahead > 0 else OVERTAKEN
        assert session.admits(packet(sequence), 1.0) is expected
        seen.add(sequence)
        arrivals += 1
    assert session.lost == max(seen) - first + 1 - len(seen)
    assert session.doubled == arrivals - len(seen)
    assert session.received + session.out_of_order == len(seen)


def test_a_refused_packet_leaves_the_peer_alone(session: Session) -> None:
    session.admits(packet(5), 1.0)
    session.refuse("damaged packet", 1.0)
    assert session.problem(1.0) == "damaged packet"
    assert session.admits(packet(6), 1.1) is NEWEST
    assert (session.refused, session.lost) == (1, 0)


@given(st.lists(st.tuples(st.integers(-(2**63), 2**63 - 1), st.floats(0.0, 2.0))))
def test_whatever_numbers_came_a_peer_that_goes_on_is_admitted_in_the_end(
    hostile: list[tuple[int, float]],
) -> None:
    session = Session("master", OWN)
    now = 1.0
    for number, pause in hostile:
        session.admits(packet(number), now := now + pause)
    # From here the peer answers whatever session it hears of, as an endpoint does.
    for tick in range(round(1000 * (RENEW_AFTER + 2 * LARGEST_JUMP))):
        now += 1e-3
        if session.admits(packet(tick, answers=session.own), now) is NEWEST:
            break
    else:
        pytest.fail("no packet was admitted")
