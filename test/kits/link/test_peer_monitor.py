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

from haptic_accel.kits.link.peer_monitor import REPEAT, SILENCE, PeerMonitor, advice
from haptic_accel.links.addresses import Route


def test_the_peer_is_reported_once_when_it_is_heard_and_once_when_it_is_not() -> None:
    hearing = PeerMonitor("peer robot", "check it", "", 0.0)
    assert hearing.lines(SILENCE - 0.1) == []
    assert hearing.lines(SILENCE) == ["peer robot: nothing received for 5 s; check it"]
    assert hearing.lines(3 * SILENCE) == []
    hearing.received += 1
    assert hearing.lines(20.0) == ["peer robot is heard"]
    hearing.received += 1
    assert hearing.lines(24.0) == []
    assert hearing.lines(28.9) == []
    assert hearing.lines(29.0)[0].startswith("peer robot: nothing received")


def test_advice_names_addresses_ports_side_and_transport() -> None:
    text = advice(Route("robot", "10.0.0.1", "10.0.0.2", 7300, 7301), "master", "udp")
    for word in ("10.0.0.1", "10.0.0.2", "7300/udp", "7301/udp", "side:=slave", "transport:=udp"):
        assert word in text
    assert "\n" not in text


def test_strangers_get_one_line_a_minute_however_many_they_are() -> None:
    hearing = PeerMonitor("peer robot", "check it", "mine", 0.0)
    said = []
    for tick in range(round(2.5 * REPEAT)):
        hearing.received += 1
        for number in range(100):
            hearing.refuse(f"10.0.0.{number}")
        said += [line for line in hearing.lines(float(tick)) if "heard" not in line]
        assert hearing.problem
    assert len(said) == 3
    assert said[0] == (
        "datagrams from 10.0.0.99 do not have this link's key: both hosts need folders of one"
        " haptic-accel keys, here keys:=mine; 100 refused"
    )
    assert said[1].endswith("; 6100 refused")
    hearing.lines(2.5 * REPEAT + SILENCE)
    assert hearing.problem == ""
