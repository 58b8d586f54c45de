"""The graph: which executables, with which parameters, for which arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from haptic_accel.core.identification.sweep import repeat_samples
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import RigParameters
from haptic_accel.devices.simulated import played
from haptic_accel.nodes.parameters import NODES, node_parameters
from haptic_accel.startup.arguments import AVERAGE_GRIP, GraphArguments, IdentifyArguments
from haptic_accel.startup.files import config_folder, read_parameter_file, rig_file, surface_file

RECORDING = "recording"
"""Name of the surface that plays a recorded acceleration."""


SIMULATED = "simulated"
"""Name of the device that is always there."""

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
        Whether it is to be stopped after the others, whose last words it takes.
    """

    executable: str
    parameter_files: tuple[Path, ...]
    parameters: dict[str, dict[str, Any]]
    last: bool = False

    @property
    def ros_arguments(self) -> list[str]:
        """What its command line needs for ROS."""
        words = ["--ros-args"]
        for path in self.parameter_files:
            words += ["--params-file", str(path)]
        for node, parameters in self.parameters.items():
            for name, value in parameters.items():
                words += ["-p", f"{node}:{name}:={_yaml(value)}"]
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
    for executable in NODES:
        node_parameters(executable, values[executable])
    _check_recording(arguments, values["slave_device"])
    files = tuple(_files(arguments))
    own = _own_parameters(arguments)
    recorder = own.pop("recorder")
    processes = [_recorder(files, recorder)] if arguments.record else []
    if arguments.composed:
        return [*processes, Process(COMPOSED, files, own)]
    return processes + [Process(name, files, {name: values}) for name, values in own.items()]


def identification_graph(arguments: IdentifyArguments) -> list[Process]:
    """Return the processes that excite a handle and record it, everything checked beforehand.

    Raises
    ------
    ParameterError
        A file or parameter is not usable.
    """
    values = graph_parameters(arguments)
    for executable in NODES:
        node_parameters(executable, values[executable])
    repeat_samples(arguments.sweep, arguments.rate)  # the rate must do for the sweep
    files = tuple(_files(arguments))
    own = _own_parameters(arguments)
    # What the identifier takes from the simulated handle, no file gives it by its name.
    own["identifier"] = values["identifier"]
    recorder = own.pop("recorder")
    nodes = [Process(name, files, {name: given}) for name, given in own.items()]
    return [_recorder(files, recorder), *nodes]


def _recorder(files: tuple[Path, ...], parameters: dict[str, Any]) -> Process:
    """Return the process to start first, so that it misses as little as can be of the others."""
    return Process("recorder", files, {"recorder": parameters}, last=True)


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
        # A simulated handle needs no bench to measure its actuator and its sensor on.
        values["identifier"] = _bench_values(values["master_device"]) | values["identifier"]
    return values


def _bench_values(master: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an identifier must know of the simulated handle, by dotted name."""
    _, devices = node_parameters("master_device", master)
    rig = devices[SIMULATED]
    known = {f"suspension.{name}": getattr(rig.handle, name) for name in ("m_a", "k_s", "b_s")}
    known["suspension.travel"] = rig.actuator.travel
    for name, value in asdict(rig.accelerometer).items():
        known[f"accelerometer.{name}"] = value
    return known


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
    if isinstance(arguments, IdentifyArguments):
        procedure = {**asdict(arguments.sweep), "trials": arguments.trials, "listeners": 2}
        return {
            "master_device": master,
            "identifier": {**sampled, **procedure},
            "recorder": recorder,
        }
    recording = {}
    if arguments.surface == RECORDING:
        recording = {
            "simulated.recording.file": arguments.recording and _absolute(arguments.recording),
            "simulated.recording.rate": arguments.recording_rate,
            "simulated.recording.column": arguments.recording_column,
        }
    return {
        "master_device": master,
        "slave_device": {**device, "device": arguments.slave, **recording},
        "coupler": {
            "duration": arguments.duration,
            # The hand starts to explore when the arms engage: all others must be there.
            "compensated": True,
            "listeners": 2 if arguments.record else 1,
        },
        "compensator": {**sampled, "controller": arguments.controller},
        "recorder": recorder,
    }


def _check_recording(arguments: GraphArguments, slave: Mapping[str, Any]) -> None:
    """Refuse a recording without a surface to play it, and the reverse, and unusable files."""
    if arguments.surface != RECORDING:
        if arguments.recording:
            raise ParameterError(
                f"recording = '{arguments.recording}': must come with surface:={RECORDING}"
            )
        return
    if not arguments.recording:
        raise ParameterError("recording = '': must be a CSV or WAV file")
    _, options = node_parameters("slave_device", slave)
    played(options["simulated"].recording, arguments.rate)


def _absolute(path: str) -> str:
    return str(Path(path).absolute())
