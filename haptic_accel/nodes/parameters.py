"""The parameters of each node, by the dotted names ROS has for them (no ROS imported)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from haptic_accel.core.actuator import LimitParameters
from haptic_accel.core.compensation import LIMITS, PLANT, CompensationParameters, check_rate
from haptic_accel.core.controllers import CONTROLLERS
from haptic_accel.core.coupling import CouplingParameters
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.inversion.plant import Plant
from haptic_accel.core.parameters import Checked, Schema, from_flat, parameter, schema
from haptic_accel.core.rig.instruments import AccelerometerParameters
from haptic_accel.core.travel import SuspensionParameters
from haptic_accel.core.trial import DEFAULT_RATE
from haptic_accel.devices import MASTERS, SLAVES

HIGHEST_RATE = 20e3
"""Above what any of these nodes can hold, Hz."""


def rate_parameter() -> Any:
    """Declare the sampling rate, which several nodes share."""
    return parameter(
        DEFAULT_RATE,
        "samples per second of devices and compensator (paper: 1 kHz)",
        unit="Hz",
        low=50.0,
        high=HIGHEST_RATE,
    )


def timeout_parameter() -> Any:
    """Declare how long silence is borne, which several nodes share."""
    return parameter(0.1, "silence after which forces go to zero", unit="s", low=0.005, high=10.0)


def trials_parameter() -> Any:
    """Declare how often a handle is excited."""
    return parameter(4, "trials, each of all repeats (paper: four a user)", low=1, high=1000)


@dataclass(frozen=True)
class DeviceNodeParameters(Checked):
    """What both device nodes have."""

    rate: float = rate_parameter()
    seed: int = parameter(0, "of texture and noise of simulated devices", low=0, high=2**31 - 1)
    timeout: float = timeout_parameter()


@dataclass(frozen=True)
class MasterNodeParameters(DeviceNodeParameters):
    """Of `master_device`."""

    device: str = parameter("simulated", "which device", choices=tuple(MASTERS))


@dataclass(frozen=True)
class SlaveNodeParameters(DeviceNodeParameters):
    """Of `slave_device`."""

    device: str = parameter("simulated", "which device", choices=tuple(SLAVES))


@dataclass(frozen=True)
class CouplerNodeParameters(CouplingParameters):
    """Of `coupler`."""

    timeout: float = timeout_parameter()
    duration: float = parameter(
        0.0,
        "time from engaging to the end of the graph; 0 for no end",
        unit="s",
        low=0.0,
        high=1e6,
    )
    listeners: int = parameter(
        1,
        "subscribers of each arm's force to wait for before engaging: its device, a recorder",
        low=0,
        high=100,
    )
    compensated: bool = parameter(
        False, "whether to wait for the compensator's first force before engaging"
    )


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
class RecorderNodeParameters(Checked):
    """Of `recorder`."""

    bag: str = parameter("", "folder to write; empty for bags/<date and time>")
    queue: int = parameter(
        100_000, "messages kept waiting for the disk before some are dropped", low=100
    )


NODES: dict[str, tuple[type[Checked], Mapping[str, type]]] = {
    "recorder": (RecorderNodeParameters, {}),
    "master_device": (MasterNodeParameters, {n: d.Parameters for n, d in MASTERS.items()}),
    "slave_device": (SlaveNodeParameters, {n: d.Parameters for n, d in SLAVES.items()}),
    "coupler": (CouplerNodeParameters, {}),
    "identifier": (
        IdentifierNodeParameters,
        {"suspension": SuspensionParameters, "accelerometer": AccelerometerParameters},
    ),
    "compensator": (
        CompensatorNodeParameters,
        {
            **{name: controller.Parameters for name, controller in CONTROLLERS.items()},
            LIMITS: LimitParameters,
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
