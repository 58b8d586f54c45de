# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel bag``: contents of a bag, and repair of a truncated or damaged one."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

import click

from haptic_accel.bags.file_order import contradictions
from haptic_accel.bags.folder import MCAP, MUST_BE, is_being_written, storage_files
from haptic_accel.bags.metadata import FileEntry, Metadata, MetadataError, read_metadata
from haptic_accel.bags.reading import read_bags
from haptic_accel.bags.repair import DamagedError, Repair, inspect, repair
from haptic_accel.bags.timeline import continuous
from haptic_accel.bags.trial_metadata import ARGUMENTS, HOST, PARAMETERS, VERSION, read_custom_data
from haptic_accel.cli.options import FILE, json_option, verb
from haptic_accel.cli.output import StoppedError, next_command, save
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tables import ResultTable

REPAIR = "haptic-accel bag repair makes it whole"


@verb()
@click.argument("path", metavar="BAG", type=FILE)
@json_option
def info(path: Path, json_file: Path | None) -> None:
    """Show a bag's topics, the settings it was recorded with, and any damage."""
    files, metadata = _contents(path)
    size, seconds = sum(file.stat().st_size for file in files), metadata.seconds
    writing = [f"{f.name}: is still being written" for f in files if is_being_written(f)]
    others = [] if writing else _other_recordings(path, files, metadata)
    own = [file for file in files if all(file.name not in names for names in others)]
    problems = writing or list(_problems(path, own, metadata))
    trial_metadata = read_custom_data(metadata.custom)
    when = "no messages"
    if metadata.messages:
        start = datetime.fromtimestamp(metadata.start / NANOSECONDS).astimezone()
        when = f"{start:%Y-%m-%d %H:%M:%S %z}, {seconds:.2f} s, {metadata.messages} messages"
    form = f"{metadata.storage}, {len(metadata.files)} file(s), {size / 1e6:.1f} MB"
    if metadata.compression_mode:
        form += f", {metadata.compression_format} by {metadata.compression_mode}"
    print(f"{path}: {when}", form, *_metadata_lines(trial_metadata), sep="\n")
    rates = (f"{topic.messages / seconds:.1f}" if seconds else "" for topic in metadata.topics)
    pairs = zip(metadata.topics, rates, strict=True)
    rows = [(topic.name, topic.type, str(topic.messages), rate) for topic, rate in pairs]
    print_table(ResultTable(("topic", "type", "messages", "per s"), rows, left=2))
    for problem in problems:
        print(problem if writing else f"{problem}: {REPAIR}")
    for names in others:
        print(f"{', '.join(names)}: another recording, which is read as a bag of its own")
    metrics = {
        "path": str(path),
        "start_ns": metadata.start if metadata.messages else None,
        "duration_s": seconds,
        "messages": metadata.messages,
        "storage": metadata.storage,
        "compression_mode": metadata.compression_mode,
        "size_bytes": size,
        "files": [asdict(file) for file in metadata.files],
        "topics": {topic.name: topic.messages for topic in metadata.topics},
        "facts": trial_metadata,
        "problems": problems,
        "other_recordings": others,
    }
    save(metrics, json_file)


@verb(name="repair")
@click.argument("paths", metavar="BAG...", type=FILE, nargs=-1, required=True)
@json_option
def repair_bags(paths: Sequence[Path], json_file: Path | None) -> None:
    """Repair bags that were cut off or damaged by kill -9, a power cut or a failing disk.

    Keeps every intact message, and writes index and metadata.yaml. Replaced files are kept
    with .damaged after their name; an intact bag is not changed.
    """
    done = []
    for path in paths:
        try:
            done.append(repair(path))
        except OSError as error:
            raise StoppedError(f"{path}: cannot be repaired: {error}") from None
        _print(done[-1])
    save([{**asdict(one), "path": str(one.path)} for one in done], json_file)
    if readable := [str(one.path) for one in done if one.messages]:
        print(next_command("analyze", *readable))
    if any(one.messages == 0 and one.problems for one in done):
        raise StoppedError


def _contents(path: Path) -> tuple[list[Path], Metadata]:
    """Return a bag's files and metadata.

    Raises
    ------
    ParameterError
        The path is not a bag, or the bag has no metadata.
    """
    if not os.path.isdir(path):
        raise ParameterError(f"{path}: must be the folder of a bag")
    files = storage_files(path)
    try:
        return files, read_metadata(path)
    except MetadataError as error:
        raise ParameterError(f"{error}: {REPAIR}" if files else f"{path}: {MUST_BE}") from None


def _problems(path: Path, files: Sequence[Path], metadata: Metadata) -> Iterator[str]:
    """Yield damage, and differences of metadata and files; other file formats are not read."""
    missing = (each.name for each in metadata.files if not os.path.exists(path / each.name))
    yield from (f"{name}: is missing" for name in missing)
    found: list[FileEntry] = []
    for file in files:
        try:
            found += inspect(file).files if file.suffix == MCAP else ()
        except DamagedError as error:
            yield str(error)
    if len(found) == len(files):
        yield from contradictions(metadata, found)


def _other_recordings(path: Path, files: Sequence[Path], metadata: Metadata) -> list[list[str]]:
    """Return the files of each recording other than that of metadata.yaml."""
    is_listed = {file.name for file in files} <= {file.name for file in metadata.files}
    if is_listed and not continuous((f.start, f.end) for f in metadata.files if f.messages):
        return []
    return [each.files for each in read_bags(path, ())[1:]]


def _metadata_lines(trial_metadata: Mapping[str, Any]) -> Iterator[str]:
    """Yield the metadata of the graph, a line each."""
    if VERSION in trial_metadata:
        yield f"haptic_accel {trial_metadata[VERSION]} on {_joined(trial_metadata.get(HOST, {}))}"
        yield f"arguments: {_joined(trial_metadata.get(ARGUMENTS, {}))}"
    parameters = trial_metadata.get(PARAMETERS, {})
    if isinstance(parameters, dict) and parameters:
        count = sum(len(values) for values in parameters.values() if isinstance(values, dict))
        yield f"{count} parameters of {', '.join(parameters)} (--json FILE has them)"


def _joined(values: Any) -> str:
    """Return names and values in one line, without empty ones."""
    if not isinstance(values, Mapping):
        return str(values)
    return ", ".join(f"{name} {value}" for name, value in values.items() if value != "")


def _print(done: Repair) -> None:
    for line in (*done.repairs, *done.problems):
        print(f"{done.path}: {line}")
    if done.problems and not done.messages:
        print(f"{done.path}: nothing in it can be read")
    else:
        state = "is whole again" if done.repairs else "is whole"
        print(f"{done.path}: {state}: {done.messages} messages in {done.duration:.2f} s")
