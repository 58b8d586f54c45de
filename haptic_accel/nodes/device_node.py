"""What the two device nodes share: sampling a device, and applying commands as they arrive."""

from __future__ import annotations

import math
import time

from haptic_accel.core.coupling import ZERO, Vector
from haptic_accel.core.histogram import DurationHistogram
from haptic_accel.devices import Device, Sample
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import NANOSECONDS, RateKeeper, start_timer, system_time
from haptic_accel.nodes.topics import Topic


class Command:
    """What is known of one kind of command: how old it was when applied, and whether it lives.

    Attributes
    ----------
    age : DurationHistogram
        From the stamp of the sample that caused a force to its application.
    late : int
        Forces older than half a period when applied.
    rejected : int
        Forces that were not finite, and not applied.
    """

    def __init__(self, period: float, timeout: float) -> None:
        self._period = period
        self._timeout = timeout
        self._last: float | None = None
        self.age = DurationHistogram()
        self.late = self.rejected = self.timeouts = 0

    def applied(self, moment: int, now: float) -> None:
        """Note that a command caused by a sample of a moment (system time, ns) was applied."""
        age = (time.time_ns() - moment) / NANOSECONDS
        self.age.add(age)
        if age > self._period / 2:
            self.late += 1
        self._last = now

    def went_silent(self, now: float) -> bool:
        """Tell, once, that commands have stopped coming."""
        if self._last is None or now - self._last < self._timeout:
            return False
        self._last = None
        self.timeouts += 1
        return True

    def status(self, name: str) -> dict[str, str]:
        """Return values for diagnostics."""
        values = {f"{name} count": str(self.age.count)}
        if self.age.count:
            for label, seconds in (
                ("p50", self.age.quantile(0.5)),
                ("p99", self.age.quantile(0.99)),
                ("max", self.age.maximum),
            ):
                values[f"{name} age {label} (us)"] = f"{seconds * 1e6:.1f}"
        values[f"{name} late"] = str(self.late)
        values[f"{name} rejected"] = str(self.rejected)
        values[f"{name} timeouts"] = str(self.timeouts)
        return values


class DeviceNode(GraphNode):
    """Samples a device on the machine's grid, publishes, applies commands at once.

    Parameters
    ----------
    executable : str
    devices : dict
        Device classes by name.
    position, velocity, acceleration, arm_force : Topic
    """

    def __init__(
        self,
        executable: str,
        devices: dict[str, type[Device]],
        position: Topic,
        velocity: Topic,
        acceleration: Topic,
        arm_force: Topic,
    ) -> None:
        super().__init__(executable)
        p = self.parameters
        self.device = devices[p.device](self.options[p.device], p.rate, p.seed)
        self._send_position = self.sender(position).send
        self._send_velocity = self.sender(velocity).send
        self._send_acceleration = self.sender(acceleration).send
        self._arm_command = self.command()
        self.listen(arm_force, self._apply_arm_force)
        self._commands = {"arm force": self._arm_command}
        self.rate_keeper = RateKeeper(p.rate)
        self.device.open()
        start_timer(self, self.rate_keeper, self._sample)

    def command(self) -> Command:
        """Make the record of one kind of command."""
        return Command(1 / self.parameters.rate, self.parameters.timeout)

    def close(self) -> None:
        """Leave the device without force."""
        self.device.close()

    def status(self) -> tuple[str, dict[str, str]]:
        """Return the rate held, the commands' ages and the device's counts."""
        keeper = self.rate_keeper
        values = {
            "rate (Hz)": f"{self.parameters.rate:g}",
            "ticks": str(keeper.ticks),
            "late ticks": str(keeper.late),
            "missed ticks": str(keeper.missed),
        }
        for name, command in self._commands.items():
            values |= command.status(name)
        values |= {name: str(count) for name, count in self.device.status().items()}
        return "", values

    def _sample(self) -> None:
        due = self.rate_keeper.tick()
        if due is None:
            return
        sample = self.device.read(due / NANOSECONDS)
        self._publish(sample, system_time(due))
        self._quiet_the_silent(due / NANOSECONDS)

    def _publish(self, sample: Sample, moment: int) -> None:
        # What makes the felt force goes first.
        self._send_acceleration(moment, (0.0, 0.0, sample.acceleration))
        self._send_position(moment, sample.position)
        self._send_velocity(moment, sample.velocity)

    def _quiet_the_silent(self, now: float) -> None:
        """Take a force off whose sender has gone."""
        if self._arm_command.went_silent(now):
            self.device.write(now, arm_force=ZERO)

    def _apply_arm_force(self, moment: int, force: Vector) -> None:
        if not math.isfinite(sum(force)):
            self._arm_command.rejected += 1
            return
        if not self._arm_command.age.count:
            # The arms engage: what was late while nodes came up says nothing about the run.
            for command in self._commands.values():
                command.age.reset()
        now = time.monotonic_ns() / NANOSECONDS
        self.device.write(now, arm_force=force)
        self._arm_command.applied(moment, now)
