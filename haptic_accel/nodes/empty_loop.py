# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Empty loop on the sampling grid, which measures the machine's lateness without any node.

``python -m haptic_accel.nodes.empty_loop RATE SECONDS`` runs it with the priority of a node, and
prints its result as JSON.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

from haptic_accel.core.process import module_command
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick.device_side import IN_TIME
from haptic_accel.nodes.timing import RateKeeper, ask_for_realtime, sharpen_timers, wake_time

STARTING_TIME = 30.0
"""Longest time for the process to start and end on a busy machine, s."""


def empty_loop(rate: float, seconds: float) -> dict[str, Any]:
    """Run the loop in a separate process.

    Parameters
    ----------
    rate : float
        Ticks per second, Hz.
    seconds : float
        Length, s.

    Returns
    -------
    dict
        ``{"missed": n, "of": n, "lateness_us": {"p50": ..., "max": ...}}``: number of ticks that
        started too late for a force in time (`IN_TIME`), all ticks, lateness.

    Raises
    ------
    RuntimeError
        The process did not start or end.
    """
    command = [*module_command(__name__), str(rate), str(seconds)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=seconds + STARTING_TIME, check=True
        )
    except (subprocess.SubprocessError, OSError) as error:
        raise RuntimeError(f"empty loop: {error}") from None
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def run(rate: float, seconds: float) -> dict[str, Any]:
    """Run the loop in this process; see `empty_loop`."""
    sharpen_timers()
    lead = wake_time()
    ask_for_realtime()
    keeper = RateKeeper(rate, lead=lead)
    missed = 0
    while keeper.ticks + keeper.missed < rate * seconds:
        time.sleep(max(0.0, keeper.next - time.monotonic()))
        late = time.monotonic() - IN_TIME * keeper.period
        while (tick := keeper.due()) is not None:
            missed += keeper.time(tick) / NANOSECONDS < late
    lateness = {name: 1e6 * value for name, value in keeper.lateness.summary().items()}
    of = keeper.ticks + keeper.missed
    return {"missed": missed + keeper.missed, "of": of, "lateness_us": lateness}


if __name__ == "__main__":
    print(json.dumps(run(*map(float, sys.argv[1:]))))
