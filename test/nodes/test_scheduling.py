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
