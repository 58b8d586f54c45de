# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command lines, exit statuses and environment variables shared by the processes of a graph."""

from __future__ import annotations

import signal
import sys

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

_RUN = (
    "import sys; sys.path = [place for place in sys.path if place]; import runpy;"
    " runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
"""Python program that runs a module. Unlike ``python -m`` it does not look into the working
directory first, where a folder ``haptic_accel``, such as that of a clone, or a file ``queue.py``
would be taken for another module. (``python -P`` does that from Python 3.11 on.)"""


def module_command(module: str) -> list[str]:
    """Return the command line that runs a module of this installation, whatever the folder."""
    return [sys.executable, "-c", _RUN, module]
