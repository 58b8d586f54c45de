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

"""Provenance of a report: version, commit, machine and command line."""

from __future__ import annotations

import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import haptic_accel
from haptic_accel.bags.facts import host

_PACKAGE = Path(haptic_accel.__file__).parent


def provenance() -> dict[str, str]:
    """Return version, commit, machine and command line of this process, for a page's settings.

    The commit exists only if the package runs from its own clone.
    """
    machine = host()
    found = {
        "version": haptic_accel.__version__,
        "commit": _commit(),
        "machine": f"{machine['name']}, {machine['cores']} cores, {machine['system']},"
        f" Python {machine['python']}",
        "command line": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }
    return {name: value for name, value in found.items() if value}


def version() -> str:
    """Return the version of the package, and the commit if it runs from its own clone."""
    return " ".join(filter(None, (haptic_accel.__version__, _commit())))


@cache
def _commit() -> str:
    """Return the commit of the clone, marked if files differ from it; empty without a clone."""
    clone = _PACKAGE.parent
    if not (clone / ".git").exists():
        return ""
    words = ["git", "-C", str(clone), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError:  # git is not installed
        return ""
    return done.stdout.strip()
