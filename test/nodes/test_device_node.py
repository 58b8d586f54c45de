# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device node with a device that remembers what was written to it."""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from haptic_accel.core import topics
from haptic_accel.core.actuator import ARM_PEAK_FORCE, ARM_TIMEOUT, MAX_AGE, ActuatorParameters
from haptic_accel.core.axes import along_actuator
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.coupling import engagement
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices import MASTERS, DeviceError, Sample
from haptic_accel.devices.simulated import SimulatedMaster
from haptic_accel.graph.domain import lock_signal
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.master_device import build_master_device
from haptic_accel.nodes.scheduling import StopPoll
from haptic_accel.nodes.signals import RIVALS_PERIOD
from haptic_accel.nodes.supervised_node import message_type, quality
from haptic_accel.nodes.timing import CATCH_UP, system_time
from running import PATIENCE, wait_until
from sound_cards import NAME, received, sound_card

PERIOD = 1_000_000
"""Period of the default rate, ns."""

DRIVE = (0.1, 0.0, 0.2), 0.3
"""Forces of the arm and of the actuator that drive the device, N."""

STOP = {"arm_force": ZERO, "actuator_force": ZERO}


class Witness(SimulatedMaster):
    """A simulated master that keeps every force written to it."""

    written: list[dict[str, Any]]
    times: list[float]
    broken = ""
    unplugged = False
    lost = False

    def open(self) -> None:
        """Start with nothing written."""
        self.written, self.times = [], []
        self._work()
        super().open()

    def read(self, time: float) -> Sample | None:
        """Give a sample while there is one."""
        self._work()
        if self.unplugged:
            return None
        sample = super().read(time)
        return sample._replace(position=(math.nan,) * 3) if self.lost and sample else sample

    def write(self, time: float, **forces: Any) -> None:
        """Keep the forces with their time, and apply them."""
        self.written.append(forces)
        self.times.append(time)
        super().write(time, **forces)

    def _work(self) -> None:
        if self.broken:
            raise DeviceError(self.broken)


class Bench:
    """A master device, and another node that sends to it."""

    def __init__(self) -> None:
        self.node = build_master_device()
        self.loop = join([self.node])
        self.loop.begin()
        self.stop_poll = StopPoll([self.loop])
        self.other = GraphNode("coupler")
        self.other.task = "commands"
        self.executor = SingleThreadedExecutor()
        for node in (self.node, self.other):
            self.executor.add_node(node)
        self._arm = self.other.sender(topics.MASTER_ARM_FORCE)
        self._actuator = self.other.sender(topics.ACTUATOR_FORCE)
        self._stop = self.other.publisher(topics.EMERGENCY_STOP)
        self.answers: list[bool] = []
        self.other.listen_state(topics.MASTER_STOPPED, self.answers.append)

    @property
    def device(self) -> Witness:
        assert isinstance(self.node.device, Witness)
        return self.node.device

    @property
    def written(self) -> list[dict[str, Any]]:
        """Commands that were written to the device so far."""
        return self.device.written

    def wrote(self, name: str, force: Any, first: int = 0) -> bool:
        """Return whether a force was written to the device."""
        return any(forces.get(name) == force for forces in self.written[first:])

    def until(self, condition: Callable[[], bool]) -> None:
        """Let both nodes run until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, (self.written[-3:], self.answers)
            self.turn(0.001)

    def turn(self, seconds: float = 0.0) -> None:
        """Let both nodes do what is due."""
        while self.stop_poll.after_work(self.loop.work()) <= time.monotonic():
            pass
        self.executor.spin_once(timeout_sec=seconds)

    def command(self, arm: Vector, actuator: float, age: float = 0.0) -> None:
        """Send a force to the arm and one to the actuator, made of samples of an age in s."""
        moment = time.time_ns() - round(age * 1e9)
        self._arm.send(moment, arm)
        self._actuator.send(moment, along_actuator(actuator))

    def drive(self, times: int = 1) -> None:
        """Send forces a few times, and let both nodes do what is due after each."""
        for _ in range(times):
            self.command(*DRIVE)
            self.turn()

    def send_actuator(self, stamp: int, force: float) -> None:
        """Send a force to the actuator, made of a sample with a stamp, ns."""
        self._actuator.send(stamp, along_actuator(force))

    def warned(self, *of: str, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Wait until the node's status has warned of something; do something meanwhile."""
        said: list[str] = []

        def found() -> bool:
            meanwhile()
            said.append(self.node.diagnostics()[0])
            return all(any(words in warning for warning in said) for words in of)

        self.until(found)

    def change_state(self, transition: str = "", number: int = 0) -> bool:
        """Ask for a transition as `ros2 lifecycle set` does."""
        request = ChangeState.Request()
        request.transition.label, request.transition.id = transition, number
        return bool(self.call(ChangeState, "master_device/change_state", request).success)

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Call a service of the node."""
        client = self.other.create_client(kind, service)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        self.other.destroy_client(client)
        return future.result()

    def driven(self) -> None:
        """Send commands until both have come."""
        before = len(self.written)

        def both() -> bool:
            self.command(*DRIVE)
            names = {name for forces in self.written[before:] for name in forces}
            return names == {"arm_force", "actuator_force"}

        self.until(both)

    def stop(self, *, driven: bool = False) -> None:
        """Publish the emergency stop, and wait for the answer; drive meanwhile."""
        known = len(self.answers)
        self.say(True)

        def answered() -> bool:
            if driven:
                self.command(*DRIVE)
            return self.answers[known:][-1:] == [True]

        self.until(answered)

    def say(self, word: bool) -> None:
        """Publish a word on the topic of the emergency stop."""
        self._stop.publish(Bool(data=word))

    def release(self) -> str:
        """Ask for the release; return why it is refused, empty if it is granted."""
        answer = self.call(SetBool, "master_device/estop", SetBool.Request(data=False))
        return "" if answer.success else str(answer.message)

    def released(self) -> None:
        """Withdraw the stop, and ask for the release until it is granted."""
        self.say(False)
        self.until(lambda: not self.release())
        self.until(lambda: self.answers[-1:] == [False])

    def close(self) -> None:
        """End both nodes."""
        self.executor.shutdown()
        for node in (self.node, self.other):
            node.destroy_node()


@pytest.fixture
def bench(
    domain: int, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> Iterator[Bench]:
    """Give a master device that is past its first moments, with parameters name:=value."""
    monkeypatch.setitem(MASTERS, "simulated", Witness)
    monkeypatch.setattr(engagement, "LATCHED_SETTLING", 0.0)
    given = [word for value in getattr(request, "param", ()) for word in ("-p", value)]
    rclpy.init(args=["--ros-args", *given] if given else None)
    bench = Bench()
    yield bench
    bench.close()
    rclpy.shutdown()


def test_the_first_command_after_a_stop_is_zero_and_there_is_no_other(bench: Bench) -> None:
    bench.driven()
    before = len(bench.written)
    bench.stop()
    assert STOP in bench.written[before:]
    stopped = len(bench.written)
    bench.drive(50)
    bench.stop()
    again = bench.written[stopped:]
    assert STOP in again, "the second stop writes zero again"
    assert all(forces == STOP for forces in again), "and nothing else"
    bench.until(lambda: bench.answers[-3:] == [True, True, True])
    assert bench.node.diagnostics()[0].startswith("emergency stop")
    refused = "/coupler published true on the topic, or may have: let it publish false, or end it"
    assert bench.release() == refused
    bench.released()
    assert "emergency stop" not in bench.node.diagnostics()[0]
    bench.driven()


def test_forces_are_taken_off_without_a_stop_while_the_device_is_open(bench: Bench) -> None:
    bench.driven()
    bench.node.take_forces_off()
    assert bench.written[-1] == STOP
    bench.driven()


def test_a_display_gets_positions_as_joints_of_the_description(bench: Bench) -> None:
    states: list[JointState] = []
    positions: dict[int, Vector] = {}
    bench.other.listen(topics.MASTER_POSITION, positions.__setitem__)
    joints = topics.JOINT_STATES.name
    shown = bench.other.create_subscription(JointState, joints, states.append, 10)
    bench.until(lambda: len(states) >= 5)
    bench.other.destroy_subscription(shown)
    stamps = [state.header.stamp.sec * 10**9 + state.header.stamp.nanosec for state in states]
    assert min(np.diff(stamps)) > 19 * PERIOD
    bench.until(lambda: stamps[-1] in positions)
    for stamp, state in zip(stamps, states, strict=True):
        assert list(state.name) == ["master_x", "master_y", "master_z"]
        # The first came perhaps before anybody listened to positions.
        assert tuple(state.position) == positions.get(stamp, tuple(state.position))


def test_a_subscriber_gets_the_work_of_the_forces_that_were_applied(bench: Bench) -> None:
    positions: dict[int, Vector] = {}
    works: dict[int, Vector] = {}
    bench.other.listen(topics.MASTER_POSITION, positions.__setitem__)
    bench.other.listen(topics.MASTER_WORK, works.__setitem__)
    bench.until(lambda: bool(works))
    force, full = (0.1, 0.0, 0.2), 0
    while full < 5:
        bench.command(force, 0.0)
        bench.turn(0.001)
        stamps = sorted(positions.keys() & works.keys())
        for before, now in itertools.pairwise(stamps):
            if now - before > 1.5 * PERIOD:
                continue
            moved = np.subtract(positions[now], positions[before])
            done = np.subtract(works[now], works[before])
            most = moved * force
            assert np.all(np.abs(done) <= np.abs(most) + 1e-12)
            full += bool(np.any(most)) and done == pytest.approx(most, rel=1e-6, abs=1e-15)
    for transition in ("deactivate", "cleanup", "configure"):
        assert bench.change_state(transition)
    bench.until(lambda: works[max(works)] == ZERO)  # no force since the device was opened


def test_subscribers_of_either_reliability_get_the_samples(bench: Bench) -> None:
    received: dict[bool, list[Any]] = {True: [], False: []}
    for reliable, messages in received.items():
        topic = replace(topics.MASTER_POSITION, reliable=reliable)
        kind, keeping = message_type(topic), quality(topic)
        bench.other.create_subscription(kind, topic.name, messages.append, keeping)
    bench.until(lambda: all(received.values()))


def test_a_command_that_a_second_node_publishes_too_is_refused_meanwhile(bench: Bench) -> None:
    bench.driven()
    force = topics.ACTUATOR_FORCE
    second = rclpy.create_node("second")
    publisher = second.create_publisher(message_type(force), force.name, quality(force))
    bench.warned("actuator force: no force while it is sent by /coupler and /second")
    bench.command(*DRIVE)
    before = len(bench.written)

    def goes_on() -> bool:
        bench.command(*DRIVE)
        written = [forces.get("arm_force") for forces in bench.written[before:]]
        return written.count((0.1, 0.0, 0.2)) > 20

    bench.until(goes_on)
    assert not any(any(forces.get("actuator_force", ZERO)) for forces in bench.written[before:])
    second.destroy_publisher(publisher)
    bench.driven()
    second.destroy_node()


RIVAL = (0.0, 0.7, -0.5)
"""Force in N, or position in m, that nobody else sends."""

POSITION_COMMAND = topics.MASTER.topic("servo_cp", topics.MASTER_POSITION.type)


COMMANDS = [topics.ACTUATOR_FORCE, topics.MASTER_ARM_FORCE, POSITION_COMMAND]


@pytest.mark.parametrize("seen", [False, True])
@pytest.mark.parametrize("command", COMMANDS, ids=lambda topic: topic.name)
def test_no_message_of_a_publisher_that_has_left_is_applied(
    bench: Bench, command: topics.Topic, *, seen: bool
) -> None:
    rival = rclpy.create_node("rival")
    try:
        for _ in range(5):
            bench.driven()
            before = len(bench.written)
            _burst(bench, rival, command, 2.5 * RIVALS_PERIOD if seen else 0.0)
            bench.driven()
            for forces in bench.written[before:]:
                assert forces.get("arm_force", ZERO) in (ZERO, (0.1, 0.0, 0.2))
                assert forces.get("actuator_force", ZERO) in (ZERO, along_actuator(0.3))
        dropped = int(bench.node.diagnostics()[1]["commands of several senders"])
        # Nobody has looked for an unseen publisher of positions yet.
        assert dropped > 0 or (command is POSITION_COMMAND and not seen)
    finally:
        rival.destroy_node()


def _burst(bench: Bench, rival: Node, command: topics.Topic, seen_for: float) -> None:
    """Send a few messages from a new publisher, which has left when the device next looks.

    The device may have seen it for a time, s, before.
    """
    publisher = rival.create_publisher(message_type(command), command.name, quality(command))
    wait_until(lambda: publisher.get_subscription_count() > 0, "the device's subscription")
    until = time.monotonic() + seen_for
    while time.monotonic() < until:
        bench.turn(0.001)
    for _ in range(3):
        publisher.publish(StampedVector(command).pack(time.time_ns(), RIVAL))
    rival.destroy_publisher(publisher)
    wait_until(lambda: bench.node.count_publishers(command.name) < 2, "the rival has left")


def test_a_stopped_coupler_stops_and_releases_first(bench: Bench) -> None:
    coupler = bench.other.publisher(topics.COUPLER_STOPPED)
    coupler.publish(Bool(data=True))
    bench.until(lambda: bench.answers[-1:] == [True])
    assert bench.release() == "the coupler is stopped: release it by its service estop"
    coupler.publish(Bool(data=False))
    bench.until(lambda: not bench.release())
    bench.driven()


def test_no_force_is_applied_before_it_is_known_whether_there_is_a_stop(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engagement, "LATCHED_SETTLING", PATIENCE)
    taken = time.monotonic() + 20 * ARM_TIMEOUT
    while time.monotonic() < taken:
        bench.drive()
    assert all(forces in (STOP, {}) for forces in bench.written)
    assert bench.answers == []
    assert bench.release() == "has just started: ask again in a second"
    monkeypatch.setattr(engagement, "LATCHED_SETTLING", 0.0)
    bench.driven()
    bench.until(lambda: bench.answers[:2] == [False, False])


def test_nothing_unsafe_reaches_the_device(bench: Bench) -> None:
    bench.driven()
    before = len(bench.written)

    def cut() -> bool:
        bench.command((30.0, 0.0, 0.0), -1e9)
        return bench.wrote("arm_force", (ARM_PEAK_FORCE, 0.0, 0.0), before)

    bench.until(cut)
    for wrong in (math.nan, math.inf):
        bench.command((0.0, wrong, 0.0), wrong)
    bench.warned("arm force not finite", "actuator force not finite")
    bench.driven()
    # More than one: where a newer force waits too, that one counts.
    bench.warned(
        *("arm force out of date", "actuator force out of date"),
        meanwhile=lambda: bench.command((0.5, 0.0, 0.0), 0.5, age=2 * MAX_AGE),
    )
    for forces in bench.written[before:]:
        assert math.hypot(*forces.get("arm_force", ZERO)) <= ARM_PEAK_FORCE * 1.000001
        assert math.hypot(*forces.get("actuator_force", ZERO)) <= ActuatorParameters.peak_force
    assert not bench.wrote("arm_force", (0.5, 0.0, 0.0))
    bench.driven()


@pytest.mark.parametrize("bench", [("safety.recovery:=manual",)], indirect=True)
def test_where_recovery_is_manual_a_service_arms(bench: Bench) -> None:
    bench.driven()
    bench.warned("not armed: arm force: none for 20 ms, actuator force: none for 5 ms")
    before = len(bench.written)
    bench.drive(20)
    assert bench.written[before:] == []
    answer = bench.call(Trigger, "master_device/arm", Trigger.Request())
    assert (answer.success, answer.message) == (True, "armed")
    bench.driven()
    bench.stop()
    answer = bench.call(Trigger, "master_device/arm", Trigger.Request())
    assert (answer.success, answer.message) == (False, "emergency stop")


def test_no_forces_are_allowed_while_the_device_applies_none(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shown(name: str) -> list[float]:
        values = bench.node.diagnostics()[1]
        return [float(value) for key, value in values.items() if key.endswith(f" {name} (N)")]

    def driven() -> bool:
        bench.command(*DRIVE)
        return all(shown("held"))

    bench.until(driven)
    assert bench.node.diagnostics()[1]["forces allowed"] == "true"
    disarmed = property(lambda _: "board: not armed since it was gone")
    monkeypatch.setattr(type(bench.node.device), "problem", disarmed)
    warning, values = bench.node.diagnostics()
    assert "board: not armed" in warning
    assert values["forces allowed"] == "false"
    assert not shown("held")
    assert len(shown("last given")) == 2
    assert all(shown("last given"))


def test_a_report_has_the_counts_up_to_now(bench: Bench) -> None:
    bench.driven()
    ask = ("master_device/report", Trigger.Request())
    counts = [json.loads(bench.call(Trigger, *ask).message) for _ in range(2)]
    due = [int(each["actuator force due"]) for each in counts]
    assert 0 < due[0] <= due[1]
    assert float(counts[1]["actuator force late (s)"]) >= 0.0


@pytest.mark.parametrize(
    ("bench", "refusal"),
    [
        (("device:=pointer",), ""),
        (("device:=serial", "serial.port:=/dev/none", "autostart:=false"), "the device is serial"),
    ],
    indirect=["bench"],
)
def test_the_parameters_of_another_device_are_changed_where_they_are_used(
    bench: Bench, refusal: str
) -> None:
    posture = Parameter("simulated.grip.posture", value="hook").to_parameter_msg()
    request = SetParameters.Request(parameters=[posture])
    (result,) = bench.call(SetParameters, "master_device/set_parameters", request).results
    assert result.successful == (not refusal)
    assert refusal in result.reason


@pytest.mark.parametrize("bench", [("autostart:=false",)], indirect=True)
def test_states_open_enable_and_close_the_device(bench: Bench) -> None:
    def state() -> str:
        answer = bench.call(GetState, "master_device/get_state", GetState.Request())
        return str(answer.current_state.label)

    def possible() -> set[str]:
        request = GetAvailableTransitions.Request()
        service = "master_device/get_available_transitions"
        found = bench.call(GetAvailableTransitions, service, request).available_transitions
        return {item.transition.label for item in found}

    heard: list[int] = []
    bench.other.listen(topics.HANDLE_ACCELERATION, lambda moment, _: heard.append(moment))
    assert state() == "unconfigured"
    assert possible() == {"configure", "shutdown"}
    assert "not active" in bench.node.diagnostics()[0]
    bench.stop()
    bench.released()
    # What cannot be from here ends nothing.
    assert not bench.change_state("activate")
    assert not bench.change_state(number=99)
    assert not heard
    assert bench.change_state("configure")
    assert state() == "inactive"
    bench.until(lambda: len(heard) > 10)
    bench.drive(20)
    assert bench.written == [], "read, but not moved"
    assert bench.change_state("activate")
    bench.driven()
    assert bench.change_state("deactivate")
    assert bench.written[-1] == STOP
    assert bench.change_state("cleanup")
    count = bench.node.rate_keeper.ticks
    first = bench.node.device
    # Again, and with a device that does not work.
    Witness.broken = "no such board"
    try:
        assert not bench.change_state("configure")
    finally:
        Witness.broken = ""
    assert state() == "unconfigured"
    assert bench.node.rate_keeper.ticks in (0, count)
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    assert bench.node.device is not first
    bench.driven()
    assert bench.change_state("shutdown")
    assert bench.node.finished.done()


def test_a_device_that_fails_is_left_without_force_until_configured_again(bench: Bench) -> None:
    bench.driven()
    device = bench.device
    device.unplugged = True
    bench.warned("no sample")
    device.unplugged = False
    device.broken = "the cable is out"
    bench.until(lambda: bench.node.state == "unconfigured")
    assert device.written[-1] == STOP
    written = len(device.written)
    bench.drive(20)
    assert len(device.written) == written
    assert bench.change_state("configure")
    assert bench.change_state("activate")
    bench.driven()


def test_a_position_that_is_no_number_is_told(bench: Bench) -> None:
    bench.driven()
    device = bench.device
    assert "position" not in bench.node.diagnostics()[0]
    device.lost = True
    bench.warned("position is not finite")
    device.lost = False
    bench.until(lambda: "position is not finite" not in bench.node.diagnostics()[0])
    assert int(bench.node.diagnostics()[1]["positions not finite"]) > 0


def test_a_stall_loses_no_sample_and_each_has_its_own_stamp(bench: Bench) -> None:
    stamps: list[int] = []
    bench.other.listen(topics.HANDLE_ACCELERATION, lambda stamp, _: stamps.append(stamp))
    bench.until(lambda: len(stamps) > 20)

    def complete() -> bool:
        first, missed = len(stamps), bench.node.diagnostics()[1]["missed ticks"]
        time.sleep(CATCH_UP / 2)
        bench.until(lambda: len(stamps) > first + 60)
        steps = np.diff(stamps[first - 1 :])
        whole = bool(np.all(np.abs(steps - PERIOD) < PERIOD / 4))
        return whole and bench.node.diagnostics()[1]["missed ticks"] == missed

    # Again where the machine made it a longer one, of which samples are lost.
    wait_until(complete, "no sample is lost")


def test_a_force_is_applied_at_the_tick_after_that_of_its_sample(bench: Bench) -> None:
    bench.driven()
    device = bench.device
    force = along_actuator(0.77)

    def in_time() -> bool:
        before = len(bench.written)
        past = bench.node.diagnostics()[1]["actuator force past their tick"]
        # Far enough ahead to arrive in time, unless the machine is very busy.
        cause = round(time.monotonic() / PERIOD * 1e9) + 50
        bench.send_actuator(system_time(bench.node.rate_keeper.time(cause)), 0.77)
        due = (cause + 1) * PERIOD / 1e9
        late = due + 1.0
        bench.until(
            lambda: bench.wrote("actuator_force", force, before) or time.monotonic() > late
        )
        if bench.node.diagnostics()[1]["actuator force past their tick"] != past:
            return False
        written = zip(bench.written[before:], device.times[before:], strict=True)
        times = [when for forces, when in written if forces.get("actuator_force") == force]
        assert times[:1] in ([], [pytest.approx(due, abs=1e-9)])
        return bool(times)

    wait_until(in_time, "a force in time")


# With the actuator behind a sound card


@pytest.fixture
def card(tmp_path: Path) -> Iterator[Path]:
    """Give the folder in which a sound card leaves what it gets."""
    with sound_card(tmp_path):
        yield tmp_path


AUDIO = ("actuator_device:=audio", f"audio.device:={NAME}")


@pytest.mark.parametrize("bench", [(*AUDIO, "latency:=5")], indirect=True)
def test_a_sound_card_plays_the_force_until_the_stop(card: Path, bench: Bench) -> None:
    def applied() -> bool:
        bench.command(ZERO, 0.33)
        return int(bench.node.diagnostics()[1]["actuator force count"]) > 50

    bench.until(applied)
    bench.stop(driven=True)
    silent = time.monotonic() + 0.05
    bench.until(lambda: time.monotonic() > silent)
    bench.node.close()
    signal = received(card)[:, 0]
    assert signal.max() == pytest.approx(0.33 / ActuatorParameters().peak_force)
    assert signal[-1] == 0.0


def test_a_latency_too_small_for_the_sound_card_ends_the_node(card: Path, domain: int) -> None:
    rclpy.init(args=["--ros-args", *(word for value in AUDIO for word in ("-p", value))])
    try:
        with pytest.raises(ParameterError, match="latency = 1: must be at least 5"):
            build_master_device()
        lock_signal(domain, f"/{topics.MASTER_POSITION.name}").close()  # left to others
    finally:
        rclpy.shutdown()
