# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `coupler`, and the base class of the nodes that couple arms."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

from std_srvs.srv import SetBool

from haptic_accel.core import tick, topics
from haptic_accel.core.coupling import passive
from haptic_accel.core.coupling.engagement import Engagement
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.process import ENGAGED, OVER, notify_supervisor
from haptic_accel.core.tick import ArmSample, CoupledForces
from haptic_accel.core.topics import ARMS
from haptic_accel.nodes.emergency_stop import CouplerStop
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.signals import Inbox, Samples
from haptic_accel.nodes.timing import CATCH_UP, ArrivalKeeper
from haptic_accel.setup.node_parameters import PASSIVE

ARM_TOPICS = {tick.MASTER: topics.MASTER, tick.SLAVE: topics.SLAVE}


class SynchronizedSignal:
    """Signal of an arm, synchronized with the positions of the same samples.

    Parameters
    ----------
    samples : Samples
    flowing : bool
        True if the signal arrives; positions then wait for its samples.

    Attributes
    ----------
    value : tuple of float
        Sample of the last stamp for which `at` was true.
    """

    def __init__(self, samples: Samples, *, flowing: bool) -> None:
        self._samples = samples
        self.flowing = flowing
        self._waiting: deque[tuple[int, Vector]] = deque()
        self._stamp = 0
        self.value = ZERO

    def receive(self) -> None:
        """Store the samples received."""
        for sample in self._samples.drain():
            self._waiting.append(sample)
            self.flowing = True

    def at(self, stamp: int) -> bool:
        """Advance to a stamp; return True if its sample is available, lost, or not expected."""
        while self._waiting and self._waiting[0][0] <= stamp:
            self._stamp, self.value = self._waiting.popleft()
        # A later sample shows a loss; the previous sample replaces the lost one.
        return self._stamp == stamp or bool(self._waiting) or not self.flowing

    def clear(self) -> None:
        """Discard waiting samples."""
        self._waiting.clear()


class MotionSynchronizer:
    """Positions of an arm, each joined with other signals of the same sample.

    Parameters
    ----------
    positions : Samples
    velocities : Samples or None
        None if velocities are not needed; they are then zero.
    work : Samples or None
        Work of the arm's force, if needed.

    Attributes
    ----------
    arriving : Samples
        Positions.
    velocity, work : SynchronizedSignal or None
    """

    def __init__(
        self, positions: Samples, velocities: Samples | None, work: Samples | None = None
    ) -> None:
        self.arriving = positions
        self._positions: deque[tuple[int, Vector]] = deque()
        self.velocity = SynchronizedSignal(velocities, flowing=True) if velocities else None
        self.work = SynchronizedSignal(work, flowing=False) if work else None

    def join(self, velocities: Samples) -> None:
        """Join velocities once they arrive."""
        self.velocity = SynchronizedSignal(velocities, flowing=False)

    def drain(self) -> Iterator[ArmSample]:
        """Yield the complete samples."""
        for sample in self.arriving.drain():
            self._positions.append(sample)
        if not self._positions:
            return
        joined = [each for each in (self.velocity, self.work) if each]
        for each in joined:
            each.receive()
        while self._positions:
            stamp, position = self._positions[0]
            if not all([each.at(stamp) for each in joined]):
                return
            self._positions.popleft()
            velocity = self.velocity.value if self.velocity else ZERO
            work = sum(self.work.value) if self.work and self.work.flowing else None
            yield ArmSample(stamp, position, velocity, work)

    @property
    def waiting(self) -> bool:
        """True while a position waits for the signals joined with it."""
        return bool(self._positions)

    def clear(self) -> None:
        """Discard waiting samples."""
        self._positions.clear()
        for each in (self.velocity, self.work):
            if each:
                each.clear()


class CouplingNode(GraphNode):
    """Node that couples arms while an `Engagement` allows it.

    Services release the arms and engage them again: `estop` also stops the devices, `~/engage`
    does not.

    Parameters
    ----------
    changeable : collection of str
        As for `GraphNode`.

    Attributes
    ----------
    part : ArmCoupling
        Set by a subclass.
    sides : mapping of str to DeviceSide
        Devices in this process; empty if there are none. With devices, a loop passes samples and
        forces through `part`, and calls `receive`, `step`, `reply` and `publish`.
    """

    part: tick.ArmCoupling

    task = "coupling"

    polls = follows_stop = True

    def __init__(self, changeable: Collection[str] = ()) -> None:
        super().__init__("coupler", lambda _: changeable)
        self.engagement = self.build_engagement(time.monotonic())
        self.forces = {arm: self.sender(ARM_TOPICS[arm].arm_force) for arm in self.engagement.arms}
        self.sides: Mapping[str, tick.DeviceSide] = {}
        self._arrivals = ArrivalKeeper(self.parameters.rate)
        self._aside = False
        # Subscribed until the first message only: each message slows the compensator.
        self._first_force: Inbox | None = None
        if self.parameters.compensated:
            self._first_force = self.inbox(topics.ACTUATOR_FORCE)
        self._stop = CouplerStop(self, self.engagement)
        self.create_service(SetBool, "~/engage", self._on_engage)

    @abstractmethod
    def build_engagement(self, now: float) -> Engagement:
        """Return the engagement of the arms, from a time in s on."""

    @abstractmethod
    def couple(self) -> bool:
        """Send forces of all complete samples; return True if no sample waits."""

    def receive(self, offset: int) -> None:
        """Receive the peer's packets before a tick; do nothing without a peer.

        Parameters
        ----------
        offset : int
            System time minus the time of the loop's stamps, ns.
        """

    def reply(self) -> None:
        """Send the results of a tick to the peer; do nothing without a peer."""

    @abstractmethod
    def publish(self, tools: list[ArmSample], commands: list[CoupledForces], offset: int) -> None:
        """Publish the results of this process's loop; `offset` as for `receive`."""

    def prepare(self) -> None:
        """Prepare for the next decision whether to engage."""

    def close(self) -> None:
        """Leave the arms without force."""
        self._let_go()

    def repeat_states(self) -> None:
        """Publish the state of the emergency stop."""
        self._stop.report_state()

    def work(self) -> float:
        """Engage or release, and process the samples that arrived."""
        if self.engagement.due(time.monotonic()):
            self.step()
        return self._arrivals.polled(found=self.couple())

    def stop_forces(self) -> None:
        """Stop all devices and release the arms."""
        self.engagement.stop.stop()
        self.follow_stop()

    def missing(self) -> str:
        """Return why the arms cannot engage or have failed; empty if there is no reason."""
        return self.engagement.missing(time.monotonic(), self.listeners)

    @property
    def listeners(self) -> int:
        """Number of subscribers to an arm's force, the smaller of both arms."""
        return 0 if self._aside else min(force.listeners for force in self.forces.values())

    def step(self) -> None:
        """Engage, release or end according to the state."""
        if not self.sides:
            self.couple()
        self._step_aside(self.engagement.aside(time.monotonic()))
        self.prepare()
        first = self._first_force
        if first and (self.engagement.compensated or first.drain_vectors()):
            self.engagement.compensated, self._first_force = True, None
            first.leave()
            return  # releasing the topics took time: engage at the next call
        decision = self.part.poll(time.monotonic(), self.listeners)
        if decision.release:
            self._let_go()
        if decision.warning:
            self.get_logger().warning(decision.warning)
        if decision.engage:
            where = " at the former reference positions" if decision.resume else ""
            self.get_logger().info(f"engaged{where}")
            notify_supervisor(ENGAGED)
        if decision.finished:
            notify_supervisor(OVER)
            self.finish(f"duration of {self.parameters.duration:g} s is over")

    def _let_go(self) -> None:
        tick.release(self.sides, time.monotonic())
        for force in () if self._aside else self.forces.values():
            force.send(time.time_ns(), ZERO)

    def _step_aside(self, aside: bool) -> None:
        """Pause or resume sending the arms' forces, for other senders."""
        if aside != self._aside:
            self._aside = aside
            for force in self.forces.values():
                force.withdraw() if aside else force.offer()

    def follow_stop(self) -> None:
        """React at once to any change of the emergency stop."""
        if self._stop.follow():
            self.step()
            self.report()

    def _on_engage(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Engage the arms as soon as possible, or release them."""
        refusal = self.engagement.request(request.data)
        if not refusal:
            self.step()
            self.report()
        response.success = not refusal
        response.message = refusal or self.missing()
        return response


class Coupler(CouplingNode):
    """Node that computes the forces on both arms from the samples of a tick."""

    def __init__(self) -> None:
        super().__init__((*schema(passive.CouplingParameters), *schema(passive.PassiveParameters)))
        p, rate = self.parameters, self.parameters.rate
        self._passive = passive.PassivePair(p, rate, p.latency) if p.coupling == PASSIVE else None
        self._coupling = self._passive or tick.PositionPositionCoupling(p)
        self._changed = False
        longest = round(CATCH_UP * rate)
        part = tick.CouplingPart(self._coupling, self.engagement, rate, longest)
        self.part: tick.CouplingPart = part
        self._motions = {
            arm: MotionSynchronizer(
                self.samples(signals.position, rate),
                self.samples(signals.velocity, rate) if self._damped else None,
                self.samples(signals.work, rate) if self._passive else None,
            )
            for arm, signals in ARM_TOPICS.items()
        }

    @property
    def _damped(self) -> bool:
        return bool(self._passive or self.parameters.damping > 0)

    def build_engagement(self, now: float) -> Engagement:
        """Return the engagement of both arms."""
        return Engagement(self.parameters, now)

    def start_again(self) -> None:
        """Discard the waiting samples."""
        self.part.pairing.clear()
        for motions in self._motions.values():
            motions.clear()

    def change(self, values: dict[str, Any]) -> None:
        """Change gains of the coupling as soon as the signals that they need are available."""
        gains = schema(passive.PassiveParameters if self._passive else passive.CouplingParameters)
        for name in values.keys() - gains:
            raise ParameterError(f"{name}: the coupling is {self.parameters.coupling}")
        self.parameters = replace(self.parameters, **values)
        self._changed = True
        if self.parameters.damping > 0:
            for arm, motions in self._motions.items():
                if not motions.velocity:
                    motions.join(self.samples(ARM_TOPICS[arm].velocity, self.parameters.rate))

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return whether the arms are coupled, and the energy in the tanks."""
        values = {
            "engaged": str(self.part.engaged).lower(),
            "positions held": str(self.part.pairing.held),
            "positions refused": str(self.engagement.refused),
        }
        for arm, side in zip(ARMS, self._passive.sides, strict=True) if self._passive else ():
            values |= {
                f"{arm} energy (mJ)": f"{side.energy * 1e3:.3f}",
                f"{arm} limited (%)": f"{side.limited * 100:.1f}",
            }
        return self.missing(), values

    def couple(self) -> bool:
        """Send the forces of every complete tick; return True if no tick is incomplete."""
        came = False
        for index, (arm, motions) in enumerate(self._motions.items()):
            for sample in motions.drain():
                came = True
                sample.arm = index
                self.part.put(sample, time.monotonic())
            if refusal := motions.arriving.sequence.refusal:
                self.engagement.watches[arm].refusal = f": {arm}: {refusal}"
        self.part.couple()
        self.publish([], self.part.forces, offset=0)
        self.part.forces.clear()
        return came and not self.part.pairing.waiting

    def publish(self, tools: list[ArmSample], commands: list[CoupledForces], offset: int) -> None:
        """Publish forces; the slave device publishes the tool's samples."""
        on_master, on_slave = self.forces.values()
        for command in commands:
            on_master.send(command.m_stamp + offset, (command.m_x, command.m_y, command.m_z))
            on_slave.send(command.s_stamp + offset, (command.s_x, command.s_y, command.s_z))

    def prepare(self) -> None:
        """Begin the transition to new gains; a damper waits for velocities."""
        velocities = [motions.velocity for motions in self._motions.values()]
        flowing = self.sides or all(each and each.flowing for each in velocities)
        if self._changed and (flowing or not self._damped):
            self._changed = False
            self._coupling.change(self.parameters, round(passive.FADE_TIME * self.parameters.rate))


def main() -> None:
    """Run the node."""
    run_nodes("coupler", Coupler)


if __name__ == "__main__":
    main()
