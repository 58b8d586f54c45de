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

"""Parameters of an arm that a user may set."""

from __future__ import annotations

import re
from typing import Any

import pytest

from haptic_accel.core.parameters import ParameterError, from_flat, schema
from haptic_accel.devices import MASTERS, SLAVES
from haptic_accel.devices.can.device import CanSlave
from haptic_accel.devices.can.kinematics import kinematics_of
from haptic_accel.devices.can.parameters import KINEMATICS, CanParameters


@pytest.mark.parametrize(("kinematics", "joints"), [*zip(KINEMATICS, (1, 2, 3), strict=True)])
def test_each_kinematics_has_its_joints(kinematics: str, joints: int) -> None:
    parameters = CanParameters(kinematics=kinematics)
    assert list(parameters.joints) == ["joint1", "joint2", "joint3"][:joints]
    assert len(kinematics_of(parameters).home) == joints


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"joint2.node_id": 0}, "joint2.node_id = 0: must not be that of joint1"),
        ({"joint1.node_id": 64}, "joint1.node_id = 64: must be a whole number, from 0 to 63"),
        ({"joint3.direction": 0}, "joint3.direction = 0: must be 1 or -1"),
        ({"options": "[1]"}, "options = '[1]': must be a JSON object"),
        ({"options": "{"}, "options = '{': must be a JSON object"),
        ({"kinematics": "delta"}, "kinematics = 'delta': must be one of stage, planar, arm"),
        (
            {"bitrate": 2_000_000},
            "bitrate = 2000000: must be a whole number, from 0 to 1e+06 bit/s",
        ),
    ],
)
def test_a_wrong_value_is_refused_in_one_line(values: dict[str, Any], what: str) -> None:
    with pytest.raises(ParameterError, match="^" + re.escape(what)) as error:
        from_flat(CanParameters, values)
    assert "\n" not in str(error.value)


def test_joints_that_are_not_there_may_have_any_node() -> None:
    assert from_flat(CanParameters, {"kinematics": "stage", "joint2.node_id": 0})


def test_both_sides_have_the_device_each_with_a_section_of_its_own() -> None:
    for devices, context in ((MASTERS, "master"), (SLAVES, "slave")):
        assert schema(devices["can"].Parameters)["context"][0] == context


def test_a_wrong_interface_is_a_wrong_argument() -> None:
    device = CanSlave(from_flat(CanSlave.Parameters, {"interface": "tin"}), 200.0, 0)
    with pytest.raises(ParameterError, match="can.interface = 'tin'"):
        device.open()
    device.close()
