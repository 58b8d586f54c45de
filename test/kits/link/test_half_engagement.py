# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two hosts that engage with each other over a simulated network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.coupling.engagement import (
    FREE_TIME,
    LATCHED_SETTLING,
    STEP_PERIOD,
    STOPPED,
    EngagementParameters,
)
from haptic_accel.core.coupling.passive import PassiveParameters
from haptic_accel.core.network import Channel, ChannelParameters
from haptic_accel.core.tick import ArmSample
from haptic_accel.kits.link import two_hosts
from haptic_accel.kits.link.endpoint import UNHEARD

RATE = 1000.0
TIMEOUT = 0.1
MASTER, SLAVE = "master", "slave"
SIDES = (MASTER, SLAVE)


class Host:
    """One host, whose arm is always there and at rest."""

    def __init__(self, side: str, session: int, now: float, recovery: str) -> None:
        parameters = EngagementParameters(timeout=TIMEOUT, listeners=0, recovery=recovery)
        self.side = side
        self.engagement = two_hosts.HalfEngagement(parameters, now - LATCHED_SETTLING, side)
        end = two_hosts.ArmEndpoint(side, PassiveParameters(), RATE, 1, session)
        self.part = two_hosts.HalfCouplingPart(end, self.engagement, TIMEOUT)
        self.end = end.endpoint
        self.log: list[str] = []

    def sample(self, now: float, system: int) -> None:
        engagement = self.engagement
        engagement.arm_stopped(self.side, engagement.stop.stopped)
        self.part.put(ArmSample(system), now)
        if not engagement.due(now):
            return
        decision = self.part.poll(now, 0)
        self.log += ["engaged"] * decision.engage + [decision.warning] * bool(decision.warning)


class Run:
    """Two hosts, and the network between them, whose time goes on as a test says."""

    def __init__(
        self, channel: ChannelParameters | None = None, recovery: str = "automatic", seed: int = 1
    ) -> None:
        self.clear = channel or ChannelParameters(delay=0.01)
        self.now = 100.0
        self.sessions = 0
        self.recovery = recovery
        self.hosts: dict[str, Host | None] = {}
        for side in SIDES:
            self.start(side)
        self.ways = {side: Channel[bytes](self.clear, seed + len(side)) for side in SIDES}

    def start(self, side: str) -> None:
        self.sessions += 1
        self.hosts[side] = Host(side, self.sessions, self.now, self.recovery)

    def kill(self, side: str) -> None:
        self.hosts[side] = None

    def cut(self, side: str, loss: float = 1.0) -> None:
        """Let the packets that a side sends be lost."""
        self.ways[side].parameters = replace(self.clear, loss=loss)

    def mend(self) -> None:
        for way in self.ways.values():
            way.parameters = self.clear

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * RATE)):
            self.now += 1 / RATE
            system = round(self.now * 1e9)
            for side, host in self.hosts.items():
                if host is None:
                    continue
                (other,) = set(SIDES) - {side}
                host.part.receive(self.ways[other].arrived(self.now), self.now, system)
                host.sample(self.now, system)
                if data := host.part.packet(self.now, system):
                    self.ways[side].send(data, self.now)

    def host(self, side: str) -> Host:
        host = self.hosts[side]
        assert host
        return host

    @property
    def engaged(self) -> tuple[bool, bool]:
        one, other = (self.host(side).engagement.engaged for side in SIDES)
        return one, other

    @property
    def resumes(self) -> tuple[bool, bool]:
        one, other = (self.host(side).engagement.resumes for side in SIDES)
        return one, other

    def missing(self, side: str) -> str:
        return self.host(side).engagement.missing(self.now, 0)

    def release(self, side: str) -> None:
        assert self.host(side).engagement.stop.release(self.now, []) == ""


def engaged_run(delay: float = 0.01, recovery: str = "automatic") -> Run:
    run = Run(ChannelParameters(delay=delay), recovery)
    run.run(4 * delay + 0.1)
    assert run.engaged == (True, True)
    return run


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.5])
def test_both_engage_once_each_knows_that_the_other_can(delay: float) -> None:
    run = engaged_run(delay)
    assert [run.host(side).log for side in SIDES] == [["engaged"], ["engaged"]]


@pytest.mark.parametrize("side", SIDES)
def test_neither_engages_while_packets_go_one_way_only(side: str) -> None:
    (other,) = set(SIDES) - {side}
    run = Run()
    run.cut(side)
    run.run(2.0)
    assert run.engaged == (False, False)
    assert (run.missing(side), run.missing(other)) == (UNHEARD, two_hosts.SILENT)
    run.mend()
    run.run(0.2)
    assert run.engaged == (True, True)
    run.cut(side)
    for _ in range(20):
        run.run(0.3)
        assert run.engaged == (False, False)


@pytest.mark.parametrize("side", SIDES)
def test_silence_frees_both_arms_within_the_time_out_and_they_return(side: str) -> None:
    run = engaged_run()
    run.cut(side)
    run.run(0.01 + TIMEOUT + 2e-3 + 0.01 + STEP_PERIOD)
    assert run.engaged == (False, False)
    run.run(2.0)
    run.mend()
    run.run(0.2)
    assert run.engaged == (True, True)
    assert run.host(MASTER).log.count("engaged") == 2


@pytest.mark.parametrize("losses", [[(MASTER,)], [(SLAVE,)], [SIDES], [(MASTER,), (SLAVE,)] * 2])
def test_after_short_losses_both_keep_their_reference_positions(
    losses: list[tuple[str, ...]],
) -> None:
    run = engaged_run()
    assert run.resumes == (False, False)
    for lost in losses:
        for side in lost:
            run.cut(side)
        run.run(0.3)
        run.mend()
        run.run(FREE_TIME + 0.02)  # hardly engaged
    run.run(0.18)
    assert run.engaged == (True, True)
    assert run.resumes == (True, True)


@pytest.mark.parametrize("side", SIDES)
def test_after_a_long_loss_a_request_or_a_stop_the_arms_engage_where_they_are(side: str) -> None:
    run = engaged_run()
    run.cut(side)
    run.run(two_hosts.RESUME_TIME + 0.2)
    run.mend()
    run.run(0.2)
    assert (run.engaged, run.resumes) == ((True, True), (False, False))
    it = run.host(side).engagement
    it.request(False)
    run.run(0.1)
    it.request(True)
    run.run(FREE_TIME + 0.2)
    assert (run.engaged, run.resumes) == ((True, True), (False, False))
    it.stop.stop()
    run.run(LATCHED_SETTLING + 0.1)
    for each in SIDES:
        run.release(each)
    run.run(FREE_TIME + 0.2)
    assert (run.engaged, run.resumes) == ((True, True), (False, False))


@pytest.mark.parametrize("side", SIDES)
def test_hosts_that_disagree_on_the_reference_positions_engage_once_more(side: str) -> None:
    run = engaged_run()
    host = run.host(side)
    packet = host.end.peer
    assert packet
    host.engagement.peer_heard(packet._replace(resumes=True), run.now)
    assert host.part.poll(run.now, 0).warning == f"uncoupled: {two_hosts.DIFFERENT}"
    run.run(FREE_TIME + 0.2)
    assert (run.engaged, run.resumes) == ((True, True), (False, False))


def test_a_peer_that_starts_again_is_engaged_with_anew() -> None:
    run = engaged_run()
    run.kill(SLAVE)
    run.run(0.2)
    run.start(SLAVE)
    run.run(FREE_TIME + 0.2)
    assert run.engaged == (True, True)
    assert run.host(SLAVE).log == ["engaged"]
    assert run.host(MASTER).log == ["engaged", f"uncoupled: {two_hosts.SILENT}", "engaged"]


def test_a_peer_that_starts_again_unnoticed_is_not_taken_for_the_one_before() -> None:
    run = engaged_run()
    master = run.host(MASTER).engagement
    packet = run.host(MASTER).end.peer
    assert packet
    master.peer_heard(packet._replace(session=99), run.now)
    assert master.decide(run.now, 0).warning == f"uncoupled: {two_hosts.RESTARTED}"


@pytest.mark.parametrize("delay", [0.0, 0.5])
@pytest.mark.parametrize("side", SIDES)
def test_a_request_on_one_host_frees_both_and_both_return_after_the_next(
    side: str, delay: float
) -> None:
    run = engaged_run(delay)
    it = run.host(side).engagement
    it.request(False)
    run.run(3.0)
    assert run.engaged == (False, False)
    it.request(True)
    run.run(FREE_TIME + 4 * delay + 0.1)
    assert run.engaged == (True, True)
    assert [run.host(each).log.count("engaged") for each in SIDES] == [2, 2]


@pytest.mark.parametrize("side", SIDES)
def test_manual_recovery_returns_after_a_loss_only_when_asked(side: str) -> None:
    run = engaged_run(recovery="manual")
    for each in SIDES:
        run.cut(each)
    run.run(1.0)
    run.mend()
    run.run(1.0)
    assert run.engaged == (False, False)
    assert run.missing(side) == two_hosts.LOST
    for each in SIDES:
        assert run.engaged == (False, False)
        run.host(each).engagement.request(True)
        run.run(0.2)
    assert run.engaged == (True, True)


@pytest.mark.parametrize("side", SIDES)
def test_a_stop_stops_both_hosts_and_each_is_released_by_itself(side: str) -> None:
    (other,) = set(SIDES) - {side}
    run = engaged_run()
    run.host(side).engagement.stop.stop()
    run.run(0.05)
    assert run.engaged == (False, False)
    assert (run.missing(side), run.missing(other)) == (STOPPED, STOPPED)
    run.run(2.0)
    run.release(other)
    run.run(2.0)
    assert not run.host(other).engagement.stop.stopped, "stopped again, though nobody stopped it"
    assert run.missing(other) == two_hosts.STOPPED_THERE
    assert run.engaged == (False, False)
    run.release(side)
    run.run(0.2)
    assert run.engaged == (True, True)
    assert [run.host(each).engagement.stop.began for each in (side, other)] == [1, 0]


@pytest.mark.parametrize("released", [False, True])
def test_a_stop_during_a_blackout_is_heard_after_it_even_if_it_ended(released: bool) -> None:
    run = engaged_run()
    run.cut(MASTER)
    run.run(0.5)
    run.host(MASTER).engagement.stop.stop()
    run.run(0.5)
    assert not run.host(SLAVE).engagement.stop.stopped
    if released:
        run.release(MASTER)
    run.mend()
    run.run(0.1)
    assert run.host(SLAVE).engagement.stop.stopped


def test_a_host_that_meets_a_stopped_peer_stops() -> None:
    run = engaged_run()
    run.host(MASTER).engagement.stop.stop()
    run.run(0.1)
    run.kill(SLAVE)
    run.run(1.0)
    run.start(SLAVE)
    run.run(0.1)
    assert run.host(SLAVE).engagement.stop.stopped
    assert run.host(SLAVE).engagement.stop.began == 0


def test_a_second_stop_on_a_host_that_follows_one_stops_the_first_again() -> None:
    run = engaged_run()
    run.host(MASTER).engagement.stop.stop()
    run.run(2.0)
    run.release(MASTER)
    run.host(SLAVE).engagement.stop.stop()  # while it still follows the master's
    run.run(0.1)
    assert run.host(MASTER).engagement.stop.stopped


def lie(run: Run, side: str) -> None:
    """Let a side's packets be followed by one that is fresh but wrong wherever it can be."""
    host = run.hosts[side]
    if host is None or host.end.peer is None:
        return
    most = 2**63 - 1
    packet = host.end.peer._replace(
        sequence=host.end.peer.sequence + 5000, sent=most, echo=most, stamp=-most, first=most
    )
    wrong = packet._replace(stops=2**32 - 1, engagement=2**32 - 1, engaged=True, shipped=1e300)
    host.part.receive([wrong.pack()], run.now, round(run.now * 1e9))


Event = Callable[[Run, str], object]

EVENTS: dict[str, Event] = {
    "wait": lambda run, _: run.run(0.3),
    "moment": lambda run, _: run.run(0.03),
    "cut": lambda run, side: run.cut(side),
    "bad": lambda run, side: run.cut(side, 0.5),
    "mend": lambda run, _: run.mend(),
    "stop": lambda run, side: run.hosts[side] and run.host(side).engagement.stop.stop(),
    "kill": lambda run, side: run.kill(side),
    "start": lambda run, side: run.hosts[side] or run.start(side),
    "lie": lie,
    "let go": lambda run, side: run.hosts[side] and run.host(side).engagement.request(False),
}


@settings(max_examples=10)
@given(
    st.lists(st.tuples(st.sampled_from(sorted(EVENTS)), st.sampled_from(SIDES)), max_size=12),
    st.floats(0.0, 0.2),
    st.floats(0.0, 0.1),
)
def test_whatever_happened_both_return_once_nothing_is_in_the_way(
    events: list[tuple[str, str]], delay: float, jitter: float
) -> None:
    run = Run(ChannelParameters(delay=delay, jitter=min(jitter, delay), duplication=0.1))
    run.run(0.5)
    for name, side in events:
        EVENTS[name](run, side)
    run.mend()
    for side in SIDES:
        if run.hosts[side] is None:
            run.start(side)
    run.run(2.0)
    for side in SIDES:
        run.host(side).engagement.stop.release(run.now, [])
        run.host(side).engagement.request(True)
    run.run(FREE_TIME + 6 * (delay + jitter) + 0.5)
    assert run.engaged == (True, True)
    assert len(set(run.resumes)) == 1
    counts = [run.host(side).engagement.count for side in SIDES]
    run.run(1.0)
    assert [run.host(side).engagement.count for side in SIDES] == counts, "not for long"
