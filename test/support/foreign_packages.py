# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Packages of others, as an installer leaves them, with entry points for this one."""

from __future__ import annotations

from pathlib import Path

GROUPS = ("commands", "nodes", "masters", "slaves", "controllers")
"""Groups of entry points, without the name of the package before them."""


def declare(site: Path, package: str, entries: dict[str, str], group: str = "commands") -> None:
    """Write what an installer writes of a package whose entry points are in one group."""
    about = site / f"{package}-9.0.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 9.0.0\n")
    lines = "".join(f"{name} = {place}\n" for name, place in entries.items())
    (about / "entry_points.txt").write_text(f"[haptic_accel.{group}]\n{lines}")
