# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Leader and follower of LeRobot: everything of their own passes, whatever coil and sensor do."""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from kits.lerobot.plug_ins import PlugIns, child, children, connected, plug_ins

from haptic_accel.devices import DeviceError
from haptic_accel.kits import lerobot
from running import wait_until

pytestmark = pytest.mark.quiet


@pytest.fixture(scope="module")
def built() -> Iterator[PlugIns]:
    with plug_ins() as found:
        yield found


def test_every_member_that_lerobot_asks_for_is_named(built: PlugIns) -> None:
    named = Path(lerobot.__file__).read_text()
    bases = (built.teleoperators.Teleoperator, built.robots.Robot)
    asked = {name for base in bases for name in base.__abstractmethods__}
    assert [name for name in sorted(asked) if name not in named] == []


def test_a_configuration_is_not_among_its_own_choices(built: PlugIns) -> None:
    leaders, followers = built.teleoperators.TeleoperatorConfig, built.robots.RobotConfig
    for registry, field in ((leaders, "leader"), (followers, "follower")):
        choice = get_type_hints(registry.get_choice_class("haptic_accel"))[field]
        assert list(choice.get_known_choices()) == [f"plain_{field}"]
        plain = choice.get_choice_class(f"plain_{field}")
        assert choice.get_choice_name(plain) == f"plain_{field}"
        assert choice.default_choice_name() is None


def window(observed: dict[str, Any], axis: str = "z", size: int = 32) -> list[float]:
    """Return the vibration along an axis in an observation."""
    return [observed[f"vibration.{axis}.{sample}"] for sample in range(size)]


def test_a_follower_is_built_by_its_name_and_passes_everything_through(built: PlugIns) -> None:
    follower = built.follower()
    assert isinstance(follower, built.robots.Robot)
    assert (follower.name, follower.id) == ("haptic_accel", "felt")
    assert follower.action_features == {"joint.pos": float}
    assert len(follower.cameras) == 0
    with connected(follower):
        assert follower.is_connected
        assert follower.get_observation()["joint.pos"] == 0.5
        assert follower.send_action({"joint.pos": 0.1}) == {"joint.pos": 0.75}
    assert follower.calls == [("connect", True), {"joint.pos": 0.1}, "disconnect"]


@pytest.mark.parametrize(("arm", "kind"), [("leader", "teleoperator"), ("follower", "robot")])
def test_motors_without_their_package_are_refused_in_one_line(
    built: PlugIns, arm: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(_: object) -> None:
        raise ModuleNotFoundError("No module named 'scservo_sdk'")

    module = sys.modules[f"lerobot_{kind}_haptic_accel"]
    monkeypatch.setattr(module, f"make_{kind}_from_config", missing)
    with pytest.raises(SystemExit, match=rf"\.{arm}: .*'scservo_sdk'; .*'lerobot\[feetech\]'$"):
        getattr(built, arm)()


def test_features_are_those_of_observations_and_known_before(built: PlugIns) -> None:
    sizes = {30: 32, 60: 16, 24: 40}
    followers = [built.follower(fps=fps) for fps in sizes]
    known = [follower.observation_features for follower in followers]
    with connected(*followers):  # which share one fast path
        observations = [follower.get_observation() for follower in followers]
    for size, features, observed in zip(sizes.values(), known, observations, strict=True):
        keys = [f"vibration.z.{each}" for each in range(size)]
        assert list(features) == ["joint.pos", *keys, "vibration.valid"]
        assert set(features.values()) == {float}
        assert list(observed) == list(features)
        assert {type(value) for value in observed.values()} == {float}


def test_three_axes_follow_each_other(built: PlugIns) -> None:
    follower = built.follower("reduction:=sum")
    keys = [key for key in follower.observation_features if key.startswith("vibration")]
    assert [keys[0], keys[32], keys[95]] == ["vibration.x.0", "vibration.y.0", "vibration.z.31"]
    with connected(follower):
        assert follower.vibration().shape == (32, 3)


def test_a_follower_observes_what_the_leaders_fast_path_measures(built: PlugIns) -> None:
    leader, follower = built.leader(), built.follower()
    leader.connect()
    follower.connect()
    try:

        def strong() -> bool:
            leader.get_action()  # the simulated hand moves once the coil may
            return float(np.std(window(follower.get_observation()))) > 1.0

        wait_until(strong, "texture under the simulated tool")
    finally:
        leader.disconnect()
        assert np.any(window(follower.get_observation()))  # goes on without the leader
        follower.disconnect()


def test_a_follower_whose_fast_path_ends_observes_silence_and_tells_it_once(
    built: PlugIns, caplog: pytest.LogCaptureFixture
) -> None:
    follower = built.follower()
    with connected(follower):
        observed = follower.get_observation()
        assert (np.any(window(observed)), observed["vibration.valid"]) == (True, 1.0)
        process = child("felt_loop")
        caplog.clear()
        os.kill(process, signal.SIGKILL)
        wait_until(lambda: not any(window(follower.get_observation())), "silence")
        observed = follower.get_observation()
        assert (observed["joint.pos"], observed["vibration.valid"]) == (0.5, 0.0)
    assert caplog.text.count("the arms go on without vibration") == 1


@pytest.mark.smoke
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
    with connected(leader):
        process = child("felt_loop")
        caplog.clear()
        os.kill(process, signal.SIGKILL)
        wait_until(lambda: leader.get_action() and caplog.records, "warning")
        for _ in range(5):
            assert leader.get_action() == {"joint.pos": 0.25}
        assert leader.is_connected
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
