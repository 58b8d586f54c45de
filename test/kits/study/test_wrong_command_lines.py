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

"""Wrong command lines of `study`: refused in one line."""

from __future__ import annotations

from pathlib import Path

from kits.study.studies import TEXT

from haptic_accel.kits.study.folder import templates
from refusals import assert_refused, rows

TEMPLATES = ", ".join(templates())

FILES = {
    "misspelt/study.yaml": TEXT.replace("adaptive", "adaptve"),
    "blank/study.yaml": TEXT.replace("I agree to take part.", '"[[ blank: purpose ]] I agree."'),
    "study/study.yaml": TEXT,
    "untested/study.yaml": TEXT.partition("tests:")[0],
}
"""Text of files in the working folder."""

REFUSED = {
    "study new --template gain mine": f"...: must be one of {TEMPLATES} (did you mean gain_jnd?)",
    "study check empty": "empty: must be a study's folder, ...",
    "study simulate empty": "empty: must be a study's folder, ...",
    "study status empty": "empty: must be a study's folder, ...",
    "study analyze empty": "empty: must be a study's folder, ...",
    "study export empty": "empty: must be a study's folder, ...",
    "study check misspelt": "misspelt/study.yaml:6: factors.controller = 'adaptve': ...",
    "study simulate untested": "untested/study.yaml: tests = nothing: must be given ...",
    "study run blank --participant P07": (
        "blank/study.yaml:5: consent.text: must have its 1 blanks filled in: purpose"
    ),
    "study run study --participant Anna": "participant = 'Anna': must be a pseudonym ...",
    "study resume study --participant Anna": "participant = 'Anna': must be a pseudonym ...",
}
"""Line of each command line, in which ... stands for any text."""


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)
