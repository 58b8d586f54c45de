"""Reading of parameter files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from haptic_accel.bags.yaml_text import LARGEST, load_yaml
from haptic_accel.core.parameters import ParameterError, checked, shown
from haptic_accel.graph.folders import config_folder
from haptic_accel.graph.node_parameters import NODES, USE_SIM_TIME, check_clock, node_schema

SURFACE = "simulated.surface."
"""Prefix of the slave device's parameters of a surface."""

_WILDCARDS = ("/**", "**", "/*", "*")


def preset_file(kind: str, name: str) -> Path:
    """Return the parameter file of a virtual rig or a surface.

    Parameters
    ----------
    kind : str
        rig or surface.
    name : str
        Name of a file in ``config/<kind>s``, or a path ending in ``.yaml``.

    Raises
    ------
    ParameterError
        There is none.
    """
    known = {path.stem: path for path in sorted((config_folder() / f"{kind}s").glob("*.yaml"))}
    if name in known:
        return known[name]
    if name.endswith(".yaml") and os.path.isfile(name):
        return Path(name).absolute()
    raise ParameterError(f"{kind} = {name!r}: must be one of {', '.join(known)}, or a .yaml file")


def surface_parameters(surface: str) -> dict[str, Any]:
    """Return all parameters of a surface, by the slave device's dotted names.

    Parameters missing from its file have their defaults, so that none of another surface stays.

    Parameters
    ----------
    surface : str
        Its name, or a path ending in ``.yaml``.

    Raises
    ------
    ParameterError
        There is none, or its file is wrong.
    """
    given = read_parameter_file(preset_file("surface", surface))["slave_device"]
    return {
        name: checked(name, given.get(name, default), default, specification)
        for name, (default, specification) in node_schema("slave_device").items()
        if name.startswith(SURFACE)
    }


def read_parameter_file(path: Path) -> dict[str, dict[str, Any]]:
    """Read a ROS 2 parameter file.

    Parameters
    ----------
    path : Path
        YAML of the form ``node: {ros__parameters: {name: value}}``; ``/**`` is every node.

    Returns
    -------
    dict
        Per executable its values by dotted name.

    Raises
    ------
    ParameterError
        It cannot be read, has another form, or names an unknown node or parameter.
    """
    what = f"config = '{path}'"
    try:
        with path.open(encoding="utf-8") as file:
            content = load_yaml(file.read(LARGEST + 1), exponents=True)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise ParameterError(f"{what}: must be a readable parameter file: {reason}") from None
    except ValueError as error:
        raise ParameterError(f"{what}: must be YAML: {shown(str(error))}") from None
    if not isinstance(content, dict):
        raise ParameterError(f"{what}: must map nodes to ros__parameters")
    values: dict[str, dict[str, Any]] = {executable: {} for executable in NODES}
    for key, section in content.items():
        node = shown(str(key))
        if not isinstance(section, dict) or set(section) != {"ros__parameters"}:
            raise ParameterError(f"{what}: {node}: must hold ros__parameters, nothing else")
        flat = _flat(section["ros__parameters"] or {}, f"{what}: {node}")
        check_clock(flat.pop(USE_SIM_TIME, False))
        for executable in NODES if node in _WILDCARDS else [node.rsplit("/", 1)[-1]]:
            if executable not in NODES:
                names = ", ".join(NODES)
                raise ParameterError(f"{what}: {node}: must be /** or one of {names}")
            values[executable] |= _known(flat, executable, node, what)
    return values


def parameter_text(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the ROS parameter file with the values of each node, nested or by dotted name."""
    content = {node: {"ros__parameters": dict(values)} for node, values in nodes.items()}
    return str(yaml.dump(content, Dumper=_Plain, sort_keys=False))


class _Plain(yaml.SafeDumper):
    """Writes values that several places share once for each, as nothing here reads aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True."""
        return True


def _flat(section: Any, what: str, prefix: str = "") -> dict[str, Any]:
    if not isinstance(section, dict):
        where = shown(prefix) or "ros__parameters"
        raise ParameterError(f"{what}: {where}: must map names to values")
    flat: dict[str, Any] = {}
    for name, value in section.items():
        if isinstance(value, dict):
            flat |= _flat(value, what, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _known(flat: dict[str, Any], executable: str, node: str, what: str) -> dict[str, Any]:
    """Keep a node's own parameters; refuse unknown ones, of a named node also other nodes'."""
    schema = node_schema(executable)
    others = NODES if node in _WILDCARDS else ()
    for name in flat:
        if name not in schema and not any(name in node_schema(other) for other in others):
            raise ParameterError(f"{what}: {node}: {shown(name)}: no such parameter")
    return {name: value for name, value in flat.items() if name in schema}
