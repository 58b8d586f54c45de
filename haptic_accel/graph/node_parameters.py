"""The parameters of each node, by the dotted names ROS has for them (no ROS imported)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.actuator.safety import MasterSafetyParameters, SafetyParameters
from haptic_accel.core.control.compensation import (
    PLANT,
    CompensationParameters,
    check_rate,
)
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.control.inversion.plant import Plant
from haptic_accel.core.coupling.engagement import EngagementParameters, timeout_parameter
from haptic_accel.core.coupling.position_position import CouplingParameters
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import ACTUATOR, AccelerometerParameters
from haptic_accel.core.parameters import Checked, Schema, from_flat, parameter, schema
from haptic_accel.core.trial import DEFAULT_RATE
from haptic_accel.devices import MASTERS, SLAVES

SAFETY = "safety"
"""Name of the limits of a device node, among its devices' parameters."""

HIGHEST_RATE = 20e3
"""Above what any of these nodes can hold, Hz."""

SCOPE_HOST = "127.0.0.1"
"""Where only this machine reaches it."""

SCOPE_PORT = 8642
"""Registered for nothing (IANA), and below those that Linux hands out."""


def rate_parameter() -> Any:
    """Declare the sampling rate, which several nodes share."""
    return parameter(
        DEFAULT_RATE,
        "samples per second of devices and compensator (paper: 1 kHz)",
        unit="Hz",
        low=50.0,
        high=HIGHEST_RATE,
    )


def scope_host_parameter() -> Any:
    """Declare where the live scope listens."""
    return parameter(
        SCOPE_HOST,
        "address the scope's page is served on; others than this machine's own need its token",
    )


def scope_port_parameter() -> Any:
    """Declare the port of the live scope."""
    return parameter(SCOPE_PORT, "of the scope's page; 0 for any that is free", low=0, high=65535)


def scope_control_parameter() -> Any:
    """Declare whether the live scope may act."""
    return parameter(False, "whether the scope's page may control the graph, not only show it")


def trials_parameter() -> Any:
    """Declare how often a handle is excited."""
    return parameter(4, "trials, each of all repeats (paper: four a user)", low=1, high=1000)


@dataclass(frozen=True)
class DeviceNodeParameters(Checked):
    """What both device nodes have."""

    rate: float = rate_parameter()
    seed: int = parameter(0, "of texture and noise of simulated devices", low=0, high=2**31 - 1)
    autostart: bool = parameter(
        True, "whether to configure and activate by itself, or wait for `ros2 lifecycle`"
    )


@dataclass(frozen=True)
class MasterNodeParameters(DeviceNodeParameters):
    """Of `master_device`."""

    device: str = parameter("simulated", "which device", choices=tuple(MASTERS))


@dataclass(frozen=True)
class SlaveNodeParameters(DeviceNodeParameters):
    """Of `slave_device`."""

    device: str = parameter("simulated", "which device", choices=tuple(SLAVES))


@dataclass(frozen=True)
class RestamperNodeParameters(Checked):
    """Of `restamper`."""

    rate: float = rate_parameter()
    drift: float = parameter(
        0.1,
        "of a stamp behind its arrival, from which on stamps are moved anew",
        unit="s",
        low=0.005,
        high=10.0,
    )
    listeners: int = parameter(
        1,
        "subscribers of acceleration and position to wait for before saying that all is ready",
        low=0,
        high=100,
    )


@dataclass(frozen=True)
class CouplerNodeParameters(CouplingParameters, EngagementParameters):
    """Parameters of the node `coupler`."""


@dataclass(frozen=True)
class CompensatorNodeParameters(CompensationParameters):
    """Of `compensator`."""

    rate: float = rate_parameter()

    def __post_init__(self) -> None:
        """Check all fields, and the rate against the high-pass."""
        super().__post_init__()
        check_rate(self, self.rate)


@dataclass(frozen=True)
class IdentifierNodeParameters(SweepParameters):
    """Of `identifier`."""

    rate: float = rate_parameter()
    timeout: float = timeout_parameter()
    trials: int = trials_parameter()
    rest: float = parameter(
        1.0, "without force before each trial: the handle settles", unit="s", low=0.1, high=600.0
    )
    listeners: int = parameter(
        1,
        "subscribers of the actuator's force to wait for: the device, a recorder",
        low=1,
        high=100,
    )
    travel_share: float = parameter(
        0.95, "of the free travel, at which a trial is ended", low=0, high=1.0, above=True
    )


@dataclass(frozen=True)
class RecorderNodeParameters(RecordingOptions):
    """Of `recorder`."""

    bag: str = parameter("", "folder to write; empty for bags/<date and time>")
    queue: int = parameter(
        100_000, "messages kept waiting for the disk before some are dropped", low=100
    )
    facts: str = parameter(
        "", "JSON object with the arguments and parameters of the graph, for the bag"
    )


@dataclass(frozen=True)
class ScopeNodeParameters(Checked):
    """Of `scope`."""

    host: str = scope_host_parameter()
    port: int = scope_port_parameter()
    control: bool = scope_control_parameter()


NODES: dict[str, tuple[type[Checked], Mapping[str, type]]] = {
    "recorder": (RecorderNodeParameters, {}),
    "scope": (ScopeNodeParameters, {}),
    "master_device": (
        MasterNodeParameters,
        {**{n: d.Parameters for n, d in MASTERS.items()}, SAFETY: MasterSafetyParameters},
    ),
    "slave_device": (
        SlaveNodeParameters,
        {**{n: d.Parameters for n, d in SLAVES.items()}, SAFETY: SafetyParameters},
    ),
    "restamper": (RestamperNodeParameters, {}),
    "coupler": (CouplerNodeParameters, {}),
    "identifier": (
        IdentifierNodeParameters,
        {ACTUATOR: ActuatorParameters, "accelerometer": AccelerometerParameters},
    ),
    "compensator": (
        CompensatorNodeParameters,
        {
            **{name: controller.Parameters for name, controller in CONTROLLERS.items()},
            ACTUATOR: ActuatorParameters,
            PLANT: Plant,
        },
    ),
}
"""Per executable its own parameters, and those of what it can be made of, by name."""


def node_schema(executable: str) -> Schema:
    """Return default and specification of every parameter of a node, by dotted name."""
    own, options = NODES[executable]
    found = schema(own)
    for name, option in options.items():
        found |= schema(option, name + ".")
    return found


def node_parameters(executable: str, values: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Build a node's own parameters, and those of its options by name.

    Parameters
    ----------
    executable : str
        A key of `NODES`.
    values : mapping
        Values by dotted name; missing ones keep their default.

    Raises
    ------
    ParameterError
        A value that is not allowed.
    """
    own, options = NODES[executable]
    return from_flat(own, values), {
        name: from_flat(option, values, name + ".") for name, option in options.items()
    }
