# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base of the two device nodes: samples a device, and applies each command when it is due."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from typing import Any

from rclpy.lifecycle import LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from std_srvs.srv import Trigger

from haptic_accel.core import topics
from haptic_accel.core.cdr import unpack_stamped_vector
from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import from_flat
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import ACTUATOR, ARM, STOPPED, ArmSample, DeviceSide, SafetyLayer
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.registry import MASTERS, SLAVES
from haptic_accel.devices.sound_bench import NoArm
from haptic_accel.nodes import crtk
from haptic_accel.nodes.emergency_stop import DeviceStop
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.timing import RateKeeper
from haptic_accel.setup.node_parameters import POSITION_SERVO, SAFETY, build_device

MANY_MISSED = 0.01
"""Fraction of missed deadlines between two reports above which diagnostics warn."""

MANY_LATE = 0.5
"""Fraction of late ticks between two reports above which the machine cannot hold the rate. Load at
the start of the nodes delays a smaller fraction."""

STALL = 0.02
"""Time without a tick above which diagnostics warn, s: 1/50 of the diagnostics' period."""

NEWS_PERIOD = 0.1
"""Interval between checks for events of the safety layer, s."""


def steady_now() -> float:
    """Return the steady time that devices use, s."""
    return time.monotonic_ns() / NANOSECONDS


class DeviceNode(crtk.Managed, GraphNode):
    """Node that samples a device on the sampling grid, publishes, and applies commands when due.

    At each tick the node takes a sample, applies the due forces, caused by the samples `latency`
    ticks before, and then publishes. Late forces are applied on arrival. Every command passes a
    safety layer. A configured node samples and publishes without forces, which shows any faults;
    forces are allowed only in the active state.

    Parameters
    ----------
    executable : str
        ``master_device`` or ``slave_device``.

    Attributes
    ----------
    arm : str
    side : DeviceSide
        Device in the loop.
    offset : int
        System time minus steady time at the last tick, ns.
    rate_keeper : RateKeeper
        Ticks of the loop.
    """

    task = "sampling"

    polls = True

    def __init__(self, executable: str) -> None:
        is_master = executable == "master_device"
        devices, arm = (MASTERS, topics.MASTER) if is_master else (SLAVES, topics.SLAVE)

        def changeable(own: Any) -> frozenset[str]:
            return devices[own.device].description.changeable_of(own.device)

        GraphNode.__init__(self, executable, changeable)
        self.begin_lifecycle()
        p = self.parameters
        self._executable = executable
        self._kind = devices[p.device]
        self._owner = self._kind.description.owners(p.device)[0]
        self.device = build_device(self._executable, self.parameters, self.options)
        self.safety = SafetyLayer(self.options[SAFETY], p.rate, self.device.axes)
        self.arm = arm.position.source
        self.offset = 0
        self._used = self._starting = self._settled = False
        self._failure: Exception | None = None
        self._dropped = 0
        self._reported_unread = self._reported_contested = self._reported_unlocated = 0
        self._reported_deadlines = 0, 0, 0, 0
        signals = arm.acceleration, arm.position, arm.velocity  # most urgent first
        self._acceleration, self._position, self._velocity = map(self.sender, signals)
        self._work_sender = self.sender(arm.work)
        self._work_subscribed = False
        self._contact_sender = self.sender(arm.contact_force) if arm.contact_force else None
        self._joint_states = crtk.JointStates(self, arm.position, p.rate)
        self._inboxes = {ARM: self.inbox(arm.arm_force)}
        if arm.actuator_force:
            self._inboxes[ACTUATOR] = self.inbox(arm.actuator_force)
        # Only the newest set-point is needed; older ones must not delay a tick.
        pointed = self._kind.description.pointed
        self._points = self.inbox(topics.HAND_SET_POINT, depth=1) if pointed else None
        self._queries = crtk.Queries(self, arm)
        servo, limits = self.options[POSITION_SERVO], self.options[SAFETY].arm
        self._motions = crtk.MotionCommands(self, arm, servo, limits)
        self.side = DeviceSide(
            self.device,
            self.safety,
            p.rate,
            p.latency,
            steady_now,
            kinds=tuple(self._inboxes),
            ahead=(ACTUATOR,) if self.device.description.ahead else (),
            framed=p.frame > 1,
            counted=[kind for kind in self._inboxes if self._kind is not NoArm or kind != ARM],
            servo=self._motions.servo,
            receive=self._receive,
        )
        self.side.sampling = False
        self.rate_keeper = RateKeeper(p.rate)
        self._operating = crtk.OperatingState(self, arm, self.safety, self._fault, self._arm_again)
        self._stop = DeviceStop(self, arm.stopped, self._take_forces_off, self._released)
        self.create_service(Trigger, "~/arm", self._serve_arm)
        self.create_service(Trigger, "~/report", self._serve_report)
        self.create_timer(NEWS_PERIOD, self._log_news)
        if p.autostart:
            self._autostart()

    # Transitions of the managed node

    def on_configure(self, state: LifecycleState) -> Outcome:
        """Open the device and start sampling, without force."""
        self._failure = None
        try:
            self._renew()
            self.device.open()
            if self.device.remark:
                self.get_logger().info(self.device.remark)
            if self.device.hang_warning:
                self.get_logger().warning(self.device.hang_warning)
            self.side.start(self.device)
        except Exception as error:  # rclpy would not log it
            self._failure = error
            if not self._starting:  # at the start, the process prints this line as it ends
                self.get_logger().error(str(error))
            self._close_device()
            return Outcome.FAILURE
        return Outcome.SUCCESS

    def on_activate(self, state: LifecycleState) -> Outcome:
        """Allow forces once the state of the emergency stop is known."""
        self.safety.enable(steady_now(), self._settled)
        return Outcome.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> Outcome:
        """Remove all forces and refuse new ones."""
        self.safety.enable(steady_now(), False)
        try:
            self.side.take_off()
        except (DeviceError, OSError) as error:
            self.get_logger().error(f"{error}: device closed")
            return Outcome.ERROR
        return Outcome.ERROR if self._failure else Outcome.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> Outcome:
        """Close the device, which leaves it without force."""
        self._release()
        return Outcome.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> Outcome:
        """Close the device and end the node."""
        self._release()
        self.finish()
        return Outcome.SUCCESS

    on_error = on_cleanup

    def change(self, values: dict[str, Any]) -> None:
        """Change parameters of the running device."""
        before: Any = self.options[self._owner]
        after = from_flat(type(before), self._described | values, f"{self._owner}.")
        self.device.change(after)
        self.options[self._owner] = after

    def stop_forces(self) -> None:
        """Remove all forces and refuse commands until the emergency stop is released."""
        self._stop.stop()

    def take_forces_off(self) -> None:
        """Remove all forces before any device is closed, as closing another one may hang."""
        with suppress(DeviceError, OSError):
            if self.side.sampling:
                self.side.take_off()

    def close(self) -> None:
        """Leave the device without force."""
        self.device.close()

    def publish_final_diagnostics(self) -> None:
        """Log the missed deadlines, and publish the final diagnostics."""
        due, missed = self.side.deadlines
        if due:
            self.get_logger().info(
                f"{missed} of {due} forces missed their deadline;"
                f" the latest came {1e3 * self.side.longest:.1f} ms after it"
            )
        super().publish_final_diagnostics()

    def repeat_states(self) -> None:
        """Publish the states of device and arm."""
        self._operating.report(again=True)
        if self._settled:
            self._stop.report_state()

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return timing, ages of commands, and values of safety layer and device."""
        keeper = self.rate_keeper
        values = {
            "state": self.state,
            "rate (Hz)": f"{self.parameters.rate:g}",
            "ticks": str(keeper.ticks),
            "late ticks": str(keeper.late),
            "missed ticks": str(keeper.missed),
            "ticks without a sample": str(self.side.unread),
            "positions not finite": str(self.side.unlocated),
            "positions refused": str(self._motions.refused),
            "commands of several senders": str(self._contested),
            "interruptions": str(self.device.interruptions),
            **keeper.lateness.diagnostics("tick lateness"),
            **keeper.work.diagnostics("tick work"),
            **self.side.diagnostics(),
            **self.safety.diagnostics(self.device.problem),
        }
        counts = {name: str(count) for name, count in self.device.counters().items()}
        return self._warning(), {**values, **counts}

    def _warning(self) -> str:
        """Return current problems and those since the last report."""
        stall = self.rate_keeper.pop_longest_gap(self.arm)
        unread, contested = self.side.unread, self._contested
        new, self._reported_unread = unread - self._reported_unread, unread
        dropped, self._reported_contested = contested - self._reported_contested, contested
        warnings = [
            *self.safety.warnings(),
            self.device.problem,
            "no sample" if new else "",
            self._unlocated(),
            "commands of several senders" if dropped else "",
            self._missed_deadlines(),
            f"stalled for {stall * 1e3:.0f} ms" if stall >= STALL else "",
        ]
        return ", ".join(filter(None, warnings))

    def _unlocated(self) -> str:
        """Return a warning if the device has returned positions that are not finite."""
        before, self._reported_unlocated = self._reported_unlocated, self.side.unlocated
        if self.side.unlocated == before:
            return ""
        if not before:
            line = "position is not finite: the arm gets no force"
            self.get_logger().error(f"{self.parameters.device}: {line}")
        return "position is not finite"

    def _missed_deadlines(self) -> str:
        """Return a warning if too many ticks or forces came late since the last report."""
        keeper, rate = self.rate_keeper, self.parameters.rate
        counts = *self.side.deadlines, keeper.ticks + keeper.missed, keeper.late + keeper.missed
        before = self._reported_deadlines
        if counts[0] < before[0]:  # forces are counted from zero once the arms engage
            before = 0, 0, *before[2:]
        due, missed, ticks, late = (now - then for now, then in zip(counts, before, strict=True))
        self._reported_deadlines = counts
        behind = late > MANY_LATE * ticks and ticks >= rate / 2
        if not behind and (missed <= MANY_MISSED * due or due < rate / 2):
            return ""
        if behind:
            late_ones, better = f"{late / ticks:.0%} of the ticks", keeper.better()
        else:
            forces = [self.side.forces[kind] for kind in self.side.counted]
            age = max(each.age.quantile(1.0 - MANY_MISSED) for each in forces)
            better = keeper.better(age, self.side.latency)
            kinds = " and ".join(self.side.counted).replace("_", " ")
            late_ones = f"{missed} of {due} forces ({kinds})"
        line = (
            f"{rate:g} Hz is not held: {late_ones} are late;"
            f" a tick takes {1e6 * keeper.work.quantile(0.5):.0f} us of {1e6 / rate:.0f} us;"
            f" {better or 'no other rate'} would hold"
        )
        if not keeper.is_warned:
            keeper.is_warned = True
            self.get_logger().warning(f"{line}; run doctor")
        return line

    def _autostart(self) -> None:
        """Configure and activate; raise the error that prevents it."""
        self._starting = True
        if self.trigger_configure() != Outcome.SUCCESS:
            self.destroy_node()  # the caller never gets the node, so cannot destroy it
            assert self._failure
            raise self._failure
        self._starting = False
        self.trigger_activate()

    def _renew(self) -> None:
        """Replace a closed device by a new instance."""
        if self._used:
            self.device = build_device(self._executable, self.parameters, self.options)
        self._used = True

    def _release(self) -> None:
        """Stop sampling, and leave the device without force."""
        self.safety.enable(steady_now(), False)
        self.side.sampling = False
        self._close_device()

    def _close_device(self) -> None:
        try:
            self.device.close()
        except (DeviceError, OSError) as error:
            self.get_logger().error(f"{self.parameters.device} device: {error}")

    def fail(self, error: Exception) -> None:
        """Close a failed device: no forces or samples until it is configured again."""
        self.get_logger().error(
            f"{self.parameters.device}: {error}: device closed, no force; to open it again, start"
            " the graph again, or configure and activate this node"
        )
        self._failure = error
        if self.state == crtk.ACTIVE:
            self.trigger_deactivate()
        elif self.state != crtk.UNCONFIGURED:
            self.trigger_cleanup()
        self.report()

    # The tick

    @property
    def received(self) -> int:
        """Number of kinds of forces received as messages, not from this process's loop."""
        return sum([not inbox.fed for inbox in self._inboxes.values()])

    def publish(self, sample: ArmSample) -> None:
        """Publish a sample."""
        stamp = self.rate_keeper.time(sample.tick) + self.offset
        self._acceleration.send(stamp, sample.acceleration)
        self._position.send(stamp, sample.position, sample.orientation)
        self._velocity.send(stamp, sample.velocity)
        if self._work_subscribed:
            self._work_sender.send(stamp, sample.work)
        if self._contact_sender and self.side.wants_contact and sample.contact is not None:
            self._contact_sender.send(stamp, sample.contact)
        self._joint_states.add(stamp, sample.position)
        if self._queries.is_subscribed:
            arm = self.safety.arm_limit
            self._queries.publish(
                stamp,
                sample.sample,
                (arm.x, arm.y, arm.z),
                self._motions.servo.set_point,
                self.device.joints,
            )

    def end_with_device(self) -> None:
        """End the node if its device has ended."""
        if self.device.ended:
            self.finish(f"{self.parameters.device} device has ended")

    def _receive(self) -> None:
        """Process the commands of other processes."""
        forces = {kind: self._received(kind) for kind in self._inboxes}
        newest = self.side.newest
        if self._motions.expected and newest:
            goals = self._motions.positions.drain_sole(unpack_stamped_vector)
            if self._may_cross():
                self._dropped += len(goals) + len(forces[ARM])
                goals, forces[ARM] = [], []
                self._note_rivals(ARM)
            if self._motions.receive(newest.position, goals):
                self.side.free()
        if self._points:
            for _, position in self._points.drain_vectors():
                self.device.point(position)
        for kind, commands in forces.items():
            for stamp, force in commands:
                self.side.command(kind, (stamp or self._unstamped(kind)) - self.offset, *force)

    def _received(self, kind: str) -> list[tuple[int, Vector]]:
        """Return received forces of a kind with their stamps, system time in ns."""
        inbox = self._inboxes[kind]
        if inbox.fed:
            return []
        commands = inbox.drain_sole(unpack_stamped_vector)
        if not inbox.sole:
            self.side.forces[kind].clear()
        if inbox.changed:
            self._note_rivals(kind)
        return commands

    @property
    def _contested(self) -> int:
        """Number of commands dropped because several publishers may have sent them."""
        inboxes = *self._inboxes.values(), self._motions.positions
        return self._dropped + sum(each.contested for each in inboxes)

    def _may_cross(self) -> bool:
        """Return whether forces and positions of the arm may come from two nodes.

        `_note_rivals` compares permanent publishers by name.
        """
        pair = self._inboxes[ARM], self._motions.positions
        return any(each.changed for each in pair) and all(each.contenders for each in pair)

    def _note_rivals(self, kind: str) -> None:
        """Refuse commands, including waiting ones, while several publishers send them."""
        inboxes = [self._inboxes[kind], *([self._motions.positions] if kind == ARM else [])]
        rivals = self.rivals(*inboxes)
        self.safety.note_rivals(kind.replace("_", " "), rivals)
        if rivals:
            self.side.forces[kind].clear()

    def _unstamped(self, kind: str) -> int:
        """Return the present time as the stamp of an unstamped force, or no stamp to refuse it."""
        if kind == ARM and self.options[SAFETY].arm.zero_stamp:
            return self.rate_keeper.time(self.side.tick) + self.offset
        return 0

    def follow_stop(self) -> None:
        """Stop on any request; withdrawing the request does not release the stop."""
        self._stop.follow()
        if not self._settled and self._stop.settles():
            self._settled = True
            self.safety.enable(steady_now(), self.state == crtk.ACTIVE)
            self.report()

    def _take_forces_off(self) -> None:
        """Remove all forces and refuse commands until the release; respond in any case."""
        known = self.safety.stopped
        if self.state != crtk.UNCONFIGURED:
            try:
                self.side.take_off()
            except (DeviceError, OSError) as error:
                self.fail(error)
        self._stop.report_state()
        if not known:
            self.safety.stop(steady_now(), True)
            self.get_logger().warning(f"{STOPPED}: no force until it is released")
            self.report()

    def _released(self) -> None:
        """Allow commands again after the release of a stop."""
        if self.safety.stopped:
            self.safety.stop(steady_now(), False)
            self.get_logger().info(f"{STOPPED} released")
        self.report()

    def _serve_arm(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refused = self._arm_again()
        response.success, response.message = not refused, refused or "armed"
        self.report()
        return response

    def _serve_report(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Publish diagnostics now, and return those of the forces as JSON."""
        self.report()
        response.success, response.message = True, json.dumps(self.side.diagnostics())
        return response

    def _arm_again(self) -> str:
        """Allow forces again after a fault of commands or device; return the reason if refused."""
        refused = self.safety.refusal
        if not refused and self.device.arm() is False:
            refused = self.device.problem or "the device does not arm"
        return refused or self.safety.arm()

    def _fault(self) -> str:
        """Return the device's fault; empty for none."""
        return str(self._failure or (self.side.sampling and self.device.problem) or "")

    def _log_news(self) -> None:
        """Log new events of the safety layer; check for stops, command senders and subscribers."""
        polls = self._stop.poll_pending, self._motions.poll, self._queries.poll
        for poll in (*polls, self._operating.report):
            poll()
        self._work_subscribed = self._work_sender.listeners > 0
        self.side.wants_contact = bool(self._contact_sender and self._contact_sender.listeners)
        for kind in self._inboxes:
            self._note_rivals(kind)
        for line in self.safety.news(steady_now()):
            self.get_logger().warning(line)
            self.report()
