# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Copyright and licence of every tracked file, as REUSE (https://reuse.software) asks for them."""

from __future__ import annotations

import fnmatch
import re
import shutil
import subprocess
from pathlib import Path

import pytest

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


def test_every_program_carries_the_header_that_ament_copyright_asks_for() -> None:
    header = Path(__file__).read_text().split('"""', maxsplit=1)[0].strip()
    lines = [line.removeprefix("#") for line in header.splitlines()]
    without = []
    for name in tracked():
        if Path(name).suffix in COMMENTS and not covered(name):
            comment = COMMENTS[Path(name).suffix]
            expected = "\n".join(comment + line for line in lines)
            if expected not in (SOURCE / name).read_text():
                without.append(name)
    assert without == []


def test_a_vendored_library_keeps_its_own_licence() -> None:
    assets = SOURCE / "haptic_accel/pages/assets"
    assert "MIT" in (assets / "uPlot.LICENSE").read_text()
    assert not re.search(r"SPDX.*haptic_accel", (assets / "uPlot.iife.min.js").read_text()[:500])
