# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pseudo-terminals and faults of emulators."""

from __future__ import annotations

import os
import select
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import ODD_TEXTS, accepted, fuzz
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.emulators.ports import (
    AXIS_ERROR,
    CAN_FAULTS,
    DROP,
    SERIAL_FAULTS,
    SHARE,
    STALL,
    UNPLUG,
    Faults,
    PseudoTerminal,
)


def test_bytes_pass_both_ways_while_a_host_has_it_open(tmp_path: Path) -> None:
    path = tmp_path / "port"
    port = PseudoTerminal(path)
    assert port.plugged
    host = os.open(path, os.O_RDWR | os.O_NOCTTY)
    os.write(host, b"to\0the\nboard\r")
    assert select.select([port], [], [], 10.0)[0]  # the kernel passes bytes on in its own time
    assert port.read() == b"to\0the\nboard\r"
    assert port.read() == b""
    assert port.write(b"to\0the\nhost\r")
    assert os.read(host, 100) == b"to\0the\nhost\r"
    os.close(host)
    assert port.read() is None
    port.unplug()


def test_nothing_is_torn_while_there_is_no_room(tmp_path: Path) -> None:
    port = PseudoTerminal(tmp_path / "port")
    host = os.open(tmp_path / "port", os.O_RDWR | os.O_NOCTTY)
    line = b"0123456789abcdef" * 8
    sent = 0
    while port.write(line):
        sent += 1
    received = b""
    while len(received) < sent * len(line):
        received += os.read(host, 4096)
        port.write(b"")  # sends the rest of the last line
    assert received == line * sent
    os.close(host)
    port.unplug()


def test_it_can_be_unplugged_and_plugged_in_again(tmp_path: Path) -> None:
    path = tmp_path / "port"
    port = PseudoTerminal(path)
    port.unplug()
    port.unplug()
    assert not path.is_symlink()
    assert port.read() is None
    assert not port.write(b"x")
    port.plug()
    name = os.readlink(path)
    port.plug()
    assert os.readlink(path) == name
    port.unplug()


def test_a_fault_with_a_time_acts_for_a_while_after_the_beginning() -> None:
    faults = Faults("unplug@3, error@5", CAN_FAULTS, 2.0)
    assert faults.advance(50.0) == []
    assert not faults.begun
    faults.begin()
    assert faults.begun
    found = []
    for time in (52.9, 53.0, 54.9, 55.1):
        found.append((faults.advance(time), faults.active(UNPLUG), faults.active(AXIS_ERROR)))
        faults.begin()  # only the first counts
    outcomes = [([], False, False), ([UNPLUG], True, False), ([], True, False)]
    assert found == [*outcomes, ([AXIS_ERROR], False, True)]


def test_a_fault_without_a_time_always_acts() -> None:
    faults = Faults(DROP, CAN_FAULTS)
    for time in (0.0, 1e6):
        faults.advance(time)
        assert faults.active(DROP)
    struck = sum(faults.strikes(DROP) for _ in range(10_000)) / 10_000
    assert struck == pytest.approx(SHARE, rel=0.2)


def test_others_come_now_and_then() -> None:
    faults = Faults(STALL, SERIAL_FAULTS)
    faults.advance(0.0)
    faults.begin()
    stalled = 0
    for step in range(100_000):
        faults.advance(step * 1e-3)
        stalled += faults.active(STALL)
    # Half a stall a second of 50 ms each, in 100 s.
    assert 1000 < stalled < 5000


def test_a_fault_may_be_injected_at_once() -> None:
    faults = Faults()
    faults.advance(5.0)
    faults.inject(UNPLUG, 1.0)
    assert faults.active(UNPLUG)
    faults.advance(6.0)
    assert not faults.active(UNPLUG)


def test_there_may_be_none() -> None:
    faults = Faults()
    assert faults.advance(0.0) == []
    assert not any(faults.active(name) or faults.strikes(name) for name in CAN_FAULTS)


@pytest.mark.parametrize("kinds", [CAN_FAULTS, SERIAL_FAULTS], ids=["can", "serial"])
@pytest.mark.parametrize("word", ["fire", "drop@", "drop@soon", "drop@-1", "drop@inf", ",", "@3"])
def test_what_is_no_fault_is_refused_in_one_line(word: str, kinds: dict[str, object]) -> None:
    names = ", ".join(kinds)
    allowed = f"^faults: .*must be NAME or NAME@SECONDS of {names}$"
    with pytest.raises(ParameterError, match=allowed) as error:
        Faults(word, kinds)
    assert "\n" not in str(error.value)


@fuzz
@given(st.sampled_from(ODD_TEXTS) | st.text(), st.sampled_from([CAN_FAULTS, SERIAL_FAULTS]))
def test_any_text_is_taken_or_refused_in_one_line(word: str, kinds: dict[str, object]) -> None:
    accepted(lambda: Faults(word, kinds))
