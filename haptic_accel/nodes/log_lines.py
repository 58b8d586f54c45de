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
