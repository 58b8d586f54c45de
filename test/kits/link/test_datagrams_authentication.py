# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import fuzz
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.link.datagrams import (
    KEY_LENGTH,
    LINK_KEY,
    LONGEST_DATAGRAM,
    TITLE,
    Authenticator,
    read_key,
    write_new_key,
)

KEY, OTHER = b"k" * KEY_LENGTH, b"o" * KEY_LENGTH


@pytest.mark.parametrize("key", [KEY, b""])
@pytest.mark.parametrize("side", ["master", "slave"])
def test_what_one_side_tags_the_other_takes_and_nobody_else(key: bytes, side: str) -> None:
    (other,) = {"master", "slave"} - {side}
    sender, receiver = Authenticator(key, side), Authenticator(key, other)
    for datagram in (b"", b"felt", bytes(LONGEST_DATAGRAM)):
        data = sender.tagged(datagram)
        assert receiver.verified(data) == datagram
        assert sender.verified(data) is None, "a reflected datagram"
        for wrong in (OTHER, KEY if not key else b""):
            assert Authenticator(wrong, other).verified(data) is None


@fuzz
@given(st.binary(max_size=300), st.data())
def test_no_other_datagram_has_the_tag(datagram: bytes, data: st.DataObject) -> None:
    sender, receiver = Authenticator(KEY, "slave"), Authenticator(KEY, "master")
    tagged = sender.tagged(datagram)
    flipped = bytearray(tagged)
    flipped[data.draw(st.integers(0, len(tagged) - 1))] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.integers(0, len(tagged) - 1))
    more = data.draw(st.binary(min_size=1, max_size=20))
    for wrong in (bytes(flipped), tagged[:cut], tagged[cut + 1 :], tagged + more, more + tagged):
        assert receiver.verified(wrong) is None
    assert receiver.verified(data.draw(st.binary(max_size=400))) is None


def test_one_key_serves_several_namespaces_apart() -> None:
    left, right = (
        [Authenticator(bytes(KEY_LENGTH), side, space) for side in ("master", "slave")]
        for space in ("/left", "/right")
    )
    datagram = left[0].tagged(b"felt")
    assert left[1].verified(datagram) == b"felt"
    assert right[1].verified(datagram) is None


def refusal(folder: Path) -> str:
    with pytest.raises(ParameterError) as refused:
        read_key(str(folder))
    return str(refused.value)


def test_a_key_that_others_can_read_is_refused(tmp_path: Path) -> None:
    write_new_key(tmp_path)
    (tmp_path / LINK_KEY).chmod(0o640)
    said = "link.key: others can read it: must be for its owner alone, chmod 600"
    assert refusal(tmp_path).endswith(said)


UNREADABLE = [
    "",
    TITLE,
    f"{TITLE}\nff\n",
    "ff" * 32,
    f"{TITLE}\n{'g' * 64}",
    f"x\n{'ff' * 32}",
    "\xff" * 9,
]


@pytest.mark.parametrize("text", UNREADABLE)
def test_another_file_is_no_key(tmp_path: Path, text: str) -> None:
    file = tmp_path / LINK_KEY
    file.write_text(text, encoding="latin-1")
    file.chmod(0o600)
    assert refusal(tmp_path) == f"{file}: must be a key that haptic-accel keys made"


def test_what_cannot_be_read_is_named_and_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    assert refusal(tmp_path).startswith(f"keys = '{tmp_path}': link.key: no such file")
    os.mkfifo(tmp_path / LINK_KEY, 0o600)
    assert "must be a key" in refusal(tmp_path)
