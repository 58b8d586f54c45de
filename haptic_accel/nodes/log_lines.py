# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lines of the log that hold up no loop."""

from __future__ import annotations

import sys
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger

from haptic_accel.core.parameters import printable


class NodeLogger(RcutilsLogger):
    """A logger that names who logs a line from the stack alone, and escapes control characters.

    rclpy's own asks `inspect`: that resolves the paths of all loaded modules at the first line,
    25 to 120 ms, and reads every source file from which a line comes. Its filters (``once``) are
    not offered.
    """

    def log(self, message: str, severity: Any) -> bool:
        """Log a message, if its severity is logged at all; return whether it is."""
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
