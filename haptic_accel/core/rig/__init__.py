# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Virtual rig: one side as a device, whose mechanics and instruments are in the files."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.axes import ACTUATOR_AXIS, Axes
from haptic_accel.core.model import AccelerometerParameters, Force, Sample, Vector
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick.rigs import Accelerometer, SimulatedArm

_NEXT_AXIS = 10
"""Distance between the random streams of two axes, above all other streams of a seed."""


@dataclass(frozen=True)
class ArmParameters(Checked):
    """Limits of an arm's motors and encoders; defaults from the Phantom Omni's data sheet."""

    max_force: float = parameter(3.3, "limit of the force of the arm's motors", unit="N", low=0)
    position_resolution: float = parameter(55e-6, "resolution of the arm's position", "m", 0, 1e-3)


class Rig:
    """One side of the virtual rig, sampled exactly at the requested times; times in s.

    Parameters
    ----------
    motion : SimulatedArm

    Attributes
    ----------
    motion : SimulatedArm
    """

    late = 0
    """Number of forces that took effect after their due time."""

    def __init__(self, motion: SimulatedArm) -> None:
        self.motion = motion

    @property
    def contact_force(self) -> Vector | None:
        """Force of the surface on the tool at the last sample, N; None if unknown."""
        arm = self.motion
        return (arm.contact_x, arm.contact_y, arm.contact_z) if arm.feel() else None

    @property
    def flat(self) -> SimulatedArm | None:
        """Motion that the loop may call directly; None for a rig that overrides its access."""
        ways = [getattr(way, "__func__", None) for way in (self.read, self.write)]
        return self.motion if ways == [Rig.read, Rig.write] else None

    def read(self, time: float) -> Sample:
        """Simulate until a time, s, and return the sample at that time."""
        self.motion.measure(time)
        return self.motion.reading.sample

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Change the forces, N, from a time on, s; later changes written before are discarded."""
        if arm_force is not None:
            self.motion.drive_at(time, True, *arm_force)
        if actuator_force is not None:
            self.motion.drive_at(time, False, *actuator_force)

    def advance(self, time: float) -> None:
        """Integrate the physics until a time since the start; past times are ignored."""
        self.motion.advance(time)

    def measure(self) -> Sample:
        """Return the present readings of encoders and accelerometer."""
        self.motion.observe()
        return self.motion.reading.sample

    def apply_arm_force(self, force: Vector) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        self.motion.pull(*force)

    def apply_actuator_force(self, force: Vector) -> None:
        """Set the forces of the actuator's coils along x, y, z of the handle, N.

        Each is rounded and limited by its converter and amplifier; NaN sets it to zero.
        """
        self.motion.push(*force)

    def release(self) -> None:
        """Set all forces to zero."""
        self.motion.release()

    def counters(self) -> dict[str, int]:
        """Return counts of out-of-range values by name."""
        return {}


def accelerometers(
    parameters: AccelerometerParameters, axes: Axes, seed: int, stream: int
) -> list[Accelerometer | None]:
    """Return accelerometers along x, y and z with independent noise; None for a missing axis.

    Parameters
    ----------
    parameters : AccelerometerParameters
        Parameters of each axis.
    axes : Axes
    seed : int
        Seed of the noise.
    stream : int
        Number of the random stream of the noise along z.
    """
    return [
        Accelerometer(parameters, seed, stream + _NEXT_AXIS * (ACTUATOR_AXIS - index))
        if index in axes.indices
        else None
        for index in range(3)
    ]
