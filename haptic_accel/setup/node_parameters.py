# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of each node, by their dotted ROS names (no ROS imported)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from types import MappingProxyType
from typing import Any

from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core import sampling
from haptic_accel.core.actuator import ActuatorParameters, MasterSafetyParameters, SafetyParameters
from haptic_accel.core.control.compensation import PLANT, CompensationParameters
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.control.filters import check_corner
from haptic_accel.core.coupling.engagement import EngagementParameters
from haptic_accel.core.coupling.passive import CouplingParameters, PassiveParameters
from haptic_accel.core.crtk import PositionServoParameters
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import ACTUATOR, AccelerometerParameters
from haptic_accel.core.network import TRANSPORTS, UDP, host_and_port, is_loopback
from haptic_accel.core.parameters import (
    Checked,
    ParameterError,
    Specification,
    from_flat,
    like,
    parameter,
    schema,
    shown,
)
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import audio
from haptic_accel.devices.interface import MASTERS_GROUP, SLAVES_GROUP, Device
from haptic_accel.devices.registry import MASTERS, SLAVES
from haptic_accel.devices.sound_bench import NO_ARM, BenchOutput, CardAccelerometer

SAFETY = "safety"
"""Name of a device node's safety limits among its devices' parameters."""

USE_SIM_TIME = "use_sim_time"
"""Parameter that ROS gives every node."""

POSITION_SERVO = "servo_cp"
"""Name of the gains of an arm's position control among its devices' parameters."""

SPRING, PASSIVE = "spring", "passive"
"""Couplings of the arms."""

HIGHEST_RATE = 20e3
"""Highest rate that a node accepts, Hz: more than any of the nodes can hold."""


@dataclass(frozen=True)
class SampledParameters(Checked):
    """Sampling rate, which several nodes share."""

    rate: float = parameter(
        sampling.DEFAULT_RATE,
        "sampling rate of devices, coupler and compensator (paper: 1 kHz)",
        unit="Hz",
        low=50.0,
        high=HIGHEST_RATE,
    )


@dataclass(frozen=True)
class DeviceNodeParameters(SampledParameters):
    """Parameters of both device nodes."""

    latency: int = parameter(
        sampling.LATENCY,
        "delay from a sample to the force that it causes, in samples; 0 applies forces on arrival",
        low=0,
        high=sampling.HIGHEST_LATENCY,
    )
    frame: int = parameter(
        1,
        "number of samples that the loop processes together, at the time of the last one; their"
        " forces are due in the next frame",
        low=1,
        high=64,
    )
    seed: int = parameter(
        0, "seed of the simulated devices' texture and sensor noise", low=0, high=2**31 - 1
    )
    accelerometer_device: str = parameter(
        "device",
        "driver of the accelerometer: the device, or the inputs of a sound card",
        choices=("device", audio.AUDIO),
    )
    autostart: bool = parameter(True, "configure and activate at the start, or else by a client")


DRIVER = "driver of the arm"


@dataclass(frozen=True)
class MasterNodeParameters(DeviceNodeParameters):
    """Parameters of the node `master_device`."""

    device: str = parameter("simulated", DRIVER, choices=tuple(MASTERS), group=MASTERS_GROUP)
    actuator_device: str = parameter(
        "device",
        "driver of the actuator: the master device, or a sound card with an amplifier",
        choices=("device", audio.AUDIO),
    )


@dataclass(frozen=True)
class SlaveNodeParameters(DeviceNodeParameters):
    """Parameters of the node `slave_device`."""

    device: str = parameter("simulated", DRIVER, choices=tuple(SLAVES), group=SLAVES_GROUP)


@dataclass(frozen=True)
class RestamperNodeParameters(SampledParameters):
    """Parameters of the node `restamper`."""

    drift: float = parameter(
        0.1,
        "maximum delay of an arrival after its shifted stamp; above, the shift is measured again",
        unit="s",
        low=0.005,
        high=10.0,
    )
    listeners: int = parameter(
        1,
        "number of subscribers to acceleration and position that are required for the report of"
        " readiness",
        low=0,
        high=100,
    )


@dataclass(frozen=True)
class CouplerNodeParameters(CouplingParameters, PassiveParameters, EngagementParameters):
    """Parameters of the node `coupler`, on one host and on each of two."""

    rate: float = like(SampledParameters, "rate")
    latency: int = like(DeviceNodeParameters, "latency")
    coupling: str = parameter(
        SPRING,
        "coupling of the arms: spring (k_m and k_sl), or passive (a spring with an energy tank)",
        choices=(SPRING, PASSIVE),
    )
    side: str = parameter("", "arm that this host has; empty for both", choices=ARMS)
    axes: str = parameter("z", "axes of this host's tool, which cross the network: z, or x, y, z")


@dataclass(frozen=True)
class CompensatorNodeParameters(CompensationParameters):
    """Parameters of the node `compensator`."""

    rate: float = like(SampledParameters, "rate")
    latency: int = like(DeviceNodeParameters, "latency")

    def __post_init__(self) -> None:
        """Check all fields, and the rate against the high-pass."""
        super().__post_init__()
        check_corner(self.rate, self.high_pass_frequency)


@dataclass(frozen=True)
class IdentifierNodeParameters(SweepParameters):
    """Parameters of the node `identifier`."""

    rate: float = like(SampledParameters, "rate")
    latency: int = like(DeviceNodeParameters, "latency", sampling.IDENTIFICATION_LATENCY)
    timeout: float = like(EngagementParameters, "timeout")
    axes: str = like(CompensationParameters, "axes")
    trials: int = parameter(
        4, "number of trials, each of all repeats (paper: four a user)", low=1, high=1000
    )
    rest: float = parameter(
        1.0, "time without force before each trial, for the handle to settle", "s", 0.1, 600.0
    )
    listeners: int = parameter(
        1,
        "number of subscribers of the actuator's force to wait for: the device, a recorder",
        low=1,
        high=100,
    )


@dataclass(frozen=True)
class RecorderNodeParameters(RecordingOptions):
    """Parameters of the node `recorder`."""

    bag: str = parameter("", "folder of the bag to write; empty for bags/<date and time>")
    queue: int = parameter(
        100_000,
        "maximum number of messages that wait for the disk; further ones are dropped",
        low=100,
    )
    facts: str = parameter(
        "", "JSON object with the arguments and parameters of the graph, for the bag"
    )


@dataclass(frozen=True)
class ScopeNodeParameters(Checked):
    """Live page: its address, and whether it controls the graph."""

    host: str = parameter(
        "127.0.0.1",
        "address of the scope's page; any other than this machine's own requires the token",
    )
    # A port that is not registered (IANA), and below those that Linux assigns.
    port: int = parameter(8642, "port of the scope's page; 0 for any free one", low=0, high=65535)
    control: bool = parameter(False, "let the scope's page control the graph, not only show it")
    side: str = like(CouplerNodeParameters, "side")


@dataclass(frozen=True)
class LinkNodeParameters(Checked):
    """Parameters of the node `link`."""

    side: str = parameter("master", "arm of this host", choices=ARMS)
    peer: str = parameter("", "peer host as HOST or HOST:PORT; empty for no link")
    transport: str = parameter(UDP, "transport of datagrams to the peer host", choices=TRANSPORTS)
    keys: str = parameter("", "folder with this host's keys, made by 'haptic-accel keys'")
    insecure: bool = parameter(
        False, "link hosts without keys: anybody with access to the port can then move the arm"
    )

    def __post_init__(self) -> None:
        """Check all fields, the form of the peer's address, and authentication."""
        super().__post_init__()
        if self.peer:
            check_peer(self.peer, self.transport, self.keys, insecure=self.insecure)


def check_peer(peer: str, transport: str, keys: str, *, insecure: bool) -> None:
    """Reject a peer with an invalid address, or without authentication.

    Raises
    ------
    ParameterError
        The message names the parameter and the allowed values.
    """
    host, _ = host_and_port(peer)
    if insecure and (keys or transport != UDP):
        conflict = f"keys:={keys}" if keys else f"transport:={transport}"
        raise ParameterError(f"insecure = True: must not come with {conflict}")
    if not (keys or insecure or (transport == UDP and is_loopback(host))):
        raise ParameterError(
            f"keys = '': must be the folder of this host's keys, as peer {host} is another host;"
            " run haptic-accel keys to make it"
        )


def _kinds(classes: Mapping[str, Any]) -> dict[str, type]:
    """Return the parameters of each kind of device or controller, by its name."""
    return {name: kind.Parameters for name, kind in classes.items()}


def _device_parts(devices: Mapping[str, Any], safety: type) -> dict[str, type]:
    """Return the parameters of a device node's parts, by name."""
    own = {name: kind for name, kind in devices.items() if not kind.description.parameters_of}
    return {**_kinds(own), SAFETY: safety, POSITION_SERVO: PositionServoParameters}


_DRIVERS: dict[str, Any] = {"master_device": MASTERS, "slave_device": SLAVES}

NODES: dict[str, tuple[type[Checked], Mapping[str, type]]] = {
    "recorder": (RecorderNodeParameters, {}),
    "scope": (ScopeNodeParameters, {}),
    "master_device": (
        MasterNodeParameters,
        {**_device_parts(MASTERS, MasterSafetyParameters), audio.AUDIO: audio.AudioParameters},
    ),
    "slave_device": (
        SlaveNodeParameters,
        {**_device_parts(SLAVES, SafetyParameters), audio.AUDIO: audio.InputParameters},
    ),
    "restamper": (RestamperNodeParameters, {}),
    "coupler": (CouplerNodeParameters, {}),
    "link": (LinkNodeParameters, {}),
    "identifier": (
        IdentifierNodeParameters,
        {ACTUATOR: ActuatorParameters, "accelerometer": AccelerometerParameters},
    ),
    "compensator": (
        CompensatorNodeParameters,
        {**_kinds(CONTROLLERS), ACTUATOR: ActuatorParameters, PLANT: Plant},
    ),
}
"""Own parameters of each node, and those of its possible devices or controllers, by name."""


@cache
def node_schema(executable: str) -> Mapping[str, tuple[Any, Specification]]:
    """Return default and specification of every parameter of a node, by dotted name."""
    own, options = NODES[executable]
    found = schema(own)
    for name, option in options.items():
        found |= schema(option, name + ".")
    return MappingProxyType(found)


def declared_schema(executable: str, own: Any) -> Mapping[str, tuple[Any, Specification]]:
    """Return `node_schema` without options that a device node with these parameters lacks."""
    if executable not in _DRIVERS:
        return node_schema(executable)
    used = {SAFETY, POSITION_SERVO, own.accelerometer_device, getattr(own, "actuator_device", "")}
    used.update(_DRIVERS[executable][own.device].description.owners(own.device))
    unused = NODES[executable][1].keys() - used
    known = node_schema(executable).items()
    return {name: each for name, each in known if name.partition(".")[0] not in unused}


def build_parameters(executable: str, values: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Build the parameters of a node, and of its options by name.

    Parameters
    ----------
    executable : str
        A key of `NODES`.
    values : mapping
        Values by dotted name; missing parameters have their default.

    Raises
    ------
    ParameterError
        A value is not allowed.
    """
    kind, kinds = NODES[executable]
    own: Any = from_flat(kind, values)
    options: dict[str, Any] = {n: from_flat(part, values, f"{n}.") for n, part in kinds.items()}
    if executable in _DRIVERS:
        _check_age(own, options[SAFETY])
        _check_frame(own, _DRIVERS[executable])
    return own, options


def build_device(executable: str, own: Any, options: Mapping[str, Any]) -> Device:
    """Build the device of a device node, with its actuator.

    Parameters
    ----------
    executable : str
        ``master_device`` or ``slave_device``.
    own, options
        Result of `build_parameters`.

    Raises
    ------
    DeviceError, ParameterError
        The device's library is missing, or its parameters are unusable.
    """
    kind = _DRIVERS[executable][own.device]
    device: Device = kind.from_options(own.device, options, own.rate, own.seed)
    card: Callable[[audio.AudioParameters, float, int], audio.SoundCard] = audio.SoundCard
    if own.accelerometer_device == audio.AUDIO:
        is_tool = executable == "slave_device"
        device = sensor = CardAccelerometer(options[audio.AUDIO], own.rate, device, is_tool)
        card = partial(BenchOutput, sensor=sensor)
    elif own.device == NO_ARM:
        raise ParameterError(f"device = {NO_ARM}: must come with accelerometers:={audio.AUDIO}")
    if getattr(own, "actuator_device", "") != audio.AUDIO:
        return device
    return audio.AudioActuator(options[audio.AUDIO], own.rate, device, own.latency, card=card)


def check_clock(use_sim_time: object) -> None:
    """Refuse simulated time.

    Raises
    ------
    ParameterError
        The value of `USE_SIM_TIME` is not false.
    """
    if use_sim_time is not False:
        raise ParameterError(
            f"{USE_SIM_TIME} = {shown(str(use_sim_time))}: must be false: simulated time is not"
            " supported; samples and forces use this machine's clock"
        )


def _check_frame(own: Any, kinds: Mapping[str, type[Device]]) -> None:
    """Refuse a frame that the device, the rate or the latency does not allow."""
    frame = own.frame
    if frame == 1:
        return
    device, actuator = own.device, getattr(own, "actuator_device", "device")
    if not kinds[device].description.framed or actuator == audio.AUDIO:
        able = ", ".join(name for name, kind in kinds.items() if kind.description.framed)
        driver = audio.AUDIO if actuator == audio.AUDIO else device
        raise ParameterError(
            f"frame = {frame}: must be 1 with the device {driver}, which takes no forces ahead of"
            f" time; {able} do"
        )
    if own.rate % frame:
        raise ParameterError(
            f"frame = {frame}: must divide rate = {own.rate:g} Hz into whole frames a second"
        )
    if own.latency <= frame:
        least = frame + 1
        raise ParameterError(
            f"latency = {own.latency}: must be at least {least} samples,"
            f" {1e3 * least / own.rate:g} ms, with frame = {frame}: the frame and a sample for the"
            " computation"
        )


def _check_age(device: DeviceNodeParameters, safety: Any) -> None:
    """Refuse a latency at which the safety layer would refuse every force as outdated."""
    age = device.latency / device.rate
    for force in ("arm", "actuator"):
        limits = getattr(safety, force, None)
        if limits and age >= limits.max_age:
            raise ParameterError(
                f"latency = {device.latency}: {age:g} s at rate = {device.rate:g} Hz, must be"
                f" below {SAFETY}.{force}.max_age = {limits.max_age:g} s"
            )
