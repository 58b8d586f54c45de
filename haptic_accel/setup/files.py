# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files: reading, former names of parameters and arguments, and updates.

An update preserves the rest of a user's file, such as a rig's.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import yaml

from haptic_accel.core.control.compensation import PLANT
from haptic_accel.core.control.inversion import LONGEST_GRANTED_TIME
from haptic_accel.core.document import Document, read_yaml_document
from haptic_accel.core.files import located, read_text, replace_file
from haptic_accel.core.parameters import ParameterError, checked, printable, shown, warn_once
from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.materials.folders import config_folder, is_recording, preset_file
from haptic_accel.setup.node_parameters import NODES, USE_SIM_TIME, check_clock, node_schema

BEGINNINGS = {
    **{"can_serial.arm.": "can.", "can_serial.handle.": "serial."},
    **{"crtk_serial.arm.": "crtk.", "crtk_serial.handle.": "serial."},
}
"""Prefixes of names before 0.2, and of the names that replace them."""

IN_SAMPLES = {
    f"{controller}.granted_delay": f"{controller}.granted_time"
    for controller in ("adaptive", "feedback", "inverse")
}
"""Delays of the compensator in samples, before 0.4, and the times that replace them."""

KEPT = "it is read until the next release"

CHANNEL, CHANNELS = "audio.channel", "audio.channels"
"""Parameter for the master device's first channel, before 0.4, and for all channels."""

FORMER = {"compensator": frozenset(IN_SAMPLES), "master_device": frozenset({CHANNEL})}
"""Names before 0.4 that a node's parameters may still have in files."""


def present_values(
    values: Mapping[str, Any], rate: object, warn: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Return values by their present names, with delays in samples converted to s.

    Parameters
    ----------
    values : mapping
        Values of a node by dotted name.
    rate
        Samples per second of the graph; an invalid rate is replaced by the default.
    warn : callable, optional
        Receives one line for each former name.

    Raises
    ------
    ParameterError
        A delay is no whole number of samples, a channel is no whole number, or the value is also
        set by its present name.

    Examples
    --------
    >>> present_values({"inverse.granted_delay": 4, "audio.channel": 3}, 4000.0)
    {'audio.channels': '3', 'inverse.granted_time': 0.001}
    """
    found = dict(values)

    def check(name: str, now: str, known: object, allowed: str) -> None:
        value = values[name]
        if not known:
            raise ParameterError(f"{name} = {shown(str(value))}: must be {allowed}")
        if now in values:
            raise ParameterError(f"{name} = {value}: must be left out, as {now} is given")

    if CHANNEL in values:
        value = found.pop(CHANNEL)
        known = type(value) is int and value > 0
        check(CHANNEL, CHANNELS, known, f"a whole number from 1; or give {CHANNELS}")
        found[CHANNELS] = str(value)
        if warn:
            warn(f"{CHANNEL} = {value} is {CHANNELS} = '{value}'; {KEPT}")
    if not (isinstance(rate, (int, float)) and rate > 0):
        rate = DEFAULT_RATE
    for name in IN_SAMPLES.keys() & values:
        now, value = IN_SAMPLES[name], found.pop(name)
        most = int(LONGEST_GRANTED_TIME * rate)
        known = type(value) is int and 0 <= value <= most
        check(name, now, known, f"a whole number of samples, from 0 to {most}; or give {now} in s")
        found[now] = value / rate
        if warn:
            means = f"{now} = {found[now]:g} s at {rate:g} Hz"
            warn(f"{name} = {value} samples is {means}; {KEPT}")
    return found


def current_values(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return a node's values in a bag, possibly an older one, by their present names.

    Raises
    ------
    ParameterError
        As for `present_values`.
    """
    renamed = {_current(name): value for name, value in recorded.items()}
    return present_values(renamed, recorded.get("rate"))


def current_arguments(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments in a bag, possibly an older one, by their present names."""
    now = dict(recorded)
    if "config" in now:
        now.setdefault("params_file", now["config"])
    if recorded.get("slave") == "virtual" and "scene" in recorded:
        now["surface"] = recorded["scene"]
    elif recorded.get("surface") == "recording":
        now["surface"] = recorded.get("recording")
    if not now.get("surface"):
        now.pop("surface", None)
    return now


def _current(name: str) -> str:
    """Return a parameter's present name."""
    old = next(filter(name.startswith, BEGINNINGS), "")
    return BEGINNINGS.get(old, "") + name.removeprefix(old)


SURFACE = "simulated.surface."
"""Prefix of the slave device's parameters of a surface."""

POSTURE = "simulated.grip.posture"
"""Parameter of the master device: grip of the simulated hand on the handle."""

MODEL = f"{PLANT}.model"
"""Parameter of the compensator: file of the plant's model."""

SEPARATOR = ","
"""Separator of the files in the argument `params_file`."""

Values: TypeAlias = dict[str, dict[str, Any]]
"""Parameters of each node by dotted name."""

EVERY_NODE = "/**"
"""Key of the values for every node in any namespace."""

ROS_PARAMETERS = "ros__parameters"
"""Key of a node's parameters in a file."""

_WILDCARDS = ("**", "*")
"""Last parts of keys that apply to any node."""


def surface_file(surface: str) -> Path:
    """Return the parameter file of a surface; all recordings share a smooth surface.

    Raises
    ------
    ParameterError
        The surface does not exist.
    """
    file = preset_file("surface", surface)
    return config_folder() / "recording.yaml" if is_recording(surface) else file


def surface_parameters(surface: str) -> dict[str, Any]:
    """Return all parameters of a surface, by the slave device's dotted names.

    Parameters missing from the file get defaults, so that no value of another surface stays.

    Parameters
    ----------
    surface : str
        Name, or a path ending in ``.yaml``.

    Raises
    ------
    ParameterError
        The surface does not exist, or its file is invalid.
    """
    values = read_parameter_file(surface_file(surface))["slave_device"]
    return {
        name: checked(name, values.get(name, default), default, specification)
        for name, (default, specification) in node_schema("slave_device").items()
        if name.startswith(SURFACE)
    }


@located("params_file")
def read_parameter_file(path: Path, namespace: str | None = None) -> dict[str, dict[str, Any]]:
    """Read a ROS 2 parameter file.

    Parameters
    ----------
    path : Path
        YAML of the form ``/**/node: {ros__parameters: {name: value}}``; ``/**`` is every node.
    namespace : str, optional
        Namespace of the nodes, with a slash before; None for values in any namespace.

    Returns
    -------
    dict
        Values by executable and dotted name.

    Raises
    ------
    ParameterError
        The file cannot be read, has another form, or names an unknown node or parameter, or a node
        in other namespaces only.
    """
    content = read_yaml_document(path)
    if not isinstance(content.value, dict):
        content.wrong(f"must map nodes to {ROS_PARAMETERS}")
    values: dict[str, dict[str, Any]] = {executable: {} for executable in NODES}
    for key, section in content.members():
        if not isinstance(section.value, dict) or set(section.value) != {ROS_PARAMETERS}:
            content.refuse(f"{shown(key)}: must hold {ROS_PARAMETERS}, nothing else", key)
        flat = dict(_flat(section.get(ROS_PARAMETERS, {})))
        if USE_SIM_TIME in flat:
            check_clock(flat.pop(USE_SIM_TIME).value)
        name = key.rpartition("/")[2]
        for executable in NODES if name in _WILDCARDS else [name]:
            if executable not in NODES:
                names = ", ".join(NODES)
                content.refuse(f"{shown(key)}: must be /** or one of {names}", key)
            known = _known(flat, executable, name)
            if namespace is None or _holds(key, f"{namespace}/{executable}"):
                values[executable] |= known
    _locate_model(path, values)
    if namespace is not None:
        for executable in NODES:
            _check_reached(content, f"{namespace}/{executable}")
    return values


def _locate_model(path: Path, values: Values) -> None:
    """Make the path of a plant's model absolute if the model is in the file's folder."""
    own = values["compensator"]
    if (model := own.get(MODEL)) and (candidate := path.parent / str(model)).is_file():
        own[MODEL] = str(candidate.absolute())


def parameter_paths(params_file: str) -> list[Path]:
    """Return the absolute paths of the files in an argument `params_file`.

    A path may contain the separator: the longest existing name is used.

    Examples
    --------
    >>> [path.name for path in parameter_paths("board.yaml,handle.yaml")]
    ['board.yaml', 'handle.yaml']
    """
    parts = [part for part in params_file.split(SEPARATOR) if part]
    found = []
    while parts:
        joined = (SEPARATOR.join(parts[:count]) for count in range(len(parts), 1, -1))
        path = next(filter(os.path.exists, joined), parts[0])
        del parts[: path.count(SEPARATOR) + 1]
        found.append(Path(path).absolute())
    return found


def read_parameter_files(
    params_file: str, namespace: str | None = None
) -> list[tuple[Path, Values]]:
    """Read the files of an argument `params_file`; a later file replaces an earlier one's values.

    A replaced value is stated in one line for the user.

    Parameters
    ----------
    params_file : str
        Paths separated by commas.
    namespace : str, optional
        As for `read_parameter_file`.

    Returns
    -------
    list of tuple
        Path and values of each file, in order of increasing precedence.

    Raises
    ------
    ParameterError
        As for `read_parameter_file`.
    """
    files = [(path, read_parameter_file(path, namespace)) for path in parameter_paths(params_file)]
    sources: dict[tuple[str, str], tuple[Path, Any]] = {}
    replaced: list[Unused] = []
    for path, values in files:
        for node, own in values.items():
            for name, value in own.items():
                before, old = sources.get((node, name), (path, value))
                if old != value:
                    replaced.append(Unused(path, name, node, value, f"replaces {old} of {before}"))
                sources[node, name] = path, value
    warn_of(replaced)
    return files


class Unused(NamedTuple):
    """Parameter value in a file that another file or an argument replaces, with the reason."""

    path: Path
    name: str
    node: str
    value: Any
    reason: str


def warn_of(found: Iterable[Unused]) -> None:
    """Log each unused value once, in one line for all its nodes."""
    nodes: dict[tuple[str, str], list[str]] = defaultdict(list)
    for path, name, node, value, reason in found:
        nodes[f"{path}: {name} of ", f" = {value}: {reason}"].append(node)
    for (before, after), names in nodes.items():
        warn_once(printable(before + ", ".join(names) + after))


def check_reached(path: Path, node: str) -> None:
    """Refuse a ROS parameter file that names a node only in other namespaces than the node's.

    ROS silently ignores such a file for the node.

    Parameters
    ----------
    path : Path
    node : str
        Name with its namespace.

    Raises
    ------
    ParameterError
        The message names the file, the key, and a key that would apply.
    """
    _check_reached(read_yaml_document(path), node)


def _check_reached(content: Document, node: str) -> None:
    """Refuse keys that name a node if no key applies to it."""
    name = node.rpartition("/")[2]
    naming = [key for key in content.mapping() if key.rpartition("/")[2] == name]
    if naming and not any(_holds(key, node) for key in naming):
        content.refuse(
            f"{shown(naming[0])}: holds in another namespace, not for {node}; write /**/{name}",
            naming[0],
        )


def _holds(key: str, node: str) -> bool:
    """Return whether a parameter file's key applies to a node by ROS 2's rules."""
    patterns = {"**": "(/[^/]+)*", "*": "/[^/]+"}
    parts = filter(None, key.split("/"))  # files before 0.2 have the key /**//**
    pattern = "".join(patterns.get(part, "/" + re.escape(part)) for part in parts)
    return re.fullmatch(pattern, node) is not None


def parameter_text(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the ROS parameter file with the values of each node, nested or by dotted name.

    It applies to these node names in any namespace; `EVERY_NODE` is all of them.
    """
    content = {
        node if node == EVERY_NODE else f"/**/{node}": {ROS_PARAMETERS: values}
        for node, values in nodes.items()
    }
    return str(yaml.dump(_quoted(content), Dumper=_Plain, sort_keys=False, width=2**31))


class _Text(str):
    """Text that ROS must not read as another type, for example 1e5."""


def _quoted(values: Any) -> Any:
    """Mark all text values."""
    if isinstance(values, Mapping):
        return {name: _quoted(value) for name, value in values.items()}
    return _Text(values) if isinstance(values, str) else values


class _Plain(yaml.SafeDumper):
    """YAML writer that repeats shared values, because no reader supports aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True."""
        return True


_Plain.add_representer(
    _Text, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)


def _flat(section: Document, prefix: str = "") -> Iterator[tuple[str, Document]]:
    """Yield values by dotted name."""
    for name, value in section.members():
        if isinstance(value.value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _known(flat: Mapping[str, Document], executable: str, name: str) -> dict[str, Any]:
    """Return a node's parameters; refuse unknown ones and, for a named node, other nodes'."""
    own = _names(executable)
    known = own.union(*map(_names, NODES)) if name in _WILDCARDS else own
    for parameter, value in flat.items():
        if parameter not in known:
            value.wrong("no such parameter: correct it, or leave it out")
    return {name: value.value for name, value in flat.items() if name in own}


def _names(executable: str) -> set[str]:
    """Return the names of a node's parameters in files, former ones included."""
    return {*node_schema(executable), *FORMER.get(executable, ())}


NOTE = "# bring-up, "
"""Prefix of comments in a rig's file on steps of the bring-up."""


def update_parameter_file(path: Path, nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Set parameters in a file, new or existing; comments and other values remain.

    The file is replaced atomically, so that a complete file exists at all times.

    Parameters
    ----------
    path : Path
    nodes : mapping
        Values of each node, or of ``/**`` for every node, nested or by dotted name.

    Raises
    ------
    ParameterError
        The file cannot be read or written.
    """
    document, content, comments = _document(path)
    for node, values in nodes.items():
        section = content.setdefault(_key(content, node), {ROS_PARAMETERS: {}})[ROS_PARAMETERS]
        for name, value in _leaves(values):
            _set(section, name.split("."), value)
    text = StringIO()
    document.dump(content, text)
    with located(path, unreadable=""):
        replace_file(path, (comments + text.getvalue()).encode())


def noted_steps(path: Path) -> dict[str, str]:
    """Return the bring-up steps noted in a rig's file, with time and result of each.

    Raises
    ------
    ParameterError
        The file cannot be read.
    """
    if not path.exists():
        return {}
    with located(path):
        lines = read_text(path).splitlines()
    found = (line.removeprefix(NOTE).partition(": ") for line in lines if line.startswith(NOTE))
    return {step: text for step, _, text in found}


def note_step(path: Path, step: str, text: str) -> None:
    """Note the result of a bring-up step in a comment that replaces any earlier one.

    Raises
    ------
    ParameterError
        The file cannot be read or written.
    """
    notes = noted_steps(path) | {step: text}
    with located(path):
        content = read_text(path) if path.exists() else ""
    kept = [line for line in content.splitlines() if not line.startswith(NOTE)]
    head = [f"{NOTE}{name}: {said}" for name, said in notes.items()]
    with located(path, unreadable=""):
        replace_file(path, "".join(f"{line}\n" for line in head + kept).encode())


def teleop_command(params_file: str, found: Path, *assignments: str) -> list[str]:
    """Return the command and arguments that run a graph with an additional file.

    Examples
    --------
    >>> teleop_command("", Path("rig.yaml"), "controller:=adaptive")
    ['teleop', 'params_file:=rig.yaml', 'controller:=adaptive']
    """
    paths = [path for path in params_file.split(SEPARATOR) if path]
    if found.absolute() not in parameter_paths(params_file):
        paths.append(str(found))
    return ["teleop", f"params_file:={SEPARATOR.join(paths)}", *assignments]


def check_updatable(path: Path) -> None:
    """Refuse a file that `update_parameter_file` cannot change.

    Raises
    ------
    ParameterError
        The file is no parameter file, or cannot be read.
    """
    _document(path)


def _document(path: Path) -> tuple[Any, Any, str]:
    """Return a YAML writer, and the content of a file, empty for a new file.

    For a file with comments only, these are returned separately.
    """
    try:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError
    except ImportError:
        missing = "an update needs ruamel.yaml: pip install ruamel.yaml"
        raise ParameterError(f"{path}: {missing}") from None
    document = YAML()
    document.width, document.preserve_quotes = 2**31, True
    if not path.exists():
        return document, {}, ""
    with located(path, "must be YAML"):
        text = read_text(path)
    if all(line.lstrip()[:1] in ("", "#") for line in text.splitlines()):
        return document, {}, "".join(f"{line}\n" for line in text.splitlines())
    read_parameter_file(path)  # refuse a file of another form
    try:
        return document, document.load(text) or {}, ""
    except YAMLError as error:
        raise ParameterError(f"{path}: must be YAML: {shown(str(error))}") from None


def _key(content: Mapping[str, Any], node: str) -> str:
    """Return the file's key for a node, or a new key that applies in any namespace."""
    if node == EVERY_NODE:
        return node
    known = (f"/**/{node}", node, f"/{node}")
    return next((key for key in known if key in content), known[0])


def _leaves(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield values by dotted name."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _set(section: Any, parts: list[str], value: Any) -> None:
    """Set a value where the file has it, by dotted name or nested; otherwise nested."""
    from ruamel.yaml.scalarstring import DoubleQuotedScalarString

    # ROS would read text such as 1e5 as a number.
    written = DoubleQuotedScalarString(value) if isinstance(value, str) else value
    for count in range(len(parts), 0, -1):
        key = ".".join(parts[:count])
        if key in section:
            break
    else:
        count, key = 1, parts[0]
    if count == len(parts):
        section[key] = written
    else:
        _set(section.setdefault(key, {}), parts[count:], value)
