# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from haptic_accel.links.addresses import Route
from haptic_accel.links.hearing import SILENCE, Hearing, advice


def test_the_peer_is_reported_once_when_it_is_heard_and_once_when_it_is_not() -> None:
    hearing = Hearing("peer robot", "check it", 0.0)
    assert hearing.line(SILENCE - 0.1) == ""
    assert hearing.line(SILENCE) == "peer robot: nothing heard for 5 s; check it"
    assert hearing.line(3 * SILENCE) == ""
    hearing.heard += 1
    assert hearing.line(20.0) == "peer robot is heard"
    hearing.heard += 1
    assert hearing.line(24.0) == ""
    assert hearing.line(28.9) == ""
    assert hearing.line(29.0).startswith("peer robot: nothing heard")


def test_advice_names_addresses_ports_side_and_transport() -> None:
    text = advice(Route("robot", "10.0.0.1", "10.0.0.2", 7300, 7301), "master", "dds")
    for word in ("10.0.0.1", "10.0.0.2", "7300/udp", "7301/udp", "side:=slave", "transport:=dds"):
        assert word in text
    assert "\n" not in text
