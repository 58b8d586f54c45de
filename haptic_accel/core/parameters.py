# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters with unit and range, checked with one-line error messages."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar

T = TypeVar("T")

_SPECIFICATION = "parameter"


class ParameterError(ValueError):
    """A value given by the user is not allowed; the message is one printable line for the user."""

    def __init__(self, message: str) -> None:
        # Names from files and command lines are in it.
        super().__init__(printable(message))


def check_positive_rate(rate: float) -> None:
    """Refuse a sampling rate in Hz that is not a positive number.

    Raises
    ------
    ParameterError
        Naming the rate.
    """
    if not (math.isfinite(rate) and rate > 0):
        raise ParameterError(f"rate = {rate}: must be above 0 Hz")


def printable(text: str, kept: str = "") -> str:
    r"""Return a text whose characters a terminal prints, and does not obey.

    Controls, those of the direction of writing, ends of lines, and bytes that are no text become
    what Python writes for them, such as ``\x1b``.

    Parameters
    ----------
    text : str
    kept : str
        Characters that stay as they are.
    """
    if text.isprintable():
        return text
    return "".join(
        each if each.isprintable() or each in kept else each.encode("unicode_escape").decode()
        for each in text
    )


def shown(text: str) -> str:
    """Return a text from outside as it fits into a message of one line."""
    printable = text if text.isprintable() else repr(text)
    return printable if len(printable) <= 200 else printable[:200] + "..."


def one_line(error: BaseException) -> str:
    """Return an error's text in one line."""
    return " ".join(str(error).split()) or type(error).__name__


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a hint for an error about an unknown word: the nearest known one, or nothing."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]}?)" if near else ""


@dataclasses.dataclass(frozen=True)
class Specification:
    """Description of one parameter: everything but its value.

    Attributes
    ----------
    text : str
        Meaning of the parameter, and the source of its default.
    unit : str
        SI unit, empty for a pure number.
    low, high : float or None
        Smallest and largest value allowed; ``None`` means no bound.
    above : bool
        True if `low` itself is excluded.
    choices : tuple of str
        The allowed words of a string parameter, beside its default; empty where any is allowed.
    block : str
        Block of the node that holds the parameter, wherever its dataclass is nested; empty for
        a parameter that belongs to its dataclass alone.
    sets : tuple of str
        Parameters of nodes that an argument of the graph sets, each as ``node.parameter``.
    """

    text: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    above: bool = False
    choices: tuple[str, ...] = ()
    block: str = ""
    sets: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """The allowed values in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        unit = f" {self.unit}" if self.unit else ""
        if self.low is None:
            return (
                f"a finite number{unit}" if self.high is None else f"at most {self.high:g}{unit}"
            )
        if self.high is None:
            return f"{'above' if self.above else 'at least'} {self.low:g}{unit}"
        return f"{'above' if self.above else 'from'} {self.low:g} to {self.high:g}{unit}"

    def admits(self, number: float) -> bool:
        """Return True for a finite number within the bounds."""
        try:
            if not math.isfinite(number):
                return False
        except OverflowError:  # a whole number larger than any float
            return False
        if self.low is not None and (number < self.low or (self.above and number == self.low)):
            return False
        return self.high is None or number <= self.high


def parameter(default: Any, text: str, *details: Any, **named: Any) -> Any:
    """Declare a dataclass field as a parameter: its default, and its `Specification` in order."""
    return specified(default, Specification(text, *details, **named))


def like(owner: type, name: str, default: Any = None) -> Any:
    """Declare a dataclass field as a field of another dataclass, with its default or another."""
    known, specification = schema(owner)[name]
    return specified(known if default is None else default, specification)


def specified(default: Any, specification: Specification) -> Any:
    """Declare a dataclass field as a parameter with a specification."""
    return dataclasses.field(default=default, metadata={_SPECIFICATION: specification})


def checked(name: str, value: Any, default: Any, specification: Specification) -> Any:
    """Return a value in the type of its default, or raise an error that names the problem.

    Parameters
    ----------
    name : str
        Name of the parameter in the message.
    value
        The value as given: from a file, a command line or code.
    default
        The default, whose type (bool, int, float or str) the result has.
    specification : Specification
        Range and choices.

    Raises
    ------
    ParameterError
        Wrong type, not finite, out of range, or not one of the choices.
    """
    found = shown(repr(value) if isinstance(value, str) else str(value))
    wrong = ParameterError(f"{name} = {found}: must be {allowed_values(default, specification)}")
    if isinstance(default, (bool, str)):
        if not isinstance(value, type(default)):
            raise wrong
        if specification.choices and value not in (*specification.choices, default):
            raise ParameterError(f"{wrong}{suggestion(str(value)[:200], specification.choices)}")
        return value
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (number and specification.admits(value)):
        raise wrong
    if not isinstance(default, int):
        return float(value)
    if value != int(value):
        raise wrong
    return int(value)


def allowed_values(default: Any, specification: Specification) -> str:
    """Return in words the values that a parameter may have, whose default gives its type."""
    if isinstance(default, bool):
        return "true or false"
    if isinstance(default, str):
        return specification.allowed if specification.choices else "text"
    if isinstance(default, int):
        return f"a whole number, {specification.allowed}"
    return specification.allowed


class Checked:
    """Base of parameter dataclasses: every field is checked when one is built."""

    def __post_init__(self) -> None:
        """Check all fields that are parameters; dataclasses of parameters check themselves.

        Raises
        ------
        ParameterError
            Naming the class' field, the value and what is allowed.
        """
        for name, (default, specification) in own_schema(type(self)).items():
            value = checked(name, getattr(self, name), default, specification)
            object.__setattr__(self, name, value)


Schema = dict[str, tuple[Any, Specification]]
"""Default and specification by dotted name."""


def own_schema(parameters: type) -> Mapping[str, tuple[Any, Specification]]:
    """Return the parameters of a dataclass without those nested in it, by field name."""
    return _collected(parameters)


@cache  # as many are built in a run
def _collected(parameters: type) -> Mapping[str, tuple[Any, Specification]]:
    own = {
        field.name: (field.default, field.metadata[_SPECIFICATION])
        for field in dataclasses.fields(parameters)
        if _SPECIFICATION in field.metadata
    }
    return MappingProxyType(own)


def schema(parameters: type, prefix: str = "") -> Schema:
    """Return all parameters of a dataclass and of those nested in it, by dotted name.

    A parameter of a block has the block's name before its own, whatever the prefix.

    Parameters
    ----------
    parameters : type
        A dataclass whose fields are parameters or dataclasses of parameters.
    prefix : str
        Prefix of every name, including its dot.
    """
    found: Schema = {}
    for field in dataclasses.fields(parameters):
        name = _dotted(field, prefix)
        if _SPECIFICATION in field.metadata:
            found[name] = (field.default, field.metadata[_SPECIFICATION])
        else:
            found |= schema(_nested(field), name + ".")
    return found


def _dotted(field: dataclasses.Field[Any], prefix: str) -> str:
    """Return the dotted name of a field behind a prefix, or in its block."""
    specification: Specification | None = field.metadata.get(_SPECIFICATION)
    in_block = specification is not None and specification.block
    return f"{in_block}.{field.name}" if in_block else prefix + field.name


def from_flat(parameters: type[T], values: Mapping[str, Any], prefix: str = "") -> T:
    """Build a dataclass, and those nested in it, from values by dotted name.

    Parameters
    ----------
    parameters : type
        The dataclass.
    values : mapping
        Values by dotted name; missing ones keep their default, unknown ones are ignored.
    prefix : str
        Prefix of every name, including its dot.

    Raises
    ------
    ParameterError
        A value is not allowed; the message gives its dotted name.
    """
    fields: dict[str, Any] = {}
    names: dict[str, str] = {}
    for field in dataclasses.fields(parameters):  # type: ignore[arg-type]
        name = names[field.name] = _dotted(field, prefix)
        if _SPECIFICATION not in field.metadata:
            fields[field.name] = from_flat(_nested(field), values, name + ".")
        elif name in values:
            fields[field.name] = values[name]
    try:
        return parameters(**fields)
    except ParameterError as error:
        # The dataclass checks itself and names its field, not where that is nested.
        field_name, equals, rest = str(error).partition(" = ")
        raise ParameterError(f"{names.get(field_name, field_name)}{equals}{rest}") from None


def _nested(field: dataclasses.Field[Any]) -> type:
    if not isinstance(field.default_factory, type):
        raise TypeError(f"{field.name}: neither a parameter nor a dataclass of parameters")
    return field.default_factory
