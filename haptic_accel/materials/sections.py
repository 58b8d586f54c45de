"""Sections of a YAML file, whose errors name the file and the line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import (
    Checked,
    ParameterError,
    Specification,
    checked,
    own_schema,
    shown,
    suggestion,
)
from haptic_accel.core.yaml_text import lines_of, read_mapping

C = TypeVar("C", bound=Checked)
T = TypeVar("T")


@dataclass(frozen=True)
class Section:
    """A mapping in a YAML file.

    Attributes
    ----------
    path : Path
    lines : mapping
        Line of each value by the keys that lead to it.
    keys : tuple of str
        Keys that lead to this section.
    values : dict
    """

    path: Path
    lines: Mapping[tuple[str, ...], int]
    keys: tuple[str, ...]
    values: dict[str, Any]

    def refuse(self, problem: str, name: str = "") -> NoReturn:
        """Raise an error at the line of a value, or of the section.

        Raises
        ------
        ParameterError
            Naming the file, the line and the section, with a problem that names the value.
        """
        line = self.lines.get((*self.keys, name)) or self.lines.get(self.keys, 1)
        text = "".join(f"{key}." for key in self.keys) + problem
        # Names from the file are in it: those of other sections, too.
        printable = text if text.isprintable() else ascii(text)
        raise ParameterError(f"{self.path}:{line}: {printable}") from None

    def check_keys(self, *known: str) -> None:
        """Refuse a key that is not known."""
        for name in self.values:
            if name not in known:
                hint = suggestion(name, known) or f": must be one of {', '.join(known)}"
                self.refuse(f"{name}: unknown{hint}", name)

    def inner(self, name: str) -> Section:
        """Return a mapping in this one; empty where it is left out."""
        return self._section(name, self.values.get(name) or {})

    def sections(self) -> Iterator[tuple[str, Section]]:
        """Yield the mappings in this one, by name."""
        for name, values in self.values.items():
            yield name, self._section(name, values)

    def items(self, name: str) -> list[Section]:
        """Return the mappings of a list in this one."""
        values = self.values[name]
        if not isinstance(values, list):
            self.refuse(f"{name} = {shown(repr(values))}: must be a list", name)
        lists = Section(self.path, self.lines, (*self.keys, name), {})
        return [lists._section(str(index), each) for index, each in enumerate(values)]

    def build(self, kind: type[C], **others: Any) -> C:
        """Return a dataclass of parameters from the values that have its fields' names."""
        given = {name: self.values[name] for name in own_schema(kind) if name in self.values}
        try:
            return kind(**given, **others)
        except ParameterError as error:
            self.refuse(str(error), str(error).partition(" = ")[0])

    def value(self, name: str, default: Any, specification: Specification) -> Any:
        """Return a checked value, or its default."""
        try:
            return checked(name, self.values.get(name, default), default, specification)
        except ParameterError as error:
            self.refuse(str(error), name)

    def choice(self, name: str, known: Mapping[str, T]) -> T:
        """Return what a word stands for."""
        word = self.values.get(name, "")
        if not isinstance(word, str) or word not in known:
            self.refuse(f"{name} = {shown(repr(word))}: must be one of {', '.join(known)}", name)
        return known[word]

    def vector(self, name: str, specification: Specification) -> Vector:
        """Return three checked numbers; zeros where they are left out."""
        values = self.values.get(name, [0.0, 0.0, 0.0])
        if not (isinstance(values, list) and len(values) == 3):
            self.refuse(f"{name} = {shown(str(values))}: must be three numbers", name)
        try:
            x, y, z = (checked(name, each, 0.0, specification) for each in values)
        except ParameterError as error:
            self.refuse(str(error), name)
        return x, y, z

    def _section(self, name: str, values: Any) -> Section:
        if not isinstance(values, dict):
            self.refuse(f"{name} = {shown(repr(values))}: must map names to values", name)
        texts = {str(key): value for key, value in values.items()}
        return Section(self.path, self.lines, (*self.keys, name), texts)


def read_sections(path: Path) -> Section:
    """Read a YAML file whose content is a mapping.

    Raises
    ------
    ParameterError
        It cannot be read, or is something else.
    """
    content, text = read_mapping(path)
    values = {str(name): value for name, value in content.items()}
    return Section(path, lines_of(text), (), values)
