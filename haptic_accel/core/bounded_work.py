# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Execution of code without limits of its own, in a process with limited time and memory."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, WRONG_ARGUMENTS, module_command, signals

MEGABYTE = 10**6

GRACE_TIME, SLOWNESS = 10.0, 2.0
"""Maximum time for the start and the waiting of a process, s; and ratio of elapsed time to
processor time on a busy computer that leaves the process half a core."""

_ENDED = tuple(-number for number in signals("SIGXCPU", "SIGKILL", "SIGALRM"))
"""Exit statuses of a process that exceeded its time."""


_refusal: ContextVar[str] = ContextVar("_refusal", default="")


class OutOfBoundsError(Exception):
    """Error: work exceeded its time or memory, or crashed; the message is one line."""


@contextmanager
def without_bounded_work(reason: str) -> Iterator[None]:
    """Reject bounded work, with a reason, in contexts that must not wait."""
    token = _refusal.set(reason)
    try:
        yield
    finally:
        _refusal.reset(token)


def run_bounded(module: str, words: Sequence[str], seconds: float) -> None:
    """Run a module that calls `bounded`, in an empty folder, and wait for its end.

    Parameters
    ----------
    module : str
    words : sequence of str
        Command-line arguments of the module.
    seconds : float
        Maximum processor time, s, as declared by the module.

    Raises
    ------
    ParameterError
        Raised by the work, or waiting is not allowed here.
    OutOfBoundsError
        The work exceeded its time or memory.
    """
    if reason := _refusal.get():
        raise ParameterError(reason)
    with TemporaryDirectory(prefix="haptic_accel-") as folder:
        try:
            done = subprocess.run(
                [*module_command(module), *words],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=2 * (SLOWNESS * seconds + GRACE_TIME),
                check=False,
            )
            status, lines = done.returncode, done.stdout.decode(errors="replace").splitlines()
        except subprocess.TimeoutExpired:
            status, lines = _ENDED[0], []
    if status == WRONG_ARGUMENTS and lines:
        raise ParameterError(lines[-1])
    if status in _ENDED:
        raise OutOfBoundsError(f"takes longer than {seconds:g} s")
    if status != DONE:
        raise OutOfBoundsError("takes too much memory, or crashes its reader")


def bounded(work: Callable[[], None], seconds: float, megabytes: float) -> None:
    """Execute the work of this process within limits, and exit.

    Parameters
    ----------
    work : callable
        The work; it raises `ParameterError` for errors in the user's file.
    seconds : float
        Maximum processor time, s.
    megabytes : float
        Maximum memory in addition to that already in use, megabytes.
    """
    # Imported only if limits are set, as the module is absent on Windows.
    import resource

    used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    limits = {
        resource.RLIMIT_CPU: math.ceil(used + seconds),
        resource.RLIMIT_DATA: data_in_use() + int(megabytes * MEGABYTE),
        resource.RLIMIT_CORE: 0,
    }
    for kind, limit in limits.items():
        hard = resource.getrlimit(kind)[1]
        lowest = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (lowest, hard))
    # Also ends waiting, for example for the other end of a pipe.
    signal.setitimer(signal.ITIMER_REAL, SLOWNESS * seconds + GRACE_TIME)
    try:
        work()
    except ParameterError as error:
        print(f"\n{error}", flush=True)  # the libraries may have written something
        sys.exit(WRONG_ARGUMENTS)
    sys.exit(DONE)


def data_in_use() -> int:
    """Return the memory that this process has allocated for data, bytes."""
    lines = Path("/proc/self/status").read_bytes().splitlines()  # a name need not be UTF-8
    (size,) = (line.split()[1] for line in lines if line.startswith(b"VmData:"))
    return int(size) * 1024
