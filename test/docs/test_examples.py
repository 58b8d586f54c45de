# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The scripts in examples: short, told in cells, and without ROS. The site's test runs them."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
LONGEST = 80
"""Lines of a script, with its licence and its text."""


@pytest.fixture(params=SCRIPTS, ids=[path.stem for path in SCRIPTS])
def script(request: pytest.FixtureRequest) -> str:
    return str(request.param.read_text(encoding="utf-8"))


def test_an_example_is_short_with_title_introduction_cells_and_labelled_axes(script: str) -> None:
    assert len(script.splitlines()) <= LONGEST
    title, line, _, *introduction = (ast.get_docstring(ast.parse(script)) or "").splitlines()
    assert line == "=" * len(title)
    assert introduction
    assert script.count("\n# %%\n# ") >= 2
    assert "label=" in script or ".plot(axes)" in script
    assert script.endswith("\npyplot.show()\n")


def test_an_example_imports_names_with_a_docstring(script: str) -> None:
    for node in ast.walk(ast.parse(script)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("haptic_accel"):
            module = import_module(node.module or "")
            for alias in node.names:
                found = getattr(module, alias.name)
                assert not alias.name.startswith("_")
                assert not callable(found) or found.__doc__


def test_the_readme_lists_every_example() -> None:
    listed = re.findall(r"``(\w+\.py)``", (EXAMPLES / "README.rst").read_text(encoding="utf-8"))
    assert sorted(listed) == [path.name for path in SCRIPTS]
