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

"""Keys pressed in the terminal while a verb runs."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from haptic_accel.core.process import REALTIME

PRIORITY = 42
"""Real-time priority of the thread that waits for a key, above those of the nodes."""

BACKGROUND_PERIOD = 0.5
"""Interval between looks while the terminal belongs to another program, s."""


@contextmanager
def on_key(key: bytes, act: Callable[[], None]) -> Iterator[bool]:
    """Call a function on a separate thread whenever a key is pressed, without Enter.

    Nothing is read where the standard input is no terminal, or another program's. Ctrl-C and the
    like remain signals. The terminal is as it was before when the context is left.

    Yields
    ------
    bool
        True while keys are read.
    """
    if not (sys.stdin and sys.stdin.isatty() and _is_ours(sys.stdin.fileno())):
        yield False
        return
    terminal = sys.stdin.fileno()
    settings = termios.tcgetattr(terminal)
    over, end = os.pipe()
    thread = threading.Thread(target=_follow, args=(terminal, over, key, act), daemon=True)
    thread.start()
    try:
        tty.setcbreak(terminal)
        yield True
    finally:
        os.close(end)
        thread.join()
        os.close(over)
        with suppress(termios.error):  # a terminal that has hung up
            termios.tcsetattr(terminal, termios.TCSADRAIN, settings)


def _follow(terminal: int, over: int, key: bytes, act: Callable[[], None]) -> None:
    """Read keys until the other end of a pipe is closed, or the terminal is gone."""
    if os.environ.get(REALTIME) != "no":
        with suppress(OSError):  # not allowed here
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    while over not in select.select([terminal, over], [], [])[0]:
        if not _is_ours(terminal):  # to read would suspend us
            select.select([over], [], [], BACKGROUND_PERIOD)
            continue
        try:
            pressed = os.read(terminal, 1024)
        except OSError:
            return
        if not pressed:
            return
        if key in pressed:
            act()


def _is_ours(terminal: int) -> bool:
    """Return whether keys pressed in a terminal are for this program."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
