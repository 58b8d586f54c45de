# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Repair of truncated or damaged bags, after kill -9, a power cut, or a full or failing disk."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_accel.bags import folder
from haptic_accel.bags.chunked_writer import ChunkedWriter
from haptic_accel.bags.mcap import DAMAGE_ERRORS, McapFile
from haptic_accel.bags.metadata import Metadata, MetadataError, TopicEntry, read_metadata
from haptic_accel.core.parameters import ParameterError

DAMAGED = ".damaged"
"""Suffix of the original file after its replacement."""


class DamagedError(Exception):
    """Error: a file of a bag cannot be read by its index; the message is one line."""


@dataclass
class Repair:
    """Result of repairing a bag.

    Attributes
    ----------
    path : Path
    messages : int
        Number of messages in the bag after the repair.
    duration : float
        Time from the first to the last message, s.
    repairs : list of str
        One line for each change; empty without changes.
    problems : list of str
        Damage that could not be repaired, one line each.
    """

    path: Path
    messages: int = 0
    duration: float = 0.0
    repairs: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def inspect(path: Path) -> Metadata:
    """Return the metadata of one MCAP file from its index.

    Raises
    ------
    DamagedError
        The index is missing or damaged, or the file is not an MCAP file.
    """
    file = McapFile(path)
    try:
        return Metadata.of(file, file.read_index())
    except (OSError, *DAMAGE_ERRORS) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise DamagedError(f"{path.name}: {reason}") from None


def _inspect_all(path: Path) -> Metadata:
    """Check the complete contents of one MCAP file; return its metadata from the index.

    Raises
    ------
    DamagedError
        Any part of the file is damaged, or it is not an MCAP file.
    """
    metadata, file = inspect(path), McapFile(path)
    deque(file.chunks(), maxlen=0)
    if file.problems:
        raise DamagedError(file.problems[0])
    return metadata


def repair(path: Path) -> Repair:
    """Repair a bag; an intact bag remains unchanged.

    Originals of replaced files are kept with the suffix `DAMAGED`.

    Parameters
    ----------
    path : Path
        Folder of a bag.

    Raises
    ------
    ParameterError
        The path is not a bag, the bag's files are not MCAP files, or a file is still being written
        or has a name that is not UTF-8.
    OSError
        A file cannot be written.
    """
    if not os.path.isdir(path):
        raise ParameterError(f"{path}: must be the folder of a bag")
    files = folder.storage_files(path)
    if not files:
        raise ParameterError(f"{path}: {folder.MUST_BE}")
    if others := [file.name for file in files if file.suffix != folder.MCAP]:
        raise ParameterError(f"{path}: must be a bag of .mcap files to repair, has {others[0]}")
    if writing := [file.name for file in files if folder.is_being_written(file)]:
        raise ParameterError(
            f"{path}: {writing[0]} is still being written: stop the recording before the repair"
        )
    if odd := [file.name for file in files if folder.listed_name(file.name) != file.name]:
        raise ParameterError(
            f"{path}: {odd[0]}: must have a name in UTF-8, which {folder.METADATA} can list:"
            " rename it"
        )
    done = Repair(path)
    try:
        before = read_metadata(path)
    except MetadataError:
        before = None
    custom = before.custom if before else _custom_data(files)
    (path / f"{folder.METADATA}.tmp").unlink(missing_ok=True)
    found = [_repaired(file, dict(custom), done) for file in files]
    whole = [metadata for metadata in found if metadata]
    now = replace(
        before or Metadata(()),
        files=tuple(file for metadata in whole for file in metadata.files),
        topics=_merged(whole),
        custom=custom,
    )
    done.messages = now.messages
    done.duration = now.seconds
    if whole and not (before and _counts(before) == _counts(now)):
        if (path / folder.METADATA).exists():
            _set_aside(path / folder.METADATA)
        now.write(path)
        done.repairs.append(f"{folder.METADATA}: rewritten")
    return done


def _repaired(path: Path, custom: dict[str, str], done: Repair) -> Metadata | None:
    """Return the metadata of a file, rebuilt if necessary; None if nothing is readable."""
    try:
        return _inspect_all(path)
    except DamagedError as damage:
        with TemporaryDirectory(dir=path.parent) as work:
            rebuilt = Path(work) / path.name
            try:
                done.problems += _rebuild(path, rebuilt, custom)
            except ValueError as error:
                done.problems.append(f"{path.name}: {error}: renamed")
                _set_aside(path)
                return None
            metadata = inspect(rebuilt)
            _set_aside(path)
            rebuilt.replace(path)
        done.repairs.append(f"{damage}: {metadata.messages} messages kept")
        return metadata


def _rebuild(damaged: Path, target: Path, custom: dict[str, str]) -> list[str]:
    """Copy an MCAP file's intact content to a new file, with an index.

    Chunks remain unchanged. A truncated, uncompressed last chunk keeps its complete messages.

    Returns
    -------
    list of str
        Chunks that could not be kept, one line each.

    Raises
    ------
    ValueError
        The file is not an MCAP file.
    """
    source = McapFile(damaged)
    rebuilt: ChunkedWriter | None = None
    for chunk in source.chunks(by_index=False):
        rebuilt = rebuilt or ChunkedWriter(target, compressed=bool(chunk.compression))
        rebuilt.add_chunk(chunk)
    rebuilt = rebuilt or ChunkedWriter(target)
    rebuilt.schemas = list(source.schemas.values())
    names = {schema.name for schema in rebuilt.schemas}
    rebuilt.channels = [c for c in source.channels.values() if c.schema in names]
    content = Metadata.of(source, rebuilt.kept)
    rebuilt.finish(replace(content, custom=custom).text)
    return source.problems


def _merged(files: Sequence[Metadata]) -> tuple[TopicEntry, ...]:
    """Return the topics of several files, with total numbers of messages."""
    topics: dict[tuple[str, str], TopicEntry] = {}
    for topic in (topic for metadata in files for topic in metadata.topics):
        before = topics.get((topic.name, topic.type))
        messages = topic.messages + (before.messages if before else 0)
        topics[topic.name, topic.type] = replace(topic, messages=messages)
    return tuple(topics.values())


def _counts(metadata: Metadata) -> tuple[object, ...]:
    """Return the part of the metadata that must agree with the files."""
    topics = sorted((topic.name, topic.type, topic.messages) for topic in metadata.topics)
    return [(file.name, file.messages) for file in metadata.files], topics


def _custom_data(files: Sequence[Path]) -> dict[str, str]:
    """Return the custom data of the first closed file with custom data."""
    for path in files:
        file = McapFile(path)
        with suppress(OSError, *DAMAGE_ERRORS):
            deque(file.chunks(), maxlen=0)
            if file.metadata and file.custom_data:
                return file.custom_data
    return {}


def _set_aside(path: Path) -> None:
    """Rename a file that is replaced."""
    path.rename(folder.free_name(path.with_name(path.name + DAMAGED)))
