# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Virtual rig of two arms: its parameters, and the loop that couples them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy.typing as npt

from haptic_accel.core import tick, topics
from haptic_accel.core.actuator import MasterSafetyParameters, SafetyParameters
from haptic_accel.core.axes import ACTUATOR_AXES, Axes
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.coupling.engagement import Engagement, EngagementParameters
from haptic_accel.core.coupling.passive import CouplingParameters, PassivePair, PassiveParameters
from haptic_accel.core.handle.mechanics import sampled_response
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, HandleParameters, ModeParameters
from haptic_accel.core.parameters import Checked, like
from haptic_accel.core.rig.master_rig import DriveParameters, MasterRigParameters, axes_of
from haptic_accel.core.rig.slave_rig import SlaveRigParameters
from haptic_accel.core.surfaces.virtual_rig import VirtualRigParameters


@dataclass(frozen=True)
class PlayedPlant(Plant):
    """Plant of a virtual rig, with effects that only a rig simulates."""

    second: ModeParameters = field(default_factory=ModeParameters)
    force_scale: float = like(DriveParameters, "force_scale")

    def response(self, frequency: npt.ArrayLike, rate: float) -> ComplexArray:
        """Return sampled acceleration over held force, m/s^2 per N, at frequencies in Hz."""
        return self.force_scale * sampled_response(
            *(self.handle, frequency, rate, self.delay, self.bandwidth, self.mount, self.second)
        )


@dataclass(frozen=True)
class RigParameters:
    """Both sides of the virtual rig and their coupling; `virtual` is the slave in a scene.

    If parameters of the passive coupling are specified, it replaces the paper's coupling. By
    default, the master's safety layer uses the limits of the actuator.
    """

    master: MasterRigParameters = field(default_factory=MasterRigParameters)
    slave: SlaveRigParameters = field(default_factory=SlaveRigParameters)
    coupling: CouplingParameters = field(default_factory=CouplingParameters)
    passive_coupling: PassiveParameters | None = None
    virtual: VirtualRigParameters = field(default_factory=VirtualRigParameters)
    master_safety: MasterSafetyParameters | None = None
    slave_safety: SafetyParameters = field(default_factory=SafetyParameters)

    def coupled(self, rate: float, latency: int) -> tick.PairCoupling:
        """Return the coupling of arms on one host."""
        if self.passive_coupling:
            return PassivePair(self.passive_coupling, rate, latency)
        return tick.PositionPositionCoupling(self.coupling)

    def plant(self, handle: HandleParameters) -> Plant:
        """Return the plant of a controller, with a handle as held by one user."""
        master = self.master
        sensor, delay = master.accelerometer.bandwidth, master.drive.delay
        stiffness = self.passive_coupling.stiffness if self.passive_coupling else self.coupling.k_m
        return PlayedPlant(
            *(handle, master.mount, delay, sensor),
            coupling=stiffness,
            second=master.second,
            force_scale=master.drive.force_scale,
        ).coupled()

    @property
    def safety(self) -> tuple[SafetyParameters, SafetyParameters]:
        """Return the limits of the devices of master and slave."""
        master = self.master_safety or MasterSafetyParameters(hardware=self.master.actuator)
        return master, self.slave_safety

    def passive(self, law: str) -> PassiveParameters:
        """Return the parameters of the passive coupling for a law."""
        if self.passive_coupling:
            return replace(self.passive_coupling, law=law)
        c = self.coupling
        return PassiveParameters(law=law, stiffness=c.k_m, scale=c.scale, max_force=c.max_force)


def rig_side(
    device: Any,
    limits: SafetyParameters,
    rate: float,
    latency: int,
    kinds: Collection[str] = (tick.ARM, tick.ACTUATOR),
    axes: Axes = ACTUATOR_AXES,
) -> tick.DeviceSide:
    """Return one side of a virtual rig for lockstep, with a safety layer that allows forces."""
    safety = tick.SafetyLayer(limits, rate, axes)
    safety.enable(0.0, True)
    return tick.DeviceSide(device, safety, rate, latency, kinds=kinds)


def build_parts(
    rig: RigParameters,
    devices: Mapping[str, Any],
    compensation: CompensationParameters,
    controllers: Mapping[str, Checked],
    rate: float,
    latency: int,
    clock: Callable[[], float] = float,
) -> tuple[dict[str, tick.DeviceSide], tick.CompensationPart]:
    """Return both arms' sides, which allow forces, and the compensation.

    Parameters
    ----------
    rig : RigParameters
        Limits of the devices, and the master's axes.
    devices : mapping of str to Device
        Master and slave, by arm.
    compensation : CompensationParameters
    controllers : mapping
        Parameters of controllers, plant and actuator by name.
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples.
    clock : callable, optional
        As for `Compensation`.

    Raises
    ------
    ParameterError
        A value is not allowed.
    """
    (on_master, on_slave), axes = rig.safety, axes_of(rig.master)
    sides = {
        tick.MASTER: rig_side(devices[tick.MASTER], on_master, rate, latency, axes=axes),
        tick.SLAVE: rig_side(devices[tick.SLAVE], on_slave, rate, latency, (tick.ARM,)),
    }
    built = Compensation(compensation, rate, controllers, latency=latency, clock=clock)
    return sides, tick.CompensationPart(built, rate, latency)


def build_loop(
    rig: RigParameters,
    sides: Mapping[str, tick.DeviceSide],
    compensation: tick.CompensationPart,
    *,
    composed: bool = True,
    longest: int = 1,
) -> tick.HostLoop:
    """Return the loop of both arms on one host, whose devices are not stopped.

    Parameters
    ----------
    rig : RigParameters
        Parameters of the coupling.
    sides, compensation
        Result of `build_parts`.
    composed : bool
        False to simulate a graph with a process for each node, whose compensation does not know
        the forces of the arms.
    longest : int
        Maximum number of waiting samples of an arm: one in lockstep, where none is late.
    """
    engagement = Engagement(EngagementParameters(), now=0.0)
    for arm in topics.ARMS:
        engagement.arm_stopped(arm, False)
    rate, latency = sides[tick.MASTER].rate, sides[tick.MASTER].latency
    law = rig.coupled(rate, latency)
    coupled = tick.CouplingPart(law, engagement, rate, longest, counted=composed)
    return tick.HostLoop(sides, coupled, compensation)
