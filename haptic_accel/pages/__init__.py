# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Templates, style sheets and scripts of the pages that are written or served.

The plots are drawn by uPlot (MIT), which is here whole because a page must not need the network.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import jinja2

_FOLDER = Path(__file__).parent


def asset(name: str) -> str:
    """Return a script or style sheet of the folder ``assets``, to be put into a page."""
    return (_FOLDER / "assets" / name).read_text(encoding="utf-8")


def template(name: str) -> jinja2.Template:
    """Return the template of a page; values are escaped unless marked as safe.

    Parameters
    ----------
    name : str
        Name of a file in ``templates``, which may include others from there.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER / "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def write(file: Path, name: str, **content: Any) -> None:
    """Write a page from its template and content, with the time as ``when``."""
    page = template(name).render(content, when=datetime.now().astimezone())
    file.write_text(page, encoding="utf-8", errors="replace")
