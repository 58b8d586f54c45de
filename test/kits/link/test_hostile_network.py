# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both ends of a link and somebody on the network between them, who has all but the key."""

from __future__ import annotations

import random
import secrets
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from haptic_accel.core.axes import along_actuator
from haptic_accel.kits.link import endpoint
from haptic_accel.kits.link.datagrams import KEY_LENGTH, Authenticator

RATE = 1000.0
TICK = 0.01
"""Time between packets here, s: ten times the real one, so that more happens in a case."""

MEETING = endpoint.RENEW_AFTER + endpoint.LIFETIME + 1.0
"""Time in which both ends must have found each other once nobody interferes, s."""

KEY, WRONG = b"k" * KEY_LENGTH, b"w" * KEY_LENGTH
OTHER = {"master": "slave", "slave": "master"}
SIDE = st.sampled_from(sorted(OTHER))
INT64 = st.integers(-(2**63), 2**63 - 1) | st.sampled_from([-(2**63), 0, 2**63 - 1])
REAL = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e300, max_value=1e300)
VECTOR = st.tuples(REAL, REAL, REAL)
LIES = st.fixed_dictionaries(
    {},
    optional={
        **dict.fromkeys(("sequence", "sent", "echo", "echo_sent", "echo_received"), INT64),
        **dict.fromkeys(("stamp", "first"), INT64),
        **dict.fromkeys(("stops", "engagement"), st.integers(0, 2**32 - 1)),
        **dict.fromkeys(("position", "velocity"), VECTOR),
        "shipped": REAL,
        "rate": st.floats(1e-300, 1e300),
        "samples": st.lists(st.floats(-1e6, 1e6, width=32), max_size=endpoint.MOST_SAMPLES).map(
            tuple
        ),
    },
)

FLIPS = 300

hostile = 0
"""Datagrams that were not the peer's, or came again, of all cases."""


class Network(RuleBasedStateMachine):
    """Packets pass as they are sent, but for what the rules do to them."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 100.0
        self.ahead = {"master": 0, "slave": 0}
        self.drift = 0.0
        self.seals = {side: Authenticator(KEY, side) for side in OTHER}
        self.ends: dict[str, endpoint.Endpoint] = {}
        self.record: dict[str, list[bytes]] = {side: [] for side in OTHER}
        self.honest: set[bytes] = set()
        self.admitted: set[tuple[int, int, int]] = set()
        self.held: list[tuple[str, bytes]] = []

    @initialize()
    def begin(self) -> None:
        for side in OTHER:
            self.start(side)
        self.pass_time(5)

    @rule(side=SIDE)
    def start(self, side: str) -> None:
        """Start the half of a host, or start it again."""
        self.ends[side] = endpoint.Endpoint(side, RATE, secrets.randbits(64) or 1)

    @rule(ticks=st.integers(1, 80))
    def pass_time(self, ticks: int, lost: bool = False, held: bool = False) -> None:
        for _ in range(ticks):
            self.now += TICK
            self.ahead["slave"] += round(self.drift * TICK * 1e9)
            for side, end in self.ends.items():
                system = self.system(side)
                end.sampled(system, along_actuator(1.0))
                data = end.outgoing(
                    endpoint.State(True), endpoint.Motion(system), self.now, self.now, system
                )
                assert data
                tagged = self.seals[side].tagged(data)
                self.honest.add(data)
                self.record[side].append(tagged)
                if held:
                    self.held.append((OTHER[side], tagged))
                elif not lost:
                    self.deliver(OTHER[side], tagged)

    @rule(ticks=st.integers(1, 120))
    def jam(self, ticks: int) -> None:
        self.pass_time(ticks, lost=True)

    @rule(ticks=st.integers(1, 20), order=st.randoms())
    def hold_up_and_reorder(self, ticks: int, order: Any) -> None:
        self.pass_time(ticks, held=True)
        order.shuffle(self.held)
        for side, data in self.held:
            self.deliver(side, data)
        self.held.clear()

    @rule(side=SIDE, hours=st.integers(-1, 1))
    def set_clock(self, side: str, hours: int) -> None:
        self.ahead[side] = hours * 3_600_000_000_000

    @rule(ppm=st.sampled_from([-500, 0, 500]))
    def let_clock_drift(self, ppm: int) -> None:
        self.drift = ppm * 1e-6

    @rule(side=SIDE, back=st.integers(1, 2000), count=st.integers(1, 600))
    def replay(self, side: str, back: int, count: int) -> None:
        record = self.record[OTHER[side]]
        start = max(0, len(record) - back)
        for data in record[start : start + count]:
            self.attack(side, data)

    @rule(side=SIDE, count=st.integers(1, 200))
    def reflect(self, side: str, count: int) -> None:
        for data in self.record[side][-count:]:
            self.attack(side, data)

    @rule(side=SIDE, seed=st.integers(0, 2**32))
    def flip(self, side: str, seed: int) -> None:
        chance = random.Random(seed)
        for _ in range(FLIPS):
            data = bytearray(self.newest(side))
            for _ in range(chance.randint(1, 3)):
                data[chance.randrange(len(data))] ^= chance.randint(1, 255)
            if bytes(data) != self.newest(side):
                self.attack(side, bytes(data))

    @rule(side=SIDE, length=st.integers(0, 300), more=st.binary(max_size=30))
    def cut_and_lengthen(self, side: str, length: int, more: bytes) -> None:
        data = self.newest(side)
        self.attack(side, data[:length] if length < len(data) else data + b"\0")
        self.attack(side, data[length:] + more)
        self.attack(side, more)

    @rule(side=SIDE, values=LIES, key=st.sampled_from([b"", WRONG]))
    def forge(self, side: str, values: dict[str, Any], key: bytes) -> None:
        """Send what would come next, of the session that was read, without the key."""
        packet = endpoint.unpack(self.newest(side)[:-16])
        wrong = packet._replace(**{"sequence": packet.sequence + 1, **values}).pack()
        self.attack(side, Authenticator(key, OTHER[side]).tagged(wrong))
        self.attack(side, wrong + self.newest(side)[-16:])

    @rule(side=SIDE, values=LIES)
    def lie(self, side: str, values: dict[str, Any]) -> None:
        """Let the peer itself, by a fault, send a packet that is wrong wherever it can be."""
        packet = endpoint.unpack(self.newest(side)[:-16])
        wrong = packet._replace(**{"sequence": packet.sequence + 1, **values}).pack()
        self.honest.add(wrong)
        self.deliver(side, self.seals[OTHER[side]].tagged(wrong))

    def newest(self, side: str) -> bytes:
        """Return the newest datagram for a side."""
        return self.record[OTHER[side]][-1]

    def system(self, side: str) -> int:
        return round(self.now * 1e9) + 10**18 + self.ahead[side]

    def attack(self, side: str, data: bytes) -> None:
        global hostile
        hostile += 1
        self.deliver(side, data)

    def deliver(self, side: str, data: bytes) -> None:
        """Let a datagram arrive; check that it is used once and only if the peer sent it here."""
        end = self.ends[side]
        session = end.session
        datagram = self.seals[side].verified(data)
        if datagram is None:
            return
        assert datagram in self.honest, "a datagram that the peer never sent has its tag"
        own, before = session.own, session.received + session.out_of_order
        end.incoming(datagram, self.now, self.system(side))
        if session.received + session.out_of_order > before:
            packet = endpoint.unpack(datagram)
            assert packet.side != side
            assert packet.echo_session == own, "a packet that is not fresh was used"
            once = own, packet.session, packet.sequence
            assert once not in self.admitted, "a packet was used twice"
            self.admitted.add(once)

    def teardown(self) -> None:
        """Let nobody interfere any more: both ends find each other, and keep each other."""
        if not self.ends:
            return
        self.pass_time(round(MEETING / TICK))
        for end in self.ends.values():
            assert end.fresh(self.now, TICK), end.problems(self.system("master"), self.now)
            assert end.round_trip_age(self.now) < 5 * TICK
            assert end.shipped > self.now - 5 * TICK


HostileNetworkTest = pytest.mark.fuzz(Network.TestCase)
fuzz = settings.get_profile("fuzz")
HostileNetworkTest.settings = settings(
    fuzz, max_examples=max(1, fuzz.max_examples // 20), stateful_step_count=30
)
