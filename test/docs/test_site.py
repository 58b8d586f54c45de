# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The documentation site and its reference of the Python interface."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from running import python

SOURCE = Path(__file__).resolve().parents[2]
SHOWN = [
    f"{root}.{name}"
    for line, root in re.findall(
        r"^(.*)<!-- api: ([\w.]+) -->$", (SOURCE / "docs" / "api.md").read_text(), re.MULTILINE
    )
    for name in re.findall(r"`(\w+)`", line)
]
"""Names whose docstrings the site shows."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site, built from all pages with warnings as errors."""
    for library in ("sphinx", "myst_parser", "numpydoc", "furo", "sphinx_gallery"):
        pytest.importorskip(library, reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("site")
    words = ["-q", "-W", "--keep-going", "-c", "docs", ".", str(folder)]
    built = python("-m", "sphinx", *words, cwd=SOURCE)
    assert built.returncode == 0, built.stderr
    return folder


@pytest.mark.slow
def test_the_site_shows_the_docstring_of_every_name(site: Path) -> None:
    page = (site / "docs" / "api.html").read_text()
    assert [name for name in SHOWN if f'id="{name}"' not in page] == []
    assert "<!-- api:" not in page


@pytest.mark.slow
def test_the_site_opens_with_the_readme(site: Path) -> None:
    (target,) = re.findall(r'url=([^"]+)"', (site / "index.html").read_text())
    title = (SOURCE / "README.md").read_text().splitlines()[0].removeprefix("# ")
    assert f"<h1>{title}" in (site / target).read_text()


@pytest.mark.slow
def test_the_sidebar_has_the_sections_of_the_index(site: Path) -> None:
    index = (SOURCE / "docs" / "README.md").read_text()
    headings = re.findall(r"^## (.*)$", index, re.MULTILINE)
    for page in (site / "docs").glob("*.html"):
        assert re.findall(r'class="caption-text">([^<]*)<', page.read_text()) == headings
        # WAI-ARIA requires a level of each heading that is none by its element.
        assert not re.findall(r'role="heading"(?! aria-level)', page.read_text())


@pytest.mark.slow
def test_the_site_shows_what_each_example_prints_and_draws(site: Path) -> None:
    for script in (SOURCE / "examples").glob("*.py"):
        page = (site / "build" / "examples" / f"{script.stem}.html").read_text()
        assert "sphx-glr-script-out" in page
        assert f"sphx_glr_{script.stem}_001.png" in page
