"""Base of the two device nodes: samples a device, applies commands as they arrive."""

from __future__ import annotations

import time
from typing import Any

from rclpy.lifecycle import LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from haptic_accel.core import topics
from haptic_accel.core.actuator.safety import STOPPED, SafetyLayer
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import ParameterError, from_flat, schema
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, ArmTopics, along_actuator
from haptic_accel.devices import Device, DeviceError, Sample
from haptic_accel.graph.node_parameters import SAFETY
from haptic_accel.nodes.managed import ACTIVE, UNCONFIGURED, ManagedNode
from haptic_accel.nodes.scheduling import RateKeeper, start_timer, system_time

STALL = 0.02
"""Time without a tick above which diagnostics warn, s: a fiftieth of their own period."""

SETTLING = 1.0
"""Age of a node below which it accepts no release of the emergency stop, s: messages latched by
several senders arrive at once and in any order, and a stop among them must win."""

NEWS_PERIOD = 0.1
"""Interval between looks for news of the safety layer, s."""


def quantiles(durations: DurationHistogram, name: str) -> dict[str, str]:
    """Return quantiles and maximum for diagnostics, in us; nothing while there are none."""
    if not durations.count:
        return {}
    found = durations.summary().items()
    return {f"{name} {label} (us)": f"{value * 1e6:.1f}" for label, value in found}


class Command:
    """Ages of one kind of command when applied.

    Attributes
    ----------
    age : DurationHistogram
        Time from the stamp of the sample that caused a force to its application.
    late : int
        Number of forces older than half a period when applied.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self.age = DurationHistogram()
        self.late = 0

    def applied(self, moment: int) -> None:
        """Note that a command caused by a sample of a moment (system time, ns) was applied."""
        age = age_of(moment)
        self.age.add(age)
        self.late += age > self._period / 2

    def status(self, name: str) -> dict[str, str]:
        """Return values for diagnostics."""
        count = {f"{name} count": str(self.age.count)}
        return {**count, **quantiles(self.age, f"{name} age"), f"{name} late": str(self.late)}


def age_of(moment: int) -> float:
    """Return the age of a moment of system time in ns, s."""
    return (time.time_ns() - moment) / NANOSECONDS


def steady_now() -> float:
    """Return the time that devices use, s."""
    return time.monotonic_ns() / NANOSECONDS


class DeviceNode(ManagedNode):
    """Samples a device on the machine's sampling grid, publishes, applies commands at once.

    Every command passes a safety layer. Once configured, the node samples and publishes,
    which needs no force and shows whether all is well; forces are allowed only while it is active.

    Parameters
    ----------
    executable : str
    devices : dict
        Device classes by name.
    arm : ArmTopics
    first : bool
        Its tick runs before that of another device in the same process.
    """

    def __init__(
        self,
        executable: str,
        devices: dict[str, type[Device]],
        arm: ArmTopics,
        *,
        first: bool = True,
    ) -> None:
        super().__init__(
            executable,
            [f"{name}.{field}" for name, kind in devices.items() for field in kind.CHANGEABLE],
        )
        p = self.parameters
        self._kind = devices[p.device]
        self.device = self._build_device()
        self.safety = SafetyLayer(self.options[SAFETY], p.rate)
        self.rate_keeper = RateKeeper(p.rate)
        self._first = first
        self._timer: Any = None
        self._used = self._starting = False
        self._failure: Exception | None = None
        self._unread = self._reported_unread = 0
        self._started = time.monotonic()
        self._send_position = self.sender(arm.position).send
        self._send_velocity = self.sender(arm.velocity).send
        self._send_acceleration = self.sender(arm.acceleration).send
        self._publish_stopped = self.publisher(arm.stopped).publish
        self._commands = {"arm force": Command(1 / p.rate)}
        self.listen(arm.arm_force, self._apply_arm_force)
        if arm.actuator_force:
            self._commands["actuator force"] = Command(1 / p.rate)
            self.listen(arm.actuator_force, self._apply_actuator_force)
        self.listen_state(topics.EMERGENCY_STOP, self._stop)
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
            self._timer = start_timer(self, self.rate_keeper, self._sample, first=self._first)
        except Exception as error:  # rclpy would keep it to itself
            self._failure = error
            if not self._starting:  # otherwise the process ends with this line
                self.get_logger().error(str(error))
            self._close_device()
            return Outcome.FAILURE
        return Outcome.SUCCESS

    def on_activate(self, state: LifecycleState) -> Outcome:
        """Allow forces."""
        self.safety.enable(steady_now(), True)
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
        name = self.parameters.device
        for changed in values:
            if not changed.startswith(f"{name}."):
                raise ParameterError(f"{changed}: the device is {name}")
        known = {
            key: self.get_parameter(key).value for key in schema(self._kind.Parameters, f"{name}.")
        }
        parameters: Any = from_flat(self._kind.Parameters, known | values, f"{name}.")
        self.device.change(parameters)
        self.options[name] = parameters

    def close(self) -> None:
        """Leave the device without force."""
        self.device.close()
        super().close()

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
            **quantiles(keeper.lateness, "tick lateness"),
        }
        for name, command in self._commands.items():
            values |= command.status(name)
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
            f"stalled for {stall * 1e3:.0f} ms" if stall >= STALL else "",
        ]
        return ", ".join(filter(None, warnings))

    def _build_device(self) -> Device:
        p = self.parameters
        return self._kind(self.options[p.device], p.rate, p.seed)

    def _autostart(self) -> None:
        """Configure and activate, or raise the reason why not."""
        self._starting = True
        if self.trigger_configure() != Outcome.SUCCESS:
            assert self._failure
            raise self._failure
        self._starting = False
        self.trigger_activate()

    def _renew(self) -> None:
        """Make a new device in place of a used one, and a new sampling grid."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self._used:
            self.device = self._build_device()
            self.rate_keeper = RateKeeper(self.parameters.rate)
        self._used = True

    def _release(self) -> None:
        """Stop sampling, and leave the device without force."""
        self.safety.enable(steady_now(), False)
        # Not destroyed: this may be its own callback.
        if self._timer is not None:
            self._timer.cancel()
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
        self._failure = None
        self.report()

    def _sample(self) -> None:
        due = self.rate_keeper.tick()
        if due is None:
            return
        try:
            sample = self.device.read(due / NANOSECONDS)
        except (DeviceError, OSError) as error:
            self._fail(error)
            return
        if sample is None:
            self._unread += 1
        else:
            self._publish(sample, system_time(due))
        self._watch(None if sample is None else sample.acceleration)
        if self.device.ended:
            self.finish(f"{self.parameters.device} device has ended")

    def _publish(self, sample: Sample, moment: int) -> None:
        # What makes the felt force goes first.
        self._send_acceleration(moment, along_actuator(sample.acceleration))
        self._send_position(moment, sample.position)
        self._send_velocity(moment, sample.velocity)

    def _watch(self, acceleration: float | None) -> None:
        """Apply the forces that the safety layer reduces without a command."""
        now = steady_now()
        arm, actuator = self.safety.tick(now, acceleration)
        self._write(now, arm_force=arm, actuator_force=actuator)

    def _write(self, now: float, **forces: Any) -> bool:
        """Apply forces that are not None, or close a device that fails; return if any is given."""
        given = {name: force for name, force in forces.items() if force is not None}
        if not given:
            return False
        try:
            self.device.write(now, **given)
        except (DeviceError, OSError) as error:
            self._fail(error)
        return True

    def _apply_arm_force(self, moment: int, force: Vector) -> None:
        now, command = steady_now(), self._commands["arm force"]
        if self._write(now, arm_force=self.safety.arm_force(now, age_of(moment), force)):
            if not command.age.count:
                # The arms engage: what was late while nodes came up says nothing about the run.
                for each in self._commands.values():
                    each.age.reset()
            command.applied(moment)

    def _apply_actuator_force(self, moment: int, force: Vector) -> None:
        now = steady_now()
        allowed = self.safety.actuator_force(now, age_of(moment), force[ACTUATOR_AXIS])
        if self._write(now, actuator_force=allowed):
            self._commands["actuator force"].applied(moment)

    def _stop(self, stop: bool) -> None:
        """Take all forces off and refuse commands, or allow them again; answer in any case."""
        now = steady_now()
        stopped = self.safety.stopped
        if stop:
            if self.state != UNCONFIGURED:
                self._write(now, arm_force=ZERO, actuator_force=0.0)
        elif time.monotonic() - self._started < SETTLING:
            stop = stopped
        if stop != stopped:
            self.safety.stop(now, stop)
        self._publish_stopped(Bool(data=stop))
        if stop == stopped:
            return
        if stop:
            self.get_logger().warning(f"{STOPPED}: no force until it is released")
        else:
            self.get_logger().info(f"{STOPPED} released")
        self.report()

    def _serve_arm(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Allow forces again after a time-out, an outdated command, or a refusal of the device."""
        refused = self.safety.refusal
        if not refused and self.device.arm() is False:
            refused = self.device.problem or "the device does not arm"
        response.message = refused or self.safety.arm() or "armed"
        response.success = not refused
        self.report()
        return response

    def _log_news(self) -> None:
        """Log news of the safety layer, each once."""
        for line in self.safety.news(steady_now()):
            self.get_logger().warning(line)
            self.report()
