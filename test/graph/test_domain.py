# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the middleware, and locks in a ROS domain."""

from __future__ import annotations

import json
import os
import pwd
import re
import signal
import subprocess
from contextlib import closing
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import MASTER_ARM_FORCE
from haptic_accel.graph.domain import (
    DISCOVERY_RANGE,
    LOOPBACK_PROFILE,
    NEEDS_ROS,
    NETWORK_PROFILE,
    PROFILES_FILES,
    ROS_PACKAGES,
    STATIC_PEERS,
    VARIABLES,
    check_middleware,
    check_ros,
    lock_signal,
    middleware_defaults,
    sole_graph,
)
from nightly import rest_slow
from observing import Observer
from running import Start, python, sending
from verbs import refusal

HOME = {"HOME": "/home/user"}

LOOPBACK = "0100007F"
"""127.0.0.1 as /proc/net/udp shows it."""


PROFILES = (LOOPBACK_PROFILE, NETWORK_PROFILE)
LOOPBACK_ALONE, NETWORK = (dict.fromkeys(PROFILES_FILES, str(each)) for each in PROFILES)


@pytest.mark.parametrize(
    ("of_user", "added"),
    [
        ({}, LOOPBACK_ALONE | {DISCOVERY_RANGE: "SYSTEM_DEFAULT"}),
        ({DISCOVERY_RANGE: "SUBNET"}, NETWORK),
        ({STATIC_PEERS: "192.168.1.7"}, NETWORK | {DISCOVERY_RANGE: "LOCALHOST"}),
        *(({name: "mine.xml"}, {DISCOVERY_RANGE: "LOCALHOST"}) for name in PROFILES_FILES),
        *(({name: "mine.xml", DISCOVERY_RANGE: "SUBNET"}, {}) for name in PROFILES_FILES),
        (middleware_defaults({}), {}),  # another node has started it
    ],
)
def test_a_graph_stays_on_its_machine_unless_the_user_chose_otherwise(
    of_user: dict[str, str], added: dict[str, str]
) -> None:
    assert middleware_defaults(HOME | of_user) == added
    assert all(Path(file).is_file() for name, file in added.items() if name in PROFILES_FILES)


@pytest.mark.parametrize("environment", [{}, {"HOME": "", "ROS_HOME": ""}])
def test_without_a_home_the_log_is_in_that_of_the_system(environment: dict[str, str]) -> None:
    folder = middleware_defaults(environment)["ROS_LOG_DIR"]
    assert folder == f"{pwd.getpwuid(os.getuid()).pw_dir}/.ros/log"


@pytest.mark.parametrize("variable", ["HOME", "ROS_HOME", "ROS_LOG_DIR"])
def test_a_folder_of_the_users_for_the_log_is_kept(variable: str) -> None:
    assert "ROS_LOG_DIR" not in middleware_defaults({variable: "/somewhere"})


def udp_addresses(pid: int) -> set[str]:
    """Return the local addresses of a process' UDP sockets, as /proc shows them."""
    links = [str(path.readlink()) for path in Path(f"/proc/{pid}/fd").iterdir()]
    inodes = {found[1] for link in links if (found := re.fullmatch(r"socket:\[(\d+)\]", link))}
    texts = [Path(f"/proc/{pid}/net/{family}").read_text() for family in ("udp", "udp6")]
    rows = [line.split() for text in texts for line in text.splitlines()[1:]]
    return {row[1].split(":")[0] for row in rows if row[9] in inodes}


@pytest.mark.quiet
def test_every_socket_is_bound_to_the_machine_where_plain_ros_nodes_find_the_graph(
    start: Start, observer: Observer, domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    command = start("-m", "haptic_accel.nodes.coupler")
    observer.status("coupler")
    pid = command.process.pid
    assert udp_addresses(pid) == {LOOPBACK}
    assert b"/dev/shm/fast" not in Path(f"/proc/{pid}/maps").read_bytes()
    threads = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/comm")]
    assert not [name for name in threads if "shm" in name], "no memory is shared"
    for reach in ("LOCALHOST", "SUBNET"):
        monkeypatch.setenv(DISCOVERY_RANGE, reach)
        plain = Observer(domain)
        try:
            plain.status("coupler")
        finally:
            plain.close()


@pytest.mark.parametrize(
    ("variable", "value", "allowed"),
    [
        (DISCOVERY_RANGE, "OFF", "LOCALHOST, SUBNET or SYSTEM_DEFAULT, or unset"),
        ("RMW_IMPLEMENTATION", "rmw_none_cpp", "rmw_fastrtps_cpp, which is installed, or unset"),
    ],
)
def test_an_environment_without_nodes_is_refused_in_a_line_that_names_the_variable(
    domain: int,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    variable: str,
    value: str,
    allowed: str,
) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "rmw_typesupport"
    index.mkdir(parents=True)
    (index / "rmw_fastrtps_cpp").touch()
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    check_middleware({})
    monkeypatch.setenv(variable, value)
    expected = f"{variable} = '{value}': must be {allowed}"
    for words in (("teleop",), ("control", "engage:=true"), ("record", "status")):
        assert refusal(*words).startswith(expected)
    with pytest.raises(ParameterError, match=f"^{variable} = '{value}': must be "):
        check_middleware(os.environ)


@pytest.mark.quiet
def test_a_node_of_its_own_refuses_such_an_environment(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DISCOVERY_RANGE, "OFF")
    command = start("-m", "haptic_accel.nodes.coupler")
    assert command.end() == 2
    assert command.lines[-1].startswith(f"coupler: {DISCOVERY_RANGE} = 'OFF': must be LOCALHOST")


def without_ros(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run code in a Python that has no ROS 2."""
    hidden = f"import sys; sys.modules.update(dict.fromkeys({sorted(ROS_PACKAGES)}))"
    return python("-c", f"{hidden}; {code}", cwd=folder)


def verb(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    code = f"from haptic_accel.cli.main import main; main({[*words]})"
    return without_ros(folder, code)


@pytest.mark.parametrize(
    "words",
    rest_slow(
        [
            *(["teleop", "duration:=1"], ["estop", "release:=true"]),
            *(["control", "controller:=none"], ["teleop", "master:=pointer", "scope:=true"]),
            *(["experiment"], ["identify"], ["bench", "latency"], ["scope"], ["record", "start"]),
        ],
        now=3,
    ),
)
def test_a_verb_that_needs_ros_says_so_in_one_line(tmp_path: Path, words: list[str]) -> None:
    done = verb(tmp_path, *words)
    name = " ".join(words[:2]) if words[0] == "bench" else words[0]
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"haptic-accel: {name} {NEEDS_ROS}\n"
    assert not [*tmp_path.iterdir()]


def test_a_wrong_word_is_named_before_ros_is_missed(tmp_path: Path) -> None:
    done = verb(tmp_path, "control", "controller:=wrong")
    assert done.returncode == 2
    assert "controller = 'wrong'" in done.stderr


def test_a_node_says_that_it_needs_ros(tmp_path: Path) -> None:
    done = without_ros(tmp_path, "from haptic_accel.nodes.start import coupler; coupler()")
    assert (done.returncode, done.stderr) == (1, f"coupler {NEEDS_ROS}\n")


def test_doctor_reports_that_ros_is_not_installed(tmp_path: Path) -> None:
    done = verb(tmp_path, "doctor", "--json", "found.json")
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads((tmp_path / "found.json").read_text())["findings"]
    (ros,) = [finding for finding in found if finding["name"] == "ROS 2"]
    assert (ros["level"], ros["found"]) == ("warning", "not installed")


def test_an_installed_ros_passes() -> None:
    pytest.importorskip("rclpy")
    check_ros()


TOPIC = f"/{MASTER_ARM_FORCE.name}"

pytestmark = pytest.mark.quiet


def test_a_signal_has_one_sender_until_that_ends_in_whatever_way(domain: int) -> None:
    with sending(domain, TOPIC) as process:
        with pytest.raises(ParameterError) as refused:
            lock_signal(domain, TOPIC)
        line = str(refused.value)
        assert f"ROS domain {domain}: has a sender of {TOPIC} already" in line
        assert f", process {process.pid} (" in line
        assert line.endswith("; stop it, or set another namespace or ROS_DOMAIN_ID")
        for _ in range(200):  # more often than it tells whose it is
            with pytest.raises(ParameterError, match="already"):
                lock_signal(domain, TOPIC)
        process.send_signal(signal.SIGKILL)
        process.wait()
        lock_signal(domain, TOPIC).close()


def test_other_domains_signals_and_namespaces_are_free(domain: int) -> None:
    long = f"/{'n' * 200}{TOPIC}"
    with (
        closing(lock_signal(domain, TOPIC)),
        closing(lock_signal(domain, f"/left{TOPIC}")),
        closing(lock_signal(domain, long)),
        closing(lock_signal(domain + 1, TOPIC)),
        pytest.raises(ParameterError),
    ):
        lock_signal(domain, long)


def test_a_graph_is_alone_in_its_namespace(domain: int) -> None:
    with sole_graph(""), sole_graph("/left"):
        for namespace, line in (("", "has a graph already"), ("/left", "has a graph in /left")):
            with pytest.raises(ParameterError, match=line), sole_graph(namespace):
                pass
    with sole_graph(""):
        pass
    for namespace in ("", "/left"):
        topic = f"{namespace}{TOPIC}"
        with (
            sending(domain, topic),
            pytest.raises(ParameterError, match=f"sender of {topic}"),
            sole_graph(namespace),
        ):
            pass
        with sending(domain, topic), sole_graph("/right"):
            pass


@pytest.mark.usefixtures("here")
def test_nodes_and_graphs_refuse_to_send_what_another_sends(start: Start, domain: int) -> None:
    coupler = start("-m", "haptic_accel.nodes.coupler")
    coupler.wait_for("waiting")
    said = f"has a sender of {TOPIC} already, process {coupler.process.pid} "
    second = start("-m", "haptic_accel.nodes.coupler")
    # A whole number will do for a real one.
    words = ("--ros-args", "-r", "__ns:=/left", "-p", "k_m:=300")
    elsewhere = start("-m", "haptic_accel.nodes.coupler", *words)
    assert second.end() == 2, second.text
    assert second.lines[-1].startswith(f"coupler: ROS domain {domain}: {said}"), second.text
    elsewhere.wait_for("waiting")
    for verb in (["teleop"], ["identify", "--out", "a"], ["experiment", "--out", "b"]):
        assert said in refusal(*verb)
    assert elsewhere.end(signal.SIGINT) == coupler.end(signal.SIGINT) == 0
