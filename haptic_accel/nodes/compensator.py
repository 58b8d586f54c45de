# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `compensator`: the actuator's force from the tool's acceleration."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

# Designing a filter needs this module; load it before other nodes discover this node.
import scipy.signal  # noqa: F401
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from haptic_accel.core import topics
from haptic_accel.core.axes import NO_REDUCTION, Orientation
from haptic_accel.core.cdr import unpack_orientation
from haptic_accel.core.control.compensation import PLANT, Compensation
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.control.fallback import NO_CONTROLLER
from haptic_accel.core.model import ZERO
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tick import ArmSample, CompensatedSample, CompensationPart
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.timing import CATCH_UP, COIL_PRIORITY, ArrivalKeeper

FROZEN = "adaptive.frozen"
"""Parameter that stops the adaptation."""

REDUCTION = "reduction"
"""Parameter that selects all axes, or a reduction to one axis."""

ONE_AXIS = (NO_REDUCTION, "axis")
"""Reductions that need only the component along the coil."""

GAIN = "gain"
"""Parameter that scales the desired acceleration."""


class Compensator(GraphNode):
    """Node that computes an actuator force from each sample of the tool, and publishes it at once.

    The controller briefly waits for the handle's acceleration of the previous tick.

    Attributes
    ----------
    part : CompensationPart
    knows_device : bool
        True once the device has told whether it applies forces.
    """

    task = "compensation"

    polls = follows_stop = True

    def __init__(self) -> None:
        super().__init__("compensator", lambda _: ("controller", REDUCTION, GAIN, FROZEN))
        p = self.parameters
        # Design all controllers now: a later design would delay a force.
        self._compensation = Compensation(
            p, p.rate, self.options, tuple(CONTROLLERS), latency=p.latency, clock=time.monotonic
        )
        if warning := self.options[PLANT].doubt:
            self.get_logger().warning(f"plant: {warning}; then run identify again")
        longest = round(CATCH_UP * p.rate)
        self.part = CompensationPart(self._compensation, p.rate, p.latency, longest)
        self._handles = self.samples(topics.HANDLE_ACCELERATION, p.rate)
        self._send_force = self.sender(topics.ACTUATOR_FORCE).send
        self._send_desired = self.sender(topics.DESIRED_ACCELERATION).send
        self._tools = self.samples(topics.TOOL_ACCELERATION, p.rate)
        # A vibration along a single axis needs no rotation to the handle's orientation.
        turns = len(self._compensation.axes.names) > 1
        self._poses = self.inbox(topics.MASTER_POSITION, depth=1) if turns else None
        self._orientation = Orientation()
        self._stops = self.inbox(topics.MASTER_STOPPED)
        self._failure = ""
        self._compensation.mute(True)  # until the device is known to apply forces
        self.knows_device = False
        self._arrivals = ArrivalKeeper(p.rate)
        self.create_service(Trigger, "~/reset", self._reset)

    def work(self) -> float:
        """Process the samples that arrived."""
        tools = [*self._tools.drain()]
        for stamp, acceleration in tools:
            self.part.put_tool(ArmSample(stamp, acceleration=acceleration))
        if self.part.waiting:
            for stamp, acceleration in self._handles.drain():
                self.part.put_handle(ArmSample(stamp, acceleration=acceleration))
            self.part.compute(float(time.time_ns()))
            self.publish(self.part.results, offset=0)
            self.part.results.clear()
        if tools:
            self._follow_orientation()
        return self._arrivals.polled(found=bool(tools) and not self.part.waiting)

    def publish(self, samples: Iterable[CompensatedSample], offset: int) -> None:
        """Publish forces; system time is their stamps plus an offset in ns.

        Before the device's state is known, publish none: the arms engage from the first force on.
        """
        for each in samples if self.knows_device else ():
            self._send_force(each.stamp + offset, each.actuator_force)
            self._send_desired(each.stamp + offset, each.desired_acceleration)

    def _follow_orientation(self) -> None:
        """Read the handle's orientation for the next samples; no force waits for it."""
        if self._poses:
            for orientation in self._poses.drain_sole(unpack_orientation):
                self._orientation.put(orientation)
                self.part.orientation = self._orientation.newest

    def follow_stop(self) -> None:
        """Compute no force while the device refuses it; log once that `none` took over."""
        for stopped in self.states(self._stops):
            self._compensation.mute(stopped)
            self.knows_device = True
        if (failure := self._compensation.failure) != self._failure:
            self._failure = failure
            if failure:
                self.get_logger().error(failure)
                self.set_parameters([Parameter("controller", value=NO_CONTROLLER)])

    def close(self) -> None:
        """Leave the actuator without force."""
        self._send_force(time.time_ns(), ZERO)

    def start_again(self) -> None:
        """Discard the waiting samples."""
        self.part.clear()

    def change(self, values: dict[str, Any]) -> None:
        """Switch controller or reduction, change the gain, or stop or resume adaptation."""
        part, reduction = self.part, values.get(REDUCTION, NO_REDUCTION)
        if reduction not in ONE_AXIS and part.samples and not part.measured_across:
            raise ParameterError(
                f"reduction = {reduction!r}: must be {' or '.join(ONE_AXIS)}, as the tool measures"
                " its acceleration along z alone; start the graph with a reduction to change it"
            )
        core = self._compensation
        changes: dict[str, Callable[[Any], None]] = {FROZEN: core.freeze, GAIN: core.set_gain}
        changes |= {REDUCTION: core.select_reduction, "controller": core.select}
        for name, change in changes.items():
            if name in values:
                change(values[name])

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return counts of lost, limited and refused samples, and the controller's values."""
        warning, values = self._compensation.diagnostics()
        return ", ".join(filter(None, (warning, self._orientation.problem))), {
            "samples": str(self.part.samples),
            "lost": str(self.part.lost),
            "bridged": str(self.part.bridged),
            "without the handle's sample": str(self.part.without),
            "out of order": str(self._tools.sequence.stale),
            **self._compensation.slow_work.diagnostics("slow work"),
            **values,
        }

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset all controllers: filters and grip estimates."""
        self._compensation.reset()
        response.success = True
        return response


def main() -> None:
    """Run the node."""
    run_nodes("compensator", Compensator, priority=COIL_PRIORITY)


if __name__ == "__main__":
    main()
