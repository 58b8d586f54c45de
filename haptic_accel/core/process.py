"""What a process of the graph and whoever starts it agree on."""

from __future__ import annotations

DONE, FAILED, WRONG_ARGUMENTS = 0, 1, 2
"""Exit statuses of every executable and of ``haptic-accel``."""

INTERRUPTED = 130
"""Exit status of ``haptic-accel`` after Ctrl-C, as shells have it."""

SUPERVISOR = "HAPTIC_ACCEL_SUPERVISOR"
"""Environment variable with the process id of who started a node."""

EXECUTOR = "HAPTIC_ACCEL_EXECUTOR"
"""Environment variable that chooses a node's executor, for comparing: events or default."""

REALTIME = "HAPTIC_ACCEL_REALTIME"
"""Environment variable that keeps nodes from asking for real-time priority, for comparing: no."""
