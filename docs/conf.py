# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The documentation site: `make docs`.

The source folder is the repository, so that links between pages hold on the site, too. Pages have
no syntax of Sphinx: docs/README.md, the index, gives the sections of the site, and a comment
`<!-- api: MODULE -->` marks a line of names that their docstrings replace.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from haptic_accel import __version__
from haptic_accel.core.process import BLAS_THREADS

# Before an example loads numpy: on a busy machine threads of BLAS spin for each other.
for variable in BLAS_THREADS:
    os.environ.setdefault(variable, "1")

SOURCE = Path(__file__).resolve().parents[1]
sys.path.append(str(SOURCE / "benchmarks"))  # an example uses a module of theirs
sys.path.append(str(SOURCE / "docs"))
INDEX = "docs/README"
"""Page whose headings and links are the site's table of contents."""
GALLERY = "build/examples"
"""Folder for the pages that are made of the examples."""
REFERENCE = "build/reference.md"
"""Page of commands, arguments and parameters, made of the code."""

project = "haptic_accel"
author = "haptic_accel maintainers"
copyright = "2026 haptic_accel maintainers"
version = release = __version__

root_doc = "README"
include_patterns = [
    "*.md",
    "CHANGELOG.rst",
    "docs/*.md",
    "firmware/*.md",
    "haptic_accel/**/*.md",
    "test/chaos/*.md",
    f"{GALLERY}/*.rst",
    REFERENCE,
]
# Large folders without pages.
exclude_patterns = [
    ".*",
    "build/docs",
    "dist",
    "install",
    "log",
    "results",
]

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]

# Headings are linked as on GitHub.
myst_heading_anchors = 4

# Types are stated in the docstrings, with shapes and units.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
nitpicky = True
# A class without parameters has nothing to say.
nitpick_ignore_regex = [("py:class", r"haptic_accel\..*\.NoParameters")]
# A single backquote in a docstring marks a name.
default_role = "code"

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": GALLERY,
    "filename_pattern": r"\.py",
    # The output depends on the package, too.
    "run_stale_examples": True,
    # Examples print what they show; the last value of a cell is often a legend.
    "capture_repr": (),
    "write_computation_times": False,
    "min_reported_time": 60,
    "download_all_examples": False,
    "show_signature": False,
}

html_theme = "furo"
html_title = f"haptic_accel {release}"
html_extra_path = ["site"]


def toctree(section: str) -> str:
    """Return the table of contents that a section of the index stands for."""
    caption, _, text = section.partition("\n")
    entries = []
    for title, link in re.findall(r"\[([^\]]+)\]\(([^)]+)\)", text):
        page = (SOURCE / INDEX).parent.joinpath(link).resolve().relative_to(SOURCE)
        name = str(page.with_suffix(""))
        entries.append(f"{title} <{'self' if name == root_doc else f'/{name}'}>")
    return "\n".join(["```{toctree}", ":hidden:", f":caption: {caption}", "", *entries, "```", ""])


def index() -> str:
    """Return the index, which leads to the pages that are made, not to what makes them."""
    text = (SOURCE / f"{INDEX}.md").read_text(encoding="utf-8")
    text = text.replace("../examples/README.rst", f"../{GALLERY}/index.rst")
    return text.replace("(tables.py)", f"(../{REFERENCE})")


def contents() -> str:
    """Return the tables of contents of the site's sidebar."""
    return "\n".join(toctree(section) for section in index().split("\n## ")[1:])


def write_reference(app: Sphinx, config: object) -> None:
    """Write the page of commands, arguments and parameters."""
    from tables import reference

    page = SOURCE / REFERENCE
    page.parent.mkdir(exist_ok=True)
    page.write_text(reference(), encoding="utf-8")


def docstrings(line: re.Match[str]) -> str:
    """Return the directives that show a line of names: a table of first lines, and docstrings."""
    names = [f"{line[2]}.{name}" for name in re.findall(r"`(\w+)`", line[1])]
    table = [".. autosummary::", "   :nosignatures:", "", *(f"   {name}" for name in names), ""]
    texts = [
        f".. autoclass:: {name}\n   :members:"
        if name.rpartition(".")[2][0].isupper()
        else f".. autofunction:: {name}"
        for name in names
    ]
    return "\n".join(["", "```{eval-rst}", *table, *texts, "```", ""])


def without_folders(page: str, text: str) -> str:
    """Return a page's text, whose links to folders are plain text: a site has no folders."""

    def plain(link: re.Match[str]) -> str:
        return link[1] if (SOURCE / page).parent.joinpath(link[2]).is_dir() else link[0]

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)#:]+)\)", plain, text)


def read(app: Sphinx, page: str, source: list[str]) -> None:
    """Adapt a page's text to the site."""
    text = re.sub(r"^(.*)<!-- api: ([\w.]+) -->$", docstrings, source[0], flags=re.M)
    text = without_folders(page, text)
    if page == root_doc:
        text = f"{text}\n{contents()}"
    elif page == INDEX:  # the sidebar lists the same pages
        text = f"---\norphan: true\n---\n{index()}"
    source[0] = text


def add_levels(
    app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object
) -> None:
    """Add the level to the sidebar's headings, which WAI-ARIA requires."""
    name = "furo_navigation_tree"
    context[name] = context[name].replace('role="heading"', 'role="heading" aria-level="2"')


def setup(app: Sphinx) -> None:
    """Connect to Sphinx."""
    app.connect("config-inited", write_reference)
    app.connect("source-read", read)
    app.connect("html-page-context", add_levels, priority=900)  # after the theme
