# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The size of each part of the package, which grows only for a stated need of its users."""

from __future__ import annotations

import ast
import io
import tokenize
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "haptic_accel"

ROOTS = "roots"
"""Files of the package's own folder: its public interface."""

BUDGETS = {
    ROOTS: 89,
    "core": 13_679,
    "analysis": 4_030,
    "nodes": 3_900,
    "kits/study": 3_854,
    "devices": 3_779,
    "cli": 2_975,
    "bags": 2_703,
    "scope": 1_350,
    "setup": 1_589,
    "materials": 1_350,
    "kits/emulators": 1_083,
    "graph": 897,
    "kits/export": 909,
    "kits/link": 2_030,
    "kits/textures": 1_021,
    "kits/bringup": 987,
    "kits/lerobot": 367,
    "kits/crtk": 272,
    "pages": 39,
}
"""Most lines of code of each folder and kit. Lower a budget with its code; raise it only in a
commit that says what need of a user it pays for."""

SLACK = 100
"""Lines by which a folder may be smaller than its budget before the budget must be lowered."""

LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}


def lines_of_code(source: str) -> int:
    """Return the number of lines that are not blank, comment or docstring."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    lines = {
        line
        for token in tokens
        if token.type not in LAYOUT and token.string
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(source)):
        # A text that is a statement documents a module, class, function or constant.
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines -= set(range(node.lineno, (node.end_lineno or 0) + 1))
    return len(lines)


def test_every_folder_has_a_budget() -> None:
    folders = {file.relative_to(PACKAGE).parts[0] for file in PACKAGE.glob("*/**/*.py")} - {"kits"}
    folders.add(ROOTS)
    kits = {f"kits/{file.parent.name}" for file in PACKAGE.glob("kits/*/__init__.py")}
    assert folders | kits == BUDGETS.keys()


@pytest.mark.parametrize("folder", BUDGETS)
def test_a_folder_stays_within_its_budget(folder: str) -> None:
    find = PACKAGE.glob if folder == ROOTS else (PACKAGE / folder).rglob
    files = [*find("*.py"), *find("*.pyi")]
    size = sum(lines_of_code(file.read_text(encoding="utf-8")) for file in files)
    budget = BUDGETS[folder]
    assert budget - SLACK <= size <= budget, f"{folder} has {size} lines, its budget is {budget}"


def test_blank_lines_comments_and_docstrings_are_no_code() -> None:
    source = '"""Module."""\n\n# Comment\nA = (\n    1,\n)\n"""Constant."""\n'
    source += '\ndef f():\n    """Function."""\n    return """\ntext\n"""\n'
    assert lines_of_code(source) == 7
