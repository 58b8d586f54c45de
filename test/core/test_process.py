# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages of processes on a machine that is short of something."""

from __future__ import annotations

import pytest

from haptic_accel.core.process import shortage
from running import python


def chained(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError(), "too little memory"),
        (ImportError("a.so: failed to map segment from shared object"), "too little memory (ul"),
        (ImportError("a.so: cannot allocate memory in static TLS block"), "too little memory"),
        (OSError(12, "Cannot allocate memory"), "too little memory (ulimit -v)"),
        (OSError(24, "Too many open files"), "too few file descriptors (ulimit -n)"),
        (RuntimeError("can't start new thread"), "too little memory or too few processes"),
        (chained(ImportError("seems to be broken"), MemoryError()), "too little memory"),
        (SystemError("error return without exception set"), "too little memory (ulimit -v)"),
        (ImportError("cannot import name"), ""),
        (ValueError("Too many open files"), ""),
        (OSError(2, "No such file or directory"), ""),
    ],
)
def test_a_shortage_is_told_from_other_errors(error: Exception, said: str) -> None:
    found = shortage(error)
    assert found.startswith(said)
    assert bool(found) == bool(said)


def test_an_exception_that_nothing_can_catch_is_reported_unless_memory_is_short() -> None:
    code = (
        "import sys; from haptic_accel.core.process import report_unraisable\n"
        "sys.unraisablehook = report_unraisable\n"
        "class Ended:\n"
        "    def __init__(self, error): self.error = error\n"
        "    def __del__(self): raise self.error\n"
        "Ended(MemoryError('short')); Ended(ValueError('wrong'))\n"
    )
    done = python("-c", code, check=True)
    assert "wrong" in done.stderr
    assert "short" not in done.stderr
