# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parsing and description of ``key:=value`` arguments by the dataclass that declares them.

This module avoids slow imports, so that an emergency stop starts at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from inspect import get_annotations
from typing import Any, TypeVar

from haptic_accel.core.parameters import (
    Checked,
    ParameterError,
    parameter,
    read_decimal,
    read_whole,
    schema,
    shown,
    suggestion,
)

_NAMESPACE = re.compile("(/[A-Za-z_][A-Za-z0-9_]*)+")


@dataclass(frozen=True)
class NamespaceArguments(Checked):
    """Namespace."""

    namespace: str = parameter("", "namespace of the graph; empty for the root")

    def __post_init__(self) -> None:
        """Check all fields; normalize the namespace to a leading slash and no trailing one."""
        super().__post_init__()
        object.__setattr__(self, "namespace", _absolute(self.namespace))


def _absolute(namespace: str) -> str:
    """Return a namespace with a leading and no trailing slash; empty for the root."""
    path = namespace.strip("/")
    if path and not _NAMESPACE.fullmatch(f"/{path}"):
        raise ParameterError(
            f"namespace = {namespace!r}: must be letters, digits and _, with / between"
        )
    return path and f"/{path}"


A = TypeVar("A", bound=Checked)

MOVED = {
    **dict.fromkeys(("storage_preset_profile", "max_bag_size", "max_bag_duration"), "recorder"),
    **dict.fromkeys(("regex", "exclude_regex", "start_paused"), "recorder"),
    "scope_host": "scope",
}
"""Former arguments, now node parameters only, with the name of the node."""


def parse_assignments(assignments: Iterable[str], kind: type[A]) -> A:
    """Read ``key:=value`` arguments.

    Parameters
    ----------
    assignments : iterable of str
    kind : type
        Dataclass that declares the keys; its class method `from_specified`, if any, builds it.

    Raises
    ------
    ParameterError
        An argument has another form, an unknown or repeated key, or a value that is not allowed.
    """
    known = schema(kind)
    values: dict[str, Any] = {}
    for assignment in assignments:
        key, separator, text = assignment.partition(":=")
        if not separator:
            raise ParameterError(f"{assignment!r}: must have the form key:=value")
        if key not in known:
            raise unknown_key(key, known)
        if key in values:
            raise ParameterError(f"{key}: given twice")
        values[key] = _value(text, known[key][0])
    build: Callable[..., A] = getattr(kind, "from_specified", kind)
    return build(**values)


def is_argument(word: str) -> bool:
    """Return whether a text has the form ``key:=value``; keys, unlike folders, have no slash."""
    key, separator, _ = word.partition(":=")
    return bool(separator) and "/" not in key


def assigned_keys(assignments: Iterable[str]) -> list[str]:
    """Return the keys of the texts of the form ``key:=value``."""
    return [assignment.partition(":=")[0] for assignment in assignments if ":=" in assignment]


def unknown_key(key: str, known: Iterable[str]) -> ParameterError:
    """Return an error that names the nearest key and all keys, or the node with that key."""
    if key in MOVED:
        name = key.removeprefix(f"{MOVED[key]}_")
        return ParameterError(
            f"{key}: no argument any more: give the parameter {name} of {MOVED[key]}"
            " with params_file:=FILE"
        )
    known = list(known)
    return ParameterError(
        f"{shown(key)}: no such argument{suggestion(key, known)}; there are {', '.join(known)}"
    )


def _value(text: str, default: Any) -> Any:
    """Convert text to its argument's type; other text is unchanged and refused later."""
    if isinstance(default, str):
        return text
    if isinstance(default, bool):
        return {"true": True, "false": False}.get(text.lower(), text)
    try:
        return read_decimal(text) if isinstance(default, float) else read_whole(text)
    except ValueError:
        return text


def described(kind: type[Checked]) -> list[tuple[str, str, str]]:
    """Return name, default and description of every argument, for help texts, group by group.

    A group contains the arguments that one class declares: first the dataclass itself, then its
    bases, one by one.
    """
    lines = []
    for name, (default, specification) in sorted(
        schema(kind).items(), key=lambda item: kind.__mro__.index(_owner(kind, item[0]))
    ):
        stated = str(default).lower() if isinstance(default, bool) else f"{default}"
        unit = f" [{specification.unit}]" if specification.unit else ""
        allowed = f"; one of {', '.join(specification.choices)}" if specification.choices else ""
        lines.append((name, stated, specification.text + unit + allowed))
    return lines


def group(kind: type[Checked], name: str) -> str:
    """Return the heading of an argument's group: the summary of the class that declares it."""
    summary = (_owner(kind, name).__doc__ or "").partition("\n")[0]
    return summary.rstrip(".")


def _owner(kind: type[Checked], name: str) -> type:
    """Return the class, a dataclass itself or a base of it, that declares an argument."""
    field = name.partition(".")[0]
    return next((base for base in kind.__mro__ if field in get_annotations(base)), kind)
