# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from collections.abc import Sequence

import numpy as np
import pytest

from haptic_accel.core.network import Channel, ChannelParameters, host_and_port, is_loopback

COUNT, PERIOD = 4000, 1e-3


def arrivals(
    parameters: ChannelParameters, blackouts: Sequence[tuple[float, float]] = ()
) -> list[tuple[float, int]]:
    """Return the time and number of each packet that arrives, sent once a period."""
    channel = Channel[int](parameters, seed=3, blackouts=blackouts)
    found = []
    for tick in range(2 * COUNT):
        now = tick * PERIOD
        if tick < COUNT:
            channel.send(tick, now)
        found += [(now, packet) for packet in channel.arrived(now)]
    return found


def test_a_clean_channel_delivers_every_packet_in_order_after_the_delay() -> None:
    found = arrivals(ChannelParameters(delay=0.02))
    assert [packet for _, packet in found] == list(range(4000))
    assert all(now == pytest.approx(packet * 1e-3 + 0.02, abs=1.01e-3) for now, packet in found)


def test_jitter_spreads_the_delays_evenly_and_lets_packets_overtake() -> None:
    found = arrivals(ChannelParameters(delay=0.02, jitter=0.01))
    delays = np.array([now - packet * 1e-3 for now, packet in found])
    assert 0.0099 < delays.min() < 0.011
    assert 0.029 < delays.max() < 0.0311
    assert delays.mean() == pytest.approx(0.0205, abs=5e-4)  # half a period of waiting for a look
    packets = [packet for _, packet in found]
    assert sorted(packets) == list(range(4000))
    assert packets != sorted(packets)


def test_the_fractions_of_lost_and_doubled_packets_are_those_asked_for() -> None:
    found = [packet for _, packet in arrivals(ChannelParameters(loss=0.1, duplication=0.2))]
    assert len(set(found)) == pytest.approx(3600, abs=4 * np.sqrt(4000 * 0.09))
    assert len(found) == pytest.approx(1.2 * len(set(found)), rel=0.05)


def test_nothing_that_is_sent_in_a_blackout_arrives() -> None:
    found = {packet for _, packet in arrivals(ChannelParameters(delay=0.1), [(1.0, 3.0)])}
    assert found == {*range(1000), *range(3000, 4000)}


def test_the_same_seed_gives_the_same_network() -> None:
    parameters = ChannelParameters(delay=0.02, jitter=0.01, loss=0.3, duplication=0.1)
    assert arrivals(parameters) == arrivals(parameters)


def test_a_channel_says_when_to_look_again() -> None:
    channel = Channel[str](ChannelParameters(delay=0.02, duplication=1.0), seed=1)
    assert (channel.travelling, channel.next_arrival) == ([], np.inf)
    channel.send("first", now=1.0)
    channel.send("second", now=1.01)
    assert (len(channel.travelling), channel.next_arrival) == (4, pytest.approx(1.02))
    channel.arrived(now=1.025)
    assert (len(channel.travelling), channel.next_arrival) == (2, pytest.approx(1.03))


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("LocalHost", True),
        ("robot.lab", False),
        ("0.0.0.0", False),
        ("", False),
    ],
)
def test_loopback(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


@pytest.mark.parametrize(
    ("peer", "expected"),
    [
        ("robot", ("robot", 0)),
        ("10.0.0.2:9000", ("10.0.0.2", 9000)),
        ("robot.lab:1", ("robot.lab", 1)),
        ("fd00::2", ("fd00::2", 0)),
        ("[fd00::2]:7447", ("fd00::2", 7447)),
    ],
)
def test_a_peer_is_a_host_with_or_without_a_port(peer: str, expected: tuple[str, int]) -> None:
    assert host_and_port(peer) == expected
