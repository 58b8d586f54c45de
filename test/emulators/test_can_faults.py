"""Faults and when they are there."""

from __future__ import annotations

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.emulators.can_faults import (
    AXIS_ERROR,
    DROP,
    FAULTS,
    UNPLUG,
    parse_faults,
)


def test_a_fault_with_a_time_lasts_a_while() -> None:
    faults = parse_faults("unplug@3, error@5", 2.0)
    assert [faults.active(UNPLUG, time) for time in (2.9, 3.0, 4.9, 5.0)] == [0, 1, 1, 0]
    assert not faults.active(DROP, 3.5)
    assert faults.begins(AXIS_ERROR, 5.1, 4.9)
    assert not faults.begins(AXIS_ERROR, 5.2, 5.1)


def test_a_fault_without_a_time_is_always_there() -> None:
    faults = parse_faults(DROP, 2.0)
    assert all(faults.active(DROP, time) for time in (0.0, 1e6))


def test_there_may_be_none() -> None:
    assert not any(parse_faults("", 1.0).active(name, 0.0) for name in FAULTS)


@pytest.mark.parametrize("word", ["fire", "drop@", "drop@soon", "drop@-1", "drop@inf", ",", "@3"])
def test_what_is_no_fault_is_refused_in_one_line(word: str) -> None:
    with pytest.raises(ParameterError, match="must be NAME or NAME@SECONDS of drop") as error:
        parse_faults(word, 1.0)
    assert "\n" not in str(error.value)
