# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Provenance of a report: version, commit, machine and command line."""

from __future__ import annotations

import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import haptic_accel
from haptic_accel.bags.trial_metadata import host

_PACKAGE = Path(haptic_accel.__file__).parent


def page_provenance() -> dict[str, str]:
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
    command = ["git", "-C", str(clone), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:  # git is not installed
        return ""
    return done.stdout.strip()
