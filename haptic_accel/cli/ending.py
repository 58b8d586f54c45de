"""The error by which a verb ends before it is done."""

from __future__ import annotations


class StoppedError(Exception):
    """A verb ends early.

    Parameters
    ----------
    status : int
        Exit status.
    line : str
        Reason for the terminal; empty if it has been shown.
    """

    def __init__(self, status: int, line: str = "") -> None:
        super().__init__(line)
        self.status = status
