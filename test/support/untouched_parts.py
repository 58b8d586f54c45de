# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Kits and core, as far as a change does not touch them: `make test` leaves their tests out.

A change touches a kit that it is in, or that imports a module of it, and all kits and the core
where it is in the public interface, in what all tests share, or in what is no module. Only what a
kit and its tests import themselves counts: for what lies behind that, the tests of the main
package stand. The core imports nothing else of the package, which `test/test_layers.py` checks.
"""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
PACKAGE = "haptic_accel"
PLACES = f"{PACKAGE}/kits", "test/kits"
"""Folders with a folder for each kit: its code and its tests."""

CORE = "core"
OF_CORE = f"{PACKAGE}/{CORE}/", f"test/{CORE}/", "tick_build/"
"""Folders whose content the tests of the core depend on."""

CODE = PACKAGE, "test", "benchmarks", "docs", "examples", "tick_build"
"""Folders of modules, which are imported or run by themselves."""


class UnknownChangeError(Exception):
    """Error: the history does not tell what changed."""


def git(source: Path, *words: str) -> str:
    """Return the output of a command of git.

    Raises
    ------
    UnknownChangeError
        It cannot be run, or fails.
    """
    try:
        found = subprocess.run(["git", "-C", source, *words], capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise UnknownChangeError from error
    return found.stdout.decode().strip("\n")


def base(source: Path) -> str:
    """Return the commit that a change begins at.

    This is where it left the main branch; on a merge into the main branch, that branch before it.
    Otherwise the main branch may have grown by any number of commits.
    """
    if git(source, "rev-parse", "--show-prefix"):
        raise UnknownChangeError  # unpacked within another repository
    for branch in ("origin/main", "main"):
        try:
            found = git(source, "merge-base", "HEAD", branch)
        except UnknownChangeError:
            continue
        is_main = git(source, "rev-parse", "--abbrev-ref", "HEAD") in ("main", "HEAD")
        if is_main and found == git(source, "rev-parse", "HEAD"):
            git(source, "rev-parse", "--verify", "HEAD^2")
            return git(source, "rev-parse", "HEAD^")
        return found
    raise UnknownChangeError


def changed(source: Path, begin: str) -> set[str]:
    """Return the files that differ from a commit, also where no commit has them yet."""
    tracked = git(source, "diff", "--name-only", "--no-renames", "-z", begin)
    others = git(source, "ls-files", "--others", "--exclude-standard", "-z")
    return {*tracked.split("\0"), *others.split("\0")} - {""}


def named(file: Path) -> Iterator[tuple[str, ast.alias]]:
    """Yield what a file imports from which module."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, alias) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias) for alias in node.names)


def module_of(file: str) -> str:
    """Return the name by which a file is imported: tests are relative to their folder."""
    path = Path(file).with_suffix("")
    parts = path.parts if path.parts[0] == PACKAGE else path.parts[1:]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imported(source: Path, kit: str) -> set[str]:
    """Return the modules that a kit and its tests import, a public name by where it is defined."""
    stubs = (source / PACKAGE).rglob("*.pyi")
    public = {
        (module_of(str(stub.relative_to(source))), alias.name): module
        for stub in stubs
        for module, alias in named(stub)
    }
    files = [file for place in PLACES for file in (source / place / kit).rglob("*.py")]
    names = [each for file in files for each in named(file)]
    found = {public.get((module, alias.name), module) for module, alias in names}
    whole = {f"{module}.{alias.name}" for module, alias in names}
    # A root that is imported itself may be asked for each of its names.
    return found | whole | {module for (root, _), module in public.items() if root in whole}


def touched(source: Path, kits: set[str], file: str) -> set[str]:
    """Return the kits that another content of a file touches, and `CORE` if it touches that."""
    path = Path(file)
    for place in map(Path, PLACES):
        if place in path.parents and (kit := path.relative_to(place).parts[0]) in kits:
            return {kit}
    if path.suffix in (".md", ".rst"):
        return set()
    parts = path.parts
    is_root = parts[0] == PACKAGE and len(parts) <= 2 + (path.name == "__init__.py")
    is_shared = path.name == "conftest.py" or parts[:2] == ("test", "support")
    is_shared = is_shared and not path.name.startswith("test_")
    if parts[0] not in CODE or path.suffix != ".py" or is_root or is_shared:
        return {*kits, CORE}
    own = {CORE} if file.startswith(OF_CORE) else set()
    return own | {kit for kit in kits if module_of(file) in imported(source, kit)}


def untouched(source: Path = SOURCE) -> str:
    """Return the untouched kits and `CORE`, with commas, and the reason; empty for none."""
    kits = {path.parent.name for path in (source / PLACES[0]).glob("*/__init__.py")}
    try:
        begin = base(source)
        files = changed(source, begin)
    except UnknownChangeError:
        return ""
    left = {*kits, CORE}.difference(*(touched(source, kits, file) for file in files))
    reason = f"nothing that they import has changed since {begin[:10]}"
    return f"{','.join(sorted(left))}: {reason}" if left else ""


if __name__ == "__main__":
    print(untouched())
