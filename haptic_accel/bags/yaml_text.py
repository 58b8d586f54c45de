"""Reads YAML that may be damaged or hostile, in bounded time and memory."""

from __future__ import annotations

import re
from typing import Any

import yaml

LARGEST = 1 << 22
"""Size of the largest text that is read, bytes: a bag of ten thousand files has half of it."""

DEEPEST = 32
"""Levels of nesting that are read; rosbag2 has seven. libyaml's loader overflows its stack."""

# With libyaml, where PyYAML has it, ten times as fast.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_LONG_NUMBER = re.compile(r"[-+.:_\d]{64}")
"""Beginning of a number to the base 60, which takes a time that grows with its square."""


def load_yaml(text: str) -> Any:
    """Return the content of a YAML text.

    Raises
    ------
    ValueError
        It is not YAML, too large, too deep, or has aliases, which may stand for any amount of
        data; the message is one line.
    """
    if len(text) > LARGEST:
        raise ValueError(f"it has {len(text)} characters, and may have {LARGEST}")
    try:
        _check(text)
        return yaml.load(text, _LOADER)
    except (yaml.YAMLError, LookupError, TypeError, AttributeError, OverflowError) as error:
        # What its constructors raise for values such as `!!binary ä` is not documented.
        raise ValueError(" ".join(str(error).split())) from None


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
    depth = 0
    for event in yaml.parse(text, _LOADER):
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("it has an alias (*), which is not read")
        if isinstance(event, yaml.ScalarEvent) and _LONG_NUMBER.match(event.value):
            raise ValueError("it has a number of more than 64 digits")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise ValueError(f"it is nested deeper than {DEEPEST} levels")
