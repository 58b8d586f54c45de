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

"""Documents in YAML, JSON or NPZ; errors name the file, the line in YAML, and the value.

All messages have one form: ``scene.yaml:4: materials.wood.stiffness = -1: must be from 1 to 10000
N/m``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from haptic_accel.core import parameters
from haptic_accel.core.bounded_files import located, read_json, read_text
from haptic_accel.core.model import FloatArray, Vector
from haptic_accel.core.yaml_text import lines_of, load_yaml

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
            given = {name: values[name] for name in parameters.own_schema(kind) if name in values}
            return kind(**given, **others)

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
    with located(parameters.shown(str(path)), "must be YAML"):
        text = read_text(path)
        return Document(path, load_yaml(text, exponents=True), text)


def read_json_document(path: Path) -> Document:
    """Read a JSON file.

    Raises
    ------
    ParameterError
        The file cannot be read, or has another format.
    """
    with located(parameters.shown(str(path)), "must be JSON"):
        return Document(path, read_json(path))
