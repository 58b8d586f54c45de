"""A device made of two: an arm's motion and force of one, the accelerometer of another."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any, ClassVar

from haptic_accel.core.model import Vector
from haptic_accel.devices.interface import Device, Sample

ARM, HANDLE = "arm", "handle"
"""Fields of the parameters, and what the names of their counts begin with."""


class CombinedDevice(Device):
    """An arm that tells position and velocity, and a handle or tool that tells acceleration.

    A subclass names both classes, and in `Parameters` a dataclass with a field `arm` and a field
    `handle` of their parameters. Both are opened or none; both are closed whatever the other
    does.
    """

    Arm: ClassVar[type[Device]]
    Handle: ClassVar[type[Device]]

    def __init_subclass__(cls, **words: Any) -> None:
        """Take over what can be changed in either."""
        super().__init_subclass__(**words)
        cls.CHANGEABLE = tuple(
            f"{field}.{name}"
            for field, kind in ((ARM, cls.Arm), (HANDLE, cls.Handle))
            for name in kind.CHANGEABLE
        )

    def __init__(self, parameters: Any, rate: float, seed: int) -> None:
        self._arm = self.Arm(parameters.arm, rate, seed)
        self._handle = self.Handle(parameters.handle, rate, seed)

    def open(self) -> None:
        """Open both, or leave both closed."""
        with ExitStack() as opened:
            opened.callback(self._arm.close)
            self._arm.open()
            opened.callback(self._handle.close)
            self._handle.open()
            opened.pop_all()

    def read(self, time: float) -> Sample | None:
        """Return the arm's motion and the handle's acceleration, None where either has none."""
        moved, shaken = self._arm.read(time), self._handle.read(time)
        if moved is None or shaken is None:
            return None
        return moved._replace(acceleration=shaken.acceleration)

    def write(
        self,
        time: float,
        *,
        arm_force: Vector | None = None,
        actuator_force: float | None = None,
    ) -> None:
        """Give each its force, the actuator's first."""
        if actuator_force is not None:
            self._handle.write(time, actuator_force=actuator_force)
        if arm_force is not None:
            self._arm.write(time, arm_force=arm_force)

    def change(self, parameters: Any) -> None:
        """Let both go on with other parameters."""
        for device, given in ((self._arm, parameters.arm), (self._handle, parameters.handle)):
            if device.CHANGEABLE:
                device.change(given)

    def arm(self) -> bool | None:
        """Let both allow forces again: False if one cannot, None if one takes a while."""
        answers = self._arm.arm(), self._handle.arm()
        if False in answers:
            return False
        return None if None in answers else True

    def close(self) -> None:
        """Leave both without force, one also when the other fails."""
        with ExitStack() as closing:
            closing.callback(self._arm.close)
            closing.callback(self._handle.close)

    @property
    def remark(self) -> str:
        """What either has to say."""
        return "; ".join(filter(None, (self._arm.remark, self._handle.remark)))

    @property
    def problem(self) -> str:
        """What is wrong with either."""
        return "; ".join(filter(None, (self._arm.problem, self._handle.problem)))

    @property
    def ended(self) -> bool:
        """Whether either has come to its end."""
        return self._arm.ended or self._handle.ended

    def status(self) -> dict[str, int]:
        """Return the counts of both, each with its part's name before it."""
        return {
            f"{part}_{name}": count
            for part, device in ((ARM, self._arm), (HANDLE, self._handle))
            for name, count in device.status().items()
        }
