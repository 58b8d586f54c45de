# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs that the processes of a pool or cluster import by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from haptic_accel.core.parameters import ParameterError


def negative(number: float) -> float:
    return -number


def killed_once(item: tuple[int, Path]) -> int:
    """Kill this process when item 3 runs for the first time."""
    number, folder = item
    if number == 3:
        try:
            (folder / "was here").touch(exist_ok=False)
        except FileExistsError:
            return -number
        os.kill(os.getpid(), signal.SIGKILL)
    return -number


def killed(_: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def refused(number: int) -> int:
    raise ParameterError(f"number = {number}: must be another")


def rested(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def endless(_: int) -> None:
    os.write(1, f"{os.getpid()}\n".encode())  # in one piece
    time.sleep(3600)
