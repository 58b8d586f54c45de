# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import select
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.link.datagrams import (
    COUPLER,
    LINK,
    LONGEST_DATAGRAM,
    MOST_WAITING,
    LocalEnd,
)

Ends = tuple[LocalEnd, LocalEnd]

DOMAIN = 250
"""No ROS domain, so that no graph of this machine is met."""


@pytest.fixture
def ends() -> Iterator[Ends]:
    with (
        closing(LocalEnd(COUPLER, DOMAIN, "/a")) as one,
        closing(LocalEnd(LINK, DOMAIN, "/a")) as two,
    ):
        yield one, two


def test_datagrams_pass_both_ways_in_order(ends: Ends) -> None:
    for sender, receiver in (ends, ends[::-1]):
        sent = [bytes([number]) * LONGEST_DATAGRAM for number in range(5)]
        assert all(sender.send(datagram) for datagram in sent)
        assert select.select([receiver], [], [], 1.0)[0] == [receiver]
        assert receiver.drain() == sent
        assert receiver.drain() == []


def test_what_has_no_room_waits_in_order_and_only_the_oldest_is_dropped(ends: Ends) -> None:
    link, coupler = ends[1], ends[0]
    numbers = iter(range(10_000))
    kept = 0
    while link.send(next(numbers).to_bytes(2, "big")):
        kept += 1
    for _ in range(MOST_WAITING):
        assert not link.send(next(numbers).to_bytes(2, "big"))
    assert link.dropped == 1
    found = [int.from_bytes(each, "big") for each in coupler.drain()]
    last = next(numbers)
    while not link.send(last.to_bytes(2, "big")):
        found += [int.from_bytes(each, "big") for each in coupler.drain()]
        last = next(numbers)
    found += [int.from_bytes(each, "big") for each in coupler.drain()]
    assert found == [number for number in range(last + 1) if number != kept]


def test_what_is_sent_to_nobody_is_dropped_and_counted() -> None:
    with closing(LocalEnd(COUPLER, DOMAIN, "/b")) as coupler:
        assert not coupler.send(b"1")
        with closing(LocalEnd(LINK, DOMAIN, "/b")) as link:
            while coupler.send(b"2"):
                pass
            assert set(link.drain()) == {b"2"}
        assert not coupler.send(b"3")
        assert coupler.dropped == 3


def test_other_namespaces_domains_and_senders_are_not_heard(ends: Ends) -> None:
    _, link = ends
    with closing(LocalEnd(COUPLER, DOMAIN, "/x" * 500)) as one:
        assert not one.send(b"other namespace")
    with closing(LocalEnd(COUPLER, DOMAIN + 1, "/a")) as one:
        assert not one.send(b"other domain")
    link.send(b"to the coupler")
    assert link.drain() == []


def test_a_second_process_for_one_end_is_refused_in_one_line(ends: Ends) -> None:
    with pytest.raises(ParameterError, match=r"^ROS domain 250: has a link .* in namespace /a al"):
        LocalEnd(LINK, DOMAIN, "/a")


def test_the_link_tells_the_coupler_about_itself_and_nobody_else_can(ends: Ends) -> None:
    coupler, link = ends
    link.write_note("datagrams from 10.0.0.5 do not have the key")
    link.send(b"1")
    assert coupler.drain() == [b"1"]
    link.send(b"note\0all is well")
    assert (coupler.drain(), coupler.note) == ([], "datagrams from 10.0.0.5 do not have the key")
    link.write_note("")
    coupler.drain()
    assert coupler.note == ""


def test_a_note_of_another_thread_changes_nothing_of_what_is_sent(ends: Ends) -> None:
    coupler, link = ends
    over = threading.Event()

    def write() -> None:
        while not over.is_set():
            link.write_note("all is well")

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    taken = []
    with ThreadPoolExecutor() as pool:
        written = pool.submit(write)
        try:
            for number in range(20_000):
                link.send(number.to_bytes(2, "big"))
                taken += coupler.drain()
        finally:
            over.set()
            sys.setswitchinterval(interval)
        written.result()
    taken += coupler.drain()
    while not link.send(b"the last"):
        taken += coupler.drain()
    taken += coupler.drain()
    assert [int.from_bytes(each, "big") for each in taken[:-1]] == [*range(20_000)]
    assert taken[-1] == b"the last"
    assert link.dropped == 0
