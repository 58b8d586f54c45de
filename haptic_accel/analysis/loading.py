"""Analyses every trial in some bags, one bag after the other."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from haptic_accel.analysis.metrics import AnalysedTrial, Shift, measure
from haptic_accel.analysis.segments import Cut, Segment, cut
from haptic_accel.bags.folder import is_bag
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.parameters import ParameterError


@dataclass(frozen=True)
class Analysis:
    """Result of analysing bags.

    Attributes
    ----------
    trials : list of AnalysedTrial
    problems : dict
        Lines that name what could not be determined, by bag.
    shift : Shift
    bags : int
        Number of bags.
    """

    trials: list[AnalysedTrial]
    problems: dict[str, list[str]]
    shift: Shift
    bags: int


@dataclass
class _Found:
    """A bag to read, and its name in the analysis."""

    path: Path
    source: Path
    name: str = field(default="")


def analyse(
    paths: Sequence[Path],
    shift: Shift | None = None,
    *,
    perceptual: bool = True,
    begun: Callable[[int, int, str], None] | None = None,
) -> Analysis:
    """Read all bags at some places and measure every trial in them.

    A bag that cannot be read is a problem of that bag, not of the others. Of trials of one
    condition with the same samples at one place, copies or repeated lockstep runs, only the first
    counts.

    Parameters
    ----------
    paths : sequence of Path
        Bags, files of bags, or folders in which to look for bags.
    shift : Shift, optional
        The paper's by default.
    perceptual : bool
        Score ST-SIM and SPQI, which takes longest.
    begun : callable, optional
        Called before each bag with its number from 0, the number of bags, and its name.

    Raises
    ------
    ParameterError
        A place does not exist, or has no bag.
    """
    shift = shift or Shift()
    found = _named([_Found(bag, path) for path in paths for bag in find_bags(path)])
    trials: list[AnalysedTrial] = []
    problems: dict[str, list[str]] = {}
    seen: dict[tuple[Path, object, bytes], str] = {}
    for number, bag in enumerate(found):
        if begun:
            begun(number, len(found), bag.name)
        parts = _cut(bag.path)
        complaints = list(parts.problems)
        for segment in parts.segments:
            name = bag.name if segment.number == 1 else f"{bag.name} #{segment.number}"
            first = seen.setdefault((bag.source, segment.condition, _digest(segment)), name)
            if first == name:
                trials.append(measure(segment, name, bag.source, shift, perceptual=perceptual))
            else:
                # Taken for another trial it would make every interval too short.
                complaints.append(f"has the same samples as {first}, and is left out")
        if complaints:
            problems[bag.name] = complaints
    return Analysis(trials, problems, shift, len(found))


def find_bags(path: Path) -> list[Path]:
    """Return the bags at a place, in order of their names.

    Parameters
    ----------
    path : Path
        A bag's folder, one of its files, or a folder in which to look for bags, however deep.

    Raises
    ------
    ParameterError
        There is nothing, or no bag below it.
    """
    if not path.exists():
        raise ParameterError(f"{path}: no such file or folder")
    if not path.is_dir() or is_bag(path):
        return [path]
    # Links are not followed: they may lead in a ring.
    folders = sorted(f for f in path.rglob("*") if f.is_dir() and not f.is_symlink())
    found = [folder for folder in folders if is_bag(folder)]
    if not found:
        raise ParameterError(f"{path}: must be a bag, or a folder with bags in it")
    return found


def _cut(path: Path) -> Cut:
    """Return a bag's segments; none, and why, where it cannot be read."""
    try:
        return cut(read_bag(path))
    except ParameterError as error:
        return Cut([], [str(error)])


def _digest(segment: Segment) -> bytes:
    """Return what two segments have in common if all their samples are the same."""
    digest = hashlib.blake2b(digest_size=16)
    for name, values in sorted(segment.signals.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values).data)
    return digest.digest()


def _named(found: Iterable[_Found]) -> list[_Found]:
    """Give each bag the shortest name that tells it from all others; a bag counts once."""
    unique = list({bag.path.resolve(): bag for bag in found}.values())
    names = Counter(bag.path.name for bag in unique)
    parents = [str(bag.path.resolve().parent) for bag in unique]
    common = os.path.commonpath(parents) if parents else ""
    for bag in unique:
        alone = names[bag.path.name] == 1
        bag.name = bag.path.name if alone else os.path.relpath(bag.path.resolve(), common)
    return unique
