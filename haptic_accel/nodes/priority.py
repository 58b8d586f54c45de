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

"""Priorities and timers of processes that compute forces (no ROS imported)."""

from __future__ import annotations

import ctypes
import os
import resource
from contextlib import suppress

from haptic_accel.core.process import REALTIME

LONGEST_RUN = 1_000_000
"""Time that a real-time thread may run without a pause, us, before the kernel ends its process
(with SIGXCPU): a fault in a node must not block the machine."""

RECORDING_PRIORITY, FORCE_PRIORITY, FELT_PRIORITY = 30, 40, 41
"""Real-time priorities, below the kernel's own threads at 50. Nodes that make forces have the
same, so that none interrupts another, but for the compensator: it may interrupt the others, whose
work for a tick can wait, for its force is due at the next. The recorder, which delays none of
them, must not wait for ordinary programs: messages would be lost."""

PR_SET_TIMERSLACK = 29
"""From linux/prctl.h."""


def sharpen_timers() -> None:
    """Set the timer slack to its minimum; the default, 50 us, was half of the lateness."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)


def ask_for_realtime(priority: int = FORCE_PRIORITY) -> bool:
    """Request real-time priority for this process, if the system allows it.

    Call it after set-up, which would otherwise take the cores from running nodes. It applies to
    all threads that exist by then, including the middleware's.

    Returns
    -------
    bool
        The priority was granted.
    """
    if os.environ.get(REALTIME) == "no" or not hasattr(os, "sched_setscheduler"):
        return False
    try:
        if priority >= FORCE_PRIORITY:  # the recorder may write to a slow disk for longer
            resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN, 2 * LONGEST_RUN))
        schedule(os.SCHED_FIFO, priority)
    except OSError:
        return False
    return True


def schedule(policy: int, priority: int) -> None:
    """Give every thread of this process a scheduling policy and a priority."""
    for thread in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):  # one that has just ended
            os.sched_setscheduler(int(thread), policy, os.sched_param(priority))


def scheduling_class() -> str:
    """Return the scheduling class of this thread, for diagnostics."""
    if not hasattr(os, "sched_getscheduler"):
        return "unknown"
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        return f"real-time {os.sched_getparam(0).sched_priority}"
    return f"shared, niceness {os.nice(0)}"
