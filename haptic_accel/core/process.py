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

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that end a verb or a node in order: the end of its terminal, too, must leave bag and
terminal in order, and no force."""

EMERGENCY = signal.SIGUSR1
"""Signal that lets a node take off all forces, and publish the emergency stop."""

SUPERVISOR = "HAPTIC_ACCEL_SUPERVISOR"
"""Environment variable with the process id of the process that started a node."""

REALTIME = "HAPTIC_ACCEL_REALTIME"
"""Environment variable that disables real-time priority for comparisons if it is ``no``."""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Environment variables with the number of threads on which BLAS computes."""

_SHORTAGES = {
    "Too many open files": "too few file descriptors (ulimit -n)",
    "cannot allocate memory": "too little memory (ulimit -v)",
    "failed to map segment": "too little memory (ulimit -v)",
    "can't start new thread": "too little memory or too few processes (ulimit -v, -u)",
    "terminated abruptly": "a process of it was killed, as where memory is short",
}
"""Resources of the machine that are used up, by what Python and the loader of libraries say in
errors of different classes."""

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


def shortage(error: BaseException | None) -> str:
    """Return the resource of the machine that an error, or one that caused it, lacked; or ''."""
    while error:
        if isinstance(error, MemoryError):
            return "too little memory"
        if isinstance(error, (ImportError, OSError, RuntimeError)):
            for said, resource in _SHORTAGES.items():
                if said.lower() in str(error).lower():
                    return resource
        error = error.__cause__ or error.__context__
    return ""
