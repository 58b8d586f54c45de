# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node run as a program."""

from __future__ import annotations

import math
import os
import select
from itertools import pairwise

import pytest

from haptic_accel.nodes.scheduling import STOP_PERIOD, StopPoll
from running import PATIENCE, Start

pytestmark = pytest.mark.quiet

ALWAYS_BEHIND = """
import time
from haptic_accel.nodes.timing import LONGEST_RUN
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.supervised_node import SupervisedNode

class Behind(SupervisedNode):
    polls = True

    def __init__(self):
        super().__init__("behind")

    def work(self):
        if time.process_time() > 2 * LONGEST_RUN * 1e-6:
            self.finish("done")
        return 0.0

run_nodes("behind", Behind)
"""


def test_a_node_that_is_always_behind_is_not_ended_as_one_that_hangs(
    start: Start,
) -> None:
    command = start("-c", ALWAYS_BEHIND)
    assert command.end() == 0, command.text


ORPHAN = """
import ctypes, os, subprocess, sys
from haptic_accel.core.process import SUPERVISOR
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.supervised_node import SupervisedNode

class Hanging(SupervisedNode):
    def work(self):
        print("hangs", os.getpid(), flush=True)
        lock, take = ctypes.create_string_buffer(64), ctypes.PyDLL(None).pthread_mutex_lock
        take(lock), take(lock)  # for ever, with Python's own lock

if SUPERVISOR in os.environ:
    run_nodes("hanging", lambda: Hanging("hanging"))
os.environ[SUPERVISOR] = str(os.getpid())
subprocess.run([sys.executable, *sys.orig_argv[1:]])
"""


def test_a_node_that_hangs_does_not_outlive_its_supervisor(start: Start) -> None:
    command = start("-c", ORPHAN)
    node = os.pidfd_open(int(command.wait_for("hangs").split()[1]))
    command.process.kill()
    assert select.select([node], [], [], PATIENCE)[0] == [node]
    os.close(node)


PARTS = """
from functools import partial
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.supervised_node import SupervisedNode

class Part(SupervisedNode):
    def begin(self):
        self.finish()

    def take_forces_off(self):
        print("off", flush=True)

    def close(self):
        print("closed", flush=True)

run_nodes("parts", partial(Part, "one"), partial(Part, "two"))
"""


def test_all_forces_are_off_before_a_node_is_closed(start: Start) -> None:
    command = start("-c", PARTS)
    assert command.end() == 0, command.text
    assert command.lines == ["off", "off", "closed", "closed"]


WORK = 5e-5
"""Duration of the work, s."""


class Follower:
    """A worker on its clock, which keeps the times at which it polled for the stop."""

    def __init__(self, period: float, late: float = 0.0, *, follows_stop: bool = True) -> None:
        self.follows_stop = follows_stop
        self.now = 0.0
        self.next = 0.0
        self.worked: list[float] = []
        self.polled: list[float] = []
        self._period, self._late = period, late
        self._poll = StopPoll([self], lambda: self.now)

    def begin(self) -> None:
        pass

    def work(self) -> float:
        if self.now >= self.next + self._late:
            self.worked.append(self.now)
            self.next += self._period
            self.now += WORK
        return self.next

    def follow_stop(self) -> None:
        self.polled.append(self.now)

    def run(self, seconds: float) -> None:
        """Call each time as soon as was said, and never at a standstill."""
        while self.now < seconds:
            self.now = max(self.now + 1e-4, min(self._poll.after_work(self.work()), seconds))


@pytest.mark.parametrize("period", [1 / 8000, 1e-3, STOP_PERIOD, 1 / 50, math.inf])
@pytest.mark.parametrize("late", [0.0, 0.1])
def test_the_stop_is_polled_as_often_however_often_and_late_is_the_work(
    period: float, late: float
) -> None:
    follower = Follower(period, late)
    follower.run(1.0)
    gaps = [after - before for before, after in pairwise(follower.polled)]
    assert max(gaps) < STOP_PERIOD + 2e-4
    assert len(gaps) > 400


def test_polls_go_with_work_that_is_frequent_enough() -> None:
    follower = Follower(1e-3)
    follower.run(1.0)
    assert set(follower.polled) <= {moment + WORK for moment in follower.worked}
    assert len(follower.polled) == pytest.approx(500, abs=1)


def test_nobody_wakes_for_a_stop_that_nobody_follows() -> None:
    follower = Follower(0.1, follows_stop=False)
    follower.run(1.0)
    assert not follower.polled
    assert len(follower.worked) == pytest.approx(10, abs=1)
