# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Immutable description of a graph: its arguments, and the parameters of all its nodes.

All code that starts, simulates, shows or analyses a graph uses this description, so that files and
arguments are resolved once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from haptic_accel.bags.trial_metadata import ARGUMENTS, PARAMETERS, json_text
from haptic_accel.core.axes import ALL_AXES
from haptic_accel.core.control.compensation import PLANT, CompensationParameters
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.parameters import ParameterError, schema, warn_once
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.topics import CONTACT_FORCE
from haptic_accel.devices.audio import AUDIO
from haptic_accel.materials.folders import config_folder, is_recording, preset_file
from haptic_accel.setup import arguments as names
from haptic_accel.setup import files, node_parameters
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments
from haptic_accel.setup.node_parameters import SAFETY, build_parameters, node_schema

RECORDER = "recorder"
"""Executable that writes the bag."""

SCOPE = "scope"
"""Executable that shows the graph."""

LINK = "link"
"""Executable that exchanges packets with the peer host."""

Arguments: TypeAlias = GraphArguments | IdentifyArguments
A = TypeVar("A", GraphArguments, IdentifyArguments)


@dataclass(frozen=True)
class Parameters:
    """Parameters of all nodes of a graph.

    Attributes
    ----------
    values : mapping
        Values of each node by dotted name; missing parameters have their default.
    """

    values: Mapping[str, Mapping[str, Any]]

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Parameters:
        """Return the parameters in a bag's metadata, with former names replaced."""
        stated = metadata.get(PARAMETERS)
        nodes = stated if isinstance(stated, Mapping) else {}
        known = {name: own for name, own in nodes.items() if isinstance(own, Mapping)}
        return cls({name: files.current_values(own) for name, own in known.items()})

    def node(self, name: str) -> tuple[Any, dict[str, Any]]:
        """Return a node's own parameters, and those of its options by name.

        Raises
        ------
        ParameterError
            A value is not allowed.
        """
        return build_parameters(name, self.values.get(name, {}))

    def rig(self) -> RigParameters:
        """Return the virtual rig of the simulated devices.

        Raises
        ------
        ParameterError
            A value is not allowed.
        """
        _, masters = self.node("master_device")
        _, slaves = self.node("slave_device")
        coupling, _ = self.node("coupler")
        passive = coupling if coupling.coupling == node_parameters.PASSIVE else None
        return RigParameters(
            *(masters["simulated"], slaves["simulated"], coupling, passive, slaves["virtual"]),
            *(masters[SAFETY], slaves[SAFETY]),
        )

    def changed(self: P, changes: Mapping[str, Mapping[str, Any]]) -> P:
        """Return a copy with changed values of nodes."""
        known = {name: {**self.values.get(name, {}), **own} for name, own in changes.items()}
        return replace(self, values={**self.values, **known})


P = TypeVar("P", bound=Parameters)


@dataclass(frozen=True)
class Setup(Parameters, Generic[A]):
    """Complete description of a graph: arguments, and parameters of all nodes.

    Attributes
    ----------
    arguments : GraphArguments or IdentifyArguments

    Examples
    --------
    >>> setup = Setup.of(GraphArguments(rig="ideal", controller="inverse"))
    >>> setup.nodes
    ['master_device', 'slave_device', 'coupler', 'compensator', 'recorder']
    >>> setup.node("compensator")[0].controller
    'inverse'
    """

    arguments: A

    @classmethod
    def of(cls, arguments: A) -> Setup[A]:
        """Resolve arguments and the files that they name.

        Raises
        ------
        ParameterError
            A file is unusable, or contradicts the arguments.
        """
        return cls(_resolved(arguments), arguments)

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Setup[GraphArguments]:
        """Return the setup of a recorded graph, of any version, without reading files.

        Raises
        ------
        ParameterError
            The metadata contains no arguments, or an argument that is no longer allowed.
        """
        recorded = recorded_arguments(metadata)
        if "latency" not in recorded:  # recorded before 0.1, or by another program
            raise ParameterError("does not state the arguments of its graph")
        known = schema(GraphArguments).keys() & recorded
        arguments = GraphArguments(**{name: recorded[name] for name in known})
        return Setup(Parameters.from_metadata(metadata).values, arguments)

    @property
    def nodes(self) -> list[str]:
        """Executables of the nodes that run."""
        return _nodes(self.arguments)

    def metadata(self) -> str:
        """Return the JSON text with arguments and all parameters, for a bag."""
        effective = {
            node: {name: default for name, (default, _) in node_schema(node).items()}
            | dict(self.values[node])
            for node in self.nodes
            if node not in (RECORDER, SCOPE)
        }
        recorded = asdict(self.arguments)
        if self.arguments.params_file:  # make paths valid in any working directory
            paths = files.parameter_paths(self.arguments.params_file)
            recorded["params_file"] = files.SEPARATOR.join(map(str, paths))
        return json_text(recorded, effective)


def recorded_arguments(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments in a bag's metadata, by their present names; empty without any."""
    stated = metadata.get(ARGUMENTS)
    return files.current_arguments(stated) if isinstance(stated, Mapping) else {}


def known_arguments(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments in a bag's metadata, or else those inferred from node parameters."""
    if stated := recorded_arguments(metadata):
        return stated
    values = Parameters.from_metadata(metadata).values
    found: dict[str, Any] = {"surface": values.get("slave_device", {}).get(names.RECORDING)}
    for name, (_, specification) in schema(GraphArguments).items():
        targets = (target.partition(".")[::2] for target in specification.sets)
        saved = (values.get(node, {}).get(key) for node, key in targets)
        found.setdefault(name, next((value for value in saved if value not in (None, "")), None))
    return {name: value for name, value in found.items() if value not in (None, "")}


def _resolved(arguments: Arguments) -> files.Values:
    """Return each node's values from files and arguments, by dotted name."""
    values: files.Values = {executable: {} for executable in node_parameters.NODES}
    set_here = _set_by(arguments)
    own = [
        (path, files.read_parameter_file(path, arguments.namespace)) for path in _files(arguments)
    ]
    named = files.read_parameter_files(arguments.params_file, arguments.namespace)
    stated = [(path, _present(path, content, arguments.rate)) for path, content in [*own, *named]]
    for index, (path, content) in enumerate(stated, 1):
        if path != _defaults_file():
            _check_file_values(path, content, set_here, [later for _, later in stated[index:]])
        for executable in node_parameters.NODES:
            values[executable] |= content[executable]
    for executable, set_values in set_here.items():
        values[executable] |= set_values
    if isinstance(arguments, GraphArguments):
        _warn_of_unknown_plant(values, [content for _, content in named])
    values["identifier"] = _known_handle(arguments, values) | values["identifier"]
    if side := getattr(arguments, "side", ""):
        _, device = build_parameters(f"{side}_device", values[f"{side}_device"])
        values["coupler"]["recovery"] = device[SAFETY].recovery
    return values


def _present(path: Path, content: files.Values, rate: float) -> files.Values:
    """Return a file's content by present names, after a warning about former ones."""

    def warn(line: str) -> None:
        warn_once(f"{path}: {line}")

    try:
        return {node: files.present_values(own, rate, warn) for node, own in content.items()}
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _warn_of_unknown_plant(values: files.Values, named: Sequence[files.Values]) -> None:
    """Warn if a controller needs the plant of coils of which only the kind is known."""
    master, compensator = values["master_device"], values["compensator"]
    preset, controller = master.get("audio.preset"), compensator.get("controller")
    is_known = any(name.startswith(f"{PLANT}.") for each in named for name in each["compensator"])
    if master.get("actuator_device") != AUDIO or not preset or is_known:
        return
    without = [name for name, kind in CONTROLLERS.items() if not kind.needs_plant]
    if controller not in without:
        warn_once(
            f"controller = {controller}: needs the handle's plant, which is unknown with"
            f" audio.preset = {preset}: a first touch, not a bench; the plant is taken as the"
            f" rig's until `identify actuator:=audio` has found it, or use"
            f" {' or '.join(without)}"
        )


def _known_handle(arguments: Arguments, values: files.Values) -> dict[str, Any]:
    """Return the identifier's parameters of a handle; a simulated handle needs no measurement."""
    if arguments.master not in (names.SIMULATED, names.POINTER):
        return {"axes": values["compensator"].get("axes", CompensationParameters.axes)}
    _, devices = build_parameters("master_device", values["master_device"])
    simulated = devices[names.SIMULATED]
    sensor = asdict(simulated.accelerometer)
    known = {f"accelerometer.{name}": value for name, value in sensor.items()}
    return {**known, "axes": simulated.axes}


def _check_file_values(
    path: Path, content: files.Values, set_here: files.Values, later: Sequence[files.Values]
) -> None:
    """Refuse a file's values that the graph sets; report those that an argument replaces.

    `read_parameter_files` reports values that a later file replaces.
    """
    replaced: list[files.Unused] = []
    for node, own in set_here.items():
        for name, value in content[node].items():
            if own.get(name, value) == value:
                continue
            argument = argument_of(node, name)
            if not argument:
                made = f"the graph's arguments make it {own[name]}; leave it out"
                raise ParameterError(f"{path}: {name} of {node} = {value}: {made}")
            if any(name in values[node] for values in later):
                continue
            reason = f"not used, as the argument {argument}:= replaces it"
            replaced.append(files.Unused(path, name, node, value, reason))
    files.warn_of(replaced)


def argument_of(node: str, name: str) -> str:
    """Return the argument that sets a node's parameter; empty if there is none."""
    known = schema(IdentifyArguments) | schema(GraphArguments)
    found = (key for key, (_, argument) in known.items() if f"{node}.{name}" in argument.sets)
    return next(found, "")


def _files(arguments: Arguments) -> list[Path]:
    """Return the files of the package and of presets, in order of increasing precedence."""
    paths = [_defaults_file(), preset_file("rig", arguments.rig)]
    surface = getattr(arguments, "surface", "")
    if surface and getattr(arguments, "slave", "") != names.VIRTUAL:
        paths.append(files.surface_file(surface))
    return paths


def _defaults_file() -> Path:
    """Return the parameter file of lowest precedence."""
    return config_folder() / "teleop.yaml"


def _set_by(arguments: Arguments) -> files.Values:
    """Return the parameters that arguments set, by the executables of the graph."""
    own: files.Values = {node: {} for node in _nodes(arguments)}

    def assign(target: str, value: Any) -> None:
        node, _, parameter = target.partition(".")
        if node in own:
            own[node][parameter] = value

    for name, (default, specification) in schema(type(arguments)).items():
        value = getattr(arguments, name)
        if not (specification.yields and value == default):
            for target in specification.sets:
                assign(target, _absolute(value) if specification.path else value)
    for target, value in _derived(arguments).items():
        if value is not None:
            assign(target, value)
    return own


def _derived(arguments: Arguments) -> dict[str, Any]:
    """Return the parameters derived from several arguments; None if not set."""
    if isinstance(arguments, IdentifyArguments):
        sweep = {f"identifier.{name}": value for name, value in asdict(arguments.sweep).items()}
        return {**sweep, "identifier.listeners": 2}
    # A signal has one or two receivers: its destination and the recorder.
    listeners = 2 if arguments.record else 1
    is_reduced = arguments.reduction != CompensationParameters.reduction
    tool_axes = ", ".join(ALL_AXES.names) if is_reduced else None
    surface, is_virtual = arguments.surface, arguments.slave == names.VIRTUAL
    scene = str(preset_file("scene", surface)) if is_virtual else None
    recorded = ",".join(filter(None, (arguments.topics, CONTACT_FORCE.name)))
    return {
        "coupler.listeners": listeners,
        "restamper.listeners": listeners,
        # The hand starts to explore when the arms engage; all other nodes must exist by then.
        "coupler.compensated": "compensator" in _nodes(arguments),
        "coupler.axes": tool_axes if arguments.side == "slave" else None,  # across the network
        f"slave_device.{names.SIMULATED}.{names.TOOL_AXES}": tool_axes,
        f"slave_device.{names.VIRTUAL}.{names.TOOL_AXES}": tool_axes,
        f"slave_device.{names.SCENE}": scene,
        f"slave_device.{names.RECORDING}": _absolute(surface) if is_recording(surface) else None,
        "recorder.topics": recorded if is_virtual else None,
    }


def _nodes(arguments: Arguments) -> list[str]:
    """Return the executables of the nodes that arguments select."""
    if isinstance(arguments, IdentifyArguments):
        return ["master_device", "identifier", RECORDER]
    slave = "restamper" if arguments.slave == names.PLAYED_TOPICS else "slave_device"
    arms = [f"{arguments.side}_device"] if arguments.side else ["master_device", slave]
    optional = {
        "compensator": arguments.side != "slave",
        LINK: arguments.peer,
        RECORDER: arguments.record,
        SCOPE: arguments.scope,
    }
    return [*arms, "coupler", *(name for name, is_selected in optional.items() if is_selected)]


def _absolute(path: str) -> str:
    """Return the absolute path of a file or folder; empty for an empty path."""
    return path and str(Path(path).absolute())
