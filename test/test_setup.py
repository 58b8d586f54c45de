# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages of `make` to a user who sets the project up."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from running import python

SOURCE = Path(__file__).resolve().parents[1]

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


TARGETS = [
    *("help", "venv", "touch", "demo", "test", "test-all", "mutants"),
    *("lint", "docs", "release", "clean"),
]

ARGS = {
    "touch": "--help",
    "demo": "--lockstep duration:=1 surface:=text --out found",
    "test": "test/test_budget.py test/test_layers.py",
    "test-all": "test/test_budget.py test/test_layers.py",
}
"""Words that make a target short: what it needs is the question, not what it does."""


def make(*words: str, folder: Path = SOURCE) -> subprocess.CompletedProcess[str]:
    """Run make as from a shell, even when make runs these tests."""
    of_make = ("MAKEFLAGS", "MAKELEVEL", "MAKEOVERRIDES", "MFLAGS")
    environment = {key: value for key, value in os.environ.items() if key not in of_make}
    command = ["make", "--directory", str(folder), "--no-print-directory", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def pretended_python(folder: Path, change: str) -> str:
    """Return an interpreter that says it is another."""
    path = folder / "python"
    path.write_text(f"#!{sys.executable}\nimport sys, sysconfig\n{change}\nexec(sys.argv[2])\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize("words", [[], ["help"]])
def test_help_lists_the_targets(words: list[str]) -> None:
    listed = [line.split()[1] for line in make(*words).stdout.splitlines()]
    assert listed == TARGETS


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("target", TARGETS)
def test_each_target_runs_alone_in_a_fresh_clone(tmp_path: Path, target: str) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", str(SOURCE), str(clone)], check=True)
    done = make(target, f"ARGS={ARGS.get(target, '')}", folder=clone)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_an_installation_says_what_pip_is_doing_and_ends_as_pip_does(tmp_path: Path) -> None:
    (tmp_path / "pip.py").write_text(
        "import sys\nprint('Collecting numpy>=1.26')\nprint('  Using cached')\n"
        "print('Installing collected packages: ' + 'numpy, ' * 50)\nsys.exit(3)\n"
    )
    (program,) = re.findall(
        r"^define INSTALL\n(.*?)^endef", (SOURCE / "Makefile").read_text(), re.M | re.S
    )
    done = python("-c", program, ".[dev]", "0", env=os.environ | {"PYTHONPATH": str(tmp_path)})
    collecting, installing = done.stdout.splitlines()
    assert (done.returncode, collecting) == (3, "  Collecting numpy>=1.26")
    assert installing.startswith("  Installing collected packages: numpy, ")
    assert len(installing) < 80


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("sys.version_info = (3, 9, 2)", "3.9 on linux-x86_64"),
        ("sys.version_info = (3, 15, 0)", "3.15 on linux-x86_64"),
        ("sysconfig.get_platform = lambda: 'linux-aarch64'", "on linux-aarch64"),
        ("sys.exit(1)", "cannot be run"),
    ],
)
def test_unfit_python_is_refused_in_one_line(tmp_path: Path, change: str, what: str) -> None:
    python = pretended_python(tmp_path, change)
    environment = tmp_path / "environment"
    done = make("venv", f"PYTHON={python}", f"VENV={environment}")
    (error,) = [line for line in done.stderr.splitlines() if not line.startswith("make: ")]
    assert done.returncode != 0
    assert error.startswith("error: needs CPython 3.10 to 3.13 on x86-64 Linux")
    assert python in error
    assert what in error
    assert not environment.exists()
