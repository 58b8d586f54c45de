# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Order of a recording's files by their content, despite wrong names or metadata.yaml."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.bags.folder import METADATA
from haptic_accel.bags.mcap import NEVER
from haptic_accel.bags.metadata import FileEntry, Metadata
from haptic_accel.bags.timeline import Arrivals, continuous
from haptic_accel.bags.trial_metadata import ARGUMENTS, PARAMETERS, PREFIX
from haptic_accel.core.model import FloatArray
from haptic_accel.core.sampling import NANOSECONDS, RELEASED, IntArray

FILE_BITS = 40
"""Bits of an offset within a file, in the offsets of a bag's messages."""

COPIED = 0.5
"""Share of equal messages above which a file is a copy of others."""

_RELEASED = round(RELEASED * NANOSECONDS)
_WEIGHTS = np.array([1.0, np.pi, np.e])
_OUTLIERS = 100
"""Number of messages for which one stamp at each end of a file may be an outlier."""


def marks_of(vectors: FloatArray) -> IntArray:
    """Return hashes of vectors, shape (n, 3)."""
    with np.errstate(all="ignore"):
        sums: FloatArray = vectors @ _WEIGHTS
    return sums.view(np.int64)


@dataclass
class FileContent:
    """Content of one file, from which its position in the recording follows.

    Attributes
    ----------
    name : str
    custom : dict
        Custom data of the bag, repeated in the file.
    counts : Counter
        Number of messages by topic.
    start, end : int
        First and last recording time, ns.
    """

    name: str
    custom: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    start: int = NEVER
    end: int = 0
    _samples: dict[str, list[Arrivals]] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Number of messages."""
        return self.counts.total()

    def count(self, topic: str, received: IntArray) -> None:
        """Add recording times of a topic's messages."""
        if len(received):
            self.counts[topic] += len(received)
            self.start = min(self.start, int(received.min()))
            self.end = max(self.end, int(received.max()))

    def add(self, topic: str, samples: Arrivals) -> None:
        """Add samples."""
        self._samples.setdefault(topic, []).append(samples)

    def samples(self) -> dict[str, Arrivals]:
        """Return the samples in order of arrival by topic."""
        found = {}
        for name, parts in self._samples.items():
            columns = ([getattr(p, key) for p in parts] for key in ("stamps", "offsets", "marks"))
            whole = Arrivals(*map(np.concatenate, columns))
            found[name] = whole[np.argsort(whole.offsets, kind="stable")]
        return found


@dataclass(frozen=True)
class Recording:
    """Files of one recording.

    Attributes
    ----------
    files : list of FileContent
        Files in the order of the recording.
    ranks : ndarray of int64
        Rank in the recording of each file in the folder; -1 for files of other recordings.
    custom : dict
        Custom data of the recording.
    notes : list of str
        Notes on files of other recordings and on changed orders, one line each.
    """

    files: list[FileContent]
    ranks: IntArray
    custom: dict[str, str]
    notes: list[str]

    def moved(self, offsets: IntArray) -> IntArray:
        """Convert offsets in the folder to offsets in the recording; -1 for other recordings."""
        ranks = self.ranks[offsets >> FILE_BITS] if len(offsets) else offsets
        within = offsets & ((1 << FILE_BITS) - 1)
        return np.where(ranks < 0, -1, (ranks << FILE_BITS) + within)


@dataclass(frozen=True)
class _Span:
    """Stamps of a file's most frequent topic: first and last by arrival, lowest, highest."""

    topic: str
    first: int
    last: int
    lowest: int
    highest: int
    keys: IntArray


def recordings(
    files: Sequence[FileContent], listed: Sequence[str], custom: Mapping[str, str]
) -> Iterator[Recording]:
    """Yield the recordings in a folder, usually one; the recording of metadata.yaml is first.

    Parameters
    ----------
    files : sequence of FileContent
        Files in order of the numbers in their names.
    listed : sequence of str
        Names in the order of metadata.yaml.
    custom : mapping
        Custom data of metadata.yaml.
    """
    spans = {number: span for number, file in enumerate(files) if (span := _span(file))}
    left, stated = _order(files, spans, listed), dict(custom)
    # Edited metadata, which differ from the copies in all files, still apply to the first
    # recording.
    own = {} if all(_foreign(file, stated) for file in files) else stated
    while left:
        notes: list[str] = []
        used: list[int] = []
        for number in left:
            file = files[number]
            reason = _foreign(file, own) or _conflict(files, spans, used, number)
            if reason:
                notes.append(f"{file.name} is of another recording: {reason}")
                continue
            own = own or file.custom
            used.append(number)
        names = [files[number].name for number in used]
        if [n for n in names if n in listed] != [n for n in listed if n in names]:
            notes.append(f"{METADATA} lists its files in another order than that of their content")
        ranks = np.full(len(files), -1, np.int64)
        ranks[used] = np.arange(len(used))
        yield Recording([files[number] for number in used], ranks, stated or own, notes)
        left, own, stated = [number for number in left if number not in used], {}, {}


def contradictions(
    metadata: Metadata, files: Sequence[FileContent] | Sequence[FileEntry]
) -> Iterator[str]:
    """Yield differences between metadata.yaml and its files, if all are undamaged.

    In old versions of rosbag2, metadata have counts and times of the bag, but not of each file.
    """
    if not metadata.files:
        return
    listed = {file.name: file for file in metadata.files}
    yield from (f"{f.name} is not listed in {METADATA}" for f in files if f.name not in listed)
    both = [file for file in files if file.name in listed]
    if len(both) < len(listed):
        return
    messages = sum(file.messages for file in both)
    if messages != metadata.messages:
        wrong = next((f for f in both if listed[f.name].messages != f.messages), both[0])
        yield (
            f"{METADATA} states {metadata.messages} messages, its files have {messages}: first in"
            f" {wrong.name}"
        )
    elif messages:
        start, end = min(file.start for file in both), max(file.end for file in both)
        if max(abs(start - metadata.start), abs(end - start - metadata.duration)) > _RELEASED:
            yield (
                f"{METADATA} states {metadata.seconds:.3f} s, its messages span"
                f" {(end - start) / NANOSECONDS:.3f} s, or begin at another time"
            )


def _span(file: FileContent) -> _Span | None:
    samples = file.samples()
    name = max(samples, key=lambda topic: len(samples[topic].stamps), default="")
    if not name:
        return None
    arrivals = samples[name]
    ordered = np.sort(arrivals.stamps)
    strays = len(ordered) // _OUTLIERS
    ends = int(ordered[strays]), int(ordered[len(ordered) - 1 - strays])
    keys = arrivals.stamps ^ arrivals.marks
    return _Span(name, int(arrivals.stamps[0]), int(arrivals.stamps[-1]), *ends, keys)


def _order(
    files: Sequence[FileContent], spans: Mapping[int, _Span], listed: Sequence[str]
) -> list[int]:
    """Return the files' indices in the order of the recording."""
    numbered = list(spans)
    ranks = {name: at for at, name in enumerate(listed)}
    stated = sorted(numbered, key=lambda n: ranks.get(files[n].name, len(listed)))
    timed = sorted(numbered, key=lambda n: spans[n].first)
    # An order on which names and metadata agree is tried first.
    tried = [stated, timed] if stated == numbered and listed else [timed, numbered, stated]
    best = min(tried, key=lambda o: continuous((spans[n].first, spans[n].last) for n in o))
    return best + [number for number in range(len(files)) if number not in spans]


def _foreign(file: FileContent, custom: Mapping[str, str]) -> str:
    """Return the reason why a file's metadata belong to another recording; empty if none."""
    for key in (PREFIX + ARGUMENTS, PREFIX + PARAMETERS):
        own, other = file.custom.get(key), custom.get(key)
        if own and other and own != other:
            return f"it states other {key.removeprefix(PREFIX)} than the recording's other files"
    return ""


def _conflict(
    files: Sequence[FileContent], spans: Mapping[int, _Span], used: Sequence[int], number: int
) -> str:
    """Return the reason why a file's samples belong to another recording; empty if none."""
    known = [spans[other] for other in used if other in spans]
    if number not in spans or not known:
        return ""
    own = spans[number]
    if abs(own.first - known[-1].last) <= _RELEASED:
        return ""
    for other, span in zip(used, known, strict=False):
        shared = min(own.highest, span.highest) - max(own.lowest, span.lowest)
        if shared <= _RELEASED or own.topic != span.topic:
            continue
        if np.isin(own.keys, np.concatenate([each.keys for each in known])).mean() < COPIED:
            return f"it has other samples at the times of {files[other].name}"
    return ""
