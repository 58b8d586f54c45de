# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `compensator`: from the tool's acceleration to the force of the actuator."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

# Loaded now, so that it is there when other nodes see this one: designing a filter needs it.
import scipy.signal  # noqa: F401
from std_srvs.srv import Trigger

from haptic_accel.core import topics
from haptic_accel.core.control.bridging import Bridge
from haptic_accel.core.control.compensation import PLANT, Compensation
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import ZERO
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, along_actuator
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import CATCH_UP, FELT_PRIORITY, ArrivalKeeper, run

FROZEN = "adaptive.frozen"
"""Parameter that stops the adaptation."""

SENDING_TIME = 0.5
"""Time kept for the way of a force to its device, periods before it is due: so long the handle's
sample of the tick before is waited for."""

LONGEST_BRIDGE = 0.02
"""Longest gap in the tool's samples that is bridged by prediction, s; texture is not known any
longer ahead, and arms let go soon after."""


class Compensator(GraphNode):
    """Every tool acceleration causes one force, published before anything else.

    It is computed with the handle's acceleration of the tick before, which is waited for a little.
    """

    task = "compensation"

    polls = True

    def __init__(self) -> None:
        super().__init__("compensator", ("controller", FROZEN))
        p = self.parameters
        # All of them: designing one takes longer than a force may wait.
        self._compensation = Compensation(
            p, p.rate, self.options, tuple(CONTROLLERS), latency=p.latency
        )
        if doubt := self.options[PLANT].doubt:
            self.get_logger().warning(f"plant: {doubt}; then run identify again")
        self._period = NANOSECONDS / p.rate
        self._longest_wait = (max(1, p.latency) - SENDING_TIME) * self._period
        self._tool: deque[tuple[int, float, int]] = deque()
        self._handle: deque[tuple[int, float]] = deque(maxlen=round(CATCH_UP * p.rate))
        self._handles = self.samples(topics.HANDLE_ACCELERATION, p.rate)
        self._bridge = Bridge()
        self._samples = self._bridged = self._without = 0
        self._send_force = self.sender(topics.ACTUATOR_FORCE).send
        self._send_desired = self.sender(topics.DESIRED_ACCELERATION).send
        self._tools = self.samples(topics.TOOL_ACCELERATION, p.rate)
        self._arrivals = ArrivalKeeper(p.rate)
        self.create_service(Trigger, "~/reset", self._reset)

    def work(self) -> float:
        """Compute the samples that came."""
        came = False
        for moment, acceleration in self._tools.take():
            came = True
            lost = self._tools.succession.skipped
            self._tool.append((moment, acceleration[ACTUATOR_AXIS], lost))
        if self._tool:
            self._compute()
        return self._arrivals.looked(found=came and not self._tool)

    def close(self) -> None:
        """Leave the actuator without force."""
        self._send_force(time.time_ns(), ZERO)

    def start_anew(self) -> None:
        """Forget the samples that wait."""
        self._tool.clear()
        self._handle.clear()

    def change(self, values: dict[str, Any]) -> None:
        """Switch the controller, or stop or resume adaptation."""
        if FROZEN in values:
            self._compensation.freeze(values[FROZEN])
        if "controller" in values:
            self._compensation.select(values["controller"])

    def status(self) -> tuple[str, dict[str, str]]:
        """Return counts of lost, limited and refused samples, and the controller's values."""
        warning, values = self._compensation.status()
        tool = self._tools.succession
        return warning, {
            "samples": str(self._samples),
            "lost": str(tool.lost),
            "bridged": str(self._bridged),
            "without the handle's sample": str(self._without),
            "out of order": str(tool.stale),
            **values,
        }

    def _compute(self) -> None:
        """Compute the forces of all samples in order, as far as the handle's samples are there."""
        for moment, acceleration in self._handles.take():
            self._handle.append((moment, acceleration[ACTUATOR_AXIS]))
        while self._tool:
            moment, tool, lost = self._tool[0]
            found, before = self._before(moment)
            if not found and time.time_ns() - moment < self._longest_wait:
                return
            self._tool.popleft()
            self._fill(lost)
            self._compensate(moment, tool, before)

    def _compensate(self, moment: int, tool: float, before: float | None) -> None:
        self._without += before is None and self._samples > 0  # the first has none before it
        self._samples += 1
        self._bridge.put(tool)
        desired, force = self._compensation.sample(tool, before)
        self._send_force(moment, along_actuator(force))
        self._send_desired(moment, along_actuator(desired))
        self._compensation.adapt()

    def _before(self, moment: int) -> tuple[bool, float | None]:
        """Return whether the handle's acceleration of the tick before is known or lost, and it."""
        wanted = moment - self._period
        while self._handle and self._handle[0][0] < wanted - self._period / 2:
            self._handle.popleft()
        if not self._handle:
            return False, None
        received, acceleration = self._handle[0]
        return True, acceleration if received < wanted + self._period / 2 else None

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset all controllers: filters and grip estimates."""
        self._compensation.reset()
        response.success = True
        return response

    def _fill(self, lost: int) -> None:
        """Pass predictions of lost samples to the filters, which keep their place in time."""
        if 0 < lost <= LONGEST_BRIDGE * self.parameters.rate:
            self._bridged += lost
            for predicted in self._bridge.predict(lost):
                self._compensation.sample(predicted, None)


def main() -> None:
    """Run the node."""
    run("compensator", Compensator, priority=FELT_PRIORITY)


if __name__ == "__main__":
    main()
