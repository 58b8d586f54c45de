# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Process of a relay, and the lines that change its network."""

from __future__ import annotations

import os

import pytest

from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.link.relaying import (
    CHANGED,
    RelayArguments,
    changed,
    open_relay,
    serve_relay,
)


def served(*lines: str) -> list[str]:
    """Return what a relay says to lines; its input ends before it does."""
    reading, writing = os.pipe()
    os.write(writing, "".join(f"{line}\n" for line in lines).encode())
    os.close(writing)
    said: list[str] = []
    arguments = RelayArguments(0.05, master="127.0.0.1:7296", slave="127.0.0.1:7298")
    serve_relay(open_relay(arguments), said.append, lambda: len(said) > len(lines), reading)
    os.close(reading)
    return said


def test_each_line_changes_the_words_it_has() -> None:
    first, second, third = served("loss:=0.02", "delay:=0.1 loss:=0")
    assert first == f"{CHANGED}delay:=0.05 jitter:=0.0 loss:=0.0 duplication:=0.0"
    assert second == f"{CHANGED}delay:=0.05 jitter:=0.0 loss:=0.02 duplication:=0.0"
    assert third == f"{CHANGED}delay:=0.1 jitter:=0.0 loss:=0.0 duplication:=0.0"


def test_a_wrong_line_changes_nothing() -> None:
    _, refused, unchanged = served("dealy:=1", "")
    assert refused.startswith("dealy: no such argument (did you mean delay?)")
    assert unchanged == f"{CHANGED}delay:=0.05 jitter:=0.0 loss:=0.0 duplication:=0.0"


@pytest.mark.parametrize("word", ["loss:=2", "delay:=-1", "delay", "seed:=1"])
def test_wrong_words_are_refused(word: str) -> None:
    with pytest.raises(ParameterError):
        changed(ChannelParameters(), [word])
