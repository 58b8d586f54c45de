"""Interface of both sides of the virtual rig."""

from __future__ import annotations

from typing import Protocol

from haptic_accel.core.model import Sample, Vector

LONGEST_ADVANCE = 0.1
"""Longest time simulated in one go, s; after a longer stall the rig has stood still."""


class Rig(Protocol):
    """One side of the virtual rig; times in s from its start."""

    def advance(self, time: float) -> None:
        """Let physics run until a time; one that has passed changes nothing."""

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N."""

    def apply_actuator_force(self, force: float) -> None:
        """Set the force of the handle's actuator, N."""

    def release(self) -> None:
        """Take all forces off."""

    def status(self) -> dict[str, int]:
        """Return counts of values beyond a range, by name."""
