# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The processes of the graph and their parameters, for given arguments."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

from haptic_accel.bags import NO_ROSBAGS
from haptic_accel.bags.facts import facts_text
from haptic_accel.core.axes import ALL_AXES
from haptic_accel.core.bounded_files import located
from haptic_accel.core.control.building import check_axes
from haptic_accel.core.control.compensation import CompensationParameters
from haptic_accel.core.identification.sweep import repeat_samples
from haptic_accel.core.parameters import ParameterError, schema
from haptic_accel.core.process import CUT_SHORT, DONE, WRONG_ARGUMENTS
from haptic_accel.core.topics import CONTACT_FORCE
from haptic_accel.core.trial import RigParameters
from haptic_accel.devices import MASTERS, SLAVES, DeviceError
from haptic_accel.devices.simulated import played
from haptic_accel.materials.folders import config_folder, is_recording, preset_file
from haptic_accel.setup import arguments as names
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments
from haptic_accel.setup.files import (
    SEPARATOR,
    Unused,
    Values,
    parameter_paths,
    parameter_text,
    read_parameter_file,
    read_parameter_files,
    surface_file,
    warn_of,
)
from haptic_accel.setup.node_parameters import NODES, PASSIVE, SAFETY, node_parameters, node_schema

RESPAWN_DELAY = 1.0
"""Time before a process that has failed is started again, s."""

RECORDER = "recorder"
"""Executable that writes the bag."""

SCOPE = "scope"
"""Executable that shows the graph."""

LINK = "link"
"""Executable that exchanges packets with the peer host."""

HALF_COUPLER = "half_coupler"
"""Executable of the node `coupler` where each arm has a host of its own."""

COMPOSED = "composed"
"""Executable that runs the nodes that make forces in one process; with the name of the side behind
it, those of one of two hosts."""


LEFT_TO_FILES = (
    *("grip", "reduction", "topics", "recording_rate", "recording_column"),
    *("replay", "replay_speed", "replay_loop", "replay_start"),
)
"""Arguments that set no parameter at their default, so that a file may."""

PATHS = ("bag", "keys", "replay")
"""Arguments that name files or folders, which nodes are given as absolute paths."""

Arguments: TypeAlias = GraphArguments | IdentifyArguments
Options: TypeAlias = dict[str, dict[str, Any]]
"""Parameters of the options of each node by name."""


@dataclass(frozen=True)
class Process:
    """One process of the graph.

    Attributes
    ----------
    executable : str
        Its name in this package.
    parameters : dict
        ROS parameters by node, then by dotted name.
    namespace : str
        Namespace of its nodes and of the topics, with a slash before; empty for the root.
    log_level : str
        Lowest severity that is logged.
    respawn : bool
        True to restart it on failure.
    last : bool
        Stop it after the others, to record their last messages.
    optional : bool
        The graph can run without it.
    domain : int or None
        Its ROS domain; None for that of the environment.
    """

    executable: str
    parameters: Values
    namespace: str = ""
    log_level: str = "info"
    respawn: bool = False
    last: bool = False
    optional: bool = False
    domain: int | None = None

    @property
    def name(self) -> str:
        """Name among the processes of a graph: the executable, with a domain of its own."""
        return self.executable if self.domain is None else f"{self.executable}@{self.domain}"

    def comes_back(self, status: int) -> bool:
        """Return whether it is restarted after an end with an exit status."""
        return self.respawn and status not in (DONE, WRONG_ARGUMENTS, *CUT_SHORT)

    def ros_arguments(self, folder: Path) -> list[str]:
        """Write the parameters to a file in a folder; return ROS words without the namespace.

        It needs a file, as command-line words cannot name a node in a namespace.
        """
        file = folder / f"{self.name}.yaml"
        file.write_text(parameter_text(self.parameters), encoding="utf-8")
        return ["--ros-args", "--params-file", str(file), "--log-level", self.log_level]


def graph(arguments: GraphArguments) -> list[Process]:
    """Return the processes that make up the graph, with everything checked beforehand.

    Raises
    ------
    ParameterError
        A surface, file or parameter is not usable.
    """
    values = graph_parameters(arguments)
    options = _checked_options(values)
    _check_side(arguments)
    if arguments.slave == names.SIMULATED:  # refuses a recording that cannot be played
        played(options["slave_device"][names.SIMULATED].recording, arguments.rate)
    _check_replay(arguments, options)
    _check_devices(arguments, options)
    around, plant = node_parameters("compensator", values["compensator"])
    check_axes(around, plant, around.rate)
    if arguments.record:
        _check_bag(arguments)
    return _processes(arguments, values, composed=arguments.composed, respawn=arguments.respawn)


def identification_graph(arguments: IdentifyArguments) -> list[Process]:
    """Return the processes that excite a handle and record it, everything checked beforehand.

    Raises
    ------
    ParameterError
        A file or parameter is not usable.
    """
    values = graph_parameters(arguments)
    _check_devices(arguments, _checked_options(values))
    _check_bag(arguments)
    repeat_samples(arguments.sweep, arguments.rate)  # the rate must suit the sweep
    return _processes(arguments, values)


def _processes(
    arguments: Arguments, values: Values, *, composed: bool = False, respawn: bool = False
) -> list[Process]:
    """Return the processes that arguments ask for."""
    asked = _own_parameters(arguments)
    nodes = {name: values[name] for name in asked if name not in (RECORDER, SCOPE)}
    process = partial(Process, namespace=arguments.namespace, log_level=arguments.log_level)
    parts = {name: {name: nodes[name]} for name in nodes}
    if composed:
        apart = {LINK: parts.pop(LINK)} if LINK in parts else {}
        side = getattr(arguments, "side", "")
        name = f"{COMPOSED}_{side}" if side else COMPOSED
        parts = {name: {name: nodes[name] for name in parts}, **apart}
    elif LINK in nodes:
        parts = {HALF_COUPLER if name == "coupler" else name: parts[name] for name in parts}
    processes = [
        # A link controls no arm: without it both arms are free, and other processes continue.
        process(name, given, respawn=respawn or name == LINK)
        for name, given in parts.items()
    ]
    if RECORDER in asked:
        effective = {
            node: {name: default for name, (default, _) in node_schema(node).items()} | given
            for node, given in nodes.items()
        }
        recorded = asdict(arguments)
        if arguments.params_file:  # found from another working directory, too
            paths = parameter_paths(arguments.params_file)
            recorded["params_file"] = SEPARATOR.join(map(str, paths))
        recorder = {**values[RECORDER], "facts": facts_text(recorded, effective)}
        # First, so that it misses few messages of the others.
        processes.insert(0, process(RECORDER, {RECORDER: recorder}, last=True))
    if SCOPE in asked:
        # Last, as the forces need not wait for it.
        processes.append(process(SCOPE, {SCOPE: values[SCOPE]}, optional=True))
    return processes


def arrangement(processes: Sequence[Process]) -> str:
    """Return a line on the nodes that share a process, and on how to change this.

    Empty where there is no choice, as for an identification.
    """
    nodes = {process.executable: tuple(process.parameters) for process in processes}
    joint = next((own for own in nodes.values() if len(own) > 1), ())
    if joint:
        apart = [name for name, own in nodes.items() if own != joint]
        rest = f", one{' each' * (len(apart) > 1)} for {_listed(apart)}" if apart else ""
        return f"one process for {_listed(joint)}{rest}; composed:=false gives each node its own"
    if "identifier" in nodes:
        return ""
    return (
        "a process for each node; composed:=true joins those that make forces, but with"
        " respawn:=true, slave:=topics or an arm by CRTK"
    )


def _listed(words: Sequence[str]) -> str:
    """Return words as a list in a sentence."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _checked_options(values: Values) -> Options:
    """Check every parameter of every node; return their options by executable and name."""
    return {executable: node_parameters(executable, values[executable])[1] for executable in NODES}


def graph_parameters(arguments: Arguments) -> Values:
    """Return the values that files and arguments give each node, by dotted name.

    Raises
    ------
    ParameterError
        A file is not usable, or contradicts the arguments.
    """
    values: Values = {executable: {} for executable in NODES}
    set_here = _own_parameters(arguments)
    own = [(path, read_parameter_file(path, arguments.namespace)) for path in _files(arguments)]
    given = read_parameter_files(arguments.params_file, arguments.namespace)
    files = [*own, *given]
    for place, (path, content) in enumerate(files, 1):
        if path != _defaults_file():
            _check_given(path, content, set_here, [later for _, later in files[place:]])
        for executable in NODES:
            values[executable] |= content[executable]
    for executable, set_values in set_here.items():
        values[executable] |= set_values
    known = {"axes": values["compensator"].get("axes", CompensationParameters.axes)}
    if arguments.master in (names.SIMULATED, names.POINTER):
        # Simulated handles need no measurement of the sensor.
        _, devices = node_parameters("master_device", values["master_device"])
        simulated = devices[names.SIMULATED]
        sensor = asdict(simulated.accelerometer)
        known = {f"accelerometer.{name}": value for name, value in sensor.items()}
        known["axes"] = simulated.axes
    values["identifier"] = known | values["identifier"]
    if side := getattr(arguments, "side", ""):
        _, device = node_parameters(f"{side}_device", values[f"{side}_device"])
        values["coupler"]["recovery"] = device[SAFETY].recovery
    return values


def _check_given(path: Path, content: Values, set_here: Values, later: Sequence[Values]) -> None:
    """Refuse a file's values that the graph sets; state those that an argument replaces.

    What a later file replaces, `read_parameter_files` states.
    """
    replaced: list[Unused] = []
    for node, own in set_here.items():
        for name, value in content[node].items():
            if own.get(name, value) == value:
                continue
            argument = _argument(node, name)
            if not argument:
                made = f"the graph's arguments make it {own[name]}; leave it out"
                raise ParameterError(f"{path}: {name} of {node} = {value}: {made}")
            if any(name in values[node] for values in later):
                continue
            reason = f"not used, as the argument {argument}:= replaces it"
            replaced.append(Unused(path, name, node, value, reason))
    warn_of(replaced)


def _argument(node: str, name: str) -> str:
    """Return the argument that sets a node's parameter; empty if there is none."""
    known = schema(IdentifyArguments) | schema(GraphArguments)
    found = (key for key, (_, given) in known.items() if f"{node}.{name}" in given.sets)
    return next(found, "")


def rig_parameters(values: Values) -> RigParameters:
    """Return the virtual rig of a graph's simulated devices.

    Parameters
    ----------
    values : mapping
        Result of `graph_parameters`.
    """
    _, masters = node_parameters("master_device", values["master_device"])
    _, slaves = node_parameters("slave_device", values["slave_device"])
    coupling, _ = node_parameters("coupler", values["coupler"])
    halves = coupling if coupling.coupling == PASSIVE else None
    return RigParameters(
        *(masters["simulated"], slaves["simulated"], coupling, halves, slaves["virtual"]),
        *(masters[SAFETY], slaves[SAFETY]),
    )


def _files(arguments: Arguments) -> list[Path]:
    """Return the files of the package and of presets, in order of increasing precedence."""
    paths = [_defaults_file(), preset_file("rig", arguments.rig)]
    if isinstance(arguments, GraphArguments) and arguments.slave != names.VIRTUAL:
        paths.append(surface_file(arguments.surface))
    return paths


def _defaults_file() -> Path:
    """Return the parameter file of lowest precedence."""
    return config_folder() / "teleop.yaml"


def _own_parameters(arguments: Arguments) -> Values:
    """Return the parameters that arguments set, by the executables of the graph."""
    own: Values = {node: {} for node in _nodes(arguments)}
    for name, (default, specification) in schema(type(arguments)).items():
        value = getattr(arguments, name)
        if name in LEFT_TO_FILES and value == default:
            continue
        for place in specification.sets:
            node, _, parameter = place.partition(".")
            if node in own:
                own[node][parameter] = _absolute(value) if name in PATHS else value
    if isinstance(arguments, IdentifyArguments):
        own["identifier"] |= {**asdict(arguments.sweep), "listeners": 2}
        return own
    # Receivers of a signal: its destination and the recorder.
    listeners = {"listeners": 2 if arguments.record else 1}
    # The hand starts to explore when the arms engage: all others must exist.
    own["coupler"] |= {**listeners, "compensated": "compensator" in own}
    if "restamper" in own:
        own["restamper"] |= listeners
    if "slave_device" in own and arguments.reduction != CompensationParameters.reduction:
        axes = ", ".join(ALL_AXES.names)
        for device in (names.SIMULATED, names.VIRTUAL):
            own["slave_device"][f"{device}.{names.TOOL_AXES}"] = axes
        if arguments.side:
            own["coupler"]["axes"] = axes  # to cross the network
    is_virtual = arguments.slave == names.VIRTUAL
    if "slave_device" in own and is_virtual:
        own["slave_device"][names.SCENE] = str(preset_file("scene", arguments.surface))
    elif "slave_device" in own and is_recording(arguments.surface):
        own["slave_device"][names.RECORDING] = _absolute(arguments.surface)
    if is_virtual and arguments.record:
        topics = filter(None, (arguments.topics, CONTACT_FORCE.name))
        own[RECORDER]["topics"] = ",".join(topics)
    return own


def _nodes(arguments: Arguments) -> list[str]:
    """Return the executables of the nodes that arguments ask for."""
    if isinstance(arguments, IdentifyArguments):
        return ["master_device", "identifier", RECORDER]
    slave = "restamper" if arguments.slave == names.PLAYED_TOPICS else "slave_device"
    arms = [f"{arguments.side}_device"] if arguments.side else ["master_device", slave]
    asked = {
        "compensator": arguments.side != "slave",
        LINK: arguments.peer,
        RECORDER: arguments.record,
        SCOPE: arguments.scope,
    }
    return [*arms, "coupler", *(name for name, wanted in asked.items() if wanted)]


def _check_side(arguments: GraphArguments) -> None:
    """Refuse, with a peer host, options for both arms, and a device of the peer's arm."""
    if not arguments.side:
        return
    side = f"side:={arguments.side}"
    for arm in ("master", "slave"):
        device = getattr(arguments, arm)
        if device in (names.REPLAY, names.PLAYED_TOPICS):
            raise ParameterError(f"{arm} = {device!r}: not with {side}: a replay has one host")
        if arm != arguments.side and device != names.SIMULATED:
            raise ParameterError(f"{arm} = {device!r}: belongs to the peer, not to {side}")


def _check_replay(arguments: GraphArguments, options: Options) -> None:
    """Refuse a replay without a device to play it, and an unplayable replay."""
    players = {names.REPLAY, names.PLAYED_TOPICS}
    if arguments.replay and players.isdisjoint((arguments.master, arguments.slave)):
        raise ParameterError(
            f"replay = '{arguments.replay}': must come with slave:=replay or master:=replay"
        )


def _check_devices(arguments: Arguments, options: Options) -> None:
    """Build each arm's device once, so that it refuses wrong parameters."""
    for arm, kinds in (("master", MASTERS), ("slave", SLAVES)):
        name = getattr(arguments, arm, "")
        if name in kinds and name not in (names.SIMULATED, names.POINTER):  # which always can
            try:
                own = options[f"{arm}_device"]
                kinds[name].from_options(name, own, arguments.rate, arguments.seed)
            except DeviceError as error:  # without its library
                raise ParameterError(f"{arm} = {name!r}: {error}") from None


def _check_bag(arguments: Arguments) -> None:
    """Refuse a bag that would be written over, or that cannot be written."""
    if not find_spec("rosbags"):
        raise ParameterError(f"record = true: {NO_ROSBAGS}; or record:=false")
    if arguments.bag and os.path.exists(arguments.bag):
        raise ParameterError(f"bag = '{arguments.bag}': must be a new folder")
    folder = Path(arguments.bag or "bags/new").absolute()
    there = next(each for each in folder.parents if os.path.exists(each))
    # Under a name of its own: a graph that starts at the same time checks the same folder.
    place = f"bag = '{arguments.bag}'"
    with (
        located(place, unreadable="must be a folder to make: "),
        TemporaryDirectory(prefix=".", dir=there) as apart,
    ):
        Path(apart, folder.relative_to(there)).mkdir(parents=True)


def _absolute(path: str) -> str:
    """Return the absolute path of a file or folder; empty for an empty one."""
    return path and str(Path(path).absolute())
