# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel keys`` as at a shell."""

from __future__ import annotations

from pathlib import Path

import pytest

from verbs import refusal, status_of

pytest.importorskip("cryptography")


def test_keys_are_made_once_for_two_hosts(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("keys", "robot.lab,10.0.0.2", "desk.lab", "--out", "mine") == 0
    out = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in out] == ["mine/robot", "mine/operator"]
    before = {path: path.read_bytes() for path in (here / "mine").glob("*/*.pem")}
    assert len(before) == 6
    assert "must be a new folder" in refusal("keys", "a", "b", "--out", "mine")
    assert {path: path.read_bytes() for path in before} == before


def test_a_wrong_name_leaves_no_folder(here: Path) -> None:
    assert "'a b': must be the name" in refusal("keys", "a b", "c")
    assert "'': must be the name" in refusal("keys", "", "c")
    assert list(here.iterdir()) == []
