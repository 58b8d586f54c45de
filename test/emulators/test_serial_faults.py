"""What a user may have an emulated board suffer."""

from __future__ import annotations

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.emulators.serial_faults import PlannedFault, parse_faults


def test_faults_have_a_time_or_none() -> None:
    assert parse_faults("") == []
    assert parse_faults("garbage, unplug@2.5") == [
        PlannedFault("garbage"),
        PlannedFault("unplug", 2.5),
    ]


@pytest.mark.parametrize("text", ["fire", "stall@", "stall@soon", "stall@-1", "stall@inf", ","])
def test_other_faults_are_refused_by_name(text: str) -> None:
    with pytest.raises(ParameterError, match=r"^faults: .*must be NAME or NAME@SECONDS of"):
        parse_faults(text)
