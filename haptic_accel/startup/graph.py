"""The graph: which executables, with which parameters, for which arguments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import RigParameters
from haptic_accel.devices.simulated import played
from haptic_accel.nodes.parameters import NODES, node_parameters
from haptic_accel.startup.arguments import GraphArguments
from haptic_accel.startup.files import config_folder, read_parameter_file, surface_file

RECORDING = "recording"
"""Name of the surface that plays a recorded acceleration."""


@dataclass(frozen=True)
class Process:
    """One executable of the graph.

    Attributes
    ----------
    executable : str
        Its name in this package; also the node's name.
    parameter_files : tuple of Path
        ROS parameter files, later ones over earlier ones.
    parameters : dict
        ROS parameters over those of the files, by dotted name.
    """

    executable: str
    parameter_files: tuple[Path, ...]
    parameters: dict[str, Any]


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
    files = tuple(path for path, _ in _files(arguments))
    own = _own_parameters(arguments)
    return [
        Process(executable, files, own[executable])
        for executable in NODES
        if executable != "recorder" or arguments.record
    ]


def graph_parameters(arguments: GraphArguments) -> dict[str, dict[str, Any]]:
    """Return the values that files and arguments give each node, by dotted name."""
    values: dict[str, dict[str, Any]] = {executable: {} for executable in NODES}
    for _, content in _files(arguments):
        for executable in NODES:
            values[executable] |= content[executable]
    for executable, given in _own_parameters(arguments).items():
        values[executable] |= given
    return values


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


def _files(arguments: GraphArguments) -> list[tuple[Path, dict[str, dict[str, Any]]]]:
    """Return the parameter files in the order in which they count, with their content."""
    paths = [config_folder() / "teleop.yaml", surface_file(arguments.surface)]
    if arguments.config:
        paths.append(Path(arguments.config).absolute())
    return [(path, read_parameter_file(path)) for path in paths]


def _own_parameters(arguments: GraphArguments) -> dict[str, dict[str, Any]]:
    """Return the parameters that arguments set, by executable."""
    sampled = {"rate": arguments.rate}
    device = {**sampled, "seed": arguments.seed}
    recording = {}
    if arguments.surface == RECORDING:
        recording = {
            "simulated.recording.file": arguments.recording and _absolute(arguments.recording),
            "simulated.recording.rate": arguments.recording_rate,
            "simulated.recording.column": arguments.recording_column,
        }
    return {
        "master_device": {**device, "device": arguments.master},
        "slave_device": {**device, "device": arguments.slave, **recording},
        "coupler": {
            "duration": arguments.duration,
            # The hand starts to explore when the arms engage: all others must be there.
            "compensated": True,
            "listeners": 2 if arguments.record else 1,
        },
        "compensator": {**sampled, "controller": arguments.controller},
        "recorder": {"bag": arguments.bag and _absolute(arguments.bag)},
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
