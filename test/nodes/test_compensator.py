# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The compensator with one sender of the tool's samples."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from itertools import cycle

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from haptic_accel.core import topics
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.supervised_node import quality
from running import PATIENCE

HOUR = 3600 * 10**9

PERIOD = 1_000_000
"""Period of the default rate, ns."""

WARNING = "warning"
"""Key of the warning among reported values."""


class Bench:
    """A compensator, and another node that sends it the tool's acceleration.

    Attributes
    ----------
    tool, felt : iterator of Vector
        Accelerations of tool and handle to send, m/s^2.
    """

    def __init__(self) -> None:
        self.node = Compensator()
        self._other = GraphNode("coupler")
        self._other.task = "samples"
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._other)
        self._tool = self._other.sender(topics.TOOL_ACCELERATION)
        self._handle = self._other.sender(topics.HANDLE_ACCELERATION)
        self.position = self._other.sender(topics.MASTER_POSITION)
        self.tool: Iterator[Vector] = cycle([(0.0, 0.0, 1.0)])
        self.felt: Iterator[Vector] = iter(())
        self.state = self._other.publisher(topics.MASTER_STOPPED)
        self._due = 0.0
        self.caused: list[int] = []
        self.forces: list[Vector] = []
        self.desired: list[Vector] = []
        self._other.listen(topics.ACTUATOR_FORCE, self._keep)
        listen, topic = self._other.listen, topics.DESIRED_ACCELERATION
        listen(topic, lambda _, vector: self.desired.append(vector))

    def send(self, ahead: int) -> None:
        """Send a sample with a stamp ahead of now, in ns."""
        stamp = time.time_ns() + ahead
        if felt := next(self.felt, None):
            self._handle.send(stamp - PERIOD, felt)
        self._tool.send(stamp, next(self.tool))

    def run(self, ahead: int, reached: Callable[[], bool]) -> None:
        """Send samples with stamps ahead of now, in ns, until something is reached.

        There is one in a period at most: of two that are closer, the node refuses the second, and
        so perhaps the same one of each cycle.
        """
        deadline = time.monotonic() + PATIENCE
        while not reached():
            assert time.monotonic() < deadline, self.node.diagnostics()
            if time.monotonic() >= self._due:
                self.send(ahead)
                self._due = time.monotonic() + PERIOD / NANOSECONDS
            self.node.work()
            self.node.follow_stop()
            self._executor.spin_once(timeout_sec=0.001)

    def reported(self, wanted: Callable[[dict[str, str]], bool]) -> None:
        """Send samples until warning and values of its diagnostics are as wanted."""
        found: dict[str, str] = {}

        def take(array: DiagnosticArray) -> None:
            for status in array.status:
                if topics.reporter(status.name)[1] == "compensator":
                    found[WARNING] = status.message
                    found.update((pair.key, pair.value) for pair in status.values)

        def reached() -> bool:
            self.node.report()
            return bool(found) and wanted(found)

        subscription = self._other.create_subscription(
            DiagnosticArray, topics.DIAGNOSTICS.name, take, quality(topics.DIAGNOSTICS)
        )
        self.run(0, reached)
        self._other.destroy_subscription(subscription)

    def _keep(self, stamp: int, force: Vector) -> None:
        self.caused.append(stamp)
        self.forces.append(force)

    def close(self) -> None:
        """End both nodes."""
        self._executor.shutdown()
        for node in (self.node, self._other):
            node.destroy_node()


@pytest.fixture
def bench(domain: int, request: pytest.FixtureRequest) -> Iterator[Bench]:
    """Give a compensator with the axes of the request, by default one, and its sender."""
    rclpy.init(args=["--ros-args", "-p", f"axes:={getattr(request, 'param', 'z')}"])
    bench = Bench()
    if request.function is not test_no_force_is_sent_before_the_state_of_the_device_is_known:
        bench.state.publish(Bool(data=False))
    yield bench
    bench.close()
    rclpy.shutdown()


def test_no_force_is_sent_before_the_state_of_the_device_is_known(bench: Bench) -> None:
    # The arms engage from the first force on; one that is withheld would differ from lockstep.
    bench.run(0, lambda: bench.node.part.samples > 20)
    assert not bench.caused
    bench.state.publish(Bool(data=False))
    bench.run(0, lambda: len(bench.caused) > 20)


def test_a_granted_delay_in_samples_is_a_time_at_the_rate(
    domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ("rate:=2000.0", "adaptive.granted_delay:=3")
    rclpy.init(args=["--ros-args", *(part for word in words for part in ("-p", word))])
    node = Compensator()
    assert node.get_parameter("adaptive.granted_time").value == 0.0015
    assert not node.has_parameter("adaptive.granted_delay")
    node.destroy_node()
    rclpy.shutdown()
    line = "adaptive.granted_delay = 3 samples is adaptive.granted_time = 0.0015 s at 2000 Hz"
    assert capfd.readouterr().err.count(line) == 1


def test_samples_stamped_an_hour_off_are_refused_and_the_compensator_goes_on(bench: Bench) -> None:
    bench.run(0, lambda: len(bench.caused) > 20)
    for off in (HOUR, -HOUR):
        bench.send(off)
    so_far = len(bench.caused)
    bench.run(0, lambda: len(bench.caused) > so_far + 20)
    assert all(abs(stamp - time.time_ns()) < HOUR / 2 for stamp in bench.caused)
    # On a busy machine others may come too late as well.
    bench.reported(lambda values: int(values["samples out of date"]) >= 2)


def test_a_clock_that_is_set_back_is_logged_once_and_the_compensator_goes_on(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.run(80_000_000, lambda: len(bench.caused) > 20)
    newest = time.time_ns() + 80_000_000
    bench.run(0, lambda: bench.caused[-1] > newest)
    assert capfd.readouterr().err.count("a clock was set by -0.") == 1


@pytest.mark.parametrize("bench", ["'x, y, z'"], indirect=True)
def test_a_turned_handle_has_the_tools_vibration_in_its_own_axes(bench: Bench) -> None:
    def turned() -> bool:
        # A quarter turn about z: the base's x is the handle's -y, and its y the handle's x.
        x, y, z = bench.desired[-1]
        return (y, z) == pytest.approx((-2 * x, 3 * x), abs=0.1)

    bench.tool = cycle([(2.0, 1.0, 3.0), (-2.0, -1.0, -3.0)])
    bench.run(0, lambda: len(bench.desired) > 20)
    x, y, z = bench.desired[-1]
    assert (y, z) == pytest.approx((x / 2, 3 * x / 2))
    upright = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    bench.position.send(time.time_ns(), ZERO, upright)
    # The filters remember the other direction for a while.
    bench.run(0, turned)
    bench.position.send(time.time_ns(), ZERO, (0.0, 0.0, 0.0, 0.0))
    bench.reported(lambda values: "not a unit quaternion" in values[WARNING])
    so_far = len(bench.desired)
    bench.run(0, lambda: len(bench.desired) > so_far + 100)
    bench.run(0, turned)  # the last valid orientation is kept


AXES = [("z", 2), *(("'x, y, z'", axis) for axis in range(3))]


@pytest.mark.parametrize("spoilt", ["tool", "handle"])
@pytest.mark.parametrize(("bench", "axis"), AXES, indirect=["bench"])
def test_nothing_is_felt_of_a_sample_with_an_axis_that_is_no_number(
    bench: Bench, axis: int, spoilt: str, capfd: pytest.CaptureFixture[str]
) -> None:
    vibration = [(1.0, 1.0, 1.0), (-1.0, -1.0, -1.0)]
    x, y, z = (math.nan if each == axis else 1000.0 for each in range(3))
    bench.tool, bench.felt = cycle(vibration), cycle(vibration)
    setattr(bench, "tool" if spoilt == "tool" else "felt", cycle([*vibration, (x, y, z)]))
    bench.run(0, lambda: len(bench.forces) > 100 and any(bench.forces[-1]))
    name = "rejected" if spoilt == "tool" else "handle not trusted"
    bench.reported(lambda values: int(values[name]) > 20)
    bench.reported(lambda values: 0.0 < float(values.get("slow work max (us)", "0")) < 1e6)
    assert max(abs(each) for vector in bench.desired for each in vector) < 10.0
    assert max(abs(each) for vector in bench.forces for each in vector) < 10.0
    assert len(capfd.readouterr().err.splitlines()) <= 1


@pytest.mark.parametrize("bench", ["'x, y, z'"], indirect=True)
def test_the_reduction_changes_while_the_node_runs(bench: Bench) -> None:
    bench.tool = cycle([(2.0, 1.0, 3.0), (-2.0, -1.0, -3.0)])
    bench.run(0, lambda: len(bench.forces) > 20 and all(bench.forces[-1]))
    reduced = bench.node.set_parameters([Parameter("reduction", value="sum")])
    assert [each.successful for each in reduced] == [True]
    bench.run(0, lambda: bench.forces[-1][:2] == (0.0, 0.0) != bench.forces[-1][1:])
    assert all(bench.desired[-1])
    bench.node.set_parameters([Parameter("reduction", value="none")])
    bench.run(0, lambda: all(bench.forces[-1]))


@pytest.mark.parametrize("bench", ["z"], indirect=True)
def test_a_tool_that_measures_one_axis_is_not_reduced(bench: Bench) -> None:
    def answer(reduction: str) -> tuple[bool, str]:
        (result,) = bench.node.set_parameters([Parameter("reduction", value=reduction)])
        return result.successful, result.reason

    bench.run(0, lambda: len(bench.forces) > 20)
    for reduction in ("sum", "principal"):
        accepted, reason = answer(reduction)
        assert not accepted
        assert reason.startswith(f"reduction = '{reduction}': must be none or axis, as the tool")
    assert answer("axis")[0]
    assert bench.node.get_parameter("reduction").value == "axis"
    bench.tool = cycle([(1.0, 2.0, 3.0), (-1.0, -2.0, -3.0)])
    count = len(bench.forces)
    bench.run(0, lambda: len(bench.forces) > count + 20)
    assert answer("sum")[0]


@pytest.mark.parametrize("bench", ["z", "'x, y, z'"], indirect=True)
def test_the_gain_changes_while_it_runs(bench: Bench) -> None:
    bench.tool = cycle([(1.0, 1.0, 1.0), (-1.0, -1.0, -1.0)])
    bench.run(0, lambda: bool(bench.desired) and any(bench.desired[-1]))
    for gain in (0.0, 0.5):
        (result,) = bench.node.set_parameters([Parameter("gain", value=gain)])
        assert result.successful
        bench.run(0, lambda felt=gain > 0: bool(bench.desired) and any(bench.desired[-1]) == felt)
    (refused,) = bench.node.set_parameters([Parameter("gain", value=5.0)])
    assert not refused.successful
