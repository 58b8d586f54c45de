# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of wrong command lines, and the line with which each is refused."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from pathlib import Path

import pytest

from verbs import refusal, tells

DATA = Path(__file__).parents[1] / "data"

LONG = "x" * 300
"""Name longer than a file can have; in a table, LONG."""


def written(folder: Path, files: Mapping[str, str]) -> Path:
    """Write texts by file name, an empty file and folder, and two bags, which tables may name."""
    (folder / "empty").mkdir()
    for name, text in {"file": "", **files}.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    for bag in ("text", "plywood"):
        (folder / bag).symlink_to(DATA / bag)
    return folder


def rows(refused: Mapping[str, str]) -> pytest.MarkDecorator:
    """Run a test with each command line and its line, in which ... stands for any text."""
    names = [f"haptic-accel {words}" for words in refused]
    return pytest.mark.parametrize(("words", "line"), refused.items(), ids=names)


def assert_refused(folder: Path, words: str, line: str) -> None:
    """Check that a command line in a folder is refused with a line, and changes no file."""
    before, working = sorted(folder.rglob("*")), Path.cwd()
    os.chdir(folder)
    try:
        said = refusal(*shlex.split(words.replace("LONG", LONG))).replace(LONG, "LONG")
    finally:
        os.chdir(working)
    assert tells(said, line), said
    assert sorted(folder.rglob("*")) == before
