# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry points for commands, executables, devices and controllers of other packages.

All code of other packages is loaded here, so that a defective package affects only its own
additions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.metadata import Distribution, EntryPoint, distributions
from importlib.util import find_spec
from typing import Any, TypeVar

from haptic_accel.core import parameters
from haptic_accel.core.parameters import ParameterError, one_line, printable, warn_once

OWN = "haptic_accel"
"""Name of this package, whose own names other packages cannot use."""

NAME = re.compile(r"[a-z][a-z0-9_]*")
"""Form of a name; the names of devices and controllers are part of ROS parameter names."""

T = TypeVar("T")


class OutsideError(ParameterError):
    """Failure of another package's code, or of its selection; the message is one line."""


@contextmanager
def guard(origin: str = "", passing: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Convert any exception of another package's code, even `SystemExit`, to an `OutsideError`.

    `KeyboardInterrupt` is not converted.

    Parameters
    ----------
    origin : str
        Module of the code, for the message. Exceptions of this package's own modules are not
        converted.
    passing : tuple of type
        Exceptions of the code that are not converted.
    """
    try:
        yield
    except BaseException as error:
        is_own = origin.partition(".")[0] == OWN
        if is_own or isinstance(error, (KeyboardInterrupt, *passing)):
            raise
        raise OutsideError(f"{origin}: {_reason(error)}".removeprefix(": ")) from None


def _reason(error: BaseException) -> str:
    kind = type(error).__name__
    try:
        return printable(f"{kind}: {one_line(error)}")
    except BaseException:  # the text also comes from foreign code
        return kind


def declared(group: str, reserved: Collection[str] = ()) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name: this package's, then those of others.

    An unusable or duplicate name is omitted with a warning.

    Parameters
    ----------
    group : str
    reserved : collection of str
        Names that already have a meaning.
    """
    found: dict[str, EntryPoint] = {}
    for entry in sorted(_entries(group), key=lambda each: (_package(each.dist) != OWN, each.name)):
        if not NAME.fullmatch(entry.name):
            reason = "must be like my_arm2"
        elif entry.name in reserved or entry.name in found:
            reason = "is taken"
        else:
            found[entry.name] = entry
            continue
        package = _package(entry.dist)
        warn_once(f"{group}: {entry.name!r} of package {package}: not used: its name {reason}")
    return found


def _entries(group: str) -> Iterator[EntryPoint]:
    """Yield the entry points of a group; for a package that is found twice, those of the first."""
    packages: set[str] = set()
    for package in distributions():
        try:
            with guard():
                is_named = f"[{OWN}." in (package.read_text("entry_points.txt") or "")
                entries = package.entry_points.select(group=group) if is_named else None
        except OutsideError as error:
            warn_once(f"package {_package(package)}: entry_points.txt: {error}")
            continue
        if entries is not None and (name := _package(package)) not in packages:
            packages.add(name)
            yield from entries


def _package(package: Distribution | None) -> str:
    """Return the name of a package as it is written in Python."""
    try:
        with guard():
            return printable(re.sub(r"[-_.]+", "_", package.name).lower()) if package else ""
    except OutsideError:
        return "without a name"


def load(entry: EntryPoint, problem: Callable[[Any], str]) -> Any:
    """Load the object of an entry point.

    Parameters
    ----------
    entry : EntryPoint
    problem : callable
        Returns the reason to reject an object; empty if there is none.

    Raises
    ------
    OutsideError
        The object cannot be loaded, or is rejected; the message contains the package.
    """
    package = f"package {_package(entry.dist)}"
    try:
        with guard():
            found = entry.load()
            reason = problem(found)
    except OutsideError as error:
        raise OutsideError(f"{package}: {error}") from None
    if reason:
        raise OutsideError(f"{package}: {entry.value}: {reason}")
    return found


def main_of(module: str) -> Callable[[], None]:
    """Return the function `main` of an executable's module.

    Raises
    ------
    OutsideError
        The module is missing, or belongs to another package and cannot be imported or lacks
        `main`.
    """
    if not module:
        raise OutsideError("no such executable, or its package is not installed")
    with guard(module):
        main: Callable[[], None] = import_module(module).main
    return main


def with_outside(
    own: Mapping[str, type[T]],
    group: str,
    base: Any,
    problem: Callable[[Any, Mapping[str, type[T]]], str],
    reserved: Collection[str] = (),
) -> dict[str, type[T]]:
    """Return classes by name: this package's, then the other packages' in a group.

    A class that cannot be loaded is replaced by one that raises the reason, an `OutsideError`,
    when it is instantiated, so that all others work.

    Parameters
    ----------
    own : mapping
        Classes of this package by name.
    group : str
        Group of entry points.
    base : type
        Base class of each class.
    problem : callable
        Returns the reason to reject a class, for the classes before it; empty if there is none.
    reserved : collection of str
        Names that classes must not have, as they have another meaning.
    """
    found = dict(own)

    def problem_of(kind: Any) -> str:
        if not (isinstance(kind, type) and issubclass(kind, base)):
            return f"must be a subclass of {base.__name__}"
        if missing := sorted(getattr(kind, "__abstractmethods__", ())):
            return f"must define {', '.join(missing)}"
        return problem(kind, found)

    for name, entry in declared(group, {*own, *reserved}).items():
        try:
            found[name] = load(entry, problem_of)
        except OutsideError as error:
            found[name] = _unusable(base, error)
    return found


def parameters_problem(kind: Any) -> str:
    """Return the reason to reject a class of parameters; empty if there is none."""
    if not (isinstance(kind, type) and issubclass(kind, parameters.Checked)):
        return "Parameters must be a Checked dataclass"
    try:
        parameters.schema(kind)
        kind()
    except Exception as error:  # a field of an unsupported type, or without a default
        return f"Parameters: {one_line(error)}"
    return ""


def _unusable(base: Any, reason: OutsideError) -> Any:
    """Return a class that raises a reason when it is instantiated."""

    def refuse(*_: Any, **__: Any) -> None:
        raise reason

    kind: Any = type("Unusable", (base,), {"__init__": refuse})
    kind.__abstractmethods__ = frozenset()  # none of its methods is ever called
    return kind


NODES_GROUP = "haptic_accel.nodes"
"""Group of entry points for executables outside the folder of the nodes."""


def node_module(executable: str) -> str:
    """Return the module with the function `main` of an executable; empty for a missing one.

    Raises
    ------
    OutsideError
        Another package declares the executable, and its folder cannot be searched.
    """
    own = f"haptic_accel.nodes.{executable}"
    if find_spec(own):
        declared(NODES_GROUP, [executable])  # warns of packages that use this name
        return own
    with guard(), suppress(ModuleNotFoundError):  # a folder may have been removed
        entry = declared(NODES_GROUP).get(executable)
        if entry and find_spec(entry.value):
            return entry.value
    return ""
