# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of which kits a change touches."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from running import python
from untouched_parts import SOURCE, git, untouched

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")

FILES = {
    "haptic_accel/__init__.py": "",
    "haptic_accel/__init__.pyi": "from haptic_accel.core.rig import Rig as Rig, run as run\n",
    "haptic_accel/analysis/__init__.py": "",
    "haptic_accel/analysis/__init__.pyi": "from haptic_accel.analysis.frames import run as run\n",
    "haptic_accel/analysis/frames.py": "",
    "haptic_accel/core/rig.py": "import haptic_accel.core.model\n",
    "haptic_accel/core/model.py": "",
    "haptic_accel/pages/scope.js": "",
    "tick_build/tick_unit.py": "",
    "haptic_accel/kits/__init__.py": "",
    "haptic_accel/kits/export/__init__.py": "",
    "haptic_accel/kits/export/page.js": "",
    "haptic_accel/kits/export/tables.py": "def f():\n    from haptic_accel import Rig\n",
    "haptic_accel/kits/study/__init__.py": "",
    "test/kits/study/test_run.py": "from haptic_accel import analysis\n",
    "test/kits/test_removal.py": "",
    "test/core/test_rig.py": "",
    "test/support/running.py": "",
    "docs/start.md": "",
    "setup.py": "",
}
"""Small project: the kit `export` uses a rig, the test of the kit `study` a root with frames."""

WHO = "-c", "user.name=nobody", "-c", "user.email=nobody@example.org"


def write(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with (folder / name).open("a") as file:
            file.write(FILES.get(name, "") + "\n")


def commit(folder: Path) -> None:
    git(folder, "add", "--all")
    git(folder, *WHO, "commit", "--quiet", "--allow-empty", "--message=change")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a clone of the project on a branch that changes nothing."""
    folder = tmp_path / "project"
    write(folder, *FILES)
    git(folder, "init", "--quiet", "--initial-branch=main")
    for _ in range(2):
        commit(folder)
    git(folder, "checkout", "--quiet", "-b", "branch")
    return folder


@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("docs/start.md", "core,export,study"),
        ("test/core/test_rig.py", "export,study"),
        ("test/kits/test_removal.py", "core,export,study"),
        ("haptic_accel/core/model.py", "export,study"),
        ("haptic_accel/core/rig.py", "study"),
        ("tick_build/tick_unit.py", "export,study"),
        ("haptic_accel/kits/export/page.js", "core,study"),
        ("haptic_accel/analysis/frames.py", "core,export"),
        ("test/kits/study/data.csv", "core,export"),
        ("haptic_accel/analysis/__init__.py", ""),
        ("haptic_accel/__init__.pyi", ""),
        ("haptic_accel/pages/scope.js", ""),
        ("haptic_accel/kits/__init__.py", ""),
        ("test/support/running.py", ""),
        ("setup.py", ""),
    ],
)
@pytest.mark.parametrize("commits", [0, 2])
def test_a_change_touches_the_kits_that_use_it(
    project: Path, name: str, left: str, commits: int
) -> None:
    write(project, name)
    for _ in range(commits):
        commit(project)
    assert untouched(project).partition(":")[0] == left


def test_on_the_main_branch_the_last_merge_counts(project: Path) -> None:
    write(project, "haptic_accel/core/rig.py")
    commit(project)
    commit(project)
    git(project, "checkout", "--quiet", "main")
    git(project, *WHO, "merge", "--quiet", "--no-ff", "branch")
    assert untouched(project).startswith("study: nothing that they import has changed since ")
    commit(project)  # and who knows how many before it
    assert untouched(project) == ""


def test_where_the_history_does_not_tell_all_kits_run(project: Path) -> None:
    commit(project)
    shallow = project.parent / "shallow"
    git(project, "clone", "--quiet", "--depth=1", f"file://{project}", str(shallow))
    assert untouched(shallow) == ""
    inner = project / "inner"
    shutil.copytree(project / "haptic_accel", inner / "haptic_accel")
    assert untouched(inner) == ""
    shutil.rmtree(project / ".git")
    assert untouched(project) == ""


def test_each_kit_has_a_smoke_test() -> None:
    kits = [path.parent for path in (SOURCE / "test/kits").glob("*/test_*.py")]
    for kit in set(kits):
        assert any("mark.smoke" in file.read_text() for file in kit.rglob("*.py")), kit


def test_of_untouched_parts_run_what_limits_forces_what_uses_others_and_smoke_tests() -> None:
    files = ["core/tick/test_guard.py", "core/test_trial.py", "core/control/test_filters.py"]
    files = [f"test/{file}" for file in (*files, "kits/link", "kits/test_removal.py")]
    words = "-m pytest --collect-only -q -p no:cacheprovider --untouched-parts=core,export,link"
    found = python(*words.split(), *files, cwd=SOURCE, check=True).stdout
    names = [line.partition("::")[0] for line in found.splitlines() if "::" in line]
    kit = "test/kits/link/test_link.py"
    assert set(names) == {*files[:2], kit, "test/kits/test_removal.py"}
    assert 0 < names.count(kit) < 5
