# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads YAML that may be damaged or hostile, in bounded time and memory."""

from __future__ import annotations

import re
from typing import Any, ClassVar

import yaml

from haptic_accel.core.bounded_files import DEEPEST, LARGEST_TEXT, MOST_VALUES
from haptic_accel.core.decimals import read_decimal, read_whole
from haptic_accel.core.parameters import one_line

# With libyaml, where PyYAML has it, ten times as fast.
_FASTEST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_FLOAT = "tag:yaml.org,2002:float"
_NUMBERS = {
    # Not 010: that is eight for ROS.
    "tag:yaml.org,2002:int": (read_whole, r"[-+]?(0|[1-9][0-9]*)"),
    _FLOAT: (read_decimal, r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+][0-9]+)?"),
}
"""Reader and form of numbers by tag. YAML 1.1 has others, with underscores or to the base 60."""


class _Loader(_FASTEST):  # type: ignore[misc]
    """Loader for which only plain decimals are numbers."""

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
    """Loader for which 1e5 is a number, too, as for ROS; in YAML 1.1 it is text."""


_ExponentLoader.add_implicit_resolver(
    _FLOAT, re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$"), _FIRST
)


def load_yaml(text: str, *, exponents: bool = False) -> Any:
    """Return the content of a YAML text.

    Parameters
    ----------
    text : str
    exponents : bool
        True if a number may have an exponent without a decimal point, as in ROS parameter files.

    Raises
    ------
    ValueError
        It is not YAML, too large, too deep, or has aliases, which may stand for any amount of
        data; the message is one line.
    """
    if len(text) > LARGEST_TEXT:
        raise ValueError(f"it has {len(text)} characters, and may have {LARGEST_TEXT}")
    try:
        _check(text)
        return yaml.load(text, _ExponentLoader if exponents else _Loader)
    except (yaml.YAMLError, LookupError, TypeError, AttributeError, OverflowError) as error:
        # What its constructors raise for values such as `!!binary ä` is not documented.
        raise ValueError(one_line(error)) from None


def texts_of(content: Any) -> dict[str, str]:
    """Return a mapping of texts, or of what may stand for one without quotation marks.

    Raises
    ------
    ValueError
        It is not one.
    """
    rows = dict(content or {}).items()
    if any(isinstance(part, (dict, list, set, tuple, bytes)) for row in rows for part in row):
        raise ValueError("custom data must be texts")
    return {str(name): str(value) for name, value in rows}


def _check(text: str) -> None:
    depth = values = 0
    for event in yaml.parse(text, _FASTEST):
        values += isinstance(event, yaml.NodeEvent)
        if values > MOST_VALUES:
            raise ValueError(f"it has more than {MOST_VALUES} values and names")
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("it has an alias (*), which is not read")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise ValueError(f"it is nested deeper than {DEEPEST} levels")


def lines_of(text: str) -> dict[tuple[str, ...], int]:
    r"""Return the line of each value of a YAML text that `load_yaml` takes, from 1, by its keys.

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
