# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Generated damage to what decoders read: `pytest --fuzz 1000000` for a million cases of each."""

from __future__ import annotations

import os
import resource
import signal
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
    "1_000",
    "\u0661\u0662",  # 12 in Arabic digits
    "\uff11\uff12",  # in those of full width
    "\u00b2",
    "\u22121",
    "0x10",
    "0b1",
    "1j",
    "1,5",
    "1e",
    "e5",
    "--1",
    "+",
    ".",
    "",
    "nan",
    "inf",
    "-Infinity",
    "1\u00a0",
    "1\0",
    "1" * 500 + "x",
)
"""Texts that are no number in a file, though Python takes some of them for one."""

ODD_TEXTS = (
    *ODD_NUMBERS,
    "\ufeff",
    "\x1b[2J",
    "\u2028",
    "\x85",
    "a" * 3000,
    "\U0001f600",
    "[",
    "{",
)
"""Texts that break parsers, and lines of output."""


SECONDS, MEGABYTES = 2.0, 500.0
"""Most that a file may take, whatever is in it."""


def fuzz(test: Callable[..., Any]) -> Callable[..., Any]:
    """Give a property the number of cases that was asked for, and its mark."""
    return pytest.mark.fuzz(settings.get_profile("fuzz")(test))


def fuzz_few(test: Callable[..., Any]) -> Callable[..., Any]:
    """As `fuzz`, with a tenth of the cases by default: each of them takes long."""
    return pytest.mark.fuzz(settings.get_profile("fuzz few")(test))


def mutated(valid: st.SearchStrategy[T], pieces: st.SearchStrategy[T]) -> st.SearchStrategy[T]:
    """Return what is valid, with up to four parts changed, cut out, doubled or inserted.

    Parameters
    ----------
    valid : strategy of bytes or str
    pieces : strategy of bytes or str
        What is inserted, or put in place of something.
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
    """Something took longer than it may."""


@contextmanager
def measured(seconds: float = SECONDS, megabytes: float = MEGABYTES) -> Iterator[None]:
    """Fail if what is inside takes longer, or more memory at a time, than is allowed.

    Time is that of the processor, so that a busy machine changes nothing. Memory is that which is
    asked for: more of it is refused, as on a machine that has no more, and none is filled.

    Raises
    ------
    TooSlowError
        After the time.
    MemoryError
        Where more memory is asked for.
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


def accepted(read: Callable[[], object]) -> bool:
    """Return whether something is read; what is refused must be in one line fit for a terminal."""
    try:
        read()
    except ParameterError as error:
        assert str(error).isprintable(), repr(str(error))
        return False
    return True


def in_child(read: Callable[[], object]) -> None:
    """Do something in a process forked of this one, for libraries that may not come back from it.

    Time and memory are bounded as by `measured`, and beyond them the process is ended, which is no
    failure: the same bounds are those of the code under test. An error is one.
    """
    received, sent = os.pipe()
    child = os.fork()
    if not child:
        os.close(received)
        failure = b""
        try:
            signal.setitimer(signal.ITIMER_REAL, 10 * SECONDS)  # where it waits
            limit = resource.getrlimit(resource.RLIMIT_DATA)[1]
            most = data_in_use() + int(MEGABYTES * 1e6)
            resource.setrlimit(resource.RLIMIT_DATA, (most, limit))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
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
