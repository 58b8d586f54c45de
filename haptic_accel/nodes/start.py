# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry points of the nodes' executables, by the nodes' names."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from functools import partial

from haptic_accel.core.outside import OutsideError, main_of, node_module
from haptic_accel.core.process import DONE
from haptic_accel.graph.domain import NEEDS_ROS, has_ros


def __getattr__(node: str) -> Callable[[], None]:
    """Return the function that runs a node."""
    return partial(_start, node)


def _start(node: str) -> None:
    if not has_ros():
        sys.exit(f"{node} {NEEDS_ROS}")
    # Libraries take a second to load. Until then a signal ends the node silently: Python's own
    # handler would print a traceback, and there is nothing to undo.
    signal.signal(signal.SIGINT, lambda *_: os._exit(DONE))
    # A launch starts nodes with this signal blocked, so that it cannot interrupt Python's start.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    try:
        main = main_of(node_module(node))
    except OutsideError as error:
        sys.exit(f"{node}: {error}")
    main()
