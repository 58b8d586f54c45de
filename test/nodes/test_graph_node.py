# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import signal
import struct
import time
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces import srv
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rclpy.clock import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Bool

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.model import Vector
from haptic_accel.core.topics import (
    ACTUATOR_FORCE,
    COUPLER_STOPPED,
    DIAGNOSTICS,
    EMERGENCY_STOP,
    MASTER_STOPPED,
    MASTER_WORK,
    SIGNALS,
    SLAVE_POSITION,
    SLAVE_STOPPED,
    VECTORS,
    Topic,
    reporter,
)
from haptic_accel.materials.folders import preset_file
from haptic_accel.nodes.graph_node import Endpoint, GraphNode, rivals
from haptic_accel.nodes.supervised_node import message_type, quality
from haptic_accel.setup.files import surface_parameters
from observing import Observer
from running import PATIENCE, Command, Start, nodes_of, wait_until
from sharing import own_domain

numbers = st.floats(allow_nan=False)
frames = st.text(st.characters(codec="ascii", exclude_characters="\0"))
of_each_type = {topic.type: topic for topic in (*SIGNALS, MASTER_WORK)}
one_of_each_type = st.sampled_from(list(of_each_type.values()))


@given(
    st.builds(replace, one_of_each_type, frame=frames),
    st.integers(0, 2**31 * 10**9 - 1),
    st.tuples(numbers, numbers, numbers),
)
def test_ros_reads_what_is_packed_and_what_it_writes_is_unpacked(
    topic: Topic, stamp: int, vector: Vector
) -> None:
    packed = StampedVector(topic).pack(stamp, vector)
    message = deserialize_message(packed, message_type(topic))
    assert message.header.frame_id == topic.frame
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    part = attrgetter(VECTORS[topic.type])(message)
    assert (part.x, part.y, part.z) == vector
    assert unpack_stamped_vector(serialize_message(message)) == (stamp, vector)


LITTLE_ENDIAN, ANOTHER = bytes([0, 1, 0, 0]), bytes([0, 7, 0, 0])

GARBAGE = (
    b"",
    b"\0",
    LITTLE_ENDIAN,
    LITTLE_ENDIAN + bytes(8) + struct.pack("<I", 2**32 - 1) + bytes(100),  # a frame of 4 GB
    ANOTHER + bytes(124),
    bytes(4) + struct.pack("<iII4s7d", 1, 0, 4, b"arm", *[1.0] * 7),  # in the other byte order
)

STATES = (EMERGENCY_STOP, COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED)


class Node:
    """A device node of the slave that runs, and a client of its parameters as ros2cli has one."""

    def __init__(self, command: Command, observer: Observer) -> None:
        self.command = command
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, "slave_device")
        assert self._client.wait_for_services(PATIENCE)

    def load(self, path: Path) -> list[SetParametersResult]:
        """Set the parameters of a file as `ros2 param load` does, and return what it prints."""
        return list(self._answer(self._client.load_parameter_file(str(path), True)).results)

    def set(self, name: str, value: object) -> str:
        """Set a parameter as `ros2 param set` does; return why that is refused."""
        future = self._client.set_parameters([Parameter(name, value=value)])
        (result,) = self._answer(future).results
        assert result.successful is not bool(result.reason)
        return str(result.reason)

    def ask(self, kind: Any, **fields: Any) -> Any:
        """Return the response of one of its parameter services to a request."""
        services = {
            srv.DescribeParameters: "describe_parameters",
            srv.GetParameters: "get_parameters",
            srv.GetParameterTypes: "get_parameter_types",
            srv.SetParameters: "set_parameters",
            srv.SetParametersAtomically: "set_parameters_atomically",
        }
        return self._observer.call(kind, f"slave_device/{services[kind]}", kind.Request(**fields))

    def values(self) -> dict[str, Any]:
        """Return all parameters as `ros2 param dump` writes them."""
        names = self._answer(self._client.list_parameters()).result.names
        found = self._answer(self._client.get_parameters(names)).values
        return dict(zip(names, map(parameter_value_to_python, found), strict=True))

    def constraints(self, *names: str) -> list[str]:
        """Return what `ros2 param describe` shows as additional constraints."""
        future = self._client.describe_parameters(list(names))
        return [each.additional_constraints for each in self._answer(future).descriptors]

    def _answer(self, future: Any) -> Any:
        self._observer.executor.spin_until_future_complete(future, PATIENCE)
        assert future.done(), self.command.text
        return future.result()


def keyed(key: str, values: dict[str, Any]) -> str:
    """Return a parameter file with one key."""
    return str(yaml.safe_dump({key: {"ros__parameters": values}}))


@pytest.fixture(scope="module")
def slave(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Node]:
    """Start a device node of the slave for tests of its parameters, which may have any values."""
    with own_domain() as number:
        words = ["-m", "haptic_accel.nodes.slave_device"]
        command, observer = Command(words, tmp_path_factory.mktemp("slave")), Observer(number)
        yield Node(command, observer)
        assert command.end(signal.SIGINT) == 0, command.text
        observer.close()


def test_a_surface_is_loaded_whole_or_not_at_all(slave: Node, tmp_path: Path) -> None:
    # rclpy passes 9e-06 on as text, and would set one parameter after the other.
    for name in ("text", "plywood", "vinyl"):
        assert all(result.successful for result in slave.load(preset_file("surface", name)))
        expected = surface_parameters(name)
        assert {key: slave.values()[key] for key in expected} == expected
    before = slave.values()
    file = tmp_path / "mine.yaml"
    for key in ("slave_device", "/slave_device", "/**"):
        for wrong, named in (
            ({"friction": -1}, "simulated.surface.friction = -1"),
            ({"stifness": 1}, "simulated.surface.stifness: slave_device has no such parameter"),
        ):
            surface = {"name": "mine", "friction": 0.9, **wrong}
            file.write_text(keyed(key, {"simulated": {"surface": surface}}))
            results = slave.load(file)
            assert not any(result.successful for result in results)
            assert all(named in result.reason for result in results), results
    assert slave.values() == before


def test_a_device_node_has_the_parameters_of_its_devices_alone(slave: Node) -> None:
    found = {name.partition(".")[0] for name in slave.values() if "." in name}
    assert found == {"simulated", "safety", "servo_cp"}
    for name, value in (("virtual.scene", "worktop"), ("can.channel", "can0")):
        assert slave.set(name, value) == f"{name}: the device is simulated"


def test_what_is_dumped_can_be_loaded(slave: Node, tmp_path: Path) -> None:
    # Most of it is read-only.
    file, before = tmp_path / "slave_device.yaml", slave.values()
    file.write_text(keyed("/slave_device", before))
    assert all(result.successful for result in slave.load(file))
    assert slave.values() == before
    before["simulated.surface.friction"] = 0.7
    file.write_text(keyed("/slave_device", before))
    assert all(result.successful for result in slave.load(file))
    assert slave.values() == before
    file.write_text(keyed("/slave_device", before | {"rate": 500.0}))
    reasons = {result.reason for result in slave.load(file)}
    assert reasons == {"rate = 500.0: must stay 1000.0 while the node runs"}


@pytest.mark.quiet
def test_only_this_machines_clock_is_taken(slave: Node, start: Start) -> None:
    reason = "use_sim_time = True: must be false: simulated time is not supported"
    assert slave.set("use_sim_time", False) == ""
    assert slave.set("use_sim_time", True).startswith(reason)
    assert not slave.values()["use_sim_time"]
    for executable in ("coupler", "scope"):
        words = ["-m", f"haptic_accel.nodes.{executable}", "--ros-args", "-p"]
        refused = start(*words, "use_sim_time:=true")
        assert refused.end() == 2
        assert refused.lines[-1].startswith(f"{executable}: {reason}")
        assert "Traceback" not in refused.text


def test_what_asks_for_no_parameter_gets_nothing_and_what_sets_none_the_reason(
    slave: Node,
) -> None:
    before = slave.values()
    for names in (["no_such"], ["rate", ""], ["\x1b[2J\n", "x" * 60_000]):
        asked = {srv.GetParameterTypes: "types", srv.DescribeParameters: "descriptors"}
        for kind, field in asked.items():
            assert len(getattr(slave.ask(kind, names=names), field)) == 0
        found = map(parameter_value_to_python, slave.ask(srv.GetParameters, names=names).values)
        assert list(found) == [before.get(name) for name in names]
    for name, kind, reason in (
        ("rate", 99, "rate: type = 99: must be one of 1 to 9"),
        ("no_such", 3, "no_such: slave_device has no such parameter"),
        ("a\x1b\n", 4, r"'a\x1b\n': slave_device has no such parameter"),
        ("rate", 8, "rate = array('d'): must be from 50 to 20000 Hz"),
        ("use_sim_time", 0, "use_sim_time = None: must be false"),
    ):
        parameters = [ParameterMessage(name=name, value=ParameterValue(type=kind))]
        atomically = slave.ask(srv.SetParametersAtomically, parameters=parameters).result
        (one,) = slave.ask(srv.SetParameters, parameters=parameters).results
        for result in (atomically, one):
            assert not result.successful
            assert result.reason.startswith(reason)
            assert result.reason.isprintable()
    assert slave.values() == before


def test_a_parameter_tells_what_it_may_be_and_takes_numbers_as_they_are_written(
    slave: Node,
) -> None:
    allowed = {
        "autostart": "true or false",
        "latency": "a whole number, from 0 to 20",
        "safety.arm.max_age": "from 0.001 to 10 s",
        "safety.recovery": "one of automatic, manual",
        "simulated.surface.name": "text",
    }
    assert dict(zip(allowed, slave.constraints(*allowed), strict=True)) == allowed
    for one in (1, 1.0, "1e0"):
        assert slave.set("simulated.surface.friction", one) == ""
        assert slave.values()["simulated.surface.friction"] == 1.0
    for wrong in (True, "rough", "nan", 3.0):
        reason = slave.set("simulated.surface.friction", wrong)
        assert reason.startswith("simulated.surface.friction = ")
        assert reason.endswith("must be from 0 to 2")


class Listener:
    """A node that takes the samples of a signal, and one that sends them."""

    def __init__(self, capfd: pytest.CaptureFixture[str]) -> None:
        rclpy.init()
        self.node = GraphNode("compensator")
        self.node.task = "listening"
        self.sender = GraphNode("slave_device")
        self.sender.task = "sending"
        self._send = self.sender.sender(SLAVE_POSITION).send
        self.samples = self.node.samples(SLAVE_POSITION, 1000.0)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._capfd = capfd
        self._said = ""

    def takes(self) -> bool:
        """Send a sample; return whether any is taken."""
        self._send(time.time_ns(), (1.0, 0.0, 0.0))
        self._executor.spin_once(timeout_sec=0.002)
        return bool(list(self.samples.drain()))

    def refuses(self, count: int) -> bool:
        """Send a sample; return whether so many have been refused."""
        self.takes()
        return self.samples.contested >= count

    def said(self, *lines: str) -> bool:
        """Return whether these lines, and no others, have been logged about the signal."""
        self._said += self._capfd.readouterr().err
        found = [line for line in self._said.splitlines() if SLAVE_POSITION.name in line]
        assert len(found) <= len(lines), found
        return len(found) == len(lines) and all(map(str.endswith, found, lines))

    def close(self) -> None:
        """End both nodes."""
        self._executor.shutdown()
        self.node.destroy_node()
        self.sender.destroy_node()
        rclpy.shutdown()


@pytest.fixture
def listener(observer: Observer, capfd: pytest.CaptureFixture[str]) -> Iterator[Listener]:
    made = Listener(capfd)
    yield made
    made.close()


@pytest.mark.quiet
def test_samples_of_two_publishers_are_not_taken(listener: Listener, observer: Observer) -> None:
    wait_until(listener.takes, "samples of one publisher")
    node = rclpy.create_node("slave_device", context=observer.context)
    topic = SLAVE_POSITION
    publisher = node.create_publisher(message_type(topic), topic.name, quality(topic))
    wait_until(lambda: publisher.get_subscription_count() == 1, "the rival's subscriber")
    wait_until(lambda: listener.refuses(1), "samples are refused")
    send = publisher.publish
    for _ in range(100):
        send(StampedVector(topic).pack(time.time_ns(), (9.0, 0.0, 0.0)))
        assert not listener.takes()
    refused = "slave/measured_cp: no sample taken while it is sent by /slave_device (2 publishers)"
    wait_until(lambda: listener.said(refused) or listener.takes(), "a line")
    wait_until(lambda: listener.refuses(100), "all are refused")
    node.destroy_node()
    wait_until(listener.takes, "samples of one publisher again")
    again = "slave/measured_cp: taken again: it has one sender"
    wait_until(lambda: listener.takes() and listener.said(refused, again), "another line")


@pytest.mark.quiet
def test_no_false_of_two_publishers_is_believed(listener: Listener) -> None:
    inbox = listener.node.inbox(COUPLER_STOPPED)
    first, second = (listener.sender.publisher(COUPLER_STOPPED) for _ in range(2))

    def heard(expected: list[bool], *words: bool) -> bool:
        for word in words:
            first.publish(Bool(data=word))
        return listener.node.states(inbox)[-len(expected) :] == expected

    wait_until(lambda: inbox.senders == 2, "both publishers")
    wait_until(lambda: heard([True], False, True, False), "true alone")
    listener.sender.destroy_publisher(second)
    wait_until(lambda: heard([True, False], True, False), "false of the one that is left")


@pytest.mark.quiet
def test_no_timer_waits_for_a_clock_that_was_set_back(listener: Listener) -> None:
    listener.node.create_timer(1.0, lambda: None)
    timers = list(listener.node.timers)
    assert len(timers) > 1
    assert {timer.clock.clock_type for timer in timers} == {ClockType.STEADY_TIME}


def test_messages_that_are_malformed_are_refused_and_counted_and_the_graph_goes_on(
    haptic_accel: Start, observer: Observer, domain: int, tmp_path: Path
) -> None:
    # A process takes no messages of signals that its own nodes send.
    graph = haptic_accel("teleop", "rate:=250", "bag:=bag", "composed:=false")
    graph.wait_for("engaged")
    nodes = ("master_device", "slave_device", "compensator", "coupler", "recorder")
    assert set(nodes_of(domain)) == set(nodes)
    sent = {
        observer.node.create_publisher(message_type(topic), topic.name, quality(topic)): pieces
        for topics, pieces in ((SIGNALS, GARBAGE), (STATES, GARBAGE[:3]))
        for topic in topics
    }

    refused = dict.fromkeys(nodes, 0)

    def all_refused(report: Any) -> bool:
        for publisher, pieces in sent.items():
            for data in pieces:
                publisher.publish(data)
        (status,) = report.status
        values = {pair.key: pair.value for pair in status.values}
        refused[reporter(status.name)[1]] = int(values["messages malformed"])
        return min(refused.values()) >= len(GARBAGE)

    with observer.watching(DIAGNOSTICS) as wait_for:
        wait_for(all_refused, lambda: refused)
    for publisher in sent:  # while there are two, nothing of either is taken
        observer.node.destroy_publisher(publisher)
    observer.collect((ACTUATOR_FORCE,), 100)
    assert graph.end(signal.SIGINT) == 0, graph.text
    assert read_bag(tmp_path / "bag").problems == []


class Numbering(GraphNode):
    """A node whose reports are numbered."""

    task = "numbering"
    reports = 0

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        self.reports += 1
        return f"report {self.reports}", {}


@pytest.mark.quiet
def test_no_report_is_lost_beside_those_on_request(domain: int) -> None:
    rclpy.init()
    node = Numbering("compensator")
    node.report()
    try:
        other = rclpy.create_node("listener")
        received: list[str] = []
        other.create_subscription(
            message_type(DIAGNOSTICS),
            DIAGNOSTICS.name,
            lambda message: received.append(message.status[0].message),
            quality(DIAGNOSTICS),
        )
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.add_node(other)
        begin, asked = time.monotonic(), 0
        # Also once a second without a request.
        while asked < 7 or node.reports < asked + 3 or len(received) < 10:
            assert time.monotonic() < begin + PATIENCE, (asked, node.reports, received)
            executor.spin_once(timeout_sec=0.01)
            # At moments that drift through the turns of the periodic ones.
            if time.monotonic() > begin + 0.29 * asked:
                asked += 1
                node.report()
        numbers = [int(text.split()[1]) for text in received]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    finally:
        other.destroy_node()
        node.destroy_node()
        rclpy.shutdown()


endpoints = st.lists(
    st.builds(
        Endpoint,
        st.sampled_from(["/servo_cf", "/servo_cp"]),
        st.sampled_from(["/coupler", "/evil"]),
        st.sampled_from([b"1", b"2"]),
    ),
    max_size=4,
)


@given(endpoints)
def test_one_node_may_publish_one_of_each_topic_and_nothing_else_is_one_sender(
    found: list[Endpoint],
) -> None:
    senders = {(each.node, each.participant) for each in found}
    topics = [each.topic for each in found]
    assert (not rivals(found)) == (len(senders) <= 1 and len(topics) == len(set(topics)))


@given(endpoints)
def test_all_are_named_with_the_number_of_their_publishers(found: list[Endpoint]) -> None:
    said = rivals(found)
    for node in {each.node for each in found} if said else ():
        number = sum(each.node == node for each in found)
        assert (f"{node} ({number} publishers)" if number > 1 else node) in said
