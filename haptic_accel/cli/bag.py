"""``haptic-accel bag``: contents of a bag, and repair of one whose recording was cut off."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import click
from rich.console import Console
from rich.table import Table

from haptic_accel.bags.facts import ARGUMENTS, HOST, PARAMETERS, VERSION, facts_of
from haptic_accel.bags.folder import MCAP, MUST_BE, storage_files
from haptic_accel.bags.metadata import Metadata, MetadataError, read_metadata
from haptic_accel.bags.repair import DamagedError, Repair, inspect, repair
from haptic_accel.cli.options import FILE, Verb, json_option
from haptic_accel.cli.output import save
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, FAILED
from haptic_accel.core.sampling import NANOSECONDS

MEGABYTE = 1e6

REPAIR = "haptic-accel bag repair makes it whole"


@dataclass(frozen=True)
class Described:
    """Description of a bag by its metadata.

    Attributes
    ----------
    metadata : Metadata
    size : int
        Size of its files, bytes.
    problems : list of str
        Differences between metadata and files, a line each.
    """

    metadata: Metadata
    size: int
    problems: list[str]


@click.command(cls=Verb)
@click.argument("path", metavar="BAG", type=FILE)
@json_option
def info(path: Path, json_file: Path | None) -> int:
    """Show a bag's topics, the settings it was recorded with, and any damage."""
    found = described(path)
    metadata = found.metadata
    print(f"{path}: {_when(metadata)}", *_lines(found), sep="\n")
    Console().print(_table(metadata))
    for problem in found.problems:
        print(f"{problem}: {REPAIR}")
    save(_metrics(path, found), json_file)
    return DONE


@click.command(cls=Verb, name="repair")
@click.argument("paths", metavar="BAG...", type=FILE, nargs=-1, required=True)
@json_option
def repair_bags(paths: Sequence[Path], json_file: Path | None) -> int:
    """Repair bags whose recording was cut off by kill -9, a power cut or a full disk.

    Keeps every intact message, and writes index and metadata.yaml. Replaced files are kept
    with .damaged after their name; an intact bag is not changed.
    """
    done = []
    for path in paths:
        try:
            done.append(repair(path))
        except OSError as error:
            print(f"haptic-accel: {path}: cannot be repaired: {error}", file=sys.stderr)
            return FAILED
        _tell(done[-1])
    save([{**asdict(one), "path": str(one.path)} for one in done], json_file)
    return FAILED if any(one.messages == 0 and one.problems for one in done) else DONE


def described(path: Path) -> Described:
    """Return a bag's metadata, compared with its files.

    Raises
    ------
    ParameterError
        It is not a bag, or has no metadata.
    """
    if not path.is_dir():
        raise ParameterError(f"{path}: must be the folder of a bag")
    files = storage_files(path)
    try:
        metadata = read_metadata(path)
    except MetadataError as error:
        if files:
            raise ParameterError(f"{error}: {REPAIR}") from None
        raise ParameterError(f"{path}: {MUST_BE}") from None
    problems = []
    for entry in metadata.files:
        problem = _problem(path / entry.name, entry.messages)
        if problem:
            problems.append(problem)
    listed = {entry.name for entry in metadata.files}
    problems += [f"{file.name}: is not listed" for file in files if file.name not in listed]
    return Described(metadata, sum(file.stat().st_size for file in files), problems)


def _problem(file: Path, messages: int) -> str:
    """Return the problem of a file; one of another form than ours is not read."""
    if not file.exists():
        return f"{file.name}: is missing"
    if file.suffix != MCAP:
        return ""
    try:
        found = inspect(file).messages
    except DamagedError as error:
        return str(error)
    return "" if found == messages else f"{file.name}: has {found} messages, not {messages}"


def _when(metadata: Metadata) -> str:
    if not metadata.messages:
        return "no messages"
    start = datetime.fromtimestamp(metadata.start / NANOSECONDS).astimezone()
    seconds = metadata.duration / NANOSECONDS
    return f"{start:%Y-%m-%d %H:%M:%S %z}, {seconds:.2f} s, {metadata.messages} messages"


def _lines(found: Described) -> list[str]:
    """Return form and facts of a bag, a line each."""
    metadata = found.metadata
    form = f"{metadata.storage}, {len(metadata.files)} file(s), {found.size / MEGABYTE:.1f} MB"
    if metadata.compression_mode:
        form += f", {metadata.compression_format} by {metadata.compression_mode}"
    facts = facts_of(metadata.custom)
    lines = [form]
    if VERSION in facts:
        lines.append(f"haptic_accel {facts[VERSION]} on {_joined(facts.get(HOST, {}))}")
        lines.append(f"arguments: {_joined(facts.get(ARGUMENTS, {}))}")
    parameters = facts.get(PARAMETERS, {})
    if isinstance(parameters, dict) and parameters:
        count = sum(len(values) for values in parameters.values())
        lines.append(f"{count} parameters of {', '.join(parameters)} (--json FILE has them)")
    return lines


def _joined(values: Any) -> str:
    """Return names and values in one line, without empty ones."""
    if not isinstance(values, Mapping):
        return str(values)
    return ", ".join(f"{name} {value}" for name, value in values.items() if value != "")


def _table(metadata: Metadata) -> Table:
    table = Table()
    for heading in ("topic", "type", "messages", "per s"):
        justify: Literal["left", "right"] = "left" if heading in ("topic", "type") else "right"
        table.add_column(heading, justify=justify, overflow="fold")
    seconds = metadata.duration / NANOSECONDS if metadata.messages else 0.0
    for topic in metadata.topics:
        rate = f"{topic.messages / seconds:.1f}" if seconds else ""
        table.add_row(topic.name, topic.type, str(topic.messages), rate)
    return table


def _metrics(path: Path, found: Described) -> dict[str, Any]:
    metadata = found.metadata
    return {
        "path": str(path),
        "start_ns": metadata.start if metadata.messages else None,
        "duration_s": metadata.duration / NANOSECONDS if metadata.messages else 0.0,
        "messages": metadata.messages,
        "storage": metadata.storage,
        "compression_mode": metadata.compression_mode,
        "size_bytes": found.size,
        "files": [asdict(file) for file in metadata.files],
        "topics": {topic.name: topic.messages for topic in metadata.topics},
        "facts": facts_of(metadata.custom),
        "problems": found.problems,
    }


def _tell(done: Repair) -> None:
    for line in (*done.repairs, *done.problems):
        print(f"{done.path}: {line}")
    if done.problems and not done.messages:
        print(f"{done.path}: nothing in it can be read")
        return
    said = "is whole again" if done.repairs else "is whole"
    print(f"{done.path}: {said}: {done.messages} messages in {done.duration:.2f} s")
