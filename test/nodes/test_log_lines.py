# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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
