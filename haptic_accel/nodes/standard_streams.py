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

"""Standard output, error and log of a node, which never wait for a reader."""

from __future__ import annotations

import io
import os
import stat
import sys
from contextlib import suppress
from typing import Any, cast

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger

from haptic_accel.core.parameters import printable

STREAMS = ("stdin", "stdout", "stderr")
"""Names of the standard streams, by descriptor."""


class LossyStream(io.RawIOBase):
    """Raw stream that drops data if it cannot write them at once: it never waits or fails.

    Lines of up to 4096 bytes (PIPE_BUF) are written whole to a pipe, or lost. After a longer line
    that was cut, the next text begins a new line.

    Parameters
    ----------
    descriptor : int
        Descriptor that does not block; it is not closed.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._cut = False

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return os.isatty(self._descriptor)

    def write(self, data: Any) -> int:
        """Write without waiting; return the length of all data."""
        text = b"\n" + bytes(data) if self._cut else bytes(data)
        # EAGAIN: no reading. EPIPE and EIO: no reader or terminal. ENOSPC: a full disk.
        with suppress(OSError):
            self._cut = os.write(self._descriptor, text) < len(text)
        return len(data)


def unblock_standard_streams() -> None:
    """Write the log of this process without blocking; drop lines without a reader.

    A write blocks once a pipe holds 64 KiB unread, or a terminal stopped by Ctrl-S less. A node
    behind a stopped or unread supervisor would block and hold the force of its last tick. The C
    library's streams, by which rclpy logs, drop such output, too; output to a file is not
    affected.
    """
    for descriptor, name in enumerate(STREAMS):
        _unblock(descriptor)
        if name == "stdin":
            continue
        before = getattr(sys, name)  # None where it was closed
        with suppress(OSError, AttributeError):
            before.flush()
        stream = io.TextIOWrapper(
            cast("Any", LossyStream(descriptor)),  # a raw stream will do
            encoding=getattr(before, "encoding", "utf-8"),
            errors="backslashreplace",
            line_buffering=True,  # a line is one write
        )
        setattr(sys, name, stream)


def _unblock(descriptor: int) -> None:
    try:
        mode = os.fstat(descriptor).st_mode
    except OSError:
        # A closed descriptor may be reused, such as by a socket, which must not get the log.
        _replace(descriptor, os.open(os.devnull, os.O_RDWR))
        return
    if descriptor == 0 or not (stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)):
        return
    # Opened again: the flag of an inherited description applies to all processes that share it,
    # such as the shell. O_NOCTTY: the leader of a session would get the terminal's signals.
    flags = os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY
    try:
        _replace(descriptor, os.open(f"/proc/self/fd/{descriptor}", flags))
    except OSError:
        # A socket, or after su another user's; a flag on a terminal would disturb the shell.
        if not stat.S_ISCHR(mode):
            os.set_blocking(descriptor, False)


def _replace(descriptor: int, other: int) -> None:
    if other != descriptor:
        os.dup2(other, descriptor)
        os.close(other)


class NodeLogger(RcutilsLogger):
    """Logger that finds a line's caller from the stack alone, and escapes control characters.

    rclpy's logger uses `inspect`, which resolves the paths of all loaded modules at the first
    line, 25 to 120 ms, and reads each caller's source file. rclpy's filters (``once``) are
    missing.
    """

    def log(self, message: str, severity: Any) -> bool:
        """Log a message of sufficient severity; return whether it was logged."""
        if not self.is_enabled_for(severity):
            return False
        frame: Any = sys._getframe(1)
        while frame.f_globals["__name__"] == RcutilsLogger.__module__:
            frame = frame.f_back
        code = frame.f_code
        rclpy_implementation.rclpy_logging_rcutils_log(
            severity, self.name, printable(message), code.co_name, code.co_filename, frame.f_lineno
        )
        return True
