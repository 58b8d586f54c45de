# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The modules of the pages' scripts: what they import, and how they become one script."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

import haptic_accel.pages
from haptic_accel.pages import modules, script

ASSETS = Path(haptic_accel.pages.__file__).parent / "assets"
SCRIPTS = sorted(file.name for file in ASSETS.glob("*.js") if not file.name.startswith("uPlot"))
PAGES = ("analysis.js", "bring_up.js", "scope.js", "study.js")
INLINE = {"page_script.js", "stop_request.js"}
"""Scripts that stand in a page itself."""
DECLARED = r"^(?:export )?(?:async )?(?:class|const|function|let) (\w+|\[[^\]]+\])"


def exported(text: str) -> set[str]:
    return set(re.findall("export " + DECLARED.removeprefix("^(?:export )?"), text))


def test_every_script_belongs_to_a_page() -> None:
    assert {name for page in PAGES for name in modules(page)} == {*SCRIPTS} - INLINE


@pytest.mark.parametrize("name", SCRIPTS)
def test_what_is_imported_is_exported_and_used(name: str) -> None:
    text = (ASSETS / name).read_text(encoding="utf-8")
    for names, source in re.findall(r'^import {([^}]*)} from "\./(.+)";$', text, re.MULTILINE):
        imported = {each.strip() for each in names.split(",") if each.strip()}
        assert imported <= exported((ASSETS / source).read_text(encoding="utf-8"))
        assert all(len(re.findall(rf"\b{each}\b", text)) > 1 for each in imported)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_module_can_be_read_at_once(name: str) -> None:
    assert (ASSETS / name).read_text(encoding="utf-8").count("\n") <= 300


@pytest.mark.parametrize("page", PAGES)
def test_modules_come_after_those_that_they_import(page: str) -> None:
    found = list(modules(page))
    assert found[-1] == page
    for name, text in modules(page).items():
        for source in re.findall(r'^import [^"]*"\./(.+)";$', text, re.MULTILINE):
            assert found.index(source) < found.index(name)


@pytest.mark.parametrize("page", PAGES)
def test_one_script_holds_every_module_and_no_name_twice(page: str) -> None:
    whole = script(page)
    assert not re.findall(r"^(?:import|export)\b.*", whole, re.MULTILINE)
    declared = Counter(re.findall(DECLARED, whole, re.MULTILINE))
    assert [name for name, count in declared.items() if count > 1] == []
    for text in modules(page).values():
        assert exported(text) <= set(declared)
