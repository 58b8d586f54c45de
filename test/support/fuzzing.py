# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generated damage to decoder input: `pytest --fuzz 1000000` runs a million cases each."""

from __future__ import annotations

import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import pytest
from hypothesis import settings
from hypothesis import strategies as st

from haptic_accel.core.bounded_work import data_in_use
from haptic_accel.core.parameters import ParameterError

T = TypeVar("T", bytes, str)

ODD_NUMBERS = (
    "\u0661\u0662",  # 12 in Arabic digits
    "\uff11\uff12",  # 12 in full-width digits
    *("1_000", "\u00b2", "\u22121", "0x10", "0b1", "1j", "1,5", "1e", "e5", "--1", "+", ".", ""),
    *("nan", "inf", "-Infinity", "1\u00a0", "1\0", "1" * 500 + "x"),
)
"""Texts that are no numbers in a file, though Python accepts some as numbers."""

ODD_TEXTS = (*ODD_NUMBERS, "\ufeff", "\x1b[2J", "\u2028", "\x85", "\U0001f600", *"[{", "a" * 3000)
"""Texts that break parsers, and lines of output."""


SECONDS, MEGABYTES = 2.0, 500.0
"""Limits for any file, whatever its content."""


def fuzz(test: Callable[..., Any]) -> Callable[..., Any]:
    """Give a property the requested number of cases, and its mark."""
    return pytest.mark.fuzz(settings.get_profile("fuzz")(test))


def fuzz_few(test: Callable[..., Any]) -> Callable[..., Any]:
    """Apply `fuzz` with fewer default cases, for slow cases."""
    return pytest.mark.fuzz(settings.get_profile("fuzz few")(test))


def fuzz_fewest(test: Callable[..., Any]) -> Callable[..., Any]:
    """Apply `fuzz` with the fewest default cases, for cases of a second."""
    return pytest.mark.fuzz(settings.get_profile("fuzz fewest")(test))


def mutated(valid: st.SearchStrategy[T], pieces: st.SearchStrategy[T]) -> st.SearchStrategy[T]:
    """Return valid input with up to four parts changed, cut out, doubled or inserted.

    Parameters
    ----------
    valid : strategy of bytes or str
    pieces : strategy of bytes or str
        Content to insert, or to replace a part.
    """
    kinds = st.sampled_from(["replace", "cut", "double", "insert", "end"])
    change = st.tuples(kinds, st.integers(0, 999), st.integers(1, 16), pieces)
    return st.builds(_changed, valid, st.lists(change, max_size=4))


def _changed(text: T, changes: list[tuple[str, int, int, T]]) -> T:
    for kind, where, length, piece in changes:
        at = where * (len(text) + 1) // 1000
        before, there, after = text[:at], text[at : at + length], text[at + length :]
        text = {
            "replace": before + piece + after,
            "cut": before + after,
            "double": before + there + there + after,
            "insert": before + piece + there + after,
            "end": before,
        }[kind]
    return text


class TooSlowError(Exception):
    """Error: a time limit was exceeded."""


@contextmanager
def measured(seconds: float = SECONDS, megabytes: float = MEGABYTES) -> Iterator[None]:
    """Fail if the body takes more time, or more memory at once, than allowed.

    Time is processor time, which a busy machine does not change. Memory is allocated memory:
    beyond the limit, allocations fail, as on a machine without more, and none is filled.

    Raises
    ------
    TooSlowError
        The time is exceeded.
    MemoryError
        An allocation failed.
    """

    def over(*_: object) -> None:
        raise TooSlowError(f"took more than {seconds:g} s")

    before = resource.getrlimit(resource.RLIMIT_DATA)
    handler = signal.signal(signal.SIGVTALRM, over)
    resource.setrlimit(resource.RLIMIT_DATA, (data_in_use() + int(megabytes * 1e6), before[1]))
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        resource.setrlimit(resource.RLIMIT_DATA, before)
        signal.signal(signal.SIGVTALRM, handler)


@contextmanager
def without_programs() -> Iterator[None]:
    """Fail if the body starts a program, also where the body handles the error."""
    _started.clear()
    yield
    assert not _started


_started: list[str] = []
"""Programs started since the last `without_programs`."""


@sys.addaudithook
def _note_program(event: str, arguments: tuple[object, ...]) -> None:
    if event in ("subprocess.Popen", "os.system", "os.posix_spawn", "os.exec", "os.fork"):
        _started.append(f"{event}: {arguments}")


def accepted(read: Callable[[], object]) -> bool:
    """Return whether input is accepted; a refusal must be one line fit for a terminal."""
    try:
        read()
    except ParameterError as error:
        assert str(error).isprintable(), repr(str(error))
        return False
    return True


def in_child(read: Callable[[], object]) -> None:
    """Call a function in a forked process, for libraries that may not return.

    Time and memory are limited as by `measured`. Beyond these limits the process is ended, which
    is no failure, as the code under test has the same limits. An error is a failure.
    """
    received, sent = os.pipe()
    child = os.fork()
    if not child:
        os.close(received)
        failure = b""
        try:
            signal.setitimer(signal.ITIMER_REAL, 10 * SECONDS)  # if it waits
            limit = resource.getrlimit(resource.RLIMIT_DATA)[1]
            most = data_in_use() + int(MEGABYTES * 1e6)
            resource.setrlimit(resource.RLIMIT_DATA, (most, limit))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
            with without_programs():
                read()
        except BaseException:
            failure = traceback.format_exc().encode()
        finally:
            os.write(sent, failure[-4000:])
            os._exit(0)
    os.close(sent)
    with open(received, "rb") as file:
        failure = file.read()
    os.waitpid(child, 0)
    assert not failure, failure.decode()
