# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import re

import pytest

from haptic_accel.core.parameters import ParameterError, allowed_values
from haptic_accel.devices import MASTERS, SLAVES
from haptic_accel.setup import build_parameters, node_schema
from haptic_accel.setup.node_parameters import (
    NODES,
    LinkNodeParameters,
    declared_schema,
)

OLDER = {"safety.arm.max_age": 0.2, "safety.actuator.max_age": 0.2}


ARMS = [("master_device", MASTERS), ("slave_device", SLAVES)]


@pytest.mark.parametrize(("executable", "devices"), ARMS)
def test_a_device_with_the_parameters_of_others_adds_none(executable: str, devices: dict) -> None:
    parts = {name.partition(".")[0] for name in node_schema(executable)}
    alone = {"pointer", "can_serial", "crtk_serial", "none"}
    assert set(devices) - parts == set(devices) & alone


@pytest.mark.parametrize(
    ("executable", "values", "parts"),
    [
        ("master_device", {}, {"simulated"}),
        ("master_device", {"device": "pointer"}, {"simulated"}),
        ("master_device", {"device": "can_serial"}, {"can", "serial"}),
        ("master_device", {"device": "none", "actuator_device": "audio"}, {"audio"}),
        ("slave_device", {"device": "can", "accelerometer_device": "audio"}, {"can", "audio"}),
        ("slave_device", {"device": "virtual"}, {"virtual"}),
    ],
)
def test_a_device_node_declares_the_parameters_of_its_devices(
    executable: str, values: dict[str, str], parts: set[str]
) -> None:
    own, _ = build_parameters(executable, values)
    declared = declared_schema(executable, own)
    common = {"safety", "servo_cp", *(["actuator"] if executable == "master_device" else [])}
    assert {name.partition(".")[0] for name in declared if "." in name} == parts | common
    assert declared.items() <= node_schema(executable).items()


def test_the_nodes_declare_few_parameters() -> None:
    own = {name: build_parameters(name, {})[0] for name in NODES}
    assert sum(len(declared_schema(*each)) for each in own.items()) <= 240


FRAGMENT = re.compile(r"(?i)(of|what|which|how|when|where|if|its?|this|that|those|and|or)\b")
"""Beginnings of texts that need something before them."""

PURE = re.compile(
    r"\b(ratio|factor|fraction|coefficient|exponent|deviation|margin|per|logarithm)\b"
)
"""Words for what has no unit."""


@pytest.mark.parametrize("executable", NODES)
def test_every_text_stands_alone_with_its_unit_and_what_is_allowed(executable: str) -> None:
    schema = node_schema(executable)
    assert schema
    for name, (default, specification) in schema.items():
        text, allowed = specification.text, allowed_values(default, specification)
        assert not FRAGMENT.match(text), f"{name}: {text}"
        assert len(text.split()) >= 3, f"{name}: {text}"
        assert not text.endswith("."), f"{name}: {text}"
        if isinstance(default, float):
            assert specification.unit or PURE.search(text), f"{name}: {text}"
            assert specification.admits(default), name
        if isinstance(default, (bool, str)) and not specification.choices:
            assert allowed == ("true or false" if isinstance(default, bool) else "text")
        else:
            assert re.match("one of|from|at least|above|a whole number, ", allowed), name
        assert all(choice in allowed for choice in specification.choices), name
        assert not specification.choices or default in (*specification.choices, ""), name


def test_defaults_are_the_papers() -> None:
    coupler, _ = build_parameters("coupler", {})
    assert (coupler.k_m, coupler.k_sl) == (250.0, 250.0)
    compensator, controllers = build_parameters("compensator", {})
    assert compensator.rate == 1000.0
    assert compensator.high_pass_frequency == 15.0
    assert controllers["actuator"].peak_force == 6.6
    assert controllers["constant"].mass == 0.128
    _, masters = build_parameters("master_device", {})
    handle = masters["simulated"].handle
    table_i = (0.018, 266.0, 2.0, 0.128, 1500.0, 11.0)
    assert (handle.m_a, handle.k_s, handle.b_s, handle.m_h, handle.k_u, handle.b_u) == table_i


@pytest.mark.parametrize("device", ["master_device", "slave_device"])
def test_a_latency_at_which_every_force_is_outdated_is_refused(device: str) -> None:
    build_parameters(device, {"latency": 20, "rate": 250.0})
    with pytest.raises(ParameterError, match=r"^latency = 20: 0\.1 s at rate = 200 Hz, must be"):
        build_parameters(device, {"latency": 20, "rate": 200.0})
    build_parameters(device, {"latency": 20, "rate": 200.0} | OLDER)


WRONG = [":7", "robot:", "robot:0", "robot:65535", "a b", "robot:x", "a/b", "[]:1"]


@pytest.mark.parametrize("peer", WRONG)
def test_another_form_is_refused_in_one_line(peer: str) -> None:
    with pytest.raises(ParameterError, match=r"^peer = .*: must be HOST or HOST:PORT"):
        LinkNodeParameters(peer=peer, keys="k")


@pytest.mark.parametrize("peer", ["10.0.0.2", "robot.lab", "fd00::2", "192.168.0.1:7300"])
def test_another_host_needs_a_key_unless_it_is_said_to_be_insecure(peer: str) -> None:
    with pytest.raises(ParameterError, match=r"^keys = '': must be the folder of this host's k"):
        LinkNodeParameters(peer=peer)
    LinkNodeParameters(peer=peer, insecure=True)
    LinkNodeParameters(peer=peer, keys="keys")


@pytest.mark.parametrize("peer", ["127.0.0.1", "127.9.9.9:7300", "localhost", "::1"])
def test_this_machine_needs_none(peer: str) -> None:
    LinkNodeParameters(peer=peer)
