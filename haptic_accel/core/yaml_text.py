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

"""Reader of damaged or hostile YAML, with bounded time and memory."""

from __future__ import annotations

import re
from typing import Any, ClassVar

import yaml

from haptic_accel.core.bounded_files import DEEPEST, LARGEST_TEXT, MOST_VALUES
from haptic_accel.core.decimals import read_decimal, read_whole
from haptic_accel.core.parameters import one_line

# With libyaml, if PyYAML includes it, ten times faster.
_FASTEST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_FLOAT = "tag:yaml.org,2002:float"
_NUMBERS = {
    # 010 is excluded, as ROS reads it as eight.
    "tag:yaml.org,2002:int": (read_whole, r"[-+]?(0|[1-9][0-9]*)"),
    _FLOAT: (read_decimal, r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+][0-9]+)?"),
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
        The text is no YAML, is too large or too deep, or has aliases, which may expand to any
        amount of data; the message is one line.
    """
    if len(text) > LARGEST_TEXT:
        raise ValueError(f"{len(text)} characters; at most {LARGEST_TEXT} are allowed")
    try:
        _check(text)
        return yaml.load(text, _ExponentLoader if exponents else _Loader)
    except (yaml.YAMLError, LookupError, TypeError, AttributeError, OverflowError) as error:
        # Errors of its constructors, for example for `!!binary ä`, are not documented.
        raise ValueError(one_line(error)) from None


def texts_of(content: Any) -> dict[str, str]:
    """Return a mapping of texts, or of values that can be read as texts without quotation marks.

    Raises
    ------
    ValueError
        The content is no such mapping.
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
            raise ValueError("it has an alias (*), which is not allowed")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise ValueError(f"it is nested deeper than {DEEPEST} levels")


def lines_of(text: str) -> dict[tuple[str, ...], int]:
    r"""Return the line of each value in a YAML text for `load_yaml`, from 1, by its keys.

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
