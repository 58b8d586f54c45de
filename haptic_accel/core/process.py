# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command lines, exit statuses and environment variables shared by the processes of a graph."""

from __future__ import annotations

import os
import signal
import sys
from typing import Any

DONE, FAILED, WRONG_ARGUMENTS, INTERRUPTED = 0, 1, 2, 130
"""Exit statuses of all executables and of ``haptic-accel``; after Ctrl-C as in shells."""

CUT_SHORT = (6, 11, 14)
"""Exit statuses of a node whose middleware aborted, crashed or hung during shutdown, after all
other work: the numbers of the corresponding signals."""

WELL = frozenset((DONE, *CUT_SHORT))
"""Exit statuses of a node that has done all its work."""


def signals(*names: str) -> tuple[signal.Signals, ...]:
    """Return the named signals that this system has."""
    return tuple(getattr(signal, name) for name in names if hasattr(signal, name))


ENDING = signals("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
"""Signals that end a command or a node cleanly. Closing the terminal must also leave a complete
bag, an intact terminal, and no force."""

EMERGENCY: signal.Signals = getattr(signal, "SIGUSR1", signal.SIGTERM)
"""Signal on which a node sets all forces to zero and publishes the emergency stop. Systems without
it cannot run a graph."""

SUPERVISOR = "HAPTIC_ACCEL_SUPERVISOR"
"""Environment variable with the id of the process that started a node."""

ENGAGED, OVER, RECORDED, REPEAT = "engaged", "over", "recorded", "repeat"
"""Events of a graph: the arms are coupled; its duration is over; a bag is complete, with its
`path`; a repeat of an excitation starts, with the number of repeats `done`."""

PROGRESS, FULL_SCALE = "progress", "full_scale"
"""Events of a command: its next stage, with `text`; the force at a sound card's full scale,
`value`, in N per kg of the handle's mass."""

UNUSABLE, TOO_STRONG = "unusable", "too_strong"
"""Events of an identification: a recording that cannot be evaluated, and an excitation that is too
strong, each with its `reason`."""

_RECORD = "\x1e"
"""First character of a line with an event: a record of a JSON text sequence (RFC 7464)."""


def notify_supervisor(event: str, **values: Any) -> None:
    """Print an event for the supervisor of this process; do nothing without one."""
    if SUPERVISOR in os.environ:
        import json  # imported here, so that an emergency stop starts without it

        # Record and line end are written at once, so that the log of another thread cannot come
        # between.
        record = json.dumps({"event": event, **values})
        print(f"{_RECORD}{record}\n", end="", flush=True)


def read_event(line: str) -> dict[str, Any]:
    r"""Return the event in a line of output; empty for a line of text.

    Examples
    --------
    >>> read_event('\x1e{"event": "engaged"}'), read_event("engaged")
    ({'event': 'engaged'}, {})
    """
    if not line.startswith(_RECORD):
        return {}
    import json

    try:
        found = json.loads(line[1:])
    except ValueError:
        return {}
    return found if isinstance(found, dict) and isinstance(found.get("event"), str) else {}


REALTIME = "HAPTIC_ACCEL_REALTIME"
"""Environment variable that disables real-time priority, for comparisons, if it is ``no``."""

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Environment variables with the number of threads for BLAS."""

_SHORTAGES = {
    "Too many open files": "too few file descriptors (ulimit -n)",
    "cannot allocate memory": "too little memory (ulimit -v)",
    "failed to map segment": "too little memory (ulimit -v)",
    "can't start new thread": "too little memory or too few processes (ulimit -v, -u)",
    "error return without exception set": "too little memory (ulimit -v)",  # as imports lose it
    "terminated abruptly": "one of its processes was killed, possibly for lack of memory",
}
"""Exhausted resources of the machine, by the messages of Python and the dynamic loader in errors
of various classes."""

_RUN = (
    "import sys; sys.path = [path for path in sys.path if path]; import runpy;"
    " runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)
"""Python program that runs a module. Unlike ``python -m`` it does not search the working directory
first. A folder ``haptic_accel`` there, for example of a clone, or a file ``queue.py`` would be
imported by mistake. (``python -P`` does the same from Python 3.11 on.)"""


def module_command(module: str) -> list[str]:
    """Return the command line that runs a module of this installation from any folder."""
    return [sys.executable, "-c", _RUN, module]


def report_unraisable(unraisable: sys.UnraisableHookArgs) -> None:
    """Report an exception that nothing can catch, as Python does, unless memory is short.

    The command itself reports that in one line. Set this function as `sys.unraisablehook`.
    """
    if unraisable.exc_type is not MemoryError:
        sys.__unraisablehook__(unraisable)


def shortage(error: BaseException | None) -> str:
    """Return the resource of the machine that caused an error, directly or indirectly; or ''."""
    while error:
        if isinstance(error, MemoryError):
            return "too little memory"
        if isinstance(error, (ImportError, OSError, RuntimeError, SystemError)):
            for said, resource in _SHORTAGES.items():
                if said.lower() in str(error).lower():
                    return resource
        error = error.__cause__ or error.__context__
    return ""
