# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Copyright and licence of every tracked file, as REUSE (https://reuse.software) asks for them."""

from __future__ import annotations

import fnmatch
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from haptic_accel._licence import SPDX_APACHE

SOURCE = Path(__file__).resolve().parents[1]
FIRST_LINES = 5
COMMENTS = {".py": "#", ".cpp": "//", ".h": "//", ".ino": "//"}
IDENTIFIER = "License-Identifier"  # apart, as this is no statement

pytestmark = pytest.mark.skipif(
    shutil.which("git") is None or not (SOURCE / ".git").exists(), reason="is not a clone"
)


def tracked() -> list[str]:
    command = ["git", "-C", str(SOURCE), "ls-files", "-z"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    names = [name for name in listed.split("\0") if (SOURCE / name).is_file()]
    assert names
    return names


def covered(name: str) -> bool:
    """Tell whether REUSE.toml or the licence itself speaks for a file."""
    paths = re.findall(r"path = \[(.*?)\]", (SOURCE / "REUSE.toml").read_text(), re.S)
    patterns = [p.replace("**", "*") for block in paths for p in re.findall(r'"(.*?)"', block)]
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in [*patterns, "LICENSE*"])


def test_every_file_states_copyright_and_licence() -> None:
    silent = []
    for name in tracked():
        if covered(name):
            continue
        head = "\n".join((SOURCE / name).read_text().splitlines()[:FIRST_LINES])
        stated = f"SPDX-{IDENTIFIER}: Apache-2.0" in head
        if not (stated and re.search(r"Copyright(Text:)? \d{4} \w", head)):
            silent.append(name)
    assert silent == []


def test_every_program_carries_the_two_lines_that_ament_copyright_recognises() -> None:
    header = SPDX_APACHE.file_headers[0].format(
        copyright="Copyright 2026 haptic_accel maintainers"
    )
    without = []
    for name in tracked():
        if Path(name).suffix in COMMENTS and not covered(name):
            comment = COMMENTS[Path(name).suffix]
            expected = "".join(f"{comment} {line}\n" for line in header.splitlines())
            if expected not in (SOURCE / name).read_text():
                without.append(name)
    assert without == []


def test_a_vendored_library_keeps_its_own_licence() -> None:
    assets = SOURCE / "haptic_accel/pages/assets"
    assert "MIT" in (assets / "uPlot.LICENSE").read_text()
    assert not re.search(r"SPDX.*haptic_accel", (assets / "uPlot.iife.min.js").read_text()[:500])
