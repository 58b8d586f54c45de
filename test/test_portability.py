# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lockstep, bags and analysis in a Python without the modules that only POSIX has."""

from __future__ import annotations

from pathlib import Path

import pytest

from running import python

PACKAGE = Path(__file__).resolve().parents[1] / "haptic_accel"

PORTABLE = ("core", "bags", "materials", "analysis", "pages", "scope")
"""Folders that load on every system."""

WITHOUT_POSIX = """
import os, signal, socket, sys
from functools import partial

class Refusal:
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "termios", "resource", "pwd", "grp", "tty", "pty", "posix_ipc"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

names = ("fcntl", "termios", "resource", "pwd", "grp", "tty", "pty")
import numpy, psutil, subprocess, asyncio, multiprocessing, rosbags.rosbag2  # load their own
for name in names:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Refusal())
for module, absent in (
    (signal, ("SIGHUP", "SIGQUIT", "SIGUSR1", "SIGALRM", "SIGXCPU")),
    (os, ("sched_getaffinity", "sched_setscheduler", "getpgrp", "tcgetpgrp")),
    (socket, ("AF_UNIX",)),
):
    for name in filter(partial(hasattr, module), absent):
        delattr(module, name)
"""
"""Takes away what Windows lacks, but for libraries that have chosen their own way already."""


def run(folder: Path, code: str) -> None:
    done = python("-c", WITHOUT_POSIX + code, cwd=folder)
    assert done.returncode == 0, done.stderr


def test_all_portable_modules_load(tmp_path: Path) -> None:
    files = [path for folder in PORTABLE for path in sorted((PACKAGE / folder).rglob("*.py"))]
    parts = [path.relative_to(PACKAGE.parent).with_suffix("").parts for path in files]
    modules = [".".join(part for part in each if part != "__init__") for each in parts]
    assert len(modules) > 100
    run(tmp_path, f"import {', '.join(modules)}")


@pytest.mark.slow
def test_an_experiment_runs_in_lockstep_and_its_bags_are_analysed(tmp_path: Path) -> None:
    words = "experiment --lockstep --jobs 1 --controllers none surface:=text duration:=1 --out out"
    run(tmp_path, f"from haptic_accel.cli.main import main; main({words.split()})")
    run(tmp_path, "import haptic_accel as h; assert h.read_bag('out/bags/text_none').signals")


@pytest.mark.slow
def test_a_surface_is_touched_until_ctrl_c(tmp_path: Path) -> None:
    run(
        tmp_path,
        "socket.AF_UNIX = 1  # asyncio of this system uses it\n"
        "import threading; threading.Timer(15.0, signal.raise_signal, [signal.SIGINT]).start()\n"
        "from haptic_accel.cli.main import main; main(['touch', '--no-open'])",
    )
