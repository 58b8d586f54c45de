# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The public interface of the package: what users may import, and what docs/api.md lists."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType

import pytest

import haptic_accel

SOURCE = Path(__file__).resolve().parents[1]

PUBLIC = {
    "haptic_accel": """
        Axes Bag ChannelParameters Checked FloatArray Goal GraphArguments GripParameters
        HandleParameters IdentifiedPlant MasterRigParameters MountParameters NotebookTrial
        ParameterError PassiveParameters Plant Provenance Rig Setup SweepParameters Texture
        TextureModel Trial Vector align causal_bound design_inverse held identify_handle
        indistinguishable lockstep_trial nrmse parameter predict preset_file read_bag read_scene
        read_texture resampled run_identification run_trial
    """,
    "haptic_accel.analysis": "bands compare groups load signals spectra trials",
    "haptic_accel.commands": "KitVerb LazyGroup",
    "haptic_accel.controllers": "CONTROLLERS Controller Loop",
    "haptic_accel.devices": ("Device DeviceDescription DeviceError Joints MASTERS SLAVES Sample"),
    "haptic_accel.kits.export": "LeRobotWriter",
    "haptic_accel.kits.textures": "Recording build described",
}
"""Names of each root; to remove or rename one breaks users' code: a change of the version."""

PAGE = (SOURCE / "docs/api.md").read_text(encoding="utf-8")
FOR_KITS, WHOLE = (
    {f"haptic_accel.{name}" for name in re.findall("`([a-z_.]+)`", part)}
    for part in PAGE.partition("### Names for kits\n")[2].partition("\n### ")[0].split("all of")
)
"""Roots with further names for kits, which are in their stubs; modules that kits share as a whole.
A minor version may change them."""

ROOTS = {root for root in PUBLIC if ".kits." not in root} | FOR_KITS

OF_PLUG_INS = "haptic_accel.kits.lerobot"
"""Kit whose own plug-ins import it, in addition to the public names."""

BENCHMARKS = 48
"""Most modules behind the public interface that benchmarks import. Lower it with them."""


def names(root: str) -> set[str]:
    return set(PUBLIC[root].split())


def listed(root: str) -> set[str]:
    """Return all names of a root."""
    return set(import_module(root).__all__)


@pytest.mark.parametrize("root", sorted({*PUBLIC, *FOR_KITS}))
def test_the_names_of_a_root_are_there_and_documented(root: str) -> None:
    stable = names(root) if root in PUBLIC else set()
    assert listed(root) >= stable if root in FOR_KITS else listed(root) == stable
    found = {name: getattr(import_module(root), name) for name in listed(root)}
    undocumented = [
        name
        for name, each in found.items()
        if isinstance(each, type | FunctionType)
        and each.__name__ == name
        and not (each.__doc__ or "").partition("\n")[0].endswith(".")
    ]
    assert undocumented == []


@pytest.mark.parametrize("root", PUBLIC)
def test_the_page_lists_every_public_name(root: str) -> None:
    lines = re.findall(rf"^(.*)<!-- (?:api|names): {re.escape(root)} -->$", PAGE, re.MULTILINE)
    listed = [name for line in lines for name in re.findall(r"`(\w+)`", line)]
    assert sorted(listed) == sorted(names(root))


def test_a_name_is_in_one_root() -> None:
    every = [name for root in ROOTS for name in listed(root)]
    assert len(every) == len(set(every))


def imported(code: str) -> Iterator[tuple[str, str]]:
    """Yield what a script imports of the package, as module and name."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("haptic_accel"):
            yield from ((node.module or "", each.name) for each in node.names)
        elif isinstance(node, ast.Import):
            yield from ((each.name, "") for each in node.names if "haptic_accel" in each.name)


def private(code: str) -> list[tuple[str, str]]:
    """Return what a script imports of the package that is not public."""
    return [
        (module, name)
        for module, name in imported(code)
        if module not in PUBLIC or name not in {"__version__", *names(module)}
    ]


SCRIPTS = [*SOURCE.glob("examples/*.py"), *SOURCE.glob("plugins/*/*.py")]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_examples_and_plug_ins_import_public_names_alone(script: Path) -> None:
    found = private(script.read_text(encoding="utf-8"))
    kits = {OF_PLUG_INS} if script.parent.parent.name == "plugins" else set()
    assert [each for each in found if each[0] not in kits] == []


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/api.md", "docs/analysis.md"])
def test_what_a_page_shows_imports_public_names_alone(page: str) -> None:
    code = re.findall(r"```python\n(.*?)```", (SOURCE / page).read_text(), re.DOTALL)
    assert code
    assert [each for block in code for each in private(block)] == []


def unlisted(needed: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return those of the imported modules and names that no root lists."""
    return {
        (module, name)
        for module, name in needed
        if module not in WHOLE and f"{module}.{name}".rstrip(".") not in ROOTS | WHOLE
        if module not in ROOTS or name not in {"__version__", "lazy_names", *listed(module)}
    }


def of_benchmarks() -> set[tuple[str, str]]:
    """Return what benchmarks import of the package, as module and name."""
    files = SOURCE.glob("benchmarks/*.py")
    return {pair for path in files for pair in imported(path.read_text(encoding="utf-8"))}


def test_benchmarks_import_no_more_than_before() -> None:
    behind = {module for module, _ in unlisted(of_benchmarks())}
    own = {module for module in behind if module.startswith("haptic_accel.kits")}
    assert len(behind - own) <= BENCHMARKS, sorted(behind - own)


def of_kits() -> set[tuple[str, str]]:
    """Return what kits import of the main package, as module and name."""
    found = set()
    for path in SOURCE.glob("haptic_accel/kits/**/*.py"):
        code = path.read_text(encoding="utf-8")
        own = {each for each in imported(code) if not each[0].startswith("haptic_accel.kits")}
        roots = {name: f"{module}.{name}" for module, name in own if f"{module}.{name}" in ROOTS}
        found |= own | {
            (roots[node.value.id], node.attr)
            for node in ast.walk(ast.parse(code))
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            if node.value.id in roots
        }
    return found


def test_kits_import_what_roots_list_alone() -> None:
    assert unlisted(of_kits()) == set()


def test_a_kit_or_benchmark_needs_every_name_that_is_listed_for_kits() -> None:
    needed = of_kits() | of_benchmarks()
    stable = {(root, name) for root in PUBLIC for name in names(root)}
    assert {(root, name) for root in FOR_KITS for name in listed(root)} - stable - needed == set()
    assert WHOLE - {module for module, _ in needed} - {f"{m}.{n}" for m, n in needed} == set()


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(haptic_accel, "unknown")
    assert not hasattr(import_module("haptic_accel.commands"), "__unknown__")


def test_importing_the_package_takes_little_longer_than_starting_python() -> None:
    """The goal is 0.15 s in all; measured against an empty program, as machines differ."""

    def shortest(code: str) -> float:
        times = []
        for _ in range(5):
            before = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True)
            times.append(time.perf_counter() - before)
        return min(times)

    assert shortest("import haptic_accel") < 3 * shortest("pass")
