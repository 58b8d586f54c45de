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

"""A leader with a coil: everything of the leader's own passes through, whatever the coil does."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from kits.lerobot.plug_ins import PlugIns, child, children, plug_ins

from haptic_accel.devices import DeviceError
from running import wait_until

pytestmark = pytest.mark.quiet


@pytest.fixture(scope="module")
def built() -> Iterator[PlugIns]:
    with plug_ins() as found:
        yield found


def test_a_leader_is_built_by_its_name_and_passes_everything_through(built: PlugIns) -> None:
    leader = built.leader()
    assert isinstance(leader, built.teleoperators.Teleoperator)
    assert (leader.name, leader.id) == ("haptic_accel", "felt")
    assert leader.action_features == {"joint.pos": float}
    assert leader.feedback_features == {"joint.force": float}
    assert not leader.is_connected
    assert not leader.is_calibrated
    leader.connect(calibrate=False)
    try:
        assert leader.is_connected
        leader.calibrate()
        leader.configure()
        assert leader.is_calibrated
        assert leader.get_action() == {"joint.pos": 0.25}
        leader.send_feedback({"joint.force": 1.5})
    finally:
        leader.disconnect()
    assert not leader.is_connected
    expected = [("connect", False), "calibrate", "configure", {"joint.force": 1.5}, "disconnect"]
    assert leader.calls == expected  # an attribute that only the plain leader has
    with pytest.raises(AttributeError):
        leader.nothing  # noqa: B018


def test_a_leader_can_be_connected_again(built: PlugIns, caplog: pytest.LogCaptureFixture) -> None:
    leader = built.leader()
    for _ in range(2):
        leader.connect()
        assert leader.get_action() == {"joint.pos": 0.25}
        leader.disconnect()
    assert [call for call in leader.calls if call == "disconnect"] == ["disconnect"] * 2
    assert caplog.text.count("fast path: simulated") == 2


def test_a_leader_goes_on_without_its_fast_path_and_tells_it_once(
    built: PlugIns, caplog: pytest.LogCaptureFixture
) -> None:
    leader = built.leader()
    leader.connect()
    try:
        process = child("felt_loop")
        caplog.clear()
        os.kill(process, signal.SIGKILL)
        wait_until(lambda: leader.get_action() and caplog.records, "warning")
        for _ in range(5):
            assert leader.get_action() == {"joint.pos": 0.25}
        assert leader.is_connected
    finally:
        leader.disconnect()
    told = [each.getMessage() for each in caplog.records if each.levelno >= logging.WARNING]
    assert told == ["fast path: ended with status -9; the arms go on without vibration"]
    assert leader.calls[-1] == "disconnect"


@pytest.mark.parametrize("device", [PlugIns.leader, PlugIns.follower])
def test_a_device_that_fails_to_disconnect_ends_the_fast_path_all_the_same(
    built: PlugIns, device: Callable[..., Any]
) -> None:
    arm = device(built, broken=True)
    arm.connect()
    with pytest.raises(ConnectionError, match="the arm is gone"):
        arm.disconnect()
    assert children("felt_loop") == []
    assert not arm.is_connected


def test_a_leader_that_does_not_connect_leaves_no_fast_path(
    built: PlugIns, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    leader = built.leader()
    processes = []

    def refuse(calibrate: bool = True) -> None:
        processes.append(child("felt_loop"))
        raise ConnectionError("no such port")

    monkeypatch.setattr(leader.wrapped, "connect", refuse)
    with pytest.raises(ConnectionError, match="no such port"):
        leader.connect()
    assert not Path(f"/proc/{processes[0]}").exists()
    assert not leader.is_connected


def test_a_fast_path_that_does_not_start_leaves_the_leader_alone(built: PlugIns) -> None:
    leader = built.leader("master:=none")
    with pytest.raises(DeviceError, match="^fast path: device = none: must come with"):
        leader.connect()
    assert leader.calls == []
    assert not leader.is_connected
