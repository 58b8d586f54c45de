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

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = """import os
from haptic_accel.nodes.log_lines import NodeLogger

log = NodeLogger("arm")
os.stat = os.lstat = None  # nothing is asked of the file system

def speak():
    return log.info("cold"), log.warning("hot"), log.warn("too\\x1b hot\\n"), log.debug("silent")

print(speak())
"""


def test_a_line_names_who_logs_it_without_a_look_at_files(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(SCRIPT)
    names = "{name} {severity} {function_name} {line_number} {message}"
    done = subprocess.run(
        [sys.executable, "program.py"],
        cwd=tmp_path,
        env=os.environ | {"RCUTILS_CONSOLE_OUTPUT_FORMAT": names},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr.splitlines() == [
        "arm INFO speak 8 cold",
        "arm WARN speak 8 hot",
        r"arm WARN speak 8 too\x1b hot\n",
    ]
    assert done.stdout.split() == ["(True,", "True,", "True,", "False)"]
