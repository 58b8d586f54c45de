# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One truth in many guises: a right input whose form is changed, but not its content.

A kind has a right form, changes of the form, and figures. For a bag, the form is its messages and
how they are written. Another kind adds changes and a function for the figures; `Kind.check` holds
for any changes that hypothesis draws.
"""

from __future__ import annotations

import itertools
import json
import shutil
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin

import bag_maker
from haptic_accel.bags.trial_metadata import PREFIX
from haptic_accel.core import topics
from haptic_accel.core.parameters import ParameterError

Form = TypeVar("Form")

Change = Callable[[Form, float, float], Form]
"""Change of a form, with two numbers from 0 to 1 that choose where and how much."""

Made: TypeAlias = Sequence[tuple[str, float, float]]
"""Changes by name, each with its two numbers."""


@dataclass(frozen=True)
class Kind(Generic[Form]):
    """Kind of input.

    Attributes
    ----------
    right : callable
        Function from an empty folder to the right form.
    changes : mapping
        Changes by name.
    figures : callable
        Function from a form and the folder to all figures, and to the lines on what was left out
        or contradicts itself; a refusal is a `ParameterError` of one line.
    """

    right: Callable[[Path], Form]
    changes: Mapping[str, Change[Form]]
    figures: Callable[[Form, Path], tuple[object, list[str]]]

    def changed(self, made: Made, folder: Path) -> Form:
        """Return the right form after some changes."""
        form = self.right(folder)
        for name, where, much in made:
            form = self.changes[name](form, where, much)
        return form

    @cached_property
    def truth(self) -> object:
        """Figures of the right form, which has no lines."""
        found, lines = self.found([])
        assert lines == []
        return found

    def found(self, made: Made) -> tuple[object, list[str]]:
        """Return figures, or None if the input is refused, and lines after some changes."""
        with TemporaryDirectory() as folder:
            form = self.changed(made, Path(folder))
            try:
                return self.figures(form, Path(folder))
            except ParameterError as error:
                return None, [str(error)]

    def check(self, made: Made) -> None:
        """Require the same figures, or lines that say why not."""
        found, lines = self.found(made)
        assert found == self.truth or lines
        assert all(len(line.splitlines()) == 1 for line in lines), lines

    @property
    def any_changes(self) -> st.SearchStrategy[Made]:
        """Up to four changes."""
        shares = st.floats(0, 1)
        change = st.tuples(st.sampled_from(sorted(self.changes)), shares, shares)
        return st.lists(change, min_size=1, max_size=4)


@dataclass(frozen=True)
class BagForm:
    """Messages of a bag, and how they are written.

    Attributes
    ----------
    messages : tuple of Message
        In order of their place in the bag.
    custom : mapping
        Custom data.
    splits : tuple of float
        Shares of the messages at which the next file begins.
    names : str
        Pattern of the files' names with ``{0}`` for the number, ``{1}`` for the reverse.
    storage, compression
        Format of the files.
    listed : str
        Order of the files in metadata.yaml: ``right``, ``reversed``, or ``none`` for no such file.
    cut_off : float
        Share of the last file that is missing at its end.
    beside : str
        File beside the bag's: ``copy`` of the first, ``other`` recording of the same time, or
        none.
    """

    messages: tuple[bag_maker.Message, ...]
    custom: Mapping[str, str]
    splits: tuple[float, ...] = ()
    names: str = "bag_{0}"
    storage: StoragePlugin = StoragePlugin.MCAP
    compression: CompressionMode = CompressionMode.NONE
    listed: str = "right"
    cut_off: float = 0.0
    beside: str = ""


def write_form(form: BagForm, folder: Path) -> Path:
    """Write a bag of some files; return its folder."""
    count = len(form.messages)
    edges = [0, *sorted(round(share * count) for share in form.splits), count]
    bag = folder / "bag"
    bag.mkdir()
    entries = []
    parts = [(a, b) for a, b in itertools.pairwise(edges) if b > a]
    for number, (begin, end) in enumerate(parts):
        part = bag_maker.write_messages(
            folder / f"part_{number}",
            form.messages[begin:end],
            storage=form.storage,
            compression=form.compression,
            custom=form.custom,
        )
        (file,) = (path for path in part.iterdir() if path.name != "metadata.yaml")
        name = form.names.format(number, len(parts) - number) + "".join(file.suffixes)
        entries.append((name, part / "metadata.yaml"))
        file.rename(bag / name)
    if form.cut_off:
        file = bag / entries[-1][0]
        content = file.read_bytes()
        file.write_bytes(content[: round(len(content) * (1 - form.cut_off))])
    if form.beside == "copy":
        shutil.copy(bag / entries[0][0], bag / f"copy of {entries[0][0]}")
    if form.beside == "other":
        other = tuple(restamped(each, lambda time: time + OTHER) for each in form.messages)
        part = bag_maker.write_messages(folder / "other", other, custom=form.custom)
        shutil.move(part / "other.mcap", bag)
        shutil.rmtree(part)
    if form.listed != "none":
        _write_metadata(bag, entries, form)
    for number in range(len(parts)):
        shutil.rmtree(folder / f"part_{number}")
    return bag


def _write_metadata(bag: Path, entries: list[tuple[str, Path]], form: BagForm) -> None:
    """Write metadata.yaml of several files from those of bags with one file each."""
    from haptic_accel.bags.metadata import Metadata, read_metadata

    parts = [read_metadata(path.parent) for _, path in entries]
    both = zip(entries, parts, strict=True)
    files = [replace(part.files[0], name=name) for (name, _), part in both]
    if form.listed == "reversed":
        files.reverse()
    whole: Metadata = replace(parts[0], files=tuple(files))
    whole.write(bag)


def restamped(message: bag_maker.Message, moved: Callable[[int], int]) -> bag_maker.Message:
    """Return a message with another stamp, if it has one, and time of reception."""
    if message.kind == bag_maker.STRING:
        return message._replace(received=moved(message.received))
    seconds, rest = struct.unpack_from("<iI", message.data, 4)
    data = bytearray(message.data)
    struct.pack_into("<iI", data, 4, *divmod(moved(seconds * 10**9 + rest), 10**9))
    return message._replace(data=bytes(data), received=moved(message.received))


def _moved(form: BagForm, moved: Callable[[int], int]) -> BagForm:
    """Move all times of a bag."""
    return replace(form, messages=tuple(restamped(each, moved) for each in form.messages))


def _stepped(form: BagForm, where: float, by: int) -> BagForm:
    """Set the clock at a share of the messages; samples of one time stay together."""
    if any(b.received < a.received for a, b in itertools.pairwise(form.messages)):
        return form  # written in another order, after the clock was set
    chosen = form.messages[round((0.1 + 0.8 * where) * (len(form.messages) - 1))].received
    is_after = False
    found = []
    for each in form.messages:
        is_after = is_after or each.received >= chosen
        found.append(restamped(each, lambda time: time + by) if is_after else each)
    return replace(form, messages=tuple(found))


def _with(**fields: Any) -> Change[BagForm]:
    """Return the change that gives a form some other fields."""
    return lambda form, where, much: replace(form, **fields)


def _renamed(form: BagForm, where: float, much: float) -> BagForm:
    return replace(form, names=NAMES[min(len(NAMES) - 1, int(much * len(NAMES)))])


def _slewed(form: BagForm, where: float, much: float) -> BagForm:
    """Let the clock run faster or slower by up to 0.1 % from a time on."""
    begin = form.messages[round(where * 0.5 * len(form.messages))].received
    rate = 1e-3 * (2 * much - 1)
    return _moved(form, lambda time: time + round(max(0, time - begin) * rate))


def _shuffled(form: BagForm, where: float, much: float) -> BagForm:
    """Write blocks of messages in another order."""
    blocks = np.array_split(np.arange(len(form.messages)), 2 + round(20 * much))
    order = np.random.default_rng(round(1e6 * where)).permutation(len(blocks))
    moved = (form.messages[at] for block in order for at in blocks[block])
    return replace(form, messages=tuple(moved))


def _by_topic(form: BagForm, where: float, much: float) -> BagForm:
    messages = sorted(form.messages, key=lambda message: message.topic)
    return replace(form, messages=tuple(messages))


def _twice(form: BagForm, where: float, much: float) -> BagForm:
    first = round(where * len(form.messages))
    count = 1 + round(much * 0.2 * len(form.messages))
    again = form.messages[first : first + count]
    rest = form.messages[first + count :]
    return replace(form, messages=form.messages[: first + count] + again + rest)


def _stray(form: BagForm, where: float, much: float) -> BagForm:
    messages = list(form.messages)
    at = round(where * (len(messages) - 1))
    stray = restamped(messages[at], lambda time: round(much) * (time + 10**17))
    messages[at] = stray._replace(received=messages[at].received)
    return replace(form, messages=tuple(messages))


def _below(form: BagForm, where: float, much: float) -> BagForm:
    below = f"/lab{round(9 * much)}"
    if any(message.topic.startswith("/lab") for message in form.messages):
        return form

    def renamed(message: bag_maker.Message) -> bag_maker.Message:
        if message.kind != bag_maker.CHANGED:
            return message._replace(topic=f"{below}{message.topic}")
        data = bag_maker.change_bytes(message.received, f"{below}/{SET[0]}", *SET[1:])
        return message._replace(data=data)

    return replace(form, messages=tuple(map(renamed, form.messages)))


OTHER = 200_400_000
"""Delay of another recording, ns: not a whole number of samples."""

NAMES = ("bag_{0}", "{0}_bag_2026_11_26-23_07_5{1}", "part{1}", "{1}", "bag_{1}_a")
"""Patterns of file names, with the counter anywhere or in reverse order."""

BAG_CHANGES: Mapping[str, Change[BagForm]] = {
    "split": lambda form, where, much: replace(form, splits=(*form.splits, where)),
    "renamed": _renamed,
    "listed in reverse": _with(listed="reversed"),
    "no metadata": _with(listed="none"),
    "compressed by file": _with(compression=CompressionMode.FILE),
    "compressed by chunk": _with(storage=StoragePlugin.MCAP, compression=CompressionMode.STORAGE),
    "other storage": _with(storage=StoragePlugin.SQLITE3, compression=CompressionMode.NONE),
    "compressed by message": _with(compression=CompressionMode.MESSAGE),
    "copy of a file": _with(beside="copy"),
    "file of another recording": _with(beside="other"),
    "clock off": lambda form, _, much: _moved(form, lambda at: at + round((much - 0.5) * 1e17)),
    "clock set back": lambda form, where, much: _stepped(form, where, -round(1 + much * 5e9)),
    "clock set forward": lambda form, where, much: _stepped(form, where, round(much * 5e9)),
    "clock slewed": _slewed,
    "blocks in another order": _shuffled,
    "by topic": _by_topic,
    "some messages twice": _twice,
    "a stray stamp": _stray,
    "other names of topics": _below,
    "cut off": lambda form, where, much: replace(form, cut_off=much),
    "no data of the recorder": _with(custom={}),
}
"""Changes of a bag's form."""


RATE, SAMPLES, GAIN = 250.0, 375, 0.8
"""Sampling rate, Hz; number of samples; handle's acceleration relative to the desired one."""

SET = "compensator", "controller", "adaptive"
"""Node, parameter and value that a bag's parameter event sets."""


@cache
def _right_bag() -> BagForm:
    # Differences of white noise have hardly any power below the high-pass of the comparison.
    desired = np.diff(np.random.default_rng(3).normal(size=SAMPLES + 1))
    actual = GAIN * np.concatenate([[0.0], desired[:-1]])
    along = {
        topics.TOOL_ACCELERATION: desired,
        topics.DESIRED_ACCELERATION: desired,
        topics.HANDLE_ACCELERATION: actual,
        topics.ACTUATOR_FORCE: 0.1 * actual,
        topics.MASTER_ARM_FORCE: np.ones(SAMPLES),
    }
    stated = bag_maker.meta("constant", "vinyl", rate=RATE)
    text = json.dumps(stated).encode() + b"\0"
    described = b"\0\1\0\0" + struct.pack("<I", len(text)) + text
    about = f"/{topics.DESCRIPTION.name}", bag_maker.STRING
    messages = [bag_maker.Message(*about, bag_maker.START, described)]
    for place in range(SAMPLES):
        stamp = bag_maker.START + round(place * 1e9 / RATE)
        for topic, values in along.items():
            data = bag_maker.vector_bytes(topic.type, stamp, "", (0.0, 0.0, float(values[place])))
            messages.append(bag_maker.Message(f"/{topic.name}", topic.type, stamp, data))
        if place % 100 == 50:
            data = bag_maker.diagnostics_bytes(stamp, "compensator", "OK", {"samples": str(place)})
            kind = topics.DIAGNOSTICS.type
            messages.append(bag_maker.Message("/diagnostics", kind, stamp, data))
        if place == SAMPLES - 1:
            data = bag_maker.change_bytes(stamp, f"/{SET[0]}", *SET[1:])
            messages.append(bag_maker.Message("/parameter_events", bag_maker.CHANGED, stamp, data))
    custom = {
        PREFIX + name: value if isinstance(value, str) else json.dumps(value)
        for name, value in stated.items()
    }
    return BagForm(tuple(messages), custom)


def right_bag(_folder: Path) -> BagForm:
    """Return a bag whose handle repeats 0.8 of the desired acceleration one sample later.

    The error is thus 20 % by theory: RMS of 0.2 times the signal over RMS of the signal.
    """
    return _right_bag()
