# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments of the graph: ``key:=value``, the same for all commands."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from haptic_accel.core.axes import ALL_AXES, Axes
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.parameters import (
    Checked,
    ParameterError,
    checked,
    like,
    parameter,
    read_decimal,
    schema,
    specified,
)
from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.devices.registry import SLAVES
from haptic_accel.materials.folders import is_recording, preset_file
from haptic_accel.setup.files import parameter_paths, read_parameter_file, read_parameter_files
from haptic_accel.setup.node_parameters import (
    NODES,
    PASSIVE,
    LinkNodeParameters,
    check_peer,
    node_schema,
)
from haptic_accel.setup.words import NamespaceArguments, parse_assignments

L = TypeVar("L", bound="LaunchArguments")

AVERAGE_GRIP = "average"
"""Grip of Table I."""

REPLAY = "replay"
"""Name of the devices that play a recording."""

SIMULATED = "simulated"
"""Name of the devices of the virtual rig."""

POINTER = "pointer"
"""Name of the simulated master whose hand the live page leads."""

SURFACES = ("plywood", "text", "vinyl")
"""The paper's surfaces."""

WORKSHOP = "workshop"
"""Default scene under the virtual slave."""

LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
"""Severities of messages in ROS 2."""

VIRTUAL = "virtual"
"""Name of the slave device whose tool touches a scene."""

CRTK = "crtk"
"""Prefix of device names whose arm another node controls; that node may lack a watchdog."""

SCENE = f"{VIRTUAL}.scene"
"""Parameter of `slave_device`: file of the scene."""

TOOL_AXES = "tool.axes"
"""Parameter of the simulated slave devices: axes that the tool measures."""

RECORDING = f"{SIMULATED}.recording.file"
"""Parameter of `slave_device`: file of the recorded acceleration."""

PLAYED_TOPICS = "topics"
"""Device name for topics that `ros2 bag play` publishes in place of a slave device."""


THREE_AXIS_SWEEP = {"start_frequency": 8.0, "end_frequency": 450.0, "duration": 1.0, "trials": 2}
"""Default excitation of three coils: the band of the coupling, in the time that one coil takes
(Hz, s)."""


LATENCY_TEXT = (
    "delay from a sample to the force that it causes, in samples, or in ms with the unit: 2ms; 0"
    " applies forces on arrival"
)
"""Description of the argument `latency`; parameter files have a whole number of samples."""


def sets(*targets: str, **changes: Any) -> Any:
    """Declare an argument that sets parameters of nodes.

    Parameters
    ----------
    targets : str
        Node and dotted parameter name, joined by a dot; the argument has the default and the
        specification of the first target.
    changes
        Changed attributes of the specification.
    """
    node, _, name = targets[0].partition(".")
    default, specification = node_schema(node)[name]
    return specified(default, replace(specification, sets=targets, **changes))


def everywhere(name: str) -> list[str]:
    """Return the targets of a parameter in all nodes that have it."""
    return [f"{node}.{name}" for node in NODES if name in node_schema(node)]


def in_devices(*names: str) -> list[str]:
    """Return the targets of parameters in both device nodes."""
    return [f"{arm}_device.{name}" for arm in ("master", "slave") for name in names]


@dataclass(frozen=True)
class ConditionArguments(Checked):
    """Controller and simulated rig."""

    controller: str = sets(
        "compensator.controller",
        text="controller of the actuator's force; with master:=pointer, adaptive if neither given"
        " nor in a parameter file",
    )
    reduction: str = sets(
        "compensator.reduction",
        text="reduction of the tool's three axes to one, which moves the coil along z alone: none"
        " (all axes that the handle has), component along z, sum, or component along the strongest"
        " vibration; with one, a simulated tool measures three axes",
        yields=True,
    )
    rig: str = parameter(
        "paper", "virtual rig: ideal, paper, three_axis_ideal, three_axis, or a .yaml file"
    )
    grip: str = sets(
        "master_device.simulated.grip.posture",
        text="grip of the simulated hand on the handle",
        yields=True,
    )
    surface: str = parameter(
        "",
        f"surface under the tool: {', '.join(SURFACES)}, a .yaml file, or a .csv or .wav file of"
        f" its acceleration in m/s^2; empty for {SURFACES[0]} under a simulated tool, and for an"
        " unknown one under a real tool; with slave:=virtual a scene, workshop by default, or a"
        " .yaml file",
    )
    recording_rate: float = sets(
        "slave_device.simulated.recording.rate",
        *in_devices("replay.rate"),
        text="rate of a CSV recording without a column of times; other files have their own",
        yields=True,
    )
    recording_column: str = sets(
        "slave_device.simulated.recording.column",
        *in_devices("replay.column"),
        text="column of a CSV recording; empty for acceleration, accel, acc or a; with"
        " surface:=FILE also three for x, y and z, as ax,ay,az",
        yields=True,
    )
    seed: int = sets(*in_devices("seed"))


@dataclass(frozen=True)
class DeviceArguments(Checked):
    """Devices, and the recording that they play."""

    master: str = sets("master_device.device", text="master device")
    actuator: str = sets("master_device.actuator_device")
    accelerometers: str = sets(*in_devices("accelerometer_device"))
    slave: str = sets(
        "slave_device.device",
        text="slave device, or the topics that `ros2 bag play` publishes",
        choices=(*SLAVES, PLAYED_TOPICS),
    )
    replay: str = sets(
        *in_devices("replay.file"),
        text="bag, or CSV or WAV file, to play with slave:=replay or master:=replay",
        yields=True,
        path=True,
    )
    replay_speed: float = sets(*in_devices("replay.speed"), yields=True)
    replay_loop: bool = sets(*in_devices("replay.loop"), yields=True)
    replay_start: float = sets(*in_devices("replay.start"), yields=True)


@dataclass(frozen=True)
class NetworkArguments(Checked):
    """Coupling, and the peer host."""

    coupling: str = sets("coupler.coupling")
    side: str = sets(*everywhere("side"))
    peer: str = sets("link.peer")
    transport: str = sets("link.transport")
    keys: str = sets("link.keys", path=True)
    insecure: bool = sets("link.insecure")

    def __post_init__(self) -> None:
        """Check all fields and their combination; two hosts need the passive coupling."""
        super().__post_init__()
        if self.side and not self.peer:
            raise ParameterError(f"side = {self.side!r}: must come with peer:=HOST")
        if not self.peer:
            for name in ("transport", "keys", "insecure"):
                if (value := getattr(self, name)) != schema(LinkNodeParameters)[name][0]:
                    raise ParameterError(f"{name} = {value!r}: must come with peer:=HOST")
            return
        if not self.side:
            raise ParameterError(f"peer = {self.peer!r}: must come with side:=master or slave")
        check_peer(self.peer, self.transport, self.keys, insecure=self.insecure)
        object.__setattr__(self, "coupling", PASSIVE)


@dataclass(frozen=True)
class LaunchArguments(NamespaceArguments):
    """Launch."""

    namespace: str = like(NamespaceArguments, "namespace")  # declared again for its heading
    params_file: str = parameter(
        "",
        "ROS parameter files, separated by commas, applied over config/teleop.yaml in order; they"
        " also decide arguments that are not given, such as the devices and the rate",
    )
    log_level: str = parameter(
        "info", "lowest severity of messages that nodes log", choices=LOG_LEVELS
    )

    @classmethod
    def from_specified(cls: type[L], **specified: Any) -> L:
        """Build from the specified arguments; parameter files decide the others.

        Raises
        ------
        ParameterError
            A file cannot be read, or a value is not allowed.
        """
        return cls(**cls.filled(specified))

    @classmethod
    def filled(cls, given: dict[str, Any]) -> dict[str, Any]:
        """Return the specified arguments, and those that their parameter files decide.

        Raises
        ------
        ParameterError
            As for `from_specified`.
        """
        decided: dict[str, Any] = {}
        namespace = NamespaceArguments(given.get("namespace", "")).namespace
        for path, values in read_parameter_files(given.get("params_file", ""), namespace):
            for name, (default, specification) in schema(cls).items():
                targets = _decisive(default, specification.sets)
                found = [target for target in targets if target[1] in values[target[0]]]
                for node, key in found[:1]:
                    target = f"{path}: {key} of {node}"
                    decided[name] = checked(target, values[node][key], default, specification)
        known = decided | given
        if isinstance(latency := known.get("latency"), str):
            rate = known.get("rate", DEFAULT_RATE)
            if isinstance(rate, (int, float)) and rate > 0:  # other values are refused later
                known["latency"] = _samples(latency, rate)
        return known


@dataclass(frozen=True)
class RunArguments(LaunchArguments):
    """Graph: its rate, duration and processes."""

    rate: float = sets(*everywhere("rate"))
    latency: int = sets(*everywhere("latency"), text=LATENCY_TEXT)
    frame: int = sets(*everywhere("frame"))
    duration: float = sets("coupler.duration")
    composed: bool = parameter(
        True,
        "run all nodes that compute forces in one process, which suits two cores; false gives"
        " each node its own process, as always with respawn:=true, slave:=topics or a CRTK"
        " arm",
    )
    respawn: bool = parameter(
        False, "restart failed nodes, except recorder and scope, instead of ending the graph"
    )


@dataclass(frozen=True)
class PageArguments(Checked):
    """Live page."""

    scope: bool = parameter(False, "serve a page that shows the graph while it runs")
    scope_port: int = sets("scope.port")
    scope_control: bool = sets("scope.control")


@dataclass(frozen=True)
class BagArguments(Checked):
    """Recording."""

    record: bool = parameter(True, "record every topic")
    bag: str = sets("recorder.bag", path=True)
    topics: str = sets("recorder.topics", yields=True)


@dataclass(frozen=True)
class GraphArguments(
    ConditionArguments,
    DeviceArguments,
    NetworkArguments,
    RunArguments,
    PageArguments,
    BagArguments,
):
    """Arguments of the graph."""

    def __post_init__(self) -> None:
        """Check all fields, and that the slave's tool can touch the surface.

        Some graphs need a process for each node: a restarted node learns of an emergency stop from
        other nodes; played topics have no device; and if nothing else removes an arm's force, only
        a fault of the arm's own node may leave the force on.
        """
        super().__post_init__()
        unwatched = self.master.startswith(CRTK) or self.slave.startswith(CRTK)
        if self.respawn or self.slave == PLAYED_TOPICS or unwatched:
            object.__setattr__(self, "composed", False)
        if self.frame > 1 and (self.side or not self.composed):
            alone = f"side:={self.side}" if self.side else "composed:=false"
            raise ParameterError(f"frame = {self.frame}: must be 1 with {alone}")
        default = {SIMULATED: SURFACES[0], VIRTUAL: WORKSHOP}.get(self.slave, "")
        object.__setattr__(self, "surface", self.surface or default)
        if is_recording(self.surface) and self.slave != SIMULATED:
            raise ParameterError(
                f"surface = {self.surface!r}: a recording must come with slave:={SIMULATED}"
            )

    @classmethod
    def from_specified(cls: type[L], **specified: Any) -> L:
        """Build as `LaunchArguments` does, with the best defaults for a page's hand."""
        known = cls.filled(specified)
        if known.get("master") == POINTER:  # the controller with the least error for a page's hand
            known = {"controller": "adaptive"} | known
        return cls(**known)


@dataclass(frozen=True)
class IdentifyArguments(SweepParameters, LaunchArguments):
    """Identification: its trials, and the graph that runs."""

    trials: int = sets("identifier.trials")
    rig: str = like(GraphArguments, "rig")
    grip: str = like(GraphArguments, "grip")
    master: str = like(GraphArguments, "master")
    actuator: str = like(GraphArguments, "actuator")
    accelerometers: str = like(GraphArguments, "accelerometers")
    rate: float = like(GraphArguments, "rate")
    latency: int = sets("identifier.latency", *everywhere("latency"), text=LATENCY_TEXT)
    bag: str = like(GraphArguments, "bag")
    topics: str = like(GraphArguments, "topics")
    seed: int = like(GraphArguments, "seed")

    @classmethod
    def from_specified(cls, **specified: Any) -> IdentifyArguments:
        """Build as `LaunchArguments` does, with defaults for three coils."""
        known = cls.filled(specified)
        files = [preset_file("rig", str(known.get("rig", cls.rig)))]
        files += parameter_paths(known.get("params_file", ""))
        axes = [read_parameter_file(path)["compensator"].get("axes") for path in files]
        if any(each and Axes.parsed(each) == ALL_AXES for each in axes):
            known = THREE_AXIS_SWEEP | known
        return cls(**known)

    @property
    def sweep(self) -> SweepParameters:
        """Parameters of the excitation."""
        return SweepParameters(**{name: getattr(self, name) for name in schema(SweepParameters)})


def _samples(text: str, rate: float) -> int | str:
    """Return a latency with the unit ms in samples; other text is unchanged and refused later.

    Raises
    ------
    ParameterError
        The latency is no whole number of samples.
    """
    number = text.removesuffix("ms")
    if number == text:
        return text
    try:
        samples = read_decimal(number) * 1e-3 * rate
    except ValueError:
        return text
    if abs(samples - round(samples)) > 1e-6:
        low = math.floor(samples)
        allowed = " or ".join(f"{1e3 * each / rate:g}ms" for each in (low, low + 1))
        raise ParameterError(
            f"latency = {text}: {samples:g} samples at {rate:g} Hz, must be a whole number of"
            f" samples, such as {allowed}"
        )
    return round(samples)


def assigned(arguments: LaunchArguments) -> list[str]:
    """Return as ``key:=value`` the arguments that differ from defaults and files.

    Examples
    --------
    >>> assigned(GraphArguments(rate=500.0, composed=False))
    ['rate:=500', 'composed:=false']
    """
    files = {"params_file": arguments.params_file, "namespace": arguments.namespace}
    known = type(arguments).from_specified(**{key: each for key, each in files.items() if each})
    values = {name: getattr(arguments, name) for name in schema(type(arguments))}
    rest = {name: value for name, value in values.items() if value != getattr(known, name)}
    return [
        f"{name}:={_text(value)}" for name, value in ({**files, **rest}).items() if value != ""
    ]


def _text(value: Any) -> str:
    """Return a value as text of ``key:=value``."""
    if isinstance(value, bool):
        return str(value).lower()
    short = f"{value:g}" if isinstance(value, float) else str(value)
    return short if not isinstance(value, float) or float(short) == value else str(value)


def _decisive(default: Any, targets: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield node and parameter of the targets whose value in a file decides an argument.

    A target with another default, such as the latency of the devices for an identification, is set
    by the argument but does not decide it.
    """
    for target in targets:
        node, _, name = target.partition(".")
        if node_schema(node)[name][0] == default:
            yield node, name


def check_lockstep(
    arguments: GraphArguments, where: str, slaves: Sequence[str] = (SIMULATED, VIRTUAL)
) -> None:
    """Refuse a device that cannot run in lockstep, or a slave that is not allowed.

    Raises
    ------
    ParameterError
        The message names the device and the allowed ones, and ends with `where`.
    """
    for arm, allowed in (("master", [SIMULATED]), ("slave", slaves)):
        if (device := getattr(arguments, arm)) not in allowed:
            raise ParameterError(f"{arm} = {device!r}: must be {' or '.join(allowed)} {where}")


def check_both_arms(arguments: GraphArguments) -> None:
    """Refuse a graph with only one arm.

    Raises
    ------
    ParameterError
        The message names the side.
    """
    if arguments.side:
        raise ParameterError(f"side = {arguments.side!r}: must be empty, as both arms are needed")


def parse_arguments(words: Iterable[str]) -> GraphArguments:
    """Read the graph's arguments from ``key:=value`` texts; see `parse_assignments`."""
    return parse_assignments(words, GraphArguments)
