# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node run as a program."""

from __future__ import annotations

from collections.abc import Callable

from running import Command

ALWAYS_BEHIND = """
import time
from haptic_accel.nodes.scheduling import LONGEST_RUN, SupervisedNode, run

class Behind(SupervisedNode):
    polls = True

    def __init__(self):
        super().__init__("behind")

    def work(self):
        if time.process_time() > 2 * LONGEST_RUN * 1e-6:
            self.finish("done")
        return 0.0

run("behind", Behind)
"""


def test_a_node_that_is_always_behind_is_not_ended_as_one_that_hangs(
    start: Callable[..., Command],
) -> None:
    command = start("-c", ALWAYS_BEHIND)
    assert command.end() == 0, command.text
