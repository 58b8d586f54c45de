# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `identifier`: excites the handle, so that a model can be fitted to its recording."""

from __future__ import annotations

import math
import time
from collections import deque

from haptic_accel.core import topics
from haptic_accel.core.axes import Axes
from haptic_accel.core.identification.sweep import repeats_of_trial, trial_forces
from haptic_accel.core.model import ACTUATOR, ZERO, Vector
from haptic_accel.core.process import REPEAT, TOO_STRONG, notify_supervisor
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import STOPPED, TravelEstimator
from haptic_accel.devices.interface import DeviceError
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.timing import ArrivalKeeper

CHECK_PERIOD = 0.1
"""Interval between checks for silence and missing subscribers, s."""

START_TIMEOUT = 30.0
"""Time allowed for the device and the recorder to start, and for the release of a stop, s."""

TRAVEL_SHARE = 0.95
"""Fraction of the free travel at which a trial is ended."""

FAREWELLS, FAREWELL_PAUSE = 3, 0.01
"""Number of zero forces sent at the end, and pause after each, s; best effort may lose one."""


class Identifier(GraphNode):
    """Node that answers each sample of the handle with the next force of the sweep.

    The sample's stamp determines the force, so that a lost sample does not shift the sweep. The
    force is removed and the run fails if the actuator's estimated travel comes near the stops, the
    handle sends no acceleration, a clock is set, or an emergency stop is requested.
    """

    task = "identification"

    polls = follows_stop = True

    def __init__(self) -> None:
        super().__init__("identifier")
        p = self.parameters
        self._axes = Axes.parsed(p.axes)
        forces = trial_forces(self._axes, p, p.rate).tolist()
        self._force = [self._axes.vector(each) for each in forces]
        self._repeats = repeats_of_trial(self._axes, p)
        self._repeat = len(self._force) // self._repeats
        self._rest = round(p.rest * p.rate)
        self._period = NANOSECONDS / p.rate
        actuator = self.options[ACTUATOR]
        self._travels = [TravelEstimator(actuator, p.rate) for _ in self._axes.names]
        self._most_travel = TRAVEL_SHARE * actuator.travel
        self._pending = deque([ZERO], maxlen=p.latency + 1)
        self._origin: int | None = None
        self._done, self._widest = -1, 0.0  # logged number of repeats, and largest travel, m
        self._started = self._received = time.monotonic()
        self._failure = ""
        self._allowed = False
        self._arrivals = ArrivalKeeper(p.rate)
        self._sender = self.sender(topics.ACTUATOR_FORCE)
        self._samples = self.samples(topics.HANDLE_ACCELERATION, p.rate)
        self._stops = self.inbox(topics.MASTER_STOPPED)
        self.create_timer(CHECK_PERIOD, self._check_progress)

    def work(self) -> float:
        """Answer the received samples."""
        came = False
        for moment, acceleration in self._samples.drain():
            came = True
            self._excite(moment, acceleration)
        return self._arrivals.polled(found=came)

    def start_again(self) -> None:
        """End the sweep, as its time is unknown after a change of the clock."""
        if self._origin is not None:
            self._fail("handle_acceleration: a clock was set, force taken off")

    def close(self) -> None:
        """Leave the actuator without force, and raise the run's failure, if any."""
        for _ in range(FAREWELLS):
            self._sender.send(time.time_ns(), ZERO)
            time.sleep(FAREWELL_PAUSE)
        if self._failure:
            self.report()
            raise DeviceError(self._failure)

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return the progress, and the largest travel of the actuator."""
        return self._failure, {
            "repeats done": str(max(0, self._done)),
            "largest travel (mm)": f"{1e3 * self._widest:.3f}",
        }

    def _excite(self, moment: int, acceleration: Vector) -> None:
        if self.finished.done():
            return
        self._received = time.monotonic()
        measured = self._axes.components(acceleration)
        if not all(map(math.isfinite, measured)):
            self._fail("handle_acceleration: not a finite number, force taken off")
            return
        # Until now, the actuator applied the force computed latency + 1 samples earlier.
        acting = self._axes.components(self._pending[0])
        parts = zip(self._travels, acting, measured, strict=True)
        travel = max([abs(each.observe(*pair)) for each, *pair in parts])
        self._widest = max(self._widest, travel)
        if travel > self._most_travel:
            reason = (
                f"travel: {1e3 * travel:.2f} mm, must be at most"
                f" {1e3 * self._most_travel:.2f} mm; use a smaller amplitude"
            )
            notify_supervisor(TOO_STRONG, reason=reason)
            self._fail(reason)
            return
        force = self._next_force(moment)
        self._pending.append(force)
        if not self.finished.done():
            self._sender.send(moment, force)

    def _next_force(self, moment: int) -> Vector:
        """Return the force for a sample with the stamp `moment`, ns."""
        if self._origin is None:
            if self._missing():
                return ZERO
            self._origin = moment
        sample = round((moment - self._origin) / self._period)
        trial, within = divmod(sample, self._rest + len(self._force))
        p = self.parameters
        if trial >= p.trials:
            self._log_progress(p.trials * self._repeats)
            # The recording includes the time in which the handle comes to rest.
            if within >= self._rest:
                self.finish()
            return ZERO
        index = within - self._rest
        if index < 0:
            return ZERO
        self._log_progress(trial * self._repeats + index // self._repeat)
        force: Vector = self._force[index]
        return force

    def _log_progress(self, done: int) -> None:
        """Log the number of repeats done, once each."""
        if done == self._done:
            return
        self._done = done
        p = self.parameters
        trial, repeat = divmod(done, self._repeats)
        line = f"trial {trial + 1} of {p.trials}, repeat {repeat + 1} of {self._repeats}"
        notify_supervisor(REPEAT, done=done)
        if trial == p.trials:
            line = f"done, largest travel {1e3 * self._widest:.2f} mm"
        self.get_logger().info(line)

    def _missing(self) -> str:
        """Return the condition that the sweep waits for; empty if there is none."""
        if not self._allowed:
            return f"waiting for {topics.MASTER_STOPPED.name}: false"
        there, expected = self._sender.listeners, self.parameters.listeners
        subscribers = f"subscribers of the actuator's force: {there} of {expected}"
        return f"waiting for {subscribers}" if there < expected else ""

    def follow_stop(self) -> None:
        """Wait for a device that is not stopped; end at an emergency stop."""
        for stopped in self.states(self._stops):
            self._allowed = not stopped
            if stopped and self._origin is not None:
                self._fail(f"{STOPPED}: force taken off")

    def _check_progress(self) -> None:
        """End the run if there is no subscriber, or no acceleration of the handle."""
        now = time.monotonic()
        if self._origin is None:
            if now - self._started > START_TIMEOUT:
                missing = self._missing() or f"waiting for {topics.HANDLE_ACCELERATION.name}"
                self._fail(f"{missing} after {START_TIMEOUT:g} s")
        elif now - self._received > self.parameters.timeout:
            self._fail(f"handle_acceleration: silent for {now - self._received:.2g} s")

    def _fail(self, failure: str) -> None:
        """Remove the force and end the run."""
        if not self.finished.done():
            self._sender.send(time.time_ns(), ZERO)
            self._failure = failure
            self.finish()


def main() -> None:
    """Run the node."""
    run_nodes("identifier", Identifier)


if __name__ == "__main__":
    main()
