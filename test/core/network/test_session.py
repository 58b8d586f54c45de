# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.model import ZERO
from haptic_accel.core.network.packet import Packet
from haptic_accel.core.network.session import (
    ANEW,
    DUPLICATE_WINDOW,
    LARGEST_JUMP,
    LIFETIME,
    PROBLEM_TIME,
    REFUSED,
    UNHEARD,
    Admission,
    Session,
)

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
    assert now == pytest.approx(1.0 + ANEW, abs=0.01)
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
    assert now < 1.1 + ANEW


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
    assert session.admits(packet(1), 1.0 + 2 * ANEW) is Admission.REFUSED
    assert session.admits(packet(2), 2.0 + 2 * ANEW) is NEWEST
    assert session.own == OWN


@given(
    st.lists(st.integers(1, DUPLICATE_WINDOW - 1), min_size=1, max_size=200), st.integers(0, 2**32)
)
def test_counts_are_those_of_the_sequence(sequences: list[int], seed: int) -> None:
    session = Session("master", OWN)
    seen: set[int] = set()
    first = sequences[0]
    for sequence in sequences:
        if sequence < first:
            continue
        expected = Admission.REFUSED
        if sequence not in seen:
            expected = NEWEST if sequence > max(seen, default=0) else OVERTAKEN
        assert session.admits(packet(sequence), 1.0) is expected
        seen.add(sequence)
    arrivals = sum(sequence >= first for sequence in sequences)
    assert session.lost == max(seen) - first + 1 - len(seen)
    assert session.doubled == arrivals - len(seen)
    assert session.received + session.out_of_order == len(seen)


def test_packets_in_any_order_and_number_are_used_once_and_their_state_forwards_only() -> None:
    arrivals = [sequence for sequence in range(1, 2000) for _ in range(2)]
    order = random.Random(4)
    arrivals.sort(key=lambda sequence: sequence + order.uniform(0.0, 50.0))
    session = Session("master", OWN)
    found = [(session.admits(packet(s), 1.0), s) for s in arrivals]
    used = [s for admission, s in found if admission is NEWEST]
    assert used == sorted(set(used))
    late = [s for admission, s in found if admission is OVERTAKEN]
    assert len({*used, *late}) == len(used) + len(late)
    assert session.doubled == pytest.approx(1999, abs=50)


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
    for tick in range(round(1000 * (ANEW + 2 * LARGEST_JUMP))):
        now += 1e-3
        if session.admits(packet(tick, answers=session.own), now) is NEWEST:
            break
    else:
        pytest.fail("no packet was admitted")
