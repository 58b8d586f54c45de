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

"""Wrong command lines of `texture`: refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from refusals import assert_refused, rows, written

SAMPLES = "".join(f"{index},60,1,{index % 7}\n" for index in range(2000))

FILES = {
    "axis.csv": f"t [ms],speed,force,ax [g]\n{SAMPLES}",
    "drag.csv": f"index,speed,force,accel\n{SAMPLES}",
    "numbers.csv": "60,1,0.5\n" * 2000,
    "slow.csv": "force,accel\n1,2\n",
    "timed.csv": f"t [ms],speed,force,accel\n{SAMPLES}",
}
"""Text of files in the working folder."""

REFUSED = {
    "texture build drag.csv --out a.yaml": "rate = 0: must be given for a CSV file ...",
    "texture build text --rate 500 --out a.yaml": "rate = 500: a bag states its own: leave ...",
    "texture build text --axes x,y,z --out a.yaml": "axes = x,y,z: a bag states its own: ...",
    "texture build no.csv --rate 1000 --out a.yaml": "no.csv: No such file or directory, ...",
    "texture build drag.csv --rate 100 --out a.yaml": "...must be at least 500 Hz...",
    "texture build drag.csv --rate 1000": "Missing option ...--out...",
    "texture build drag.csv --rate 1000 --out no/a.yaml": "out = 'no/a.yaml': No such file ...",
    "texture build drag.csv --rate 1000 --axes a,b --out a.yaml": "axes = a,b: must be 3 ...",
    "texture build drag.wav --out a.yaml": "drag.wav: is a WAV file, must be a CSV file ...",
    "texture build timed.csv --rate 2000 --out a.yaml": (
        "timed.csv: column t [ms] says 1000 Hz, rate = 2000: must agree"
    ),
    "texture import axis.csv --out a.yaml": (
        "axis.csv: column = acceleration or ...: no such column; there are t [ms], ..., ax [g]"
    ),
    "texture build axis.csv --out a.yaml": (
        "axis.csv: ...there are t [ms], speed, force, ax [g]; choose one with --axes X,Y,Z"
    ),
    "texture build slow.csv --rate 1000 --out a.yaml": (
        "slow.csv: column = speed: no such column; there are force, accel"
    ),
    "texture build numbers.csv --rate 1000 --out a.yaml": (
        "numbers.csv: has no titles, but columns 1, 2, 3: add titles"
    ),
    "texture show oak": "texture = 'oak': must be one of plywood, text, vinyl, ...",
    "texture render vinyl --speed -1 --force 1 --out a.wav": "...--speed...: -1.0 is not in ...",
}
"""Line of each command line, in which ... stands for any text."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the command lines name."""
    folder = written(tmp_path_factory.mktemp("folder"), FILES)
    wavfile.write(folder / "drag.wav", 1000, np.zeros(2000))
    return folder


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)
