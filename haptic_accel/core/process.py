"""Exit statuses and environment variables shared by the processes of a graph."""

from __future__ import annotations

import signal

DONE, FAILED, WRONG_ARGUMENTS = 0, 1, 2
"""Exit statuses of every executable and of ``haptic-accel``."""

CUT_SHORT = (6, 11)
"""Exit statuses of a node whose middleware aborted or faulted while it was shut down, all else
being done: the numbers of the signals that this raises."""

INTERRUPTED = 130
"""Exit status of ``haptic-accel`` after Ctrl-C, as in shells."""

EMERGENCY = signal.SIGUSR1
"""Signal that lets a node take off all forces, and publish the emergency stop."""

SUPERVISOR = "HAPTIC_ACCEL_SUPERVISOR"
"""Environment variable with the process id of the process that started a node."""

REALTIME = "HAPTIC_ACCEL_REALTIME"
"""Environment variable that disables real-time priority for comparisons if it is ``no``."""
