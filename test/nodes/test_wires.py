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

from haptic_accel.nodes.wires import Wire, Wires


def test_each_receiver_is_told_whoever_was_there_first() -> None:
    wire = Wire()
    before: list[bool] = []
    after: list[bool] = []
    wire.join(before.append)
    wire.offer()
    wire.join(after.append)
    assert (before, after) == ([False, True], [True])
    assert wire.listeners == 2


def test_a_signal_left_to_others_comes_as_messages_and_who_has_left_is_told_nothing() -> None:
    wire = Wire()
    told: list[bool] = []
    take = told.append
    wire.join(take)
    wire.offer()
    wire.withdraw()
    assert (told, wire.listeners) == ([False, True, False], 0)
    wire.offer()
    wire.leave(take)
    wire.withdraw()
    assert (told[3:], wire.listeners) == ([True], 0)


def test_only_nodes_that_are_to_share_a_process_share_wires() -> None:
    wires = Wires()
    alone = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is not alone
    wires.joined = True
    shared = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is shared
    assert wires.of("/left/master/measured_cp") is not shared
