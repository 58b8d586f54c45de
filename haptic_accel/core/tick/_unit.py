# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Choice between the compiled extension of all sections and their plain Python source."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import struct
import sys
from pathlib import Path

from haptic_accel.core.parameters import warn_once

COMPILED, PLAIN = "compiled", "plain Python"


def _chosen() -> str:
    """Use the compiled extension if it was built from these sources; return the form in use.

    Any value of the environment variable HAPTIC_ACCEL_PLAIN selects plain Python.
    """
    name = f"{__package__}._compiled"
    found = importlib.util.find_spec(name)
    if os.environ.get("HAPTIC_ACCEL_PLAIN") or not (found and found.origin):
        return PLAIN
    try:
        with open(found.origin, "rb") as file:
            head, length = file.read(62).ljust(62), os.fstat(file.fileno()).st_size
        # Offset, entry size and number of entries of the section header table, which is at the end
        # of an ELF file (elf(5)).
        start, size, count = struct.unpack("=Q10xHH", head[40:])
        if head[:5] == b"\x7fELF\x02" and length < start + size * count:
            # Loading a truncated file would end Python with a bus error.
            raise ImportError(f"{found.origin}: the end of the file is missing")
        unit = importlib.import_module(name)
        text = b"".join(map(Path.read_bytes, sorted(Path(__file__).parent.glob("[a-z]*.py"))))
        if hashlib.sha256(text).hexdigest() != unit.DIGEST:
            raise ImportError("it is of another version; install haptic_accel again")
    except Exception as error:  # a file for another processor, or damaged
        warn_once(f"plain Python runs instead of the compiled tick: {error}")
        return PLAIN
    sys.modules.update(dict.fromkeys([f"{__package__}.{name}" for name in unit.SECTIONS], unit))
    return COMPILED


TICK = _chosen()
"""Form of the sections that run: `COMPILED` or `PLAIN`."""
