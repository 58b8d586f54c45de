# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry points of the nodes' executables, by the nodes' names."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from importlib import import_module


def __getattr__(node: str) -> Callable[[], None]:
    """Return the function that runs a node."""
    return partial(_start, node)


def _start(node: str) -> None:
    # Libraries take a second to load. Until a node handles signals, one ends it without a word:
    # Python's own handler would show where the loading was interrupted.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    import_module(f"{__package__}.{node}").main()
