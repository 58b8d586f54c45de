"""The processes of the graph and their parameters, for given arguments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from haptic_accel.bags.facts import facts_text
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core.identification.sweep import repeat_samples
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.trial import RigParameters
from haptic_accel.devices import MASTERS, SLAVES
from haptic_accel.devices.simulated import played
from haptic_accel.graph.arguments import (
    AVERAGE_GRIP,
    PLAYED_TOPICS,
    RECORDING,
    REPLAY,
    SIMULATED,
    GraphArguments,
    IdentifyArguments,
)
from haptic_accel.graph.files import config_folder, read_parameter_file, rig_file, surface_file
from haptic_accel.graph.node_parameters import NODES, node_parameters, node_schema

RECORDER = "recorder"
"""Executable that writes the bag."""

SCOPE = "scope"
"""Executable that shows the graph."""

COMPOSED = "composed"
"""Executable that runs all nodes but the recorder in one process."""


@dataclass(frozen=True)
class Process:
    """One process of the graph.

    Attributes
    ----------
    executable : str
        Its name in this package.
    parameter_files : tuple of Path
        ROS parameter files, later ones over earlier ones.
    parameters : dict
        ROS parameters over those of the files: by node, then by dotted name.
    last : bool
        Stop it after the others, whose last messages it records.
    optional : bool
        The graph goes on when it ends.
    namespace : str
        Namespace of its only node and of the topics, with a slash before; empty for the root.
    """

    executable: str
    parameter_files: tuple[Path, ...]
    parameters: dict[str, dict[str, Any]]
    last: bool = False
    optional: bool = False
    namespace: str = ""

    @property
    def ros_arguments(self) -> list[str]:
        """Words of its command line that are for ROS."""
        words = ["--ros-args"]
        for path in self.parameter_files:
            words += ["--params-file", str(path)]
        for node, parameters in self.parameters.items():
            for name, value in parameters.items():
                # Of a node in a namespace, a word cannot say the name.
                to = "" if self.namespace else f"{node}:"
                words += ["-p", f"{to}{name}:={_yaml(value)}"]
        if self.namespace:
            words += ["-r", f"__ns:={self.namespace}"]
        return words


def _yaml(value: Any) -> str:
    """Write a value as ROS reads it back: text quoted, so that it stays text."""
    if isinstance(value, str):
        return str(yaml.safe_dump(value, default_style='"', width=2**31)).strip()
    return str(value).lower() if isinstance(value, bool) else repr(value)


def graph(arguments: GraphArguments) -> list[Process]:
    """Return the processes that make up the graph, with everything checked beforehand.

    Raises
    ------
    ParameterError
        A surface, file or parameter is not usable.
    """
    values = graph_parameters(arguments)
    options = _checked_options(values)
    _check_recording(arguments, options["slave_device"])
    _check_replay(arguments, options)
    own = _own_parameters(arguments)
    return _processes(arguments, values, own, composed=arguments.composed)


def identification_graph(arguments: IdentifyArguments) -> list[Process]:
    """Return the processes that excite a handle and record it, everything checked beforehand.

    Raises
    ------
    ParameterError
        A file or parameter is not usable.
    """
    values = graph_parameters(arguments)
    _checked_options(values)
    repeat_samples(arguments.sweep, arguments.rate)  # the rate must do for the sweep
    # What the identifier takes from the simulated handle, no file gives it by its name.
    own = _own_parameters(arguments) | {"identifier": values["identifier"]}
    return _processes(arguments, values, own)


def _processes(
    arguments: GraphArguments | IdentifyArguments,
    values: Mapping[str, Mapping[str, Any]],
    own: dict[str, dict[str, Any]],
    *,
    composed: bool = False,
) -> list[Process]:
    """Return the processes for the parameters of their own, by executable."""
    files = tuple(_files(arguments))
    recorder, scope = own.pop(RECORDER, None), own.pop(SCOPE, None)
    processes = [Process(name, files, {name: given}) for name, given in own.items()]
    if composed:
        processes = [Process(COMPOSED, files, own)]
    if recorder is not None:
        recorder["facts"] = _facts(arguments, values, own)
        # First, so that it misses as little as can be of the others.
        processes.insert(0, Process(RECORDER, files, {RECORDER: recorder}, last=True))
    if scope is not None:
        # Last, as what makes the forces need not wait for it.
        processes.append(scope_process(scope, files))
    return processes


def _checked_options(values: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Check every parameter of every node; return their options by executable and name."""
    return {executable: node_parameters(executable, values[executable])[1] for executable in NODES}


def _facts(
    arguments: GraphArguments | IdentifyArguments,
    values: Mapping[str, Mapping[str, Any]],
    nodes: Iterable[str],
) -> str:
    """Return the facts for the bag: the graph's arguments, and every value of its nodes."""
    effective = {
        node: {
            name: values[node].get(name, default)
            for name, (default, _) in node_schema(node).items()
        }
        for node in nodes
    }
    return facts_text(asdict(arguments), effective)


def scope_process(
    parameters: dict[str, Any], files: tuple[Path, ...] = (), namespace: str = ""
) -> Process:
    """Return the process that shows a graph; it may end and the graph goes on."""
    return Process(SCOPE, files, {SCOPE: parameters}, optional=True, namespace=namespace)


def graph_parameters(
    arguments: GraphArguments | IdentifyArguments,
) -> dict[str, dict[str, Any]]:
    """Return the values that files and arguments give each node, by dotted name."""
    values: dict[str, dict[str, Any]] = {executable: {} for executable in NODES}
    for path in _files(arguments):
        content = read_parameter_file(path)
        for executable in NODES:
            values[executable] |= content[executable]
    for executable, own in _own_parameters(arguments).items():
        values[executable] |= own
    if arguments.master == SIMULATED:
        # A simulated handle needs no bench to measure its sensor on.
        values["identifier"] = _bench_values(values["master_device"]) | values["identifier"]
    return values


def _bench_values(master: Mapping[str, Any]) -> dict[str, Any]:
    """Return the simulated handle's values that an identifier needs, by dotted name."""
    _, devices = node_parameters("master_device", master)
    sensor = asdict(devices[SIMULATED].accelerometer)
    return {f"accelerometer.{name}": value for name, value in sensor.items()}


def rig_parameters(values: Mapping[str, Mapping[str, Any]]) -> RigParameters:
    """Return the virtual rig that the simulated devices of a graph make up.

    Parameters
    ----------
    values : mapping
        As `graph_parameters` gives them.
    """
    _, masters = node_parameters("master_device", values["master_device"])
    _, slaves = node_parameters("slave_device", values["slave_device"])
    coupling, _ = node_parameters("coupler", values["coupler"])
    return RigParameters(masters["simulated"], slaves["simulated"], coupling)


def _files(arguments: GraphArguments | IdentifyArguments) -> list[Path]:
    """Return the parameter files in the order in which they count."""
    paths = [config_folder() / "teleop.yaml", rig_file(arguments.rig)]
    if isinstance(arguments, GraphArguments):
        paths.append(surface_file(arguments.surface))
    if arguments.config:
        paths.append(Path(arguments.config).absolute())
    return paths


def _own_parameters(
    arguments: GraphArguments | IdentifyArguments,
) -> dict[str, dict[str, Any]]:
    """Return the parameters that arguments set, by executable."""
    sampled = {"rate": arguments.rate}
    device = {**sampled, "seed": arguments.seed}
    master = {**device, "device": arguments.master}
    if arguments.grip != AVERAGE_GRIP:  # which a file may change
        master[f"{SIMULATED}.grip.posture"] = arguments.grip
    recorder = {"bag": arguments.bag and _absolute(arguments.bag)}
    for name, (default, _) in schema(RecordingOptions).items():
        if getattr(arguments, name) != default:  # which a file may change
            recorder[name] = getattr(arguments, name)
    if isinstance(arguments, IdentifyArguments):
        procedure = {**asdict(arguments.sweep), "trials": arguments.trials, "listeners": 2}
        return {
            "master_device": master,
            "identifier": {**sampled, **procedure},
            RECORDER: recorder,
        }
    recording = {}
    if arguments.surface == RECORDING:
        recording = {
            "simulated.recording.file": arguments.recording and _absolute(arguments.recording),
            "simulated.recording.rate": arguments.recording_rate,
            "simulated.recording.column": arguments.recording_column,
        }
    slave = {**device, "device": arguments.slave, **recording, **_replay(arguments)}
    # Of each signal: the node that it is for, and the recorder.
    listeners = 2 if arguments.record else 1
    restamper = {**sampled, "listeners": listeners}
    from_topics = arguments.slave == PLAYED_TOPICS
    page = {
        "host": arguments.scope_host,
        "port": arguments.scope_port,
        "control": arguments.scope_control,
    }
    return {
        "master_device": master | _replay(arguments),
        **({"restamper": restamper} if from_topics else {"slave_device": slave}),
        "coupler": {
            "duration": arguments.duration,
            # The hand starts to explore when the arms engage: all others must be there.
            "compensated": True,
            "listeners": listeners,
        },
        "compensator": {**sampled, "controller": arguments.controller},
        **({RECORDER: recorder} if arguments.record else {}),
        **({SCOPE: page} if arguments.scope else {}),
    }


def _replay(arguments: GraphArguments) -> dict[str, Any]:
    """Return the parameters of the devices that play a recording, if there is one."""
    if not arguments.replay:
        return {}
    return {
        f"{REPLAY}.file": _absolute(arguments.replay),
        f"{REPLAY}.rate": arguments.recording_rate,
        f"{REPLAY}.column": arguments.recording_column,
        f"{REPLAY}.speed": arguments.replay_speed,
        f"{REPLAY}.loop": arguments.replay_loop,
        f"{REPLAY}.start": arguments.replay_start,
    }


def _check_replay(arguments: GraphArguments, options: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse a replay without a device that plays it, and one that cannot be played."""
    if arguments.replay and {REPLAY, PLAYED_TOPICS}.isdisjoint(
        (arguments.master, arguments.slave)
    ):
        raise ParameterError(
            f"replay = '{arguments.replay}': must come with slave:={REPLAY} or master:={REPLAY}"
        )
    if arguments.composed and arguments.slave == PLAYED_TOPICS:
        raise ParameterError(f"composed = true: not with slave:={PLAYED_TOPICS}")
    if arguments.master == REPLAY:
        MASTERS[REPLAY](options["master_device"][REPLAY], arguments.rate, arguments.seed)
    if arguments.slave == REPLAY:
        SLAVES[REPLAY](options["slave_device"][REPLAY], arguments.rate, arguments.seed)


def _check_recording(arguments: GraphArguments, slave: Mapping[str, Any]) -> None:
    """Refuse a recording without a surface to play it, and the reverse, and unusable files."""
    if arguments.surface != RECORDING or arguments.slave != SIMULATED:
        if arguments.recording:
            raise ParameterError(
                f"recording = '{arguments.recording}': must come with surface:={RECORDING}"
                f" slave:={SIMULATED}"
            )
        return
    if not arguments.recording:
        raise ParameterError("recording = '': must be a CSV or WAV file")
    played(slave[SIMULATED].recording, arguments.rate)


def _absolute(path: str) -> str:
    return str(Path(path).absolute())
