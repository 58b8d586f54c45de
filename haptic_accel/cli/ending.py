# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The error by which a verb ends before it is done."""

from __future__ import annotations

from haptic_accel.core.process import FAILED


class StoppedError(Exception):
    """A verb ends early.

    Parameters
    ----------
    line : str
        Reason for the terminal; empty if it has been shown.
    status : int
        Exit status.
    """

    def __init__(self, line: str = "", status: int = FAILED) -> None:
        super().__init__(line)
        self.status = status
