# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest

from haptic_accel import __version__
from haptic_accel.bags.facts import custom_data, facts_of, facts_text
from haptic_accel.core.parameters import ParameterError


def test_what_goes_into_a_bag_comes_out() -> None:
    arguments = {"surface": "vinyl", "rate": 1000.0, "record": True}
    parameters = {"coupler": {"k_m": 250.0}}
    stored = custom_data(facts_text(arguments, parameters))
    assert all(isinstance(value, str) for value in stored.values())
    facts = facts_of({**stored, "another.program": "says something"})
    assert facts["arguments"] == arguments
    assert facts["parameters"] == parameters
    assert facts["version"] == __version__
    assert {"python", "system", "ros_distro", "cores"} <= set(facts["host"])
    assert set(facts) == {"arguments", "parameters", "version", "host"}


def test_a_recorder_by_itself_knows_at_least_where_it_runs() -> None:
    facts = facts_of(custom_data(""))
    assert (facts["arguments"], facts["parameters"]) == ({}, {})


@pytest.mark.parametrize("text", ["{", "[1]", "word"])
def test_what_is_no_object_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="^facts: must be a JSON object"):
        custom_data(text)
