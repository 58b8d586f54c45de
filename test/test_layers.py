# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rules of which part of the package may import which, read from the syntax trees.

Every import counts: those inside functions and those for type checkers alone, too.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from running import python

PACKAGE = "haptic_accel"
SOURCE = Path(__file__).resolve().parents[1] / PACKAGE

BELOW: dict[str, set[str]] = {
    "core": set(),
    "_licence": set(),
    "pages": {"core"},
    "scope": {"core", "devices", "graph", "setup", "materials", "pages"},
    "bags": {"core"},
    "materials": {"core"},
    "devices": {"core", "bags", "materials"},
    "setup": {"core", "bags", "devices", "materials"},
    "graph": {"core", "bags", "devices", "materials", "setup"},
    "nodes": {"core", "bags", "devices", "materials", "setup", "graph", "scope"},
    "analysis": {"core", "bags", "materials", "setup", "pages"},
    "cli": {
        *("core", "bags", "devices", "materials", "setup", "graph"),
        *("nodes", "scope", "analysis"),
    },
    "controllers": {"core"},
    "commands": {"core", "cli"},
    "kits": {
        *("core", "bags", "devices", "materials", "setup", "graph"),
        *("nodes", "scope", "analysis", "pages", "cli", "controllers", "commands"),
    },
}
"""The folders that each folder of the package may import, besides itself."""

APART = {
    "handle": {"control", "identification", "rig"},
    "control": {"identification", "rig"},
    "identification": {"control", "rig"},
    "rig": {"control", "identification"},
}
"""Rooms of the core, and those that each must not know: what they share is in `core/handle`."""

RIG = "haptic_accel.core.rig"
RIG_USERS = {
    *("haptic_accel.devices.simulated", "haptic_accel.core.trial", "haptic_accel.core.track"),
    "haptic_accel.core.simulated_rig",
    *("haptic_accel.core.surfaces.virtual_rig", "haptic_accel.core.surfaces.tool"),
    "haptic_accel.materials.moving",
}
"""The virtual rig is a leaf: everything else reaches it through these."""

ROS = {
    *("rclpy", "launch", "launch_ros", "ament_index_python"),
    *("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "lifecycle_msgs"),
    *("rcl_interfaces", "sensor_msgs", "std_msgs", "std_srvs", "crtk_msgs"),
}
ROS_USERS: dict[str, set[str]] = {
    # Commands that call services and publish on topics of a running graph.
    "haptic_accel.cli.joining": {"rclpy"},
    # An arm of another node, loaded when it is opened.
    "haptic_accel.kits.crtk.client": {"rclpy", "geometry_msgs", "std_msgs"},
    # Undocumented names of rclpy, for that arm and for the nodes.
    "haptic_accel.devices.rclpy_internals": {"rclpy"},
    # Launch files.
    "haptic_accel.graph.launching": {"launch", "launch_ros", "ament_index_python"},
    # Folders of an installed ROS 2, which does without where there is none.
    "haptic_accel.bags.metadata": {"ament_index_python"},
}
"""Modules outside ``nodes`` that import something of ROS 2, and what."""

Import = tuple[str, str]


def names() -> dict[str, Path]:
    """Return the modules of the package with their files."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = names()
FOLDERS = sorted({name.rpartition(".")[0] for name in MODULES} - {""})


@cache
def nodes(module: str) -> list[ast.AST]:
    """Return all nodes of a module's syntax tree."""
    return list(ast.walk(ast.parse(MODULES[module].read_text())))


def imported_by(module: str) -> Iterator[str]:
    """Yield what a module imports, as modules of the package or names of other packages."""
    path = MODULES[module]
    here = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in nodes(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = here.split(".")[: len(here.split(".")) - node.level + 1]
                base = ".".join([*above, *filter(None, [base])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                yield inner if inner in MODULES else base


@cache
def imports() -> frozenset[Import]:
    return frozenset((module, name) for module in MODULES for name in imported_by(module))


def inside() -> Iterator[Import]:
    """Yield the imports of one module of the package by another."""
    return (pair for pair in imports() if pair[1] in MODULES and pair[0] != pair[1])


def within(module: str, folder: str) -> bool:
    return module == folder or module.startswith(folder + ".")


def room(module: str) -> str:
    """Return the folder of the package that a module is in, empty for the package itself."""
    return module.split(".")[1] if "." in module else ""


def broken() -> set[Import]:
    """Return the imports that the rules do not allow."""
    found = set()
    for importer, imported in imports():
        top = imported.split(".")[0]
        if top == PACKAGE:
            allowed = BELOW.get(room(importer), set()) | {room(importer)}
            upward = bool(room(imported)) and room(imported) not in allowed
            rig = within(imported, RIG) and not within(importer, RIG)
            if upward or (rig and importer not in RIG_USERS):
                found.add((importer, imported))
        elif top in ROS - ROS_USERS.get(importer, set()) and room(importer) != "nodes":
            found.add((importer, imported))
    return found


def circles(graph: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Return one path along each arrow that leads back to where the search came from."""
    found: list[list[str]] = []
    done: set[str] = set()

    def visit(place: str, path: list[str]) -> None:
        if place in path:
            found.append([*path[path.index(place) :], place])
        elif place not in done:
            for other in sorted(graph.get(place, ())):
                visit(other, [*path, place])
            done.add(place)

    for place in sorted(graph):
        visit(place, [])
    return found


def arrows(folder: str) -> dict[str, set[str]]:
    """Return which files and folders directly in a folder import which others there."""
    depth = folder.count(".") + 2
    graph: dict[str, set[str]] = {}
    for importer, imported in inside():
        if within(importer, folder) and within(imported, folder):
            ends = [".".join(module.split(".")[:depth]) for module in (importer, imported)]
            if ends[0] != ends[1] and folder not in ends:
                graph.setdefault(ends[0], set()).add(ends[1])
    return graph


def test_every_folder_has_its_rule() -> None:
    assert {room(module) for module in MODULES} - {""} == set(BELOW)


def test_imports_point_down() -> None:
    assert sorted(broken()) == []


@pytest.mark.parametrize("name", APART)
def test_rooms_of_the_core_stay_apart(name: str) -> None:
    known = {to for by, to in inside() if within(by, f"haptic_accel.core.{name}")}
    others = [f"haptic_accel.core.{other}" for other in APART[name]]
    assert not [module for module in known for other in others if within(module, other)]


KITS = {name.split(".")[2] for name in MODULES if name.startswith("haptic_accel.kits.")}


@pytest.mark.parametrize("kit", sorted(KITS))
def test_a_kit_imports_no_other_kit_and_only_public_names(kit: str) -> None:
    own = f"haptic_accel.kits.{kit}"
    known = {to for by, to in inside() if within(by, own) and within(to, "haptic_accel.kits")}
    assert [to for to in known if not within(to, own)] == []
    for module in (name for name in MODULES if within(name, own)):
        for node in nodes(module):
            if isinstance(node, ast.ImportFrom) and not within(node.module or "", own):
                private = [each.name for each in node.names if re.match("_[^_]", each.name)]
                assert not private, (module, private)


LOADING = {"__version__", "lazy_names"}
"""What the package itself has, in addition to names that are loaded at their first use."""


def test_only_kits_import_the_names_of_the_root() -> None:
    """What the root loads lies above most of the package, so that circles would follow."""
    for module in MODULES:
        if not within(module, f"{PACKAGE}.kits"):
            for node in nodes(module):
                if isinstance(node, ast.ImportFrom) and node.module == PACKAGE:
                    names = [each.name for each in node.names]
                    folders = {name for name in names if f"{PACKAGE}.{name}" in MODULES}
                    assert {each.name for each in node.names} <= LOADING | folders, module


def test_no_exception_is_out_of_date() -> None:
    used = {(importer, imported.split(".")[0]) for importer, imported in imports()}
    unused = {
        module
        for module, packages in ROS_USERS.items()
        if not any((module, package) in used for package in packages)
    }
    assert unused == set(), "remove these from ROS_USERS"


def test_modules_do_not_import_each_other_in_circles() -> None:
    graph: dict[str, set[str]] = {}
    for importer, imported in inside():
        graph.setdefault(importer, set()).add(imported)
    assert circles(graph) == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_files_and_folders_of_a_folder_make_no_circle(folder: str) -> None:
    assert circles(arrows(folder)) == []


def loaded_by(statements: str) -> set[str]:
    """Return the modules that a fresh Python has loaded after it ran some statements."""
    script = f"import json, os, sys\n{statements}\nprint(json.dumps(sorted(sys.modules)))"
    done = python("-c", script)
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_neither_reading_bags_nor_the_drivers_names_need_ros_or_change_the_environment() -> None:
    rooms = {"core", "bags", "analysis"}
    wanted = sorted(module for module in MODULES if room(module) in rooms)
    loaded = loaded_by(
        f"before = dict(os.environ); import {', '.join(wanted)}\n"
        f"from {PACKAGE}.devices import MASTERS\n"
        "assert dict(os.environ) == before, 'the environment was changed'"
    )
    assert {name for name in loaded if within(name, f"{PACKAGE}.nodes")} == set()
    assert {name for name in loaded if name.split(".")[0] in ROS} == set()


def test_the_package_alone_loads_nothing_else() -> None:
    loaded = loaded_by(f"import {PACKAGE}")
    heavy = {"numpy", "scipy", "pandas", "matplotlib", "rosbags", "importlib.metadata"}
    assert loaded & heavy == set()
    assert {name for name in loaded if within(name, PACKAGE)} == {PACKAGE}


@pytest.mark.skipif(find_spec("rclpy") is None, reason="ROS 2 is not installed")
def test_a_graph_starts_without_what_takes_long_to_load() -> None:
    modules = ["setup.processes", "nodes.master_device", "nodes.coupler", "nodes.recorder"]
    loaded = loaded_by("\n".join(f"import {PACKAGE}.{module}" for module in modules))
    assert loaded & {"scipy.signal", "scipy.stats", "scipy.optimize", "pandas"} == set()


def test_commands_load_what_draws_when_they_draw() -> None:
    loaded = loaded_by(f"from {PACKAGE}.cli import experiment, identify, bench")
    assert "matplotlib" not in loaded


def test_a_script_begins_when_all_of_its_file_is_known() -> None:
    early = [
        path.name
        for path in sorted(SOURCE.rglob("*.py"))
        for statement in ast.parse(path.read_text()).body[:-1]
        if isinstance(statement, ast.If) and "__main__" in ast.unparse(statement.test)
    ]
    assert early == []
