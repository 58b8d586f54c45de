# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import config_folder
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments, parse_arguments
from haptic_accel.setup.node_parameters import node_schema
from haptic_accel.setup.processes import arrangement, graph, identification_graph
from haptic_accel.setup.setup import Setup
from haptic_accel.setup.words import parse_assignments

TELEOPERATION = {"recorder", "master_device", "slave_device", "coupler", "compensator"}

APART = (
    "a process for each node; composed:=true joins those that make forces, but with respawn:=true,"
    " slave:=topics or an arm by CRTK"
)
"""Line for a process for each node."""


OF_ALL = "one process for master_device, slave_device, coupler and compensator"
OF_SLAVE = "one process for slave_device and coupler, one each for recorder, link and scope"
TO_PART = "composed:=false gives each node its own"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """Return the path of a user's parameter file."""
    return tmp_path / "mine.yaml"


def test_five_processes_whose_parameters_they_have() -> None:
    processes = graph(GraphArguments(composed=False))
    assert {process.executable for process in processes} == TELEOPERATION
    for process in processes:
        assert list(process.parameters) == [process.executable]
        for node, values in process.parameters.items():
            assert set(values) <= set(node_schema(node))


@pytest.mark.parametrize(
    ("side", "executables"),
    [
        ("slave", ["recorder", "slave_device", "half_coupler", "link"]),
        ("master", ["recorder", "master_device", "half_coupler", "compensator", "link"]),
    ],
)
def test_beside_a_peer_each_host_has_its_arm_a_half_of_the_coupling_and_a_link(
    side: str, executables: list[str], mine: Path
) -> None:
    mine.write_text(f"{side}_device: {{ros__parameters: {{safety: {{recovery: manual}}}}}}")
    words = (f"side:={side}", "peer:=desk:7000", "keys:=/k", f"params_file:={mine}")
    given = parse_arguments([*words, "composed:=false"])
    processes = {process.executable: process for process in graph(given)}
    assert list(processes) == executables
    assert [name for name, each in processes.items() if each.respawn] == ["link"]
    coupler = processes["half_coupler"].parameters["coupler"]
    expected = {"side": side, "coupling": "passive", "recovery": "manual"}
    assert coupler.items() >= {**expected, "compensated": side == "master"}.items()
    link = {"side": side, "peer": "desk:7000", "transport": "udp", "keys": "/k", "insecure": False}
    assert processes["link"].parameters["link"] == link
    metadata = json.loads(processes["recorder"].parameters["recorder"]["facts"])
    assert metadata["arguments"].items() >= {"side": side, "peer": "desk:7000"}.items()
    others = {"compensator"} if side == "master" else set()
    assert set(metadata["parameters"]) == {f"{side}_device", "coupler", "link"} | others


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("slave:=none", "device = none: must come with accelerometers:=audio"),
        ("accelerometers:=audio", "audio.scales = '': must be the acceleration at full scale"),
        (
            "accelerometers:=audio composed:=false params_file:=scales.yaml",
            "composed = false: must be true with accelerometers:=audio",
        ),
        ("side:=slave", "side = 'slave': must come with peer:=HOST"),
        ("peer:=desk", "peer = 'desk': must come with side:=master or slave"),
        ("side:=both peer:=desk", "side = 'both': must be one of master, slave"),
        ("side:=slave peer:=a:b", "peer = 'a:b': must be HOST or HOST:PORT"),
        ("transport:=zenoh", "transport = 'zenoh': must come with peer:=HOST"),
        ("keys:=mine", "keys = 'mine': must come with peer:=HOST"),
        ("insecure:=true", "insecure = True: must come with peer:=HOST"),
        ("side:=slave peer:=desk", "keys = '': must be the folder of this host's keys"),
        ("side:=slave peer:=10.0.0.2:7000", "keys = '': must be the folder of this host's keys"),
        ("side:=slave peer:=localhost transport:=zenoh", "keys = '': must be the folder"),
        ("side:=slave peer:=desk transport:=dds", "transport = 'dds': must be one of udp, zenoh"),
        ("side:=slave peer:=a keys:=b insecure:=true", "insecure = True: must not come with keys"),
        (
            "side:=slave peer:=a transport:=zenoh insecure:=true",
            "insecure = True: must not come with transport:=zenoh",
        ),
        ("side:=slave peer:=localhost slave:=replay", "slave = 'replay': not with side:=slave"),
        ("side:=master peer:=localhost slave:=topics", "slave = 'topics': not with side:=master"),
        (
            "side:=master peer:=localhost slave:=serial",
            "slave = 'serial': belongs to the peer, not to side:=master",
        ),
        ("slave:=virtual surface:=cave", "surface = 'cave': must be one of workshop"),
        ("bag:=/proc/x/y", "bag = '/proc/x/y': must be a folder to make: "),
        ("bag:=/dev/null/bag", "bag = '/dev/null/bag': must be a folder to make: "),
        ("params_file:=scales.yaml rate:=100", "rate = 100: must be above twice high_pass_freq"),
        ("master:=serial", "serial.port = '': must be the path of a port"),
        ("slave:=serial", "serial.port = '': must be the path of a port"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_starts(
    words: str, line: str, here: Path
) -> None:
    own = "_device: {ros__parameters: {audio: {scales: '100'}}}\n"
    high = "compensator: {ros__parameters: {high_pass_frequency: 60.0}}"
    (here / "scales.yaml").write_text(f"master{own}slave{own}{high}", encoding="utf-8")
    with pytest.raises(ParameterError) as refused:
        graph(parse_arguments(words.split()))
    assert str(refused.value).startswith(line)


APART_FOR = ["respawn:=true", "slave:=topics replay:=/bag"]


@pytest.mark.parametrize("words", APART_FOR)
@pytest.mark.parametrize("asked", ["", " composed:=true"])
def test_what_needs_a_process_for_each_node_gets_it(words: str, asked: str) -> None:
    arguments = parse_arguments((words + asked).split())
    processes = graph(arguments)
    assert len(processes) == 5
    assert not arguments.composed
    assert arrangement(processes).startswith("a process for each node; ")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("", f"{OF_ALL}, one for recorder; {TO_PART}"),
        ("record:=false", f"{OF_ALL}; {TO_PART}"),
        ("side:=slave peer:=localhost scope:=true", f"{OF_SLAVE}; {TO_PART}"),
        ("composed:=false", APART),
        ("composed:=false side:=slave peer:=localhost", APART),
    ],
)
def test_one_line_tells_which_nodes_share_a_process(words: str, line: str) -> None:
    assert arrangement(graph(parse_arguments(words.split()))) == line


def test_an_identification_has_no_other_arrangement() -> None:
    assert arrangement(identification_graph(IdentifyArguments())) == ""


def test_who_leads_the_hand_changes_nothing_else_of_the_simulated_handle() -> None:
    words = ["rig:=ideal", "grip:=pinch", "controller:=adaptive"]
    masters = ("simulated", "pointer")
    given = (parse_arguments([f"master:={master}", *words]) for master in masters)
    scripted, led = (Setup.of(each).values for each in given)
    assert led["master_device"] == scripted["master_device"] | {"device": "pointer"}
    assert {**led, "master_device": {}} == {**scripted, "master_device": {}}


def test_an_identification_has_three_and_knows_the_simulated_actuator(mine: Path) -> None:
    mine.write_text(
        "/**: {ros__parameters: {actuator: {m_a: 0.03, k_s: 400.0}}}\n"
        "identifier: {ros__parameters: {actuator: {k_s: 500.0}, rest: 2.0}}"
    )
    sweep = {"trials": 2, "end_frequency": 300.0, "grip": "hook"}
    arguments = IdentifyArguments(params_file=str(mine), **sweep)
    processes = {p.executable: p.parameters for p in identification_graph(arguments)}
    assert set(processes) == {"recorder", "master_device", "identifier"}
    values = processes["identifier"]["identifier"]
    assert set(values) <= set(node_schema("identifier"))
    assert values["actuator.m_a"] == 0.03
    assert values["actuator.k_s"] == 500.0  # what the user measured goes first
    assert (values["trials"], values["end_frequency"], values["rest"]) == (2, 300.0, 2.0)
    assert processes["master_device"]["master_device"]["simulated.grip.posture"] == "hook"


def test_a_scene_is_checked_before_anything_starts_and_its_force_is_recorded(here: Path) -> None:
    recorder, *_ = found = graph(parse_arguments(["slave:=virtual", "topics:=/joy"]))
    assert recorder.parameters["recorder"]["topics"] == "/joy,slave/contact_force"
    (slave,) = (each for each in found if "slave_device" in each.parameters)
    scene = slave.parameters["slave_device"]["virtual.scene"]
    assert Path(scene) == config_folder() / "scenes" / "workshop.yaml"
    Path("mine.yaml").write_text("objects: {box: {shape: box, material: wood}}")
    with pytest.raises(ParameterError, match=r"mine\.yaml:1: objects\.box\.material = 'wood'"):
        graph(parse_arguments(["slave:=virtual", "surface:=mine.yaml"]))


def test_a_sweep_beyond_half_the_rate_or_a_board_without_a_port_is_refused() -> None:
    with pytest.raises(ParameterError, match="end_frequency = 300"):
        identification_graph(IdentifyArguments(end_frequency=300.0, rate=500.0))
    with pytest.raises(ParameterError, match=r"serial.port = '': must be the path of a port"):
        identification_graph(IdentifyArguments(master="serial"))


@pytest.mark.parametrize("composed", [False, True])
def test_a_scope_is_added_last_and_the_graph_can_do_without_it(composed: bool) -> None:
    arguments = GraphArguments(scope=True, scope_port=0, scope_control=True, composed=composed)
    *others, scope = graph(arguments)
    assert scope.executable == "scope"
    assert scope.optional
    given = {"port": 0, "control": True}
    assert scope.parameters["scope"].items() >= given.items()
    assert not any(process.optional for process in others)
    assert {"scope"}.isdisjoint(node for process in others for node in process.parameters)


@pytest.mark.parametrize("composed", [False, True])
def test_all_processes_of_a_graph_are_in_its_namespace_and_log_alike(composed: bool) -> None:
    given = {"namespace": "lab/left", "log_level": "debug", "scope": True}
    arguments = GraphArguments(composed=composed, **given)
    for process in graph(arguments):
        assert (process.namespace, process.log_level) == ("/lab/left", "debug")


@pytest.mark.parametrize(
    ("key", "namespace", "holds"),
    [
        ("coupler", "", True),
        ("/coupler", "", True),
        ("/*/coupler", "", False),
        ("/**/coupler", "", True),
        ("/left/coupler", "", False),
        ("/**/coupler", "/lab/left", True),
        ("/lab/*/coupler", "/lab/left", True),
        ("/lab/**/coupler", "/lab/left", True),
        ("/lab/**", "/lab/left", True),
        ("/lab/left/coupler", "lab/left", True),
        ("/left/coupler", "/lab/left", False),
        ("coupler", "left", False),
    ],
)
def test_a_users_key_must_hold_in_the_namespace_of_the_graph(
    mine: Path, key: str, namespace: str, holds: bool
) -> None:
    mine.write_text(f"{key}: {{ros__parameters: {{k_m: 300.0}}}}")
    arguments = GraphArguments(params_file=str(mine), namespace=namespace)
    if holds:
        assert Setup.of(arguments).values["coupler"]["k_m"] == 300.0
    else:
        why = rf"{mine}:1: {re.escape(key)}: holds in another namespace, not for /.*coupler; write"
        with pytest.raises(ParameterError, match=rf"{why} /\*\*/coupler$"):
            Setup.of(arguments)


@pytest.mark.parametrize("namespace", ["a-b", "a//b", "1a", "a b", "~"])
def test_what_is_no_namespace_is_refused(namespace: str) -> None:
    with pytest.raises(ParameterError, match=f"^namespace = '{namespace}': must be letters"):
        GraphArguments(namespace=namespace)


@pytest.mark.parametrize(
    ("node", "given", "arguments", "line"),
    [
        (
            "compensator",
            "rate: 500",
            {},
            "rate of compensator = 500: not used, as the argument rate:= replaces it",
        ),
        (
            *("/**", "latency: 4", {}),
            "latency of master_device, slave_device, coupler, compensator = 4: not used, as the"
            " argument latency:= replaces it",
        ),
        ("slave_device", "device: can", {}, "as the argument slave:= replaces it"),
        ("scope", "port: 9000", {"scope": True}, "as the argument scope_port:= replaces it"),
        (
            "master_device",
            "simulated.grip.posture: hook",
            {"grip": "pinch"},
            "as the argument grip:= replaces it",
        ),
    ],
)
def test_a_value_of_a_file_that_an_argument_replaces_is_stated(
    mine: Path,
    caplog: pytest.LogCaptureFixture,
    node: str,
    given: str,
    arguments: dict[str, Any],
    line: str,
) -> None:
    mine.write_text(f"{node}: {{ros__parameters: {{{given}}}}}")
    graph(GraphArguments(params_file=str(mine), **arguments))
    (stated,) = caplog.messages
    assert stated.startswith(f"{mine}: ")
    assert line in stated


def test_a_value_of_a_file_that_the_graph_itself_sets_is_refused(mine: Path) -> None:
    mine.write_text("coupler: {ros__parameters: {compensated: false}}")
    why = "compensated of coupler = False: the graph's arguments make it True; leave it out"
    with pytest.raises(ParameterError, match=f"^{mine}: {why}$"):
        graph(GraphArguments(params_file=str(mine)))


RIG = """
/**: {ros__parameters: {rate: 500.0}}
master_device: {ros__parameters: {device: serial, serial: {port: /dev/ttyACM0}}}
slave_device: {ros__parameters: {device: serial, serial: {port: /dev/ttyACM1}}}
"""


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """Return the parameter file of a rig with two boards."""
    path = tmp_path / "rig.yaml"
    path.write_text(RIG)
    return path


def test_a_rigs_file_decides_the_devices_and_the_rate(rig_file: Path) -> None:
    arguments = parse_arguments([f"params_file:={rig_file}"])
    assert (arguments.master, arguments.slave, arguments.rate) == ("serial", "serial", 500.0)
    values = Setup.of(arguments).values
    assert values["master_device"]["device"] == "serial"
    assert values["master_device"]["serial.port"] == "/dev/ttyACM0"
    assert values["coupler"]["rate"] == 500.0


def test_a_word_wins_over_the_file_even_if_it_is_the_default(rig_file: Path) -> None:
    words = [f"params_file:={rig_file}", "master:=simulated", "rate:=1000"]
    arguments = parse_arguments(words)
    assert (arguments.master, arguments.slave, arguments.rate) == ("simulated", "serial", 1000.0)
    assert Setup.of(arguments).values["master_device"]["device"] == "simulated"


def test_an_identification_keeps_its_own_latency(tmp_path: Path, rig_file: Path) -> None:
    late = tmp_path / "late.yaml"
    late.write_text("master_device: {ros__parameters: {latency: 3}}")
    words = [f"params_file:={rig_file},{late}"]
    assert parse_arguments(words).latency == 3
    found = parse_assignments(words, IdentifyArguments)
    assert (found.latency, found.master, found.rate) == (10, "serial", 500.0)


def test_a_wrong_value_for_an_argument_names_the_file(mine: Path) -> None:
    mine.write_text("master_device: {ros__parameters: {device: seriel}}")
    with pytest.raises(
        ParameterError, match=f"^{mine}: device of master_device = 'seriel': must be one"
    ):
        parse_arguments([f"params_file:={mine}"])


def test_the_last_of_several_files_wins_and_the_replaced_value_is_stated(
    here: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name, k_m, m_a in (("a.yaml", 300.0, 0.02), ("b.yaml", 200.0, 0.03)):
        coupler = f"coupler: {{ros__parameters: {{k_m: {k_m}, k_sl: 300.0}}}}"
        every = f"/**: {{ros__parameters: {{actuator: {{m_a: {m_a}}}}}}}"
        Path(name).write_text(f"{coupler}\n{every}")
    values = Setup.of(GraphArguments(params_file="a.yaml,b.yaml")).values
    assert (values["coupler"]["k_m"], values["coupler"]["k_sl"]) == (200.0, 300.0)
    a, b = here / "a.yaml", here / "b.yaml"
    assert f"{b}: k_m of coupler = 200.0: replaces 300.0 of {a}" in caplog.messages
    (mass,) = (each for each in caplog.messages if "m_a" in each)
    assert mass.startswith(f"{b}: actuator.m_a of ")
    assert mass.endswith(f" = 0.03: replaces 0.02 of {a}")
    assert len(caplog.messages) == 2


UNUSED = "not used, as the argument controller:= replaces it"


@pytest.mark.parametrize(("typed", "unused"), [([], []), (["controller:=none"], [UNUSED])])
def test_of_two_files_that_decide_an_argument_the_earlier_is_stated_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, typed: list[str], unused: list[str]
) -> None:
    files = {tmp_path / "a.yaml": "inverse", tmp_path / "b.yaml": "adaptive"}
    for file, controller in files.items():
        file.write_text(f"compensator: {{ros__parameters: {{controller: {controller}}}}}")
    a, b = files
    Setup.of(parse_arguments([f"params_file:={a},{b}", *typed]))
    here = f"{b}: controller of compensator = adaptive: "
    assert caplog.messages == [f"{here}replaces inverse of {a}", *(here + why for why in unused)]


def test_the_recorder_notes_every_file_by_its_absolute_path(here: Path) -> None:
    for name in ("a.yaml", "b.yaml"):
        Path(name).write_text("coupler: {ros__parameters: {k_m: 300.0}}")
    recorder = graph(GraphArguments(params_file="a.yaml,b.yaml"))[0]
    metadata = json.loads(recorder.parameters["recorder"]["facts"])
    assert metadata["arguments"]["params_file"] == f"{here}/a.yaml,{here}/b.yaml"


@pytest.mark.parametrize(
    ("node", "given"),
    [
        ("scope", "port: 9000"),  # no page is asked for
        ("identifier", "rate: 500"),  # nor an identification
        ("master_device", "simulated.grip.posture: hook"),
        ("recorder", "max_bag_duration: 60.0"),
    ],
)
def test_what_no_argument_sets_a_file_may_give(mine: Path, node: str, given: str) -> None:
    mine.write_text(f"{node}: {{ros__parameters: {{{given}}}}}")
    name, value = given.split(": ")
    values = Setup.of(GraphArguments(params_file=str(mine))).values
    assert str(values[node][name]) == value


def test_the_rig_is_made_of_the_same_parameters(mine: Path) -> None:
    mine.write_text("master_device: {ros__parameters: {simulated: {handle: {m_h: 0.2}}}}")
    rig = Setup.of(GraphArguments(surface="vinyl", params_file=str(mine))).rig()
    assert rig.master.handle.m_h == 0.2
    assert rig.slave.surface.name == "vinyl"


def test_a_bag_is_not_made_before_anything_starts(tmp_path: Path) -> None:
    graph(GraphArguments(bag=str(tmp_path / "new" / "bag")))
    assert not (tmp_path / "new").exists()


def test_graphs_that_start_together_in_a_new_folder_do_not_refuse_each_other(here: Path) -> None:
    arguments = GraphArguments()
    with ThreadPoolExecutor(2) as pool:
        assert len(list(pool.map(graph, [arguments] * 40))) == 40
    assert not list(here.iterdir())
