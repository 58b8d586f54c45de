# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Documents in YAML, JSON or NPZ; errors name the file, the line in YAML, and the value.

All messages have one form: ``scene.yaml:4: materials.wood.stiffness = -1: must be from 1 to 10000
N/m``. Damaged or hostile YAML takes bounded time and memory.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NoReturn, TypeVar

import numpy as np
import yaml

from haptic_accel.core import files, parameters
from haptic_accel.core.model import FloatArray, Vector

# With libyaml, if PyYAML includes it, ten times faster.
_FASTEST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_FLOAT = "tag:yaml.org,2002:float"
_NUMBERS = {
    # 010 is excluded, as ROS reads it as eight.
    "tag:yaml.org,2002:int": (parameters.read_whole, r"[-+]?(0|[1-9][0-9]*)"),
    _FLOAT: (parameters.read_decimal, r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+][0-9]+)?"),
}
"""Reader and form of numbers by tag. YAML 1.1 has other forms too, with underscores or base 60."""


class _Loader(_FASTEST):  # type: ignore[misc]
    """Loader that reads only plain decimals as numbers."""

    yaml_implicit_resolvers: ClassVar = {
        first: [(tag, form) for tag, form in known if tag not in _NUMBERS]
        for first, known in _FASTEST.yaml_implicit_resolvers.items()
    }


_FIRST = list("-+.0123456789")
"""First characters of numbers."""

for _tag, (_read, _form) in _NUMBERS.items():
    _Loader.add_implicit_resolver(_tag, re.compile(f"(?:{_form})$"), _FIRST)
    _Loader.add_constructor(
        _tag, lambda loader, node, read=_read: read(loader.construct_scalar(node))
    )


class _ExponentLoader(_Loader):
    """Loader that also reads 1e5 as a number, as ROS does; in YAML 1.1 it is text."""


_ExponentLoader.add_implicit_resolver(
    _FLOAT, re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$"), _FIRST
)


def load_yaml(text: str, *, exponents: bool = False) -> Any:
    """Return the content of a YAML text.

    Parameters
    ----------
    text : str
    exponents : bool
        Allow an exponent without a decimal point, as in ROS parameter files.

    Raises
    ------
    ValueError
        The text is not YAML, is too large or too deep, or has aliases, which may expand to any
        amount of data; the message is one line.
    """
    if len(text) > files.LARGEST_TEXT:
        raise ValueError(f"{len(text)} characters; at most {files.LARGEST_TEXT} are allowed")
    try:
        _check(text)
        return yaml.load(text, _ExponentLoader if exponents else _Loader)
    except (yaml.YAMLError, LookupError, TypeError, AttributeError, OverflowError) as error:
        # Errors of YAML's constructors, for example for `!!binary ä`, are not documented.
        raise ValueError(parameters.one_line(error)) from None


def texts_of(content: Any) -> dict[str, str]:
    """Return a mapping of texts, or of values that can be read as texts without quotation marks.

    Raises
    ------
    ValueError
        The content is not such a mapping.
    """
    rows = dict(content or {}).items()
    if any(isinstance(part, (dict, list, set, tuple, bytes)) for row in rows for part in row):
        raise ValueError("custom data must be texts")
    return {str(name): str(value) for name, value in rows}


def _check(text: str) -> None:
    depth = values = 0
    for event in yaml.parse(text, _FASTEST):
        values += isinstance(event, yaml.NodeEvent)
        if values > files.MOST_VALUES:
            raise ValueError(f"it has more than {files.MOST_VALUES} values and names")
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("it has an alias (*), which is not allowed")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > files.DEEPEST:
            raise ValueError(files.TOO_DEEP)


def lines_of(text: str) -> dict[tuple[str, ...], int]:
    r"""Return the line of each value in a YAML text for `load_yaml`, counted from 1, by its keys.

    Examples
    --------
    >>> lines_of("wood:\n  stiffness: 1")
    {(): 1, ('wood',): 1, ('wood', 'stiffness'): 2}
    """
    lines: dict[tuple[str, ...], int] = {(): 1}

    def visit(node: Any, keys: tuple[str, ...]) -> None:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                inner = (*keys, str(key.value))
                lines[inner] = key.start_mark.line + 1
                visit(value, inner)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                lines[(*keys, str(index))] = value.start_mark.line + 1
                visit(value, (*keys, str(index)))

    visit(yaml.compose(text, _Loader), ())
    return lines


C = TypeVar("C", bound=parameters.Checked)
T = TypeVar("T")

_NUMBER, _TEXT = parameters.Specification("number"), parameters.Specification("text")


@dataclass(frozen=True)
class Document:
    """Value in a document; methods raise an error for a value of another type.

    Attributes
    ----------
    path : Path
    value : Any
    source : str
        Text of the YAML document, to find the lines of its values; empty for other formats.
    keys : tuple of str
        Keys and indices of the value.

    Raises
    ------
    ParameterError
        Raised by the methods, with a one-line message.
    """

    path: Path
    value: Any
    source: str = ""
    keys: tuple[str, ...] = ()

    def refuse(self, problem: str, key: str = "") -> NoReturn:
        """Raise an error at the line of a nested value; the problem names the value."""
        line = f":{self._line(key)}" if self.source else ""
        above = "".join(f"{parameters.shown(each)}." for each in self.keys)
        raise parameters.ParameterError(
            f"{parameters.shown(str(self.path))}{line}: {above}{problem}"
        ) from None

    def wrong(self, allowed: str) -> NoReturn:
        """Raise an error that states the allowed values."""
        if not self.keys:
            self.refuse(allowed)
        *above, name = self.keys
        found = parameters.shown(repr(self.value))
        outer = Document(self.path, None, self.source, tuple(above))
        outer.refuse(f"{parameters.shown(name)} = {found}: {allowed}", name)

    @contextmanager
    def located(self, key: str = "") -> Iterator[None]:
        """Add a nested value's location to errors; by default, of the value they name."""
        try:
            yield
        except parameters.ParameterError as error:
            text = str(error)
            within = key and not text.startswith(key)
            self.refuse(f"{key}: {text}" if within else text, key or text.partition(" = ")[0])

    def __contains__(self, key: str) -> bool:
        """Return True for a mapping that contains a key."""
        return isinstance(self.value, dict) and key in self.value

    def at(self, *keys: str) -> Document:
        """Return the value for one or more keys."""
        found = self
        for key in keys:
            if key not in found:
                found.refuse(f"{key} = nothing: must be given", key)
            found = found.get(key)
        return found

    def get(self, key: str, default: Any = None) -> Document:
        """Return the value of a key, or a default if it is missing or null."""
        value = self.mapping().get(key)
        return self._inner(key, default if value is None else value)

    def mapping(self) -> dict[str, Any]:
        """Return the values by name."""
        if not isinstance(self.value, dict):
            self.wrong("must map names to values")
        return {str(name): value for name, value in self.value.items()}

    def members(self) -> Iterator[tuple[str, Document]]:
        """Yield the values of a mapping by name."""
        for name, value in self.mapping().items():
            yield name, self._inner(name, value)

    def items(self) -> Iterator[Document]:
        """Yield the values of a list."""
        if not isinstance(self.value, list):
            self.wrong("must be a list")
        for index, value in enumerate(self.value):
            yield self._inner(str(index), value)

    def check_keys(self, *known: str) -> None:
        """Reject unknown keys."""
        for name in self.mapping():
            if name not in known:
                hint = parameters.suggestion(name, known) or f": must be one of {', '.join(known)}"
                self.refuse(f"{parameters.shown(name)}: unknown{hint}", name)

    def checked(self, default: Any, specification: parameters.Specification) -> Any:
        """Return the value with the type of a default; see `parameters.checked`."""
        try:
            return parameters.checked("", self.value, default, specification)
        except parameters.ParameterError:
            self.wrong(f"must be {parameters.allowed_values(default, specification)}")

    def number(self, specification: parameters.Specification = _NUMBER) -> float:
        """Return a number within its range."""
        return float(self.checked(0.0, specification))

    def text(self) -> str:
        """Return a text; lone surrogates, which no text file can contain, become ?."""
        return str(self.checked("", _TEXT)).encode(errors="replace").decode()

    def choice(self, known: Mapping[str, T]) -> T:
        """Return the choice for a word."""
        if not isinstance(self.value, str) or self.value not in known:
            self.wrong(f"must be one of {', '.join(known)}")
        return known[self.value]

    def vector(self, specification: parameters.Specification) -> Vector:
        """Return three numbers within their range; zeros for null."""
        if self.value is None:
            return 0.0, 0.0, 0.0
        if not (isinstance(self.value, list) and len(self.value) == 3):
            self.wrong("must be three numbers")
        x, y, z = (each.number(specification) for each in self.items())
        return x, y, z

    def array(self) -> FloatArray:
        """Return an array of numbers."""
        try:
            found = np.asarray(self.value)
            if found.dtype.kind not in "fiu" or not found.size:
                raise ValueError
        except ValueError:  # also for rows of different lengths
            self.wrong("must be numbers, in rows of one length")
        return found.astype(float)

    def build(self, kind: type[C], **others: Any) -> C:
        """Return a dataclass of parameters, with the values of the same names."""
        values = self.mapping()
        with self.located():
            own = {name: values[name] for name in parameters.own_schema(kind) if name in values}
            return kind(**own, **others)

    def _inner(self, key: str, value: Any) -> Document:
        return Document(self.path, value, self.source, (*self.keys, key))

    def _line(self, key: str) -> int:
        lines, keys = lines_of(self.source), (*self.keys, key)
        while keys not in lines:
            keys = keys[:-1]
        return lines[keys]


def read_yaml_document(path: Path) -> Document:
    """Read a YAML file; numbers may have the form of ROS parameter files.

    Raises
    ------
    ParameterError
        The file cannot be read, or has another format.
    """
    with files.located(parameters.shown(str(path)), "must be YAML"):
        text = files.read_text(path)
        return Document(path, load_yaml(text, exponents=True), text)


def read_json_document(path: Path) -> Document:
    """Read a JSON file.

    Raises
    ------
    ParameterError
        The file cannot be read, or has another format.
    """
    with files.located(parameters.shown(str(path)), "must be JSON"):
        return Document(path, files.read_json(path))
