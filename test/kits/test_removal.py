# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package without a kit, without any kit, and with a verb of another package."""

from __future__ import annotations

import ast
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Collection, Iterator
from importlib.metadata import distribution
from pathlib import Path

import pytest

from foreign_packages import declare
from running import Start, python

SOURCE = Path(__file__).resolve().parents[2]
KITS = sorted(path.parent.name for path in SOURCE.glob("haptic_accel/kits/*/__init__.py"))
VERBS = {
    "bringup": "bringup",
    "emulators": "emulate",
    "export": "export",
    "link": "keys",
    "study": "study",
    "textures": "texture",
}
"""Verb of each kit that has one."""

WITHOUT_A_VERB = {"crtk", "lerobot"}
"""Kits of drivers, and those that another program calls, not `haptic-accel`."""

MAIN = "-c", "from haptic_accel.cli.start import main; main()"
"""What the console script does."""

EVERY_MODULE = """
import pkgutil, haptic_accel.kits
from importlib import import_module
kits = [*pkgutil.iter_modules(haptic_accel.kits.__path__)]
# Without any kit all modules are there; that no kit needs another, test_layers sees in each.
for module in [] if kits else pkgutil.walk_packages(haptic_accel.__path__, "haptic_accel."):
    # Left out: what only a graph loads, and only where there is all of ROS 2.
    if not module.name.startswith(("haptic_accel.nodes", "haptic_accel.graph.launching")):
        import_module(module.name)
print(haptic_accel.__file__)
"""

EACH = f"""
import os, sys
import aiohttp, matplotlib.pyplot, pandas, scipy.optimize, scipy.signal, scipy.stats
for folder in sys.argv[1:]:
    child = os.fork()
    if not child:
        sys.path.insert(0, folder)
        sys.argv[1:] = ["--help"]
        exec({EVERY_MODULE!r})
        from haptic_accel.cli.start import main
        main()
    print("ended with", os.waitpid(child, 0)[1], flush=True)
"""
"""Loads the package of each folder, and prints its help, beside libraries that are loaded once."""


def house(folder: Path, removed: Collection[str]) -> Path:
    """Copy the package without some kits, as if it were installed so."""
    left_out = {str(SOURCE / "haptic_accel" / "kits" / kit) for kit in removed}

    def ignored(parent: str, names: list[str]) -> list[str]:
        return [name for name in names if f"{parent}/{name}" in left_out]

    shutil.copytree(SOURCE / "haptic_accel", folder / "haptic_accel", ignore=ignored)
    shutil.copy(SOURCE / "package.xml", folder)
    (folder / "config").symlink_to(SOURCE / "config")
    declare(folder, "haptic_accel", {})
    entries = [
        f"[{each.group}]\n{each.name} = {each.value}\n"
        for each in distribution("haptic_accel").entry_points
        if each.value.startswith("haptic_accel.kits.")
        if re.split("[.:]", each.value)[2] not in removed
    ]
    (declared,) = folder.glob("*.dist-info/entry_points.txt")
    with declared.open("a") as file:
        file.writelines(entries)
    return folder


def ended(folder: Path, *words: str, beside: str = "") -> subprocess.CompletedProcess[str]:
    """Run Python with the package in a folder, and what is in another folder beside it."""
    return python(*words, env=os.environ | {"PYTHONPATH": f"{folder}:{beside}"}, cwd=folder)


def run(folder: Path, *words: str, beside: str = "") -> subprocess.CompletedProcess[str]:
    """Run Python as `ended`; it must succeed."""
    found = ended(folder, *words, beside=beside)
    said = found.stdout + found.stderr
    assert (found.returncode, "Traceback" in found.stderr) == (0, False), said
    return found


def command(folder: Path, *words: str, beside: str = "") -> subprocess.CompletedProcess[str]:
    """Run ``haptic-accel WORDS`` of the package in a folder."""
    return run(folder, *MAIN, *words, beside=beside)


def test_every_kit_has_a_verb_or_needs_none() -> None:
    assert sorted({*VERBS, *WITHOUT_A_VERB}) == KITS


def test_each_kit_can_be_taken_away_and_all(tmp_path: Path) -> None:
    removed = {kit: [kit] for kit in KITS} | {"all": KITS}
    folders = [house(tmp_path / name, kits) for name, kits in removed.items()]
    *said, rest = run(tmp_path, "-c", EACH, *map(str, folders)).stdout.split("ended with 0\n")
    assert rest == ""
    for kits, folder, text in zip(removed.values(), folders, said, strict=True):
        first, *lines = text.splitlines()
        assert first == f"{folder}/haptic_accel/__init__.py"
        verbs = {line.split()[0] for line in lines if line.startswith("  ")}
        assert not verbs & {VERBS.get(kit) for kit in kits}
        others = {verb for other, verb in VERBS.items() if other not in kits}
        assert verbs > others | {"touch", "teleop"}


def imported(path: Path) -> Iterator[str]:
    """Yield the modules that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_no_test_but_its_own_imports_a_kit() -> None:
    tests = SOURCE / "test"
    users = [
        (str(path.relative_to(tests)), each)
        for path in tests.rglob("*.py")
        for each in imported(path)
        for kit in KITS
        if f"{each}.".startswith(f"haptic_accel.kits.{kit}.")
        and tests / "kits" / kit not in path.parents
    ]
    assert users == []


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the package without any kit."""
    return house(tmp_path_factory.mktemp("bare"), KITS)


def test_without_kits_the_experiment_runs_and_is_analysed(bare: Path) -> None:
    words = "duration:=1", "surface:=text", "controller:=dynamic"
    assert "dynamic" in command(bare, "experiment", "--lockstep", *words, "--out", "found").stdout


def test_without_its_kit_a_peer_is_refused_in_one_line(bare: Path) -> None:
    words = "teleop", "side:=slave", "peer:=127.0.0.1"
    found = ended(bare, *MAIN, *words)
    assert (found.returncode, found.stdout) == (2, "")
    needed = "side:=slave: needs the kit link, which is not installed"
    assert found.stderr == f"haptic-accel: {needed}\n"


def test_without_its_kit_an_arm_by_crtk_is_refused_in_one_line(bare: Path) -> None:
    found = ended(bare, *MAIN, "teleop", "slave:=crtk")
    assert (found.returncode, found.stdout) == (2, "")
    assert re.fullmatch(
        r"haptic-accel: slave = 'crtk': must be one of simulated, .*\n", found.stderr
    )


def test_without_its_kit_a_network_is_refused_in_one_line(bare: Path) -> None:
    words = "experiment", "--lockstep", "--delay", "20", "duration:=1", "surface:=text"
    found = ended(bare, *MAIN, *words, "controller:=none", "--out", "lossy")
    needed = "network between the arms: needs the kit link, which is not installed"
    assert (found.returncode, needed in found.stderr) == (2, True), found.stderr
    assert "Traceback" not in found.stderr


@pytest.mark.quiet
def test_without_kits_a_surface_is_touched(
    bare: Path, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(bare))
    touching = start(*MAIN, "touch", "--no-open")
    touching.wait_for("http")
    assert touching.end(signal.SIGINT) == 0, touching.text


@pytest.mark.quiet
def test_without_kits_the_graph_runs(
    bare: Path, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(bare))
    running = start(*MAIN, "teleop", "duration:=1", "record:=false")
    assert running.end() == 0, running.text


def test_another_package_adds_a_verb(bare: Path, tmp_path: Path) -> None:
    (tmp_path / "lab_kit.py").write_text(
        "import click\n"
        "from haptic_accel.cli.commands import KitVerb\n"
        "VERB = KitVerb('Devices', 'weigh a handle', 'lab_kit')\n"
        "@click.command()\n"
        "def weigh() -> None:\n"
        "    click.echo('0.064 kg')\n"
    )
    declare(tmp_path, "lab_kit", {"weigh": "lab_kit:VERB", "teleop": "lab_kit:VERB"})
    found = command(bare, "weigh", beside=str(tmp_path))
    assert found.stdout == "0.064 kg\n"
    (line,) = found.stderr.splitlines()  # teleop keeps its meaning
    assert line.endswith("'teleop' of package lab_kit: not used: its name is taken")
    assert command(bare, "--help", beside=str(tmp_path)).stdout.count("weigh a handle") == 1


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("import lab", "weigh: lab_weighing: ModuleNotFoundError: No module named 'lab'"),
        ("raise SystemExit(3)", "weigh: lab_weighing: SystemExit: 3"),
        ("", "weigh: lab_weighing has no click command of this name"),
    ],
)
def test_a_verb_without_its_command_is_told_in_one_line(
    bare: Path, tmp_path: Path, text: str, line: str
) -> None:
    (tmp_path / "lab_kit.py").write_text(
        "from haptic_accel.cli.commands import KitVerb\n"
        "VERB = KitVerb('Devices', 'weigh a handle', 'lab_weighing')\n"
    )
    (tmp_path / "lab_weighing.py").write_text(text)
    declare(tmp_path, "lab_kit", {"weigh": "lab_kit:VERB"})
    found = ended(bare, *MAIN, "weigh", beside=str(tmp_path))
    assert (found.returncode, found.stdout) == (1, "")
    assert found.stderr == f"haptic-accel: {line}\n"


def test_a_verb_that_cannot_be_loaded_takes_no_other_away(bare: Path, tmp_path: Path) -> None:
    declare(tmp_path, "broken_kit", {"weigh": "no_such_module:VERB"})
    found = command(bare, "--help", beside=str(tmp_path))
    assert "teleop" in found.stdout
    assert len(found.stderr.splitlines()) == 1
    assert "weigh: package broken_kit: ModuleNotFoundError" in found.stderr
