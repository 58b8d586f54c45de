# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The launch files: what they declare, what they start, and what the end of a node does."""

from __future__ import annotations

import math
import os
import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from ament_index_python.packages import PackageNotFoundError

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import WELL
from haptic_accel.core.topics import SIGNALS
from haptic_accel.graph.domain import sole_graph
from haptic_accel.graph.frames import description as description_text
from haptic_accel.materials.folders import share_folder
from haptic_accel.nodes.scheduling import TEARDOWN
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments, parse_arguments
from haptic_accel.setup.files import parameter_text, read_parameter_file
from haptic_accel.setup.processes import Process, graph, identification_graph
from haptic_accel.setup.replay import described_replay, replay_arguments
from haptic_accel.setup.words import described, parse_assignments

try:
    import launch_ros.actions  # noqa: F401
except ImportError:
    sys.path.insert(0, str(Path(__file__).parents[1] / "support" / "launch_double"))

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, RegisterEventHandler, Shutdown

from haptic_accel.graph import launching

BAG = Path(__file__).parents[1] / "data" / "text"

pytestmark = pytest.mark.quiet

Words = dict[str, str]
Start = Callable[..., dict[str, SimpleNamespace]]


def description(name: str) -> LaunchDescription:
    """Return what a launch file describes."""
    path = share_folder() / "launch" / f"{name}.launch.py"
    found: LaunchDescription = runpy.run_path(str(path))["generate_launch_description"]()
    return found


def declared(name: str) -> list[tuple[str, str, str]]:
    return [
        (entity.name, "".join(part.text for part in entity.default_value), entity.description)
        for entity in description(name).entities
        if isinstance(entity, DeclareLaunchArgument)
    ]


@pytest.fixture
def installed() -> set[str]:
    """Return the other ROS packages that a launch finds, none to begin with."""
    return set()


def prefix(installed: set[str], package: str) -> str:
    if package not in installed:
        raise PackageNotFoundError(package)
    return "/opt/ros"


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch, domain: int, installed: set[str]) -> Iterator[Start]:
    """Execute a launch file; return the nodes it starts, by name or executable."""
    monkeypatch.setattr(launching, "Node", SimpleNamespace)
    monkeypatch.setattr(launching, "get_package_prefix", partial(prefix, installed))
    context = LaunchContext()

    def started(name: str, **words: str) -> dict[str, SimpleNamespace]:
        context.launch_configurations.clear()
        context.launch_configurations.update(words)
        context.extend_locals({"current_launch_file_path": f"/ros/{name}.launch.py"})
        found: list[Any] = []
        for entity in description(name).entities:
            found += entity.execute(context) or []
        handlers.extend(each for each in found if isinstance(each, RegisterEventHandler))
        nodes = [each for each in found if isinstance(each, SimpleNamespace)]
        return {getattr(each, "name", each.executable): each for each in nodes}

    handlers: list[RegisterEventHandler] = []
    yield started
    for handler in handlers:
        handler.event_handler.handle(Shutdown(reason="over"), context)
    with sole_graph(""):
        """Nothing is locked any more."""


def ended(node: SimpleNamespace, status: int, *, shutdown: bool = False) -> Any:
    """Return what a launch does when a node has ended."""
    event = SimpleNamespace(process_name=node.executable, returncode=status)
    return node.on_exit(event, SimpleNamespace(is_shutdown=shutdown))


def test_every_argument_is_declared_with_default_and_text() -> None:
    assert declared("teleop") == described(GraphArguments)
    assert declared("identify") == described(IdentifyArguments)
    assert declared("replay") == described_replay()


GRAPHS: dict[str, Callable[[list[str]], list[Process]]] = {
    "teleop": lambda words: graph(parse_arguments(words)),
    "identify": lambda words: identification_graph(parse_assignments(words, IdentifyArguments)),
    "replay": lambda words: graph(replay_arguments(words).graph),
}
"""Processes that a verb starts for its words."""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("teleop", {}),
        ("teleop", {"master": "pointer"}),
        ("teleop", {"controller": "none", "composed": "false", "scope": "true", "namespace": "a"}),
        ("teleop", {"slave": "virtual", "surface": "workshop"}),
        ("identify", {"grip": "pinch", "trials": "1"}),
        ("replay", {"bag": str(BAG), "controller": "inverse"}),
    ],
)
def test_the_nodes_are_those_of_the_command_line_with_the_same_parameters(
    start: Start, name: str, words: Words
) -> None:
    processes = GRAPHS[name]([f"{key}:={value}" for key, value in words.items()])
    nodes = start(name, **words)
    assert [node.executable for node in nodes.values()] == [p.executable for p in processes]
    for process in processes:
        node = nodes[process.executable]
        assert node.package == "haptic_accel"
        words = node.arguments
        file = Path(words[words.index("--params-file") + 1])
        assert file.read_text() == parameter_text(process.parameters)
        assert node.namespace == (process.namespace or "/")
        assert (node.on_exit is None) == process.optional


@pytest.mark.parametrize(
    ("pushed", "namespace", "found"),
    [
        ("/lab", "", "/lab"),
        ("/lab", "left", "/lab/left"),
        ("/lab", "/left", "/left"),
        ("/lab", "/", "/"),
        ("", "", "/"),
    ],
)
def test_a_namespace_around_the_launch_file_counts_as_in_launch_ros(
    start: Start, tmp_path: Path, pushed: str, namespace: str, found: str
) -> None:
    mine = tmp_path / "mine.yaml"
    keys = {"/**/coupler": 200.0, "/lab/coupler": 300.0, "/lab/left/coupler": 400.0}
    for key, k_m in keys.items():
        with mine.open("a") as file:
            file.write(f"{key}: {{ros__parameters: {{k_m: {k_m}}}}}\n")
    around = {"ros_namespace": pushed} if pushed else {}
    nodes = start("teleop", params_file=str(mine), namespace=namespace, **around)
    assert {node.namespace for node in nodes.values()} == {found}
    words = nodes["composed"].arguments
    given = read_parameter_file(Path(words[words.index("--params-file") + 1]))["coupler"]
    assert given["k_m"] == {"/lab": 300.0, "/lab/left": 400.0}.get(found, 200.0)


def test_a_second_graph_is_refused_in_its_namespace_and_welcome_in_another(start: Start) -> None:
    start("teleop", namespace="left")
    start("teleop", namespace="right")
    with pytest.raises(ParameterError, match="has a graph in /left already"):
        start("identify", namespace="left")


def test_a_wrong_argument_is_refused_in_one_line_before_anything_starts(start: Start) -> None:
    with pytest.raises(ParameterError, match=r"^controller = 'magic': must be one of"):
        start("teleop", controller="magic")
    with pytest.raises(ParameterError, match=r"^bag = '': must be"):
        start("replay")
    with pytest.raises(ParameterError, match=r"^namespace = '9x': must be letters"):
        start("teleop", namespace="9x")


def test_a_misspelt_word_is_named_where_the_launch_file_is_the_users(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["launch", "haptic_accel", "teleop.launch.py", "emulate_tty:=true", "controler:=none"]
    monkeypatch.setattr(sys, "argv", ["/opt/ros/bin/ros2", *words])
    with pytest.raises(ParameterError, match=r"^controler: .* \(did you mean controller\?\)"):
        start("teleop")
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "/mine/lab.launch.py", *words[3:]])
    assert start("teleop")


def test_the_first_line_tells_which_nodes_share_a_process(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    start("teleop")
    start("teleop", namespace="left", composed="false")
    one, each, *_ = (text for text in caplog.messages if "process" in text)
    assert one.startswith("one process for master_device, slave_device, coupler and compensator")
    assert each.startswith("a process for each node")


@pytest.mark.parametrize("status", WELL)
def test_the_end_of_a_process_ends_all_and_the_recorder_is_waited_for(
    start: Start, status: int
) -> None:
    nodes = start("teleop")
    (action,) = ended(nodes["composed"], status)
    assert isinstance(action, Shutdown)
    patience = {name: float(node.sigterm_timeout) for name, node in nodes.items()}
    assert patience["recorder"] > patience["composed"] > TEARDOWN


def test_a_node_that_comes_back_ends_nothing(start: Start) -> None:
    nodes = start("teleop", respawn="true", scope="true")
    coming = [name for name, node in nodes.items() if node.respawn]
    assert sorted(coming) == ["compensator", "coupler", "master_device", "slave_device"]
    assert ended(nodes["coupler"], -9) == []
    (action,) = ended(nodes["coupler"], 0)
    assert isinstance(action, Shutdown)
    with pytest.raises(RuntimeError, match="coupler ended with status 2"):
        ended(nodes["coupler"], 2)
    with pytest.raises(RuntimeError, match="recorder ended with status 1"):
        ended(nodes["recorder"], 1)


@pytest.mark.parametrize("status", [0, -2, 1])
def test_the_ends_after_the_first_do_nothing(start: Start, status: int) -> None:
    assert ended(start("teleop")["recorder"], status, shutdown=True) == []


def test_arms_are_shown_as_they_move_where_robot_state_publisher_is(
    start: Start, installed: set[str]
) -> None:
    installed |= {"tf2_ros", "robot_state_publisher"}
    nodes = start("teleop", namespace="left")
    # It alone publishes all frames; those of graphs in other namespaces have the same names.
    assert not any("static" in node.executable for node in nodes.values())
    node = nodes["robot_state_publisher"]
    assert node.namespace == "/left"
    assert dict(node.remappings) == {"/tf": "tf", "/tf_static": "tf_static"}
    (parameters,) = node.parameters
    text = parameters["robot_description"].value
    assert "".join(getattr(part, "text", part) for part in text) == description_text()
    assert not hasattr(node, "on_exit")


def test_frames_rest_where_only_tf2_is(start: Start, installed: set[str]) -> None:
    installed.add("tf2_ros")
    nodes = start("identify").values()
    statics = [node for node in nodes if node.package == "tf2_ros"]
    given = [dict(zip(node.arguments[::2], node.arguments[1::2], strict=True)) for node in statics]
    parents = {words["--child-frame-id"]: words["--frame-id"] for words in given}
    assert set(parents) == {topic.frame for topic in SIGNALS}
    for frame in parents:
        while frame != "world":
            frame = parents[frame]
    for words in given:
        for axis in ("x", "y", "z", "roll", "pitch", "yaw"):
            assert math.isfinite(float(words[f"--{axis}"]))


def test_without_either_the_graph_starts_and_says_so(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    assert "composed" in start("teleop")
    assert "no frames are published: neither robot_state_publisher nor tf2_ros" in caplog.text


def test_an_interruption_waits_for_a_node_that_starts(start: Start, tmp_path: Path) -> None:
    nodes = start("teleop")
    words = launching.blocking_prefix()
    if not words:
        pytest.skip("this system's env blocks no signals")
    assert nodes["composed"].prefix.split() == list(words)
    assert nodes["composed"].exec_name == "composed"
    # While Python itself starts, where it would answer with a traceback.
    (tmp_path / "sitecustomize.py").write_text("import os\nos.kill(os.getpid(), 2)")
    done = subprocess.run(
        [*words, sys.executable, "-c", "from haptic_accel.nodes.start import link; link()"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 0)
