# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder in a graph that runs, asked and hurt as users do it."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.interfaces import QosDurability, QosReliability
from std_msgs.msg import String
from std_srvs.srv import Trigger

from haptic_accel.bags.metadata import Metadata, read_metadata
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.topics import DEVICES, TOPICS
from haptic_accel.setup.files import parameter_text
from observing import Observer
from reading import deserialised, with_mcap, with_rosbags
from running import Command, Start, limit_size, nodes_of, wait_until
from verbs import next_command

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TEXT_TYPE = 4
"""rcl_interfaces/msg/ParameterType."""


def asked(observer: Observer, verb: str) -> str:
    """Ask the recorder for something that it can do; return its line."""
    response = observer.call(Trigger, f"recorder/{verb}", Trigger.Request())
    assert response.success, response.message
    return str(response.message)


def counts(metadata: Metadata) -> dict[str, int]:
    return {topic.name: topic.messages for topic in metadata.topics}


def test_a_recording_is_paused_split_and_stopped_and_survives_a_full_disk(
    haptic_accel: Start, observer: Observer, domain: int, tmp_path: Path
) -> None:
    for name in ("/named", "/found/wanted", "/found/hidden", "/other"):
        publisher = observer.node.create_publisher(String, name, LATCHED)
        publisher.publish(String(data=name))
    options = {"regex": "^/found", "exclude_regex": "hidden", "start_paused": True}
    (tmp_path / "recorder.yaml").write_text(parameter_text({"recorder": options}))
    words = ("rate:=250", "rig:=ideal", "surface:=vinyl", "bag:=bag", "topics:=named")
    graph = haptic_accel("teleop", *words, "params_file:=recorder.yaml")
    graph.wait_for("engaged")
    graph.wait_for("/named: recorded too")
    graph.wait_for("/found/wanted: recorded too")
    assert "paused, 0 messages" in asked(observer, "status")
    assert "goes on" in asked(observer, "start")
    value = ParameterValue(type=TEXT_TYPE, string_value="none")
    change = SetParameters.Request(parameters=[Parameter(name="controller", value=value)])
    observer.call(SetParameters, "compensator/set_parameters", change)
    for transition in ("deactivate", "activate"):
        asked_for = ChangeState.Request()
        asked_for.transition.label = transition
        observer.call(ChangeState, "slave_device/change_state", asked_for)
    told = haptic_accel("record", "split")
    assert told.end() == 0, told.text
    assert told.text == f"{tmp_path / 'bag'}: another file follows bag_0.mcap"
    values = observer.status("recorder", state="recording")
    assert int(values["free space (bytes)"]) > 0
    told = haptic_accel("record", "stop")
    assert told.end() == 0, told.text
    assert "0 dropped" in told.text
    assert next_command(told.text) == ["analyze", str(tmp_path / "bag")]
    refused = observer.call(Trigger, "recorder/pause", Trigger.Request())
    assert (refused.success, refused.message) == (False, f"{tmp_path / 'bag'}: is stopped already")

    assert asked(observer, "start") == f"{tmp_path / 'bag-2'}: recording"
    second = tmp_path / "bag-2" / "bag-2_0.mcap"
    wait_until(lambda: second.stat().st_size > 300_000, "some chunks of recording")
    # A limit on the size of files stands for the disk, which a test cannot fill.
    limit_size(nodes_of(domain)["recorder"], second)
    warned = graph.wait_for("File too large")
    assert "recorder" in warned
    assert observer.status("coupler")
    assert graph.process.poll() is None  # the graph goes on
    assert graph.end(signal.SIGINT) == 1, graph.text
    last = next(line for line in graph.lines if "are saved and can be read" in line)
    assert f"{len(with_rosbags(tmp_path / 'bag-2'))} messages up to" in last

    metadata = read_metadata(tmp_path / "bag")
    assert len(metadata.files) == 2
    topics = {f"/{topic.name.lstrip('/')}" for topic in TOPICS}
    events = {f"/{device}/transition_event" for device in DEVICES}
    expected = topics | events | {"/parameter_events", "/rosout", "/named", "/found/wanted"}
    assert set(counts(metadata)) == expected
    assert counts(metadata)["/slave_device/transition_event"] == 4
    logged = deserialised(tmp_path / "bag", ["/rosout"])["/rosout"]
    assert "recorder" in {log.name for log in logged}
    (named,) = (topic for topic in metadata.topics if topic.name == "/named")
    durable = [qos.durability for qos in named.offered_qos_profiles]
    assert durable == [QosDurability.TRANSIENT_LOCAL]
    for topic in metadata.topics:
        assert {qos.reliability for qos in topic.offered_qos_profiles} == {QosReliability.RELIABLE}
    bag = read_bag(tmp_path / "bag")
    assert bag.problems == []
    assert bag.metadata["arguments"]["surface"] == "vinyl"
    assert bag.metadata["parameters"]["slave_device"]["simulated.surface.name"] == "vinyl"
    changes = [(one.node, one.parameter, one.value) for one in bag.changes]
    assert ("compensator", "controller", "none") in changes
    later = read_bag(tmp_path / "bag-2").changes  # it begins with the values of that moment
    named = ("compensator", "controller")
    values = [one.value for one in later if (one.node, one.parameter) == named]
    assert values == ["none"]
    assert len(with_rosbags(tmp_path / "bag")) == len(with_mcap(tmp_path / "bag"))


@pytest.mark.slow
def test_of_the_graphs_in_other_namespaces_nothing_is_recorded(
    start: Start, observer: Observer, tmp_path: Path
) -> None:
    def node(name: str, namespace: str, *words: str) -> Command:
        place = ("-r", f"__ns:={namespace}") if namespace else ()
        return start("-m", f"haptic_accel.nodes.{name}", "--ros-args", *place, *words)

    bags = {"": tmp_path / "bag", "/left": tmp_path / "left"}
    recorders = [node("recorder", own, "-p", f"bag:={bag}") for own, bag in bags.items()]
    for recorder in recorders:
        recorder.wait_for("recording to")
    couplers = [node("coupler", namespace) for namespace in ("", "/left", "/right")]
    for coupler in couplers:
        coupler.wait_for("waiting for the position of master and slave")
    stiffer = Parameter(name="k_m", value=ParameterValue(type=3, double_value=300.0))
    for namespace in ("", "/left", "/right"):
        service = f"{namespace}/coupler/set_parameters"
        observer.call(SetParameters, service, SetParameters.Request(parameters=[stiffer]))
    for each in (*couplers, *recorders):
        assert each.end(signal.SIGINT) == 0, each.text
    for own, bag in bags.items():
        below = own[1:] and f"{own[1:]}."
        found = deserialised(bag)
        names = {log.name for log in found["/rosout"]}
        assert names == {f"{below}coupler", f"{below}recorder"}
        changed = {event.node for event in found["/parameter_events"]}
        assert changed == {f"{own}/coupler"}
        reports = {array.status[0].name for array in found["/diagnostics"]}
        assert f"{own}/coupler: coupling".lstrip("/") in reports
        assert not any("right" in name for name in reports)


@pytest.mark.quiet
def test_a_recorder_that_is_told_nonsense_says_so(start: Start) -> None:
    node = start("-m", "haptic_accel.nodes.recorder", "--ros-args", "-p", "facts:=word")
    assert node.end() == 2
    assert node.text == "recorder: facts: must be a JSON object"
