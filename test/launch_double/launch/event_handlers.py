"""What is done at events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class OnShutdown:
    """What is done when a launch ends."""

    def __init__(self, *, on_shutdown: Callable[..., None]) -> None:
        self._on_shutdown = on_shutdown

    def handle(self, event: Any, context: Any) -> None:
        self._on_shutdown(event, context)
