# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of an arm that a user may set."""

from __future__ import annotations

import re
from typing import Any

import pytest

from haptic_accel.core.parameters import ParameterError, from_flat, schema
from haptic_accel.devices import MASTERS, SLAVES
from haptic_accel.devices.can.parameters import CanParameters


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


def test_both_sides_have_the_device_each_with_a_section_of_its_own() -> None:
    for devices, context in ((MASTERS, "master"), (SLAVES, "slave")):
        assert schema(devices["can"].Parameters)["context"][0] == context
