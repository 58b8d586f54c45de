# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Module that Python imports at start if PYTHONPATH has this folder.

It logs when a node imports a module, opens a file, or queries a file.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import Any

WATCHED = ("import", "open")
"""Python audit events; ``os.stat`` has no event."""

DEPTH = 4
"""Number of callers that are named."""


def watch(folder: str, node: str) -> None:
    """Log system time, event and callers, one line each, to a file with a node's name."""
    log = os.open(f"{folder}/{node}", os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def note(event: str, name: object) -> None:
        callers: list[str] = []
        frame: Any = sys._getframe(2)
        while frame and len(callers) < DEPTH:
            callers.append(f"{os.path.basename(frame.f_code.co_filename)}:{frame.f_lineno}")
            frame = frame.f_back
        os.write(log, f"{time.time_ns()} {event} {name!r} {' < '.join(callers)}\n".encode())

    def noted(ask: Callable[..., Any]) -> Callable[..., Any]:
        def call(path: object, *words: Any, **given: Any) -> Any:
            note(ask.__name__, path)
            return ask(path, *words, **given)

        return call

    sys.addaudithook(lambda event, given: note(event, given[0]) if event in WATCHED else None)
    os.stat, os.lstat = noted(os.stat), noted(os.lstat)


for word in sys.orig_argv:
    if word.startswith("haptic_accel.nodes."):
        watch(os.environ["LOADING_FOLDER"], word.rsplit(".", 1)[-1])
