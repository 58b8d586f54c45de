"""Events of processes."""

from __future__ import annotations


class ProcessExited:
    """The end of a process."""
