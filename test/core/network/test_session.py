# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.model import ZERO
from haptic_accel.core.network.packet import Packet
from haptic_accel.core.network.session import LIFETIME, PROBLEM_TIME, WINDOW, Session


def packet(sequence: int, session: int = 7, side: str = "slave") -> Packet:
    return Packet(
        *(side, session, sequence, 0, 0, 0, 0, 0, True, False, False, 0, 0, 0),
        *(ZERO, ZERO, 0.0, 1e3, 0, ()),
    )


def test_a_peer_on_the_own_side_is_refused() -> None:
    session = Session("master")
    assert not session.admits(packet(1, side="master"), 1.0)
    assert session.problem(1.0) == "both hosts are side:=master: one must be the other"
    assert session.problem(1.1 + PROBLEM_TIME) == ""
    assert session.peer == 0


def test_a_second_peer_is_refused_while_the_first_lives() -> None:
    session = Session("master")
    assert session.admits(packet(1, session=7), 1.0)
    assert not session.admits(packet(1, session=8), 1.0 + 0.9 * LIFETIME)
    assert session.problem(1.5) == "second peer with side:=slave: end one of the two"
    assert session.admits(packet(2, session=7), 1.0 + 0.95 * LIFETIME)
    assert not session.admits(packet(2, session=8), 1.0 + 1.9 * LIFETIME)
    assert (session.refused, session.restarts, session.peer) == (2, 0, 7)


def test_a_peer_that_starts_again_is_admitted_and_its_former_run_never_more() -> None:
    session = Session("master")
    session.admits(packet(100, session=7), 1.0)
    assert session.admits(packet(1, session=8), 1.1 + LIFETIME)
    assert (session.restarts, session.peer) == (1, 8)
    assert not session.admits(packet(101, session=7), 2.0)
    assert not session.admits(packet(102, session=7), 1000.0)
    assert session.admits(packet(2, session=8), 1001.0)


def test_a_peer_whose_cable_was_out_goes_on() -> None:
    session = Session("master")
    session.admits(packet(1), 1.0)
    assert session.admits(packet(501), 2.0)
    assert (session.lost, session.restarts) == (499, 0)


@given(st.lists(st.integers(1, WINDOW - 1), min_size=1, max_size=200), st.integers(0, 2**32))
def test_counts_are_those_of_the_sequence(sequences: list[int], seed: int) -> None:
    session = Session("master")
    seen: set[int] = set()
    first = sequences[0]
    for sequence in sequences:
        if sequence < first:
            continue
        assert session.admits(packet(sequence), 1.0) == (sequence > max(seen, default=0))
        seen.add(sequence)
    arrivals = sum(sequence >= first for sequence in sequences)
    assert session.lost == max(seen) - first + 1 - len(seen)
    assert session.doubled == arrivals - len(seen)
    assert session.received + session.out_of_order == len(seen)


def test_packets_in_any_order_and_number_are_used_forwards_only() -> None:
    arrivals = [sequence for sequence in range(1, 2000) for _ in range(2)]
    order = random.Random(4)
    arrivals.sort(key=lambda sequence: sequence + order.uniform(0.0, 50.0))
    session = Session("master")
    used = [s for s in arrivals if session.admits(packet(s), 1.0)]
    assert used == sorted(set(used))
    assert session.doubled == pytest.approx(1999, abs=50)


def test_a_refused_packet_leaves_the_peer_alone() -> None:
    session = Session("master")
    session.admits(packet(5), 1.0)
    session.refuse("damaged packet", 1.0)
    assert session.problem(1.0) == "damaged packet"
    assert session.admits(packet(6), 1.1)
    assert (session.refused, session.lost) == (1, 0)
