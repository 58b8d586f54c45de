# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Updates of a user's parameter file, such as a rig's, that preserve the rest of the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any

from haptic_accel.core.files import located, read_text, replace_file
from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.setup import files
from haptic_accel.setup.files import ROS_PARAMETERS

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
    paths = [path for path in params_file.split(files.SEPARATOR) if path]
    if found.absolute() not in files.parameter_paths(params_file):
        paths.append(str(found))
    return ["teleop", f"params_file:={files.SEPARATOR.join(paths)}", *assignments]


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
    files.read_parameter_file(path)  # refuse a file of another form
    try:
        return document, document.load(text) or {}, ""
    except YAMLError as error:
        raise ParameterError(f"{path}: must be YAML: {shown(str(error))}") from None


def _key(content: Mapping[str, Any], node: str) -> str:
    """Return the file's key for a node, or a new key that applies in any namespace."""
    if node == files.EVERY_NODE:
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
