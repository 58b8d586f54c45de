# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The graph, started as a user starts it."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from haptic_accel.analysis import load
from haptic_accel.analysis.summary import summary
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.axes import ALL_AXES
from haptic_accel.core.process import CUT_SHORT, REALTIME, module_command
from haptic_accel.core.topics import DIAGNOSTICS, MASTER_STOPPED, SIGNALS, TOPICS, reporter
from haptic_accel.nodes.device_node import STALL
from nightly import rest_slow
from observing import Observer
from reading import deserialised
from running import Command, Start, ended_one_by_one, nodes_of, realtime_is_allowed, wait_until
from sharing import LookAtOneGraph, SharedGraph
from verbs import tells

EXECUTABLES = {"master_device", "slave_device", "coupler", "compensator", "recorder"}
"""Executables of `APART`, named like their nodes."""

APART = "composed:=false"
"""Word for a process for each node."""

JOINT = {"composed", "recorder"}
"""Executables of a graph that is not asked for another arrangement."""


def stamp_of(message: Any) -> int:
    """Return a message's stamp, ns."""
    stamp = message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


GRAPH_RATE = 1000.0
"""Samples per second of a graph that is not asked for another rate, Hz."""

SECONDS = 1.5
"""Duration of a graph that ends by itself, s."""

LEAST_TAKEN = 1 / 10
"""Share of the grid that the busiest host for these tests lets a device sample."""

LEAST_ARRIVED = 0.8
"""Share of the samples taken that every signal must have, also beside missed ticks."""


def check_complete(messages: Mapping[str, list[Any]], seconds: float) -> None:
    """Assert that every signal has nearly all samples taken while the arms were engaged.

    A busy host keeps ticks of the grid from being taken, which no bound on their number can know;
    what was taken must arrive.
    """
    stamps = {topic: {stamp_of(m) for m in messages[f"/{topic.name}"]} for topic in SIGNALS}
    for arm in ("master", "slave"):
        own = {topic: found for topic, found in stamps.items() if topic.source == arm}
        begin, end = max(map(min, own.values())), min(map(max, own.values()))
        taken = [stamp for stamp in set().union(*own.values()) if begin <= stamp <= end]
        assert len(taken) > LEAST_TAKEN * seconds * GRAPH_RATE, arm
        for topic, found in own.items():
            assert len(found.intersection(taken)) > LEAST_ARRIVED * len(taken), topic


def check_followed(messages: Mapping[str, list[Any]]) -> None:
    """Assert that each force is the constant gain's answer to the desired acceleration."""
    asked = messages["/compensator/desired_acceleration"]
    desired = {stamp_of(message): message.accel.linear.z for message in asked}
    sent = messages["/master/handle/servo_cf"]
    forces = {stamp_of(message): message.wrench.force.z for message in sent}
    both = desired.keys() & forces.keys()
    assert len(both) > LEAST_ARRIVED * len(desired)
    # Table I: the constant gain is the 0.128 kg of handle and hand. The actuator's limits, which
    # a tool that hits the surface reaches where forces come late, only make it smaller.
    force, wanted = np.array([(forces[moment], 0.128 * desired[moment]) for moment in both]).T
    limited = np.abs(force - wanted) > 1e-12
    assert np.all(np.abs(force[limited]) < np.abs(wanted[limited]))
    assert limited.mean() < 0.5


def check_reported_evenly(bag: Path) -> None:
    """Assert that the coupler's reports, beside its steps, come as the compensator's do."""
    reports = read_bag(bag).diagnostics
    nodes = ("coupler", "compensator")
    times = ([each.received for each in reports if each.node == node] for node in nodes)
    coupler, compensator = (np.diff(own).max() for own in times)
    assert coupler < 2 * compensator


@pytest.mark.parametrize("rig", rest_slow(["ideal", "paper"]))
def test_duration_ends_the_graph_and_the_bag_holds_every_topic(
    haptic_accel: Start, tmp_path: Path, domain: int, rig: str
) -> None:
    words = (f"duration:={SECONDS:g}", "bag:=bag", "controller:=constant", "surface:=text")
    command = haptic_accel("teleop", f"rig:={rig}", *words)
    assert command.end() == 0, command.text
    messages = deserialised(tmp_path / "bag")
    assert set(messages) == {
        "/parameter_events",
        "/rosout",
        *(f"/{device}/transition_event" for device in ("master_device", "slave_device")),
        *(f"/{topic.name.lstrip('/')}" for topic in TOPICS),
    }
    assert messages[DIAGNOSTICS.name]
    check_complete(messages, SECONDS)
    check_followed(messages)
    check_reported_evenly(tmp_path / "bag")
    for topic in SIGNALS:
        found = messages[f"/{topic.name}"]
        stamps = [stamp_of(message) for message in found]
        assert found[0].header.frame_id == topic.frame
        # The last is the zero force of closing; a sample that the coupler lost counts again.
        assert np.all(np.diff(stamps[:-1]) >= 0), topic
    assert nodes_of(domain) == {}


@pytest.mark.slow
def test_a_graph_in_frames_records_every_sample(
    haptic_accel: Start, tmp_path: Path, domain: int
) -> None:
    words = (f"duration:={SECONDS:g}", "bag:=bag", "controller:=constant", "surface:=text")
    command = haptic_accel("teleop", "frame:=5", "latency:=10ms", *words)
    assert command.end() == 0, command.text
    messages = deserialised(tmp_path / "bag")
    check_complete(messages, SECONDS)
    check_followed(messages)
    (trial,) = load(tmp_path / "bag").trials
    assert trial.segment.latency == 10


@pytest.mark.slow
def test_a_handle_with_three_coils_follows_the_tool_in_all_axes(
    haptic_accel: Start, tmp_path: Path
) -> None:
    words = "rig:=three_axis_ideal", "controller:=inverse", "duration:=3", "bag:=bag"
    command = haptic_accel("teleop", *words)
    assert command.end() == 0, command.text
    assert read_bag(tmp_path / "bag", ()).axes == ALL_AXES
    (trial,) = load(tmp_path / "bag").trials
    # Without a force each error is 100 %; on an idle machine that of the vector is 4 %.
    for error in ("nrmse", "nrmse_x", "nrmse_y", "nrmse_z"):
        assert trial.metrics[f"{error}_percent"] < 50.0, error
    assert trial.metrics["direction_error_deg"] < 10.0


class TestGraphAsStarted(LookAtOneGraph):
    """A graph with a bag, real-time where that is allowed."""

    RATE = 400.0
    WORDS = ("teleop", "bag:=bag", f"rate:={RATE:g}")
    VARIABLES: ClassVar = {REALTIME: "yes"}

    def test_every_topic_comes_at_the_rate_asked_for(
        self, graph: SharedGraph, observer: Observer
    ) -> None:
        assert graph.command.process.poll() is None
        messages = observer.collect(SIGNALS, 200)
        for topic in SIGNALS:
            periods = np.diff([stamp_of(message) for message in messages[topic.name]])
            # Stamps lie on the sampling grid, whatever the machine's load.
            assert np.median(periods) == pytest.approx(1e9 / self.RATE, rel=0.01), topic

    @pytest.mark.usefixtures("graph")
    def test_diagnostics_come_from_every_node(self, observer: Observer) -> None:
        names: set[str] = set()
        values: dict[str, dict[str, str]] = {}
        while names != EXECUTABLES:
            for message in observer.collect((DIAGNOSTICS,), 5)[DIAGNOSTICS.name]:
                for status in message.status:
                    node = reporter(status.name)[1]
                    names.add(node)
                    values[node] = {pair.key: pair.value for pair in status.values}
        assert float(values["master_device"]["rate (Hz)"]) == self.RATE
        assert int(values["recorder"]["dropped"]) == 0
        assert values["compensator"]["controller"] == "dynamic"

    def test_what_makes_forces_is_real_time_where_that_is_allowed(
        self, graph: SharedGraph
    ) -> None:
        scheduled = os.SCHED_FIFO if realtime_is_allowed() else os.SCHED_OTHER
        wait_for_scheduling(graph.domain, scheduled)

    def test_ctrl_c_ends_cleanly_and_the_bag_is_whole(self, graph: SharedGraph) -> None:
        command, bag = graph.command, graph.folder / "bag"
        wait_until(lambda: set(nodes_of(graph.domain)) == JOINT, "all processes", command)
        graph.end()
        assert "Traceback" not in command.text
        assert "0 dropped" in command.wait_for("messages")
        arrangement, stop, *_ = command.lines
        assert arrangement.startswith(
            "one process for master_device, slave_device, coupler and comp"
        )
        assert stop.startswith("emergency stop: haptic-accel estop in another terminal;")
        assert command.lines[-1] == f"next: haptic-accel analyze {bag}"
        for device in ("master_device", "slave_device"):
            command.wait_for(rf"\[{device}\].* \d+ of \d+ forces missed their deadline")
        assert deserialised(bag)


def test_a_pause_of_a_simulated_world_counts_as_a_real_handle_would_feel_it(
    haptic_accel: Start, tmp_path: Path, domain: int
) -> None:
    pause, latest = 0.09, 0.07  # arms let go after 0.1 s
    command = haptic_accel("teleop", "bag:=bag", f"duration:={SECONDS:g}")
    command.wait_for("engaged")
    process = nodes_of(domain)["composed"]
    time.sleep(0.5)
    os.kill(process, signal.SIGSTOP)
    time.sleep(pause)
    os.kill(process, signal.SIGCONT)
    assert command.end() == 0, command.text
    analysis = load(tmp_path / "bag")
    deadlines = analysis.trials[-1].segment.delivery.deadlines
    assert set(deadlines) == {"actuator force", "master arm force", "slave arm force"}
    for kind, counts in deadlines.items():
        # The world waited with the process: its ticks were all carried out with their forces.
        assert counts["missed"] - counts["past_tick"] > latest * GRAPH_RATE, (kind, counts)
        assert counts["longest_us"] > latest * 1e6, (kind, counts)
        assert counts["late_s"] > latest, (kind, counts)
    told = " ".join(summary(analysis))
    found = re.search(r"due time, the latest by ([0-9.]+) ms", told)
    assert found, told
    assert float(found[1]) > latest * 1e3
    assert "the simulated world waited for its node" in told


DYING = [("recorder", []), *((name, [APART]) for name in sorted(EXECUTABLES))]


@pytest.mark.parametrize(("process", "words"), DYING)
@pytest.mark.slow
def test_a_process_that_dies_ends_the_graph_and_is_named(
    haptic_accel: Start, domain: int, process: str, words: list[str]
) -> None:
    command = haptic_accel("teleop", "bag:=bag", *words)
    command.wait_for("engaged")
    check_named_when_killed(command, domain, process)


def check_named_when_killed(command: Command, domain: int, process: str) -> None:
    """Kill a process of a graph, which ends the graph and is named."""
    os.kill(nodes_of(domain)[process], signal.SIGKILL)
    assert command.end() == 1, command.text
    assert f"{process} ended with status -9" in command.text
    assert "ended with" not in command.text.replace(f"{process} ended with status -9", "")
    assert nodes_of(domain) == {}


@pytest.mark.quiet
def test_nodes_end_when_their_supervisor_is_killed(haptic_accel: Start, domain: int) -> None:
    command = haptic_accel("teleop", "record:=false")
    command.wait_for("engaged")
    command.end(signal.SIGKILL)
    wait_until(lambda: nodes_of(domain) == {}, "all nodes ended")


ABORTING = """
import ctypes, os
from haptic_accel.nodes.coupler import Coupler
from haptic_accel.nodes.scheduling import run_nodes

class Aborting(Coupler):
    def work(self):
        if os.environ.pop("fail", None):
            raise OSError("the cable is out")
        return super().work()

    def destroy_node(self):
        lock, take = ctypes.create_string_buffer(64), ctypes.PyDLL(None).pthread_mutex_lock
        {}

run_nodes("coupler", Aborting)
"""


@pytest.mark.parametrize("end", rest_slow(["os.abort()", "take(lock), take(lock)"]))
@pytest.mark.quiet
def test_middleware_that_does_not_end_when_all_is_done_is_told_from_a_fault(
    start: Start, end: str
) -> None:
    command = start("-c", ABORTING.format(end))
    command.wait_for("waiting for the position of master and slave")
    assert command.end(signal.SIGINT) in CUT_SHORT, command.text


@pytest.mark.quiet
def test_middleware_that_aborts_after_a_failure_hides_none(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("fail", "once")
    command = start("-c", ABORTING.format("os.abort()"))
    assert command.end() == -signal.SIGABRT, command.text


def test_a_node_that_stalls_is_named_in_diagnostics_and_a_process_that_dies_ends_the_graph(
    haptic_accel: Start, observer: Observer, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def says(node: str, text: str) -> Callable[[Any], bool]:
        return lambda message: any(
            status.name == f"{node}: sampling" and text in status.message
            for status in message.status
        )

    monkeypatch.setenv(REALTIME, "no")
    command = haptic_accel("teleop", "bag:=bag")
    command.wait_for("engaged")
    wait_for_scheduling(domain, os.SCHED_OTHER)
    with observer.watching(DIAGNOSTICS) as wait_for:
        wait_for(says("slave_device", ""))
        process = nodes_of(domain)["composed"]
        os.kill(process, signal.SIGSTOP)
        # A time that we keep: on a busy machine the arms may have let go before.
        time.sleep(10 * STALL)
        os.kill(process, signal.SIGCONT)
        wait_for(says("slave_device", "stalled for"))
    check_named_when_killed(command, domain, "composed")


def start_again(command: Command, domain: int, node: str) -> None:
    """Kill a node and wait until it has been started again."""
    before, seen = nodes_of(domain)[node], len(command.lines)
    os.kill(before, signal.SIGKILL)
    command.wait_for(f"{node}. ended with status -9; it is started again", after=seen)
    wait_until(lambda: nodes_of(domain).get(node, before) != before, f"{node} started again")


@pytest.mark.quiet
def test_a_node_that_fails_comes_back_and_is_stopped_while_the_others_are(
    haptic_accel: Start, observer: Observer, domain: int, ask: Callable[..., tuple[int, str]]
) -> None:
    command = haptic_accel("teleop", "record:=false", "respawn:=true")
    command.wait_for("engaged")
    assert command.lines[0].startswith("a process for each node; ")
    seen = len(command.lines)
    start_again(command, domain, "slave_device")
    command.wait_for("coupler]: engaged", after=seen)
    assert ask("estop")[0] == 0
    start_again(command, domain, "master_device")
    observer.wait_for_state(MASTER_STOPPED, state=True)
    assert command.end(signal.SIGINT) == 0, command.text


def wait_for_scheduling(domain: int, expected: int) -> None:
    """Wait until all threads of all nodes are scheduled in one way."""
    for name, process in nodes_of(domain).items():
        wait_until(partial(runs_as, process, expected), f"{name} is scheduled as it should be")


def runs_as(process: int, scheduling_class: int) -> bool:
    """Return True where all threads of a process are scheduled in one way."""
    threads = os.listdir(f"/proc/{process}/task")
    with suppress(ProcessLookupError):  # a thread that has just ended
        return {os.sched_getscheduler(int(thread)) for thread in threads} == {scheduling_class}
    return False


@pytest.mark.quiet
def test_what_lies_in_the_working_directory_is_not_taken_for_a_module(
    start: Start, tmp_path: Path
) -> None:
    (tmp_path / "haptic_accel").mkdir()  # as after `git clone` and `cd ..`
    (tmp_path / "queue.py").write_text("raise SystemExit('mine')")
    nodes = {"nodes.recorder": ["--fast"], "nodes.composed": ["--fast"]}
    for module, refused in ({"cli.main": ["teleop", "rate:=-1"]} | nodes).items():
        _, *words = module_command(f"haptic_accel.{module}")
        command = start(*words, *refused)
        assert command.end() == 2, command.text
        assert len(command.lines) == 1, command.text
        assert "mine" not in command.text


REFUSED_BY_NODES = {
    "compensator --fast": "--fast: no such argument; ...",
    "compensator --ros-args -p controller": "...'-p controller'...",
    "compensator --ros-args -p controller:=magic": (
        "controller = 'magic': must be one of none, constant, dynamic, ..."
    ),
    "compensator --ros-args -p constant.mass:=.nan": "constant.mass = nan: must be at least 0 kg",
    "compensator --ros-args --params-file nowhere.yaml": "...'--params-file nowhere.yaml'...",
    "compensator --ros-args --params-file broken.yaml": "...'--params-file broken.yaml'...",
    "compensator --ros-args --params-file right.yaml": (
        "right.yaml:1: ... not for /compensator; write /**/compensator"
    ),
    "compensator --ros-args --params-file right.yaml -r __ns:=/left": (
        "right.yaml:1: /right/compensator: holds in another namespace, not for /left/compensator;"
        " write /**/compensator"
    ),
    "master_device --ros-args -p simulated.handle.m_h:=0.0": (
        "simulated.handle.m_h = 0.0: must be above 0 kg"
    ),
    "slave_device --ros-args -p device:=omni": "device = 'omni': must be one of simulated, ...",
    "coupler --ros-args -p k_m:=stiff": "k_m = 'stiff': must be from 0 to 5000 N/m",
    "recorder --ros-args -p quue:=3": "quue: no such parameter",
}
"""Line of each node for its arguments, in which ... stands for any text."""


@pytest.mark.quiet
def test_a_node_by_itself_refuses_wrong_arguments(start: Start, tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_text("compensator: {ros__parameters: [")
    right = "/right/compensator: {ros__parameters: {controller: none}}"
    (tmp_path / "right.yaml").write_text(right)
    programs = [f"haptic_accel.nodes.{words}".split() for words in REFUSED_BY_NODES]
    found = ended_one_by_one(start, programs)
    for (words, said), (status, lines) in zip(REFUSED_BY_NODES.items(), found, strict=True):
        assert (status, len(lines)) == (2, 1), (words, lines)
        assert tells(lines[0], f"{words.split()[0]}: {said}"), lines
