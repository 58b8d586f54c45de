from __future__ import annotations

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.emulators.faults import read_faults


def test_faults_have_a_time_or_none() -> None:
    assert read_faults("", ["drop"]) == []
    assert read_faults("drop, error@3.5", ["drop", "error"]) == [("drop", None), ("error", 3.5)]


@pytest.mark.parametrize("text", ["fire", "drop@", "drop@soon", "drop@-1", "drop@inf", "drop,"])
def test_what_is_none_is_named_with_what_there_is(text: str) -> None:
    with pytest.raises(ParameterError, match="must be NAME or NAME@SECONDS of drop, error"):
        read_faults(text, ["drop", "error"])
