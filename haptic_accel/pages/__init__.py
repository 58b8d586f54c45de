# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Templates, style sheets and scripts of written and served pages.

uPlot (MIT) draws the plots; it is included because a page must not need the network.
"""

from __future__ import annotations

import os
import re
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2

_FOLDER = Path(__file__).parent

_IMPORT = re.compile(r'^import (?:{[^}]*} from )?"\./(.+)";\n', re.MULTILINE)
"""Pattern of an import of a module in ``assets``."""

_EXPORT = re.compile(r"^export (?=async|class|const|function|let)", re.MULTILINE)


def asset(name: str) -> str:
    """Return a script or style sheet from the folder ``assets``, for insertion into a page."""
    return (_FOLDER / "assets" / name).read_text(encoding="utf-8")


def modules(name: str) -> dict[str, str]:
    """Return a script and its imported modules by name, each after its own imports."""
    found: dict[str, str] = {}

    def add(module: str) -> None:
        text = asset(module)
        for imported in _IMPORT.findall(text):
            if imported not in found:
                add(imported)
        found[module] = text

    add(name)
    return found


def script(name: str) -> str:
    """Return a script merged with its imported modules, for a page in a single file.

    All modules share one scope: names must be unique, and imports may not rename.
    """
    return _EXPORT.sub("", _IMPORT.sub("", "\n".join(modules(name).values())))


def template(name: str) -> jinja2.Template:
    """Return the template of a page; values are escaped unless marked as safe.

    The filter ``link`` converts the name of a file in the page's folder to an address.

    Parameters
    ----------
    name : str
        Name of a file in ``templates``, which may include other templates.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {"asset": asset, "script": script}
    # Autoescape keeps # and %, which have another meaning in an address.
    environment.filters["link"] = lambda name: quote(os.fsencode(name))
    return environment.get_template(name)


def write(file: Path, name: str, **content: Any) -> None:
    """Write a page from its template and content, with the time as ``when``."""
    page = template(name).render(content, when=datetime.now().astimezone())
    file.write_text(page, encoding="utf-8", errors="replace")
