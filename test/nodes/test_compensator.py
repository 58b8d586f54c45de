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

"""The compensator with one sender of the tool's samples."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

from haptic_accel.core.topics import ACTUATOR_FORCE, DIAGNOSTICS, TOOL_ACCELERATION, reporter
from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.topic_node import quality
from running import PATIENCE

HOUR = 3600 * 10**9


class Bench:
    """A compensator, and another node that sends it the tool's acceleration."""

    def __init__(self) -> None:
        self.node = Compensator()
        self._other = GraphNode("coupler")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._other)
        self._tool = self._other.sender(TOOL_ACCELERATION)
        self.caused: list[int] = []
        self._other.listen(ACTUATOR_FORCE, lambda stamp, _: self.caused.append(stamp))

    def send(self, ahead: int) -> None:
        """Send a sample with a stamp ahead of now, in ns."""
        self._tool.send(time.time_ns() + ahead, (0.0, 0.0, 1.0))

    def run(self, ahead: int, reached: Callable[[], bool]) -> None:
        """Send samples with stamps ahead of now, in ns, until something is reached."""
        deadline = time.monotonic() + PATIENCE
        while not reached():
            assert time.monotonic() < deadline
            self.send(ahead)
            self.node.work()
            self._executor.spin_once(timeout_sec=0.001)

    def reported(self) -> dict[str, str]:
        """Return the values of its next diagnostics."""
        found: dict[str, str] = {}

        def take(array: DiagnosticArray) -> None:
            for status in array.status:
                if reporter(status.name)[1] == "compensator":
                    found.update((pair.key, pair.value) for pair in status.values)

        self._other.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, take, quality(DIAGNOSTICS)
        )
        self.run(0, lambda: self.node.report() or bool(found))
        return found

    def close(self) -> None:
        """End both nodes."""
        self._executor.shutdown()
        for node in (self.node, self._other):
            node.destroy_node()


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    """Give a compensator and its sender."""
    rclpy.init()
    bench = Bench()
    yield bench
    bench.close()
    rclpy.shutdown()


def test_samples_stamped_an_hour_off_are_refused_and_the_compensator_goes_on(
    bench: Bench,
) -> None:
    bench.run(0, lambda: len(bench.caused) > 20)
    for off in (HOUR, -HOUR):
        bench.send(off)
    so_far = len(bench.caused)
    bench.run(0, lambda: len(bench.caused) > so_far + 20)
    assert all(abs(stamp - time.time_ns()) < HOUR / 2 for stamp in bench.caused)
    values = bench.reported()
    assert int(values["samples out of date"]) == 2


def test_a_clock_that_is_set_back_is_logged_once_and_the_compensator_goes_on(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.run(80_000_000, lambda: len(bench.caused) > 20)
    newest = time.time_ns() + 80_000_000
    bench.run(0, lambda: bench.caused[-1] > newest)
    assert capfd.readouterr().err.count("a clock was set by -0.0") == 1
