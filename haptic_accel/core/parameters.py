# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters with unit and range, and checks with one-line error messages.

Numbers in files and on command lines are plain ASCII decimals: Python's `float` and `int` also
accept digits of other scripts, underscores, ``nan`` and ``inf``. In JSON, null stands for
undefined numbers.
"""

from __future__ import annotations

import dataclasses
import difflib
import logging
import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar

T = TypeVar("T")

_SPECIFICATION = "parameter"


class ParameterError(ValueError):
    """Error: a value from the user is not allowed; the message is one printable line."""

    def __init__(self, message: str) -> None:
        # Names may come from files or the command line.
        super().__init__(printable(message))


def check_positive_rate(rate: float) -> None:
    """Reject a sampling rate in Hz that is not a positive number.

    Raises
    ------
    ParameterError
        The message names the rate.
    """
    if not (math.isfinite(rate) and rate > 0):
        raise ParameterError(f"rate = {rate}: must be above 0 Hz")


def printable(text: str, kept: str = "") -> str:
    r"""Return a text with non-printable characters escaped.

    Control characters, writing direction marks, line ends, and undecodable bytes are replaced
    by Python's escapes, for example ``\x1b``.

    Parameters
    ----------
    text : str
    kept : str
        Characters that remain unchanged.
    """
    if text.isprintable():
        return text
    return "".join(
        each if each.isprintable() or each in kept else each.encode("unicode_escape").decode()
        for each in text
    )


def shown(text: str) -> str:
    """Return an external text in a form suitable for a one-line message."""
    printable = text if text.isprintable() else repr(text)
    return printable if len(printable) <= 200 else printable[:200] + "..."


def one_line(error: BaseException) -> str:
    """Return the text of an error in one line."""
    return " ".join(str(error).split()) or type(error).__name__


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a hint on an unknown word: the most similar known word, or ''."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]}?)" if near else ""


@dataclasses.dataclass(frozen=True)
class Specification:
    """Description of a parameter, without its value.

    Attributes
    ----------
    text : str
        Meaning of the parameter, and the source of its default.
    unit : str
        SI unit; empty for a pure number.
    low, high : float or None
        Smallest and largest allowed value; ``None`` for no bound.
    above : bool
        True if `low` itself is excluded.
    choices : tuple of str
        Allowed words of a string parameter, in addition to its default; empty if any is allowed.
    group : str
        Group of entry points by which other packages add choices; empty if they cannot.
    block : str
        Block of the node that contains the parameter, wherever its dataclass is nested. Empty for
        a parameter of its dataclass only.
    sets : tuple of str
        Node parameters that an argument of the graph sets, each as ``node.parameter``.
    yields : bool
        True for an argument that sets nothing while it has its default, so that a file can set the
        value.
    path : bool
        True for the name of a file or folder, which nodes receive as an absolute path.
    """

    text: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    above: bool = False
    choices: tuple[str, ...] = ()
    group: str = ""
    block: str = ""
    sets: tuple[str, ...] = ()
    yields: bool = False
    path: bool = False

    @property
    def allowed(self) -> str:
        """Description of the allowed values."""
        if self.choices:
            more = f"; packages add more by the entry point {self.group}" if self.group else ""
            return f"one of {', '.join(self.choices)}{more}"
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
        except OverflowError:  # whole number beyond the float range
            return False
        if self.low is not None and (number < self.low or (self.above and number == self.low)):
            return False
        return self.high is None or number <= self.high


def parameter(default: Any, text: str, *details: Any, **named: Any) -> Any:
    """Declare a dataclass field as a parameter, with its default and `Specification` fields."""
    return specified(default, Specification(text, *details, **named))


def like(owner: type, name: str, default: Any = None) -> Any:
    """Declare a dataclass field like a field of another dataclass; the default may differ."""
    known, specification = schema(owner)[name]
    return specified(known if default is None else default, specification)


def specified(default: Any, specification: Specification) -> Any:
    """Declare a dataclass field as a parameter with a specification."""
    return dataclasses.field(default=default, metadata={_SPECIFICATION: specification})


def checked(name: str, value: Any, default: Any, specification: Specification) -> Any:
    """Return a value converted to the type of its default; raise an error if it is invalid.

    Parameters
    ----------
    name : str
        Name of the parameter for the message.
    value
        Value from a file, a command line or code.
    default
        Default; the result has its type (bool, int, float or str).
    specification : Specification
        Range and choices.

    Raises
    ------
    ParameterError
        The type is wrong, or the value is not finite, out of range, or not one of the choices.
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
    """Return a description of a parameter's allowed values; the default determines its type."""
    if isinstance(default, bool):
        return "true or false"
    if isinstance(default, str):
        return specification.allowed if specification.choices else "text"
    if isinstance(default, int):
        return f"a whole number, {specification.allowed}"
    return specification.allowed


class Checked:
    """Base of parameter dataclasses, which checks all fields of a new instance."""

    def __post_init__(self) -> None:
        """Check all parameter fields; nested dataclasses of parameters check themselves.

        Raises
        ------
        ParameterError
            The message contains the class' field, the value and the allowed range.
        """
        for name, (default, specification) in own_schema(type(self)).items():
            value = checked(name, getattr(self, name), default, specification)
            object.__setattr__(self, name, value)


Schema = dict[str, tuple[Any, Specification]]
"""Default and specification by dotted name."""


def own_schema(parameters: type) -> Mapping[str, tuple[Any, Specification]]:
    """Return the parameters of a dataclass, without nested ones, by field name."""
    return _collected(parameters)


@cache  # cached, as many instances are built in a run
def _collected(parameters: type) -> Mapping[str, tuple[Any, Specification]]:
    own = {
        field.name: (field.default, field.metadata[_SPECIFICATION])
        for field in dataclasses.fields(parameters)
        if _SPECIFICATION in field.metadata
    }
    return MappingProxyType(own)


def schema(parameters: type, prefix: str = "") -> Schema:
    """Return all parameters of a dataclass, including nested ones, by dotted name.

    A parameter of a block has the prefix of the block, regardless of `prefix`.

    Parameters
    ----------
    parameters : type
        Dataclass whose fields are parameters or dataclasses of parameters.
    prefix : str
        Prefix of all names, including its dot.
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
    """Return the dotted name of a field after a prefix, or in its block."""
    specification: Specification | None = field.metadata.get(_SPECIFICATION)
    in_block = specification is not None and specification.block
    return f"{in_block}.{field.name}" if in_block else prefix + field.name


def from_flat(parameters: type[T], values: Mapping[str, Any], prefix: str = "") -> T:
    """Build a dataclass, and nested ones, from values by dotted name.

    Parameters
    ----------
    parameters : type
        Dataclass to build.
    values : mapping
        Values by dotted name. Missing ones keep their default, unknown ones are ignored.
    prefix : str
        Prefix of all names, including its dot.

    Raises
    ------
    ParameterError
        A value is not allowed; the message contains its dotted name.
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
        # The dataclass checks itself and names its field, but not the position of that field.
        field_name, equals, rest = str(error).partition(" = ")
        raise ParameterError(f"{names.get(field_name, field_name)}{equals}{rest}") from None


def _nested(field: dataclasses.Field[Any]) -> type:
    if not isinstance(field.default_factory, type):
        raise TypeError(f"{field.name}: neither a parameter nor a dataclass of parameters")
    return field.default_factory


@cache
def warn_once(line: str) -> None:
    """Log a warning once, however often its cause occurs."""
    logging.getLogger(__name__).warning("%s", line)


_BLANKS = " \t"
_WHOLE = re.compile(r"[-+]?[0-9]{1,300}")  # fits into a float
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def read_decimal(text: str) -> float:
    """Return a decimal number, with or without exponent; infinity if it is too large.

    Raises
    ------
    ValueError
        The text is not a decimal number.
    """
    return float(_matched(_DECIMAL, text))


def read_whole(text: str) -> int:
    """Return a whole number written as decimal digits.

    Raises
    ------
    ValueError
        The text is not a whole number, or has more than 300 digits.
    """
    return int(_matched(_WHOLE, text))


def defined(value: Any) -> Any:
    """Return a value for JSON: None instead of a number that is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: defined(inner) for key, inner in value.items()}
    return [defined(inner) for inner in value] if isinstance(value, (list, tuple)) else value


def _matched(pattern: re.Pattern[str], text: str) -> str:
    """Return a text without surrounding blanks; raise `ValueError` if it has another form."""
    bare = text.strip(_BLANKS)
    if not pattern.fullmatch(bare):
        raise ValueError(f"{text[:40]!r}: must be a number")
    return bare
