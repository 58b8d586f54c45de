"""What the two device nodes share: sampling a device, and applying commands as they arrive."""

from __future__ import annotations

import math
import time
from collections import Counter
from typing import Any

from haptic_accel.core.coupling import ZERO, Vector
from haptic_accel.core.histogram import DurationHistogram
from haptic_accel.devices import Device, Sample
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import NANOSECONDS, RateKeeper, start_timer, system_time
from haptic_accel.nodes.topics import Topic

STALL = 0.02
"""Time without a tick from which on diagnostics warn, s: a fiftieth of their own period."""


def quantiles(durations: DurationHistogram, name: str) -> dict[str, str]:
    """Return quantiles and maximum for diagnostics, in us; nothing while there are none."""
    if not durations.count:
        return {}
    found = durations.summary().items()
    return {f"{name} {label} (us)": f"{value * 1e6:.1f}" for label, value in found}


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
        values |= quantiles(self.age, f"{name} age")
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
    first : bool
        Whether its tick gives no other the precedence.
    """

    def __init__(
        self,
        executable: str,
        devices: dict[str, type[Device]],
        position: Topic,
        velocity: Topic,
        acceleration: Topic,
        arm_force: Topic,
        *,
        first: bool = True,
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
        self._told: Counter[str] = Counter()
        self.rate_keeper = RateKeeper(p.rate)
        self.device.open()
        start_timer(self, self.rate_keeper, self._sample, first=first)

    def command(self) -> Command:
        """Make the record of one kind of command."""
        return Command(1 / self.parameters.rate, self.parameters.timeout)

    def close(self) -> None:
        """Leave the device without force."""
        self.device.close()
        super().close()

    def status(self) -> tuple[str, dict[str, str]]:
        """Return the rate held, the commands' ages and the device's counts."""
        keeper = self.rate_keeper
        values = {
            "rate (Hz)": f"{self.parameters.rate:g}",
            "ticks": str(keeper.ticks),
            "late ticks": str(keeper.late),
            "missed ticks": str(keeper.missed),
            **quantiles(keeper.lateness, "tick lateness"),
        }
        for name, command in self._commands.items():
            values |= command.status(name)
        values |= {name: str(count) for name, count in self.device.status().items()}
        return self._warning(), values

    def _warning(self) -> str:
        """Say what went wrong since the last report."""
        stall = self.rate_keeper.take_longest_gap()
        warnings = [f"stalled for {stall * 1e3:.0f} ms"] if stall >= STALL else []
        timeouts = {name: command.timeouts for name, command in self._commands.items()}
        warnings += [f"{n} went silent" for n, count in timeouts.items() if count > self._told[n]]
        self._told.update(timeouts)
        return ", ".join(warnings)

    def _sample(self) -> None:
        due = self.rate_keeper.tick()
        if due is None:
            return
        sample = self.device.read(due / NANOSECONDS)
        self._publish(sample, system_time(due))
        self._quiet_the_silent(due / NANOSECONDS)

    def write(self, **forces: Any) -> float:
        """Apply forces now; return what time it is, s."""
        now = time.monotonic_ns() / NANOSECONDS
        self.device.write(now, **forces)
        return now

    def _publish(self, sample: Sample, moment: int) -> None:
        # What makes the felt force goes first.
        self._send_acceleration(moment, (0.0, 0.0, sample.acceleration))
        self._send_position(moment, sample.position)
        self._send_velocity(moment, sample.velocity)

    def _quiet_the_silent(self, now: float) -> None:
        """Take a force off whose sender has gone."""
        if self._arm_command.went_silent(now):
            self.write(arm_force=ZERO)

    def _apply_arm_force(self, moment: int, force: Vector) -> None:
        if not math.isfinite(sum(force)):
            self._arm_command.rejected += 1
            return
        if not self._arm_command.age.count:
            # The arms engage: what was late while nodes came up says nothing about the run.
            for command in self._commands.values():
                command.age.reset()
        self._arm_command.applied(moment, self.write(arm_force=force))
