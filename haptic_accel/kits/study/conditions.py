# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conditions as settings of the graph, and the check that the graph can deliver them."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from haptic_accel import ChannelParameters, GraphArguments, ParameterError, preset_file
from haptic_accel.core import LARGEST_GAIN
from haptic_accel.core.document import Document, load_yaml
from haptic_accel.core.parameters import Specification, checked
from haptic_accel.kits.study.procedures import expected_minutes
from haptic_accel.kits.study.protocol import Condition, Protocol, Value
from haptic_accel.kits.study.reading import ARGUMENTS, GAIN, NETWORK, TEXTS, word
from haptic_accel.materials import is_recording
from haptic_accel.setup import arguments as names
from haptic_accel.setup import graph
from haptic_accel.setup.arguments import parse_arguments

LIVE = ("controller", GAIN, "surface", "grip", "reduction", NETWORK)
"""Factors that can change while a graph runs; a surface only if it is no recording."""

FILES = ("surface", "rig", "params_file", "replay")
"""Arguments that may name files; relative paths start at the protocol's folder."""

GAIN_RANGE = Specification("gain of the desired acceleration", low=0.0, high=LARGEST_GAIN)

DEVICES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "surface": ("slave", (names.SIMULATED, names.VIRTUAL)),
    "grip": ("master", (names.SIMULATED, names.POINTER)),
}
"""Factors that need particular devices, with the arm and its devices."""

BYTES_PER_TICK = 1800
"""Size of a bag per tick of the graph, bytes: 1.8 MB/s at 1 kHz, a third more than measured."""

BLANK = re.compile(r"\[\[\s*blank\b:?\s*([^\]]*)", re.IGNORECASE)
"""Pattern of a blank in a template's text, with the instruction for filling it."""

_CHANNEL = re.compile(r"(\d+(?:\.\d+)?)(?:\+-(\d+(?:\.\d+)?))?(?:,(\d+(?:\.\d+)?)%)?")

_MS, _PERCENT = 1e-3, 1e-2

Settings = Iterable[tuple[str, Value]]


def arguments(protocol: Protocol, condition: Condition) -> GraphArguments:
    """Return the settings of a condition that must be set at the graph's start.

    Raises
    ------
    ParameterError
        A value is not allowed.
    """
    return _parsed(protocol, [each for each in condition.settings if not _is_live(*each)])


def live(protocol: Protocol, condition: Condition) -> dict[str, Value]:
    """Return the settings of a condition that can change in a running graph, by factor."""
    return {
        name: _located(protocol, name, value)
        for name, value in condition.settings
        if _is_live(name, value)
    }


def channel(value: Value) -> ChannelParameters:
    """Return the network that a value of the factor ``network`` describes.

    Parameters
    ----------
    value : str or float
        One-way delay, ms; optionally with jitter, ms, and loss, %.

    Raises
    ------
    ParameterError
        The value has another form, or is out of range.

    Examples
    --------
    >>> channel("50+-10,2%")
    ChannelParameters(delay=0.05, jitter=0.01, loss=0.02, duplication=0.0)
    """
    if not (found := _CHANNEL.fullmatch(word(value))):
        allowed = "must be a one-way delay in ms, such as 50, 50+-10 or 50+-10,2%"
        raise ParameterError(f"{NETWORK} = {word(value)}: {allowed}")
    delay, jitter, loss = (float(each or 0) for each in found.groups())
    return ChannelParameters(delay * _MS, jitter * _MS, loss * _PERCENT)


def _gain(value: Value) -> float:
    return float(checked(GAIN, value, 1.0, GAIN_RANGE))


_OTHERS: Mapping[str, Callable[[Value], object]] = {GAIN: _gain, NETWORK: channel}
"""Checks of the factors that are not arguments of the graph."""


def check_deliverable(protocol: Protocol) -> None:
    """Check everything that can be checked before a session.

    Raises
    ------
    ParameterError
        A condition needs a missing file, device or value, or the session is longer than its limit.
    """
    file = _document(protocol)
    with file.located("language"):
        preset_file("studies/language", protocol.language, protocol.source.parent)
    done = set()
    for condition in protocol.conditions:
        settings = tuple(each for each in condition.settings if each[0] in ARGUMENTS)
        with _in_file(file):
            for name, value in condition.settings:
                _OTHERS.get(name, word)(value)
            if settings not in done:
                done.add(settings)
                _check_graph(_parsed(protocol, settings), condition)
    minutes, limit = expected_minutes(protocol), protocol.limits.minutes
    if minutes > limit:
        allowed = f"must be at least {math.ceil(minutes)}, the expected duration"
        file.get("limits", {}).get("minutes", limit).wrong(allowed)
    _check_room(protocol, minutes)


def check_blanks(protocol: Protocol) -> None:
    """Refuse texts for the participant with blanks of a template, ``[[ blank: ... ]]``.

    Raises
    ------
    ParameterError
        The message has the line of the text, and all its blanks.
    """
    file = _document(protocol)
    for location, name in (*(((), text) for text in TEXTS), (("consent",), "text")):
        section = file.at(*location)
        if blanks := BLANK.findall(section.at(name).text()):
            told = "; ".join(" ".join(each.split()) for each in blanks)
            section.refuse(f"{name}: must have its {len(blanks)} blanks filled in: {told}", name)


def _document(protocol: Protocol) -> Document:
    return Document(protocol.source, load_yaml(protocol.content, exponents=True), protocol.content)


def _check_room(protocol: Protocol, minutes: float) -> None:
    """Check that the bags of a session fit on the disk."""
    rate = arguments(protocol, protocol.conditions[0]).rate
    needed, folder = BYTES_PER_TICK * rate * 60 * minutes, protocol.source.parent
    free = shutil.disk_usage(folder).free
    if free < needed:
        room = f"{free / 1e9:.1f} GB are free: must be at least {needed / 1e9:.1f} GB"
        raise ParameterError(f"{folder.absolute()}: {room}, for the bags of a session")


def _is_live(name: str, value: Value) -> bool:
    return name in LIVE and not (name == "surface" and is_recording(str(value)))


def _parsed(protocol: Protocol, settings: Settings) -> GraphArguments:
    given = {**protocol.graph, **dict(settings)}
    return parse_arguments(
        f"{name}:={word(_located(protocol, name, value))}" for name, value in given.items()
    )


def _located(protocol: Protocol, name: str, value: Value) -> Value:
    """Return a value, with file paths relative to the protocol's folder made absolute."""
    if name not in FILES or not isinstance(value, str):
        return value
    beside = [protocol.source.parent / each for each in value.split(",")]
    found = all(each.suffix and each.exists() for each in beside)
    return ",".join(str(each.absolute()) for each in beside) if found else value


def _check_graph(found: GraphArguments, condition: Condition) -> None:
    """Check that a graph can start with its arguments, and that its devices suit a condition."""
    graph(replace(found, record=False))
    for name, value in condition.settings:
        arm, devices = DEVICES.get(name, ("", ()))
        if arm and (device := getattr(found, arm)) not in devices:
            allowed = f"must come with {arm}:= one of {', '.join(devices)}, not {device}"
            raise ParameterError(f"{name} = {word(value)}: {allowed}")


@contextmanager
def _in_file(file: Document) -> Iterator[None]:
    """Add the file and the line of the value that an error names."""
    try:
        yield
    except ParameterError as error:
        name = str(error).partition(" = ")[0]
        named = [each for each in ("factors", "graph") if name in file.get(each, {})]
        (file.get(named[0]) if named else file).refuse(str(error), name if named else "levels")
