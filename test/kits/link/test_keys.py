# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel keys`` as at a shell."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from haptic_accel.kits.link.datagrams import LINK_KEY, read_key
from verbs import next_command, refusal, status_of


def test_both_hosts_get_one_key_also_without_certificates(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "haptic_accel.kits.link.certificates", None)
    for name in ("one", "other"):
        assert status_of("keys", "robot.lab", "desk.lab", "--out", name) == 0
    assert capsys.readouterr().out.startswith("without certificates for transport:=zenoh")
    names = ("one/robot", "one/operator", "other/robot")
    robot, operator, other = (read_key(str(here / name)) for name in names)
    assert robot == operator != other
    assert (here / "one/robot" / LINK_KEY).stat().st_mode & 0o777 == 0o600
    assert [path.name for path in (here / "one/robot").iterdir()] == [LINK_KEY]


def test_keys_are_made_once_for_two_hosts(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert status_of("keys", "robot.lab,10.0.0.2", "desk.lab", "--out", "mine") == 0
    pytest.importorskip("cryptography")
    out = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in out[::2]] == ["mine/robot", "mine/operator"]
    for line, host, words in zip(
        out[1::2],
        ("robot.lab", "desk.lab"),
        ("side:=slave peer:=desk.lab keys:=robot", "side:=master peer:=robot.lab keys:=operator"),
        strict=True,
    ):
        assert line.startswith(f"next on {host}: ")
        monkeypatch.chdir(here / "mine")
        assert next_command(line) == ["teleop", *words.split()]
    monkeypatch.chdir(here)
    before = {path: path.read_bytes() for path in (here / "mine").glob("*/*")}
    assert len(before) == 8
    assert "must be a new folder" in refusal("keys", "a", "b", "--out", "mine")
    assert {path: path.read_bytes() for path in before} == before


def test_a_wrong_name_leaves_no_folder(here: Path) -> None:
    pytest.importorskip("cryptography")
    assert "'a b': must be the name" in refusal("keys", "a b", "c")
    assert "'': must be the name" in refusal("keys", "", "c")
    assert list(here.iterdir()) == []
