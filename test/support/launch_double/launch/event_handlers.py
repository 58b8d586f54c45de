# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Handlers of events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class OnShutdown:
    """Handler of the end of a launch."""

    def __init__(self, *, on_shutdown: Callable[..., None]) -> None:
        self._on_shutdown = on_shutdown

    def handle(self, event: Any, context: Any) -> None:
        self._on_shutdown(event, context)
