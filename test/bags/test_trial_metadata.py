# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest

from haptic_accel import __version__
from haptic_accel.bags.trial_metadata import custom_data, json_text, read_custom_data
from haptic_accel.core.parameters import ParameterError


def test_what_goes_into_a_bag_comes_out() -> None:
    arguments = {"surface": "vinyl", "rate": 1000.0, "record": True}
    parameters = {"coupler": {"k_m": 250.0}}
    stored = custom_data(json_text(arguments, parameters))
    assert all(isinstance(value, str) for value in stored.values())
    found = read_custom_data({**stored, "another.program": "says something"})
    assert found["arguments"] == arguments
    assert found["parameters"] == parameters
    assert found["version"] == __version__
    assert {"python", "system", "ros_distro", "cores"} <= set(found["host"])
    assert set(found) == {"arguments", "parameters", "version", "host"}


def test_a_recorder_by_itself_knows_at_least_where_it_runs() -> None:
    found = read_custom_data(custom_data(""))
    assert (found["arguments"], found["parameters"]) == ({}, {})


@pytest.mark.parametrize("text", ["{", "[1]", "word"])
def test_what_is_no_object_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="^facts: must be a JSON object"):
        custom_data(text)
