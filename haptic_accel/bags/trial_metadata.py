# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metadata stored in a bag that identifies the run and machine."""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from typing import Any

from haptic_accel import __version__
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tick import TICK

PREFIX = "haptic_accel."
"""Prefix of this package's keys in a bag's custom data."""

VERSION, ARGUMENTS, PARAMETERS, HOST = "version", "arguments", "parameters", "host"

RUN, LOCKSTEP = "run", "lockstep"
"""Name and value that mark a bag from lockstep instead of a live graph."""


def custom_data(text: str) -> dict[str, str]:
    """Return metadata in the form of rosbag2's custom data: text by name.

    Parameters
    ----------
    text : str
        JSON object, optionally with `ARGUMENTS` and `PARAMETERS`; empty for none.

    Raises
    ------
    ParameterError
        The text is not a JSON object.
    """
    try:
        read = json.loads(text or "{}")
    except ValueError:
        read = None
    if not isinstance(read, dict):
        raise ParameterError("facts: must be a JSON object")
    texts = {
        VERSION: __version__,
        ARGUMENTS: json.dumps(read.get(ARGUMENTS, {})),
        PARAMETERS: json.dumps(read.get(PARAMETERS, {})),
        HOST: json.dumps(host()),
    }
    return {PREFIX + name: value for name, value in texts.items()}


def read_custom_data(custom: Mapping[str, str]) -> dict[str, Any]:
    """Return metadata from a bag's custom data; text that is not JSON remains text."""
    found: dict[str, Any] = {}
    for key, value in custom.items():
        if (name := key.removeprefix(PREFIX)) == key:
            continue
        try:
            found[name] = value if name == VERSION else json.loads(value)
        except (ValueError, RecursionError):
            found[name] = value
    return found


def json_text(arguments: Mapping[str, Any], parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the JSON text that `custom_data` reads."""
    return json.dumps({ARGUMENTS: dict(arguments), PARAMETERS: parameters})


def description(node: str, values: Mapping[str, Any]) -> str:
    """Return the JSON text that a node publishes on `core.topics.DESCRIPTION`.

    Parameters
    ----------
    node : str
        Name without namespace.
    values : mapping
        All parameters of the node by dotted name.
    """
    return json.dumps({VERSION: __version__, PARAMETERS: {node: dict(values)}})


def read_description(text: str) -> dict[str, Any]:
    """Return the metadata in a message of `core.topics.DESCRIPTION`.

    The parameters of its nodes, key `PARAMETERS`, are dictionaries; a lockstep trial's message
    has all metadata of the trial.

    Raises
    ------
    ValueError
        The text is not a JSON object, or does not describe parameters of nodes.
    """
    try:
        found = json.loads(text)
    except RecursionError:
        raise ValueError("its lists are too deep") from None
    nodes = found.get(PARAMETERS) if isinstance(found, dict) else None
    if not isinstance(nodes, dict) or not all(isinstance(own, dict) for own in nodes.values()):
        raise ValueError(f"must be a JSON object with {PARAMETERS!r} of nodes")
    return dict(found)


def host() -> dict[str, Any]:
    """Return name, system and software of this machine."""
    return {
        "name": platform.node(),
        "python": platform.python_version(),
        "tick": TICK,
        "system": platform.platform(),
        "ros_distro": ros_distro(),
        "cores": os.cpu_count(),
    }


@cache
def ros_distro() -> str:
    """Return the ROS 2 distribution of the environment, or of the installed wheels."""
    names = " ".join(each.name or "" for each in metadata.distributions())
    wheels = re.findall(r"\bros[-_](\w+)[-_]rclpy\b", names)
    return os.environ.get("ROS_DISTRO") or (*wheels, "unknown")[0]
