# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Base of the two device nodes: samples a device, and applies each command when it is due."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.lifecycle import LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from haptic_accel.core import topics
from haptic_accel.core.actuator.safety import MAX_AGE, STOPPED, SafetyLayer
from haptic_accel.core.arm_work import ArmWork
from haptic_accel.core.due_forces import DueForces
from haptic_accel.core.emergency_stop import EmergencyStop
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import ParameterError, from_flat, schema
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, ArmTopics, along_actuator
from haptic_accel.devices import Device, DeviceError, Sample
from haptic_accel.devices.interface import LATER
from haptic_accel.graph.node_parameters import POSITION_SERVO, SAFETY
from haptic_accel.nodes.crtk import Motions, OperatingState, Queries
from haptic_accel.nodes.interface import Inbox
from haptic_accel.nodes.joint_states import JointStates
from haptic_accel.nodes.managed import ACTIVE, UNCONFIGURED, ManagedNode
from haptic_accel.nodes.scheduling import (
    FLOWING,
    ArrivalKeeper,
    RateKeeper,
    system_time,
    wake_time,
)
from haptic_accel.nodes.stopping import LOOK_PERIOD, StopWords

ARM, ACTUATOR = "arm_force", "actuator_force"
"""Kinds of commands, by their names in `Device.write`."""

MANY_MISSED = 0.01
"""Share of missed deadlines between two reports above which diagnostics warn."""

PATIENCE = 0.02
"""Time after which a sample that has not come counts as lost, s."""

STALL = 0.02
"""Time without a tick above which diagnostics warn, s: a fiftieth of their own period."""

NEWS_PERIOD = 0.1
"""Interval between looks for news of the safety layer, s."""


def quantiles(durations: DurationHistogram, name: str) -> dict[str, str]:
    """Return quantiles and maximum for diagnostics, in us; nothing while there are none."""
    if not durations.count:
        return {}
    found = durations.summary().items()
    return {f"{name} {label} (us)": f"{value * 1e6:.1f}" for label, value in found}


class Commands:
    """Commands of one kind: where they come from, and when they were applied.

    Parameters
    ----------
    inbox : Inbox
    latency : int
        As for `DueForces`.
    allowed : callable
        Returns the force to write for a time in s, an age of the command's sample in s, and a
        force; None to leave the device as it is.
    late_at_device : callable, optional
        For a device that takes forces before they are due: returns the number of those that it
        applied late itself.

    Attributes
    ----------
    forces : DueForces
    age : DurationHistogram
        Time from the stamp of the sample that caused a force to its application.
    """

    def __init__(
        self,
        inbox: Inbox,
        latency: int,
        allowed: Callable[[float, float, Vector], Any],
        *,
        late_at_device: Callable[[], int] | None = None,
    ) -> None:
        self.inbox = inbox
        self.allowed = allowed
        self.ahead = late_at_device is not None and latency > 0
        self._late_at_device = late_at_device or int
        self._late_before = 0
        self.latency = latency
        self._lag = 0 if self.ahead else latency
        self.forces = DueForces(latency)
        self.age = DurationHistogram()

    @property
    def missed(self) -> int:
        """Number of forces that came after they were due, here or at the device."""
        return self.forces.missed + max(0, self._late_at_device() - self._late_before)

    def is_missing(self, tick: int) -> bool:
        """Return whether commands come, but not yet the one that is needed after a tick."""
        newest, needed = self.forces.newest, tick - self._lag
        return newest is not None and needed - FLOWING <= newest < needed

    def applied(self, stamp: int) -> None:
        """Note that a command caused by a sample with a stamp was applied."""
        self.age.add(age_of(stamp))

    def count_anew(self) -> None:
        """Forget ages and counts."""
        self.age.reset()
        self.forces.count_anew()
        self._late_before = self._late_at_device()

    def status(self, name: str) -> dict[str, str]:
        """Return values for diagnostics."""
        return {
            f"{name} count": str(self.age.count),
            f"{name} due": str(self.forces.due),
            f"{name} deadlines missed": str(self.missed),
            **quantiles(self.age, f"{name} age"),
        }


def age_of(moment: int) -> float:
    """Return the age of a moment of system time in ns, s."""
    return (time.time_ns() - moment) / NANOSECONDS


def steady_now() -> float:
    """Return the time that devices use, s."""
    return time.monotonic_ns() / NANOSECONDS


class DeviceNode(ManagedNode):
    """Samples a device on the machine's sampling grid, publishes, and applies commands when due.

    At each tick it takes a sample, publishes it, and then applies the forces that are due: those
    caused by the samples `latency` ticks before. What comes later is applied on arrival. Every
    command passes a safety layer. Once configured, the node samples and publishes,
    which needs no force and shows whether all is well; forces are allowed only while it is active.

    Parameters
    ----------
    executable : str
    devices : dict
        Device classes by name.
    arm : ArmTopics
    """

    task = "sampling"

    polls = True

    def __init__(self, executable: str, devices: dict[str, type[Device]], arm: ArmTopics) -> None:
        super().__init__(
            executable,
            [
                f"{kind.PARAMETERS_OF or name}.{field}"
                for name, kind in devices.items()
                for field in kind.CHANGEABLE
            ],
        )
        p = self.parameters
        self._kind = devices[p.device]
        self._options_name = self._kind.PARAMETERS_OF or p.device
        self.device = self._build_device()
        self.safety = SafetyLayer(self.options[SAFETY], p.rate)
        self._lead = wake_time()
        self.rate_keeper = RateKeeper(p.rate, lead=self._lead)
        self._arrivals = ArrivalKeeper(p.rate)
        self._patience = max(1, round(PATIENCE * p.rate))
        self._per_nanosecond = p.rate / NANOSECONDS
        self._sampling = False
        self._tick = self._stamp = 0
        self._now = steady_now()
        self._waiting: deque[int] = deque()
        self._used = self._starting = self._warned = self._settled = False
        self._failure: Exception | None = None
        self._unread = self._reported_unread = 0
        self._reported_deadlines = {"due": 0, "missed": 0}
        self._stop = EmergencyStop(steady_now())
        self._stop_due = 0.0
        self._send_position = self.sender(arm.position).send
        self._send_velocity = self.sender(arm.velocity).send
        self._send_acceleration = self.sender(arm.acceleration).send
        self._work_sender = self.sender(arm.work)
        self._work_asked = self._contact_asked = False
        self._work = ArmWork()
        self._contact_sender = self.sender(arm.contact_force) if arm.contact_force else None
        self._publish_stopped = self.publisher(arm.stopped).publish
        self._joint_states = JointStates(self, arm.position, p.rate)
        self._commands = {
            ARM: Commands(self.inbox(arm.arm_force), p.latency, self.safety.arm_force)
        }
        if arm.actuator_force:
            self._commands[ACTUATOR] = Commands(
                self.inbox(arm.actuator_force),
                p.latency,
                self._allowed_actuator_force,
                late_at_device=(lambda: self.device.late) if self.device.AHEAD else None,
            )
        # The newest is enough; of more, none may hold up a tick.
        self._points = self.inbox(topics.HAND_SET_POINT, depth=1) if self._kind.POINTED else None
        self._queries = Queries(self, arm)
        self._motions = Motions(self, arm, self.options[POSITION_SERVO], self.options[SAFETY].arm)
        self._operating = OperatingState(self, arm, self.safety, self._fault, self._arm_again)
        self._newest: Sample | None = None
        self._stop_words = StopWords(self)
        self._coupler_stops = self.inbox(topics.COUPLER_STOPPED)
        self.create_service(SetBool, "~/estop", self._serve_stop)
        self.create_service(Trigger, "~/arm", self._serve_arm)
        self.create_timer(NEWS_PERIOD, self._log_news)
        if p.autostart:
            self._autostart()

    # Transitions of the managed node

    def on_configure(self, state: LifecycleState) -> Outcome:
        """Open the device and begin to sample it, without force."""
        self._failure = None
        try:
            self._renew()
            self.device.open()
            if self.device.remark:
                self.get_logger().info(self.device.remark)
            self.rate_keeper = RateKeeper(self.parameters.rate, lead=self._lead)
            self._arrivals = ArrivalKeeper(self.parameters.rate)
            self._waiting.clear()
            self._work = ArmWork()
            self._sampling = True
        except Exception as error:  # rclpy would keep it to itself
            self._failure = error
            if not self._starting:  # otherwise the process ends with this line
                self.get_logger().error(str(error))
            self._close_device()
            return Outcome.FAILURE
        return Outcome.SUCCESS

    def on_activate(self, state: LifecycleState) -> Outcome:
        """Allow forces, once it is known whether there is an emergency stop."""
        self.safety.enable(steady_now(), self._settled)
        return Outcome.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> Outcome:
        """Take all forces off, and allow none."""
        self.safety.enable(steady_now(), False)
        try:
            self.device.write(steady_now(), arm_force=ZERO, actuator_force=0.0)
        except (DeviceError, OSError) as error:
            self.get_logger().error(f"{error}: device closed")
            return Outcome.ERROR
        return Outcome.ERROR if self._failure else Outcome.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> Outcome:
        """Close the device, which leaves it without force."""
        self._release()
        return Outcome.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> Outcome:
        """Close the device, and end."""
        self._release()
        self.finish()
        return Outcome.SUCCESS

    on_error = on_cleanup

    def change(self, values: dict[str, Any]) -> None:
        """Change parameters of the running device."""
        name = self._options_name
        for changed in values:
            if not changed.startswith(f"{name}."):
                raise ParameterError(f"{changed}: the device is {self.parameters.device}")
        known = {
            key: self.get_parameter(key).value for key in schema(self._kind.Parameters, f"{name}.")
        }
        parameters: Any = from_flat(self._kind.Parameters, known | values, f"{name}.")
        self.device.change(parameters)
        self.options[name] = parameters

    def stop_forces(self) -> None:
        """Take all forces off and refuse commands until the emergency stop is released."""
        self._stop.stop()
        self._take_forces_off()

    def close(self) -> None:
        """Leave the device without force."""
        self.device.close()

    def say_farewell(self) -> None:
        """Log the missed deadlines, and publish the last diagnostics."""
        if (counts := self._deadlines())["due"]:
            text = "{missed} of {due} forces missed their deadline"
            self.get_logger().info(text.format(**counts))
        super().say_farewell()

    def report(self) -> None:
        """Publish the diagnostics, and the states of device and arm."""
        super().report()
        self._operating.report(again=True)
        if self._settled:
            self._publish_stopped(Bool(data=self.safety.stopped))

    def status(self) -> tuple[str, dict[str, str]]:
        """Return timing, the commands' ages, the safety layer's values, the device's counts."""
        keeper = self.rate_keeper
        values = {
            "state": self.state,
            "rate (Hz)": f"{self.parameters.rate:g}",
            "ticks": str(keeper.ticks),
            "late ticks": str(keeper.late),
            "missed ticks": str(keeper.missed),
            "ticks without a sample": str(self._unread),
            "positions refused": str(self._motions.refused),
            **quantiles(keeper.lateness, "tick lateness"),
        }
        for name, commands in self._commands.items():
            values |= commands.status(name.replace("_", " "))
        counts = {name: str(count) for name, count in self.device.status().items()}
        return self._warning(), {**values, **self.safety.status(), **counts}

    def _warning(self) -> str:
        """Return current problems, and those since the last report."""
        stall = self.rate_keeper.take_longest_gap()
        new, self._reported_unread = self._unread - self._reported_unread, self._unread
        warnings = [
            *self.safety.warnings(),
            self.device.problem,
            "no sample" if new else "",
            self._missed_deadlines(),
            f"stalled for {stall * 1e3:.0f} ms" if stall >= STALL else "",
        ]
        return ", ".join(filter(None, warnings))

    def _missed_deadlines(self) -> str:
        """Return a warning if too many forces came late since the last report."""
        counts = self._deadlines()
        due, missed = (counts[name] - self._reported_deadlines[name] for name in counts)
        self._reported_deadlines = counts
        if missed <= MANY_MISSED * due or due < self.parameters.rate / 2:
            return ""
        if not self._warned:
            self._warned = True
            self.get_logger().warning(
                f"{missed} of {due} forces came after their due time: is this machine fit for"
                f" {self.parameters.rate:g} Hz now? haptic-accel doctor"
            )
        return f"{missed} of {due} deadlines missed"

    def _deadlines(self) -> dict[str, int]:
        """Return how many forces were due, and how many of them came late."""
        commands = self._commands.values()
        return {
            "due": sum(each.forces.due for each in commands),
            "missed": sum(each.missed for each in commands),
        }

    def _build_device(self) -> Device:
        p = self.parameters
        return self._kind(self.options[self._options_name], p.rate, p.seed)

    def _autostart(self) -> None:
        """Configure and activate, or raise the reason why not."""
        self._starting = True
        if self.trigger_configure() != Outcome.SUCCESS:
            assert self._failure
            raise self._failure
        self._starting = False
        self.trigger_activate()

    def _renew(self) -> None:
        """Make a new device in place of a used one."""
        if self._used:
            self.device = self._build_device()
        self._used = True

    def _release(self) -> None:
        """Stop sampling, and leave the device without force."""
        self.safety.enable(steady_now(), False)
        self._sampling = False
        self._close_device()

    def _close_device(self) -> None:
        try:
            self.device.close()
        except (DeviceError, OSError) as error:
            self.get_logger().error(f"{self.parameters.device} device: {error}")

    def _fail(self, error: Exception) -> None:
        """Close a device that failed: no force, no samples, until configured again."""
        name = self.get_fully_qualified_name()
        self.get_logger().error(
            f"{error}: device closed, no force; ros2 lifecycle set {name} configure opens it again"
        )
        self._failure = error
        if self.state == ACTIVE:
            self.trigger_deactivate()
        elif self.state != UNCONFIGURED:
            self.trigger_cleanup()
        self.report()

    # The tick

    def work(self) -> float:
        """Serve a tick whose time has come, or what the last one still needs."""
        if not self._settled:
            self._settle()
        if (now := steady_now()) >= self._stop_due:
            self._stop_due = now + LOOK_PERIOD
            self._follow_stop()
        if not self._sampling:
            return steady_now() + NEWS_PERIOD
        tick = self.rate_keeper.due()
        if tick is None:
            self._look_again()
        else:
            self._serve(tick)
        if self.device.ended:
            self.finish(f"{self.parameters.device} device has ended")
        following = self.rate_keeper.next
        if self._needs_more():
            return min(self._arrivals.looked(found=False), following)
        if tick is None:
            self._arrivals.looked(found=True)
        return following

    def _serve(self, tick: int) -> None:
        """Take the sample of a tick, publish it, and apply the forces that are due."""
        moment = self.rate_keeper.time(tick)
        self._tick, self._stamp = tick, system_time(moment)
        self._waiting.append(tick)
        acceleration = self._read()
        if self._sampling:
            self._receive()
            self._apply(moment / NANOSECONDS)
            self._watch(moment / NANOSECONDS, acceleration)

    def _look_again(self) -> None:
        """Take samples and forces that were not there at their tick."""
        self._read()
        if self._sampling:
            self._receive()
            self._apply(steady_now())

    def _needs_more(self) -> bool:
        """Return whether a sample or a command of the last tick is still to come."""
        return bool(self._waiting) or any(
            commands.is_missing(self._tick) for commands in self._commands.values()
        )

    def _read(self) -> float | None:
        """Publish the samples that are there, in order; return the last acceleration."""
        acceleration = None
        while self._waiting:
            tick = self._waiting[0]
            moment = self.rate_keeper.time(tick)
            try:
                sample = self.device.read(moment / NANOSECONDS)
            except (DeviceError, OSError) as error:
                self._fail(error)
                return None
            if sample is LATER:
                if tick > self._tick - self._patience:
                    break
                sample = None
            self._waiting.popleft()
            if sample is None:
                self._unread += 1
            else:
                acceleration = sample.acceleration
                stamp = self._stamp - self.rate_keeper.time(self._tick) + moment
                self._newest = sample
                self._publish(sample, stamp)
                work = self._work.until(moment / NANOSECONDS, sample.position)
                if self._work_asked:
                    self._work_sender.send(stamp, work)
                if self._contact_asked:
                    self._publish_contact(stamp)
                if self._motions.servo.set_point:
                    self._hold(tick, stamp, sample)
        return acceleration

    def _publish(self, sample: Sample, stamp: int) -> None:
        # What makes the felt force goes first.
        self._send_acceleration(stamp, along_actuator(sample.acceleration))
        self._send_position(stamp, sample.position)
        self._send_velocity(stamp, sample.velocity)
        self._joint_states.take(stamp, sample.position)
        if self._queries.asked:
            self._queries.publish(
                stamp,
                sample,
                self.safety.held_arm_force,
                self._motions.servo.set_point,
                self.device.joints,
            )

    def _publish_contact(self, stamp: int) -> None:
        force = self.device.contact_force
        if self._contact_sender and force is not None:
            self._contact_sender.send(stamp, force)

    def _hold(self, tick: int, stamp: int, sample: Sample) -> None:
        """Command the force that a sample causes while a position is commanded."""
        servo = self._motions.servo
        if self.safety.refusal or self.safety.contested:
            servo.set_point = None
        elif force := servo.force(sample.position, sample.velocity):
            self._commands[ARM].forces.put(tick, stamp, force)

    def _receive(self) -> None:
        """Take the commands that have come."""
        if self._motions.expected:
            self._take_motions()
        if self._points:
            for _, position in self._points.take_vectors():
                self.device.point(position)
        for name, commands in self._commands.items():
            for stamp, force in commands.inbox.take_vectors():
                stamp = stamp or self._unstamped(name)
                if name == ARM and commands.forces.newest is None:
                    # The arms engage: what was late while nodes came up says nothing of the run.
                    for each in self._commands.values():
                        each.count_anew()
                sample = self._tick + round((stamp - self._stamp) * self._per_nanosecond)
                if abs(age_of(stamp)) > MAX_AGE:
                    sample = self._tick - commands.latency
                    commands.forces.pass_on(stamp, force)
                else:
                    commands.forces.put(sample, stamp, force)
                    if name == ARM:
                        self._motions.servo.set_point = None
                if commands.ahead:
                    self._send_ahead(name, sample + commands.latency)

    def _unstamped(self, name: str) -> int:
        """Return the stamp for a force without one: that of now, or none, for it to be refused."""
        return self._stamp if name == ARM and self.options[SAFETY].arm.zero_stamp else 0

    def _take_motions(self) -> None:
        """Follow the motion commands that have come."""
        if self._newest and self._motions.take(self._newest.position):
            self._commands[ARM].forces.put(self._tick, self._stamp, ZERO)

    def _send_ahead(self, name: str, tick: int) -> None:
        """Write a force that a device will apply by its own clock when it is due."""
        # One that is late already acts at once, and the device does not count it.
        self._commands[name].forces.missed += tick <= self._tick
        self._write_due(self.rate_keeper.time(tick) / NANOSECONDS, tick, [name])

    def _apply(self, time: float) -> None:
        """Apply the forces that are due at the last tick, or were before."""
        self._write_due(
            time, self._tick, [name for name, each in self._commands.items() if not each.ahead]
        )

    def _write_due(self, time: float, tick: int, names: Sequence[str]) -> None:
        """Write the newest forces that are due at a tick, as the safety layer allows them."""
        now = self._advanced(time)
        given: dict[str, Any] = {}
        stamps: dict[str, int] = {}
        for name in names:
            commands = self._commands[name]
            if caused := commands.forces.take(tick, ahead=commands.ahead):
                stamp, force = caused
                allowed = commands.allowed(now, age_of(stamp), force)
                if allowed is not None:
                    given[name], stamps[name] = allowed, stamp
        if not given or not self._write(time, **given):
            return
        for name, stamp in stamps.items():
            self._commands[name].applied(stamp)

    def _advanced(self, time: float) -> float:
        """Return a time for the safety layer, s, which must not go back."""
        self._now = max(self._now, min(time, steady_now()))
        return self._now

    def _watch(self, time: float, acceleration: float | None) -> None:
        """Apply the forces that the safety layer reduces without a command."""
        arm, actuator = self.safety.tick(self._advanced(time), acceleration)
        self._write(time, arm_force=arm, actuator_force=actuator)

    def _write(self, time: float, **forces: Any) -> bool:
        """Apply forces that are not None, or close a device that fails; return if any was."""
        given = {name: force for name, force in forces.items() if force is not None}
        if not given:
            return False
        try:
            self.device.write(time, **given)
        except (DeviceError, OSError) as error:
            self._fail(error)
            return False
        if "arm_force" in given:
            self._work.apply(time, given["arm_force"])
        return True

    def _allowed_actuator_force(self, now: float, age: float, force: Vector) -> float | None:
        return self.safety.actuator_force(now, age, force[ACTUATOR_AXIS])

    def _settle(self) -> None:
        """Allow forces, and say whether there is an emergency stop, after the first moments."""
        self._settled = self._stop.is_settled(steady_now())
        if self._settled:
            self.safety.enable(steady_now(), self.state == ACTIVE)
            self.report()

    def _follow_stop(self) -> None:
        """Stop where anybody says so; what withdraws a stop releases nothing."""
        now = steady_now()
        for word in self._stop_words.take():
            self._stop.heard(word, now)
            if word:
                self._take_forces_off()
        for stopped in self.states(self._coupler_stops):
            if self._stop.coupler_said(stopped, now):
                self._take_forces_off()

    def _take_forces_off(self) -> None:
        """Take all forces off and refuse commands until the release; answer in any case."""
        now, known = steady_now(), self.safety.stopped
        if self.state != UNCONFIGURED:
            self._write(now, arm_force=ZERO, actuator_force=0.0)
        self._publish_stopped(Bool(data=True))
        if not known:
            self.safety.stop(now, True)
            self.get_logger().warning(f"{STOPPED}: no force until it is released")
            self.report()

    def _serve_stop(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        """Stop, or allow commands again unless there is a reason for the stop."""
        if request.data:
            self.stop_forces()
            response.success, response.message = True, "stopped"
            return response
        self._follow_stop()  # what was said before this was asked for
        refusal = self._stop.release(steady_now(), self._stop_words.publishers())
        if not refusal:
            if self.safety.stopped:
                self.safety.stop(steady_now(), False)
                self.get_logger().info(f"{STOPPED} released")
            self.report()
        response.success, response.message = not refusal, refusal or "released"
        return response

    def _serve_arm(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        refused = self._arm_again()
        response.message = refused or "armed"
        response.success = not refused
        self.report()
        return response

    def _arm_again(self) -> str:
        """Allow forces again after a fault of commands or device; return what prevents it."""
        refused = self.safety.refusal
        if not refused and self.device.arm() is False:
            refused = self.device.problem or "the device does not arm"
        return refused or self.safety.arm()

    def _fault(self) -> str:
        """Return what is wrong with the device, empty for nothing."""
        return str(self._failure or (self._sampling and self.device.problem) or "")

    def _log_news(self) -> None:
        """Log news of the safety layer, each once; look who sends commands and who asks."""
        for look in (self._motions.look, self._queries.look, self._operating.report):
            look()
        self._work_asked = self._work_sender.listeners > 0
        self._contact_asked = bool(self._contact_sender and self._contact_sender.listeners)
        for name, commands in self._commands.items():
            inboxes = [commands.inbox, *([self._motions.positions] if name == ARM else [])]
            self.safety.note_senders(name.replace("_", " "), self.rivals(*inboxes))
        for line in self.safety.news(steady_now()):
            self.get_logger().warning(line)
            self.report()
