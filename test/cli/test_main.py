from __future__ import annotations

from collections.abc import Callable

import pytest

from running import Command

Start = Callable[..., Command]


@pytest.mark.parametrize("verb", ["teleop", "experiment"])
@pytest.mark.quiet
def test_help_lists_every_argument_with_default_and_unit(haptic_accel: Start, verb: str) -> None:
    command = haptic_accel(verb, "--help")
    assert command.end() == 0
    names = ["controller", "surface", "master", "slave", "rate", "duration", "record"]
    for name in [*names, "bag", "config", "seed"]:
        command.wait_for(rf"^  {name} .*\(default: ")
    assert "[Hz] (default: 1000.0)" in command.text


@pytest.mark.parametrize("words", [[], ["dance"], ["teleop", "--fast"]])
@pytest.mark.quiet
def test_wrong_verbs_and_options_have_status_2(haptic_accel: Start, words: list[str]) -> None:
    command = haptic_accel(*words)
    assert command.end() == 2
    assert "Traceback" not in command.text
