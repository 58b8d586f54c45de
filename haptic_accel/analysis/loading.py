"""From bags to the figures of every trial in them, one bag after the other."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from haptic_accel.analysis.finding import find_bags
from haptic_accel.analysis.measures import Measures, Shift, measure
from haptic_accel.analysis.segments import Cut, Stretch, cut
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.parameters import ParameterError


@dataclass(frozen=True)
class AnalysedTrial:
    """A trial with its figures.

    Attributes
    ----------
    name : str
        Of its bag, with a number where it is not the bag's first; no other trial has it.
    source : Path
        What the user named that it was found in.
    measures : Measures
    """

    name: str
    source: Path
    measures: Measures

    @property
    def controller(self) -> str:
        """Under which it was made."""
        return self.measures.stretch.condition.controller

    @property
    def surface(self) -> str:
        """On which it was made."""
        return self.measures.stretch.condition.surface


@dataclass(frozen=True)
class Analysis:
    """What came of some bags.

    Attributes
    ----------
    trials : list of AnalysedTrial
    problems : dict
        By bag: what cannot be said of it, lines.
    shift : Shift
    bags : int
        How many were looked at.
    """

    trials: list[AnalysedTrial]
    problems: dict[str, list[str]]
    shift: Shift
    bags: int


@dataclass
class _Found:
    """A bag to read, with what it is called."""

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

    A bag that cannot be read is a problem of that bag, not of the others. Of trials with the same
    samples at one place, copies or repeated lockstep runs, the first alone counts.

    Parameters
    ----------
    paths : sequence of Path
        Bags, files of bags, or folders in which to look for bags.
    shift : Shift, optional
        The paper's by default.
    perceptual : bool
        Whether to score how it feels, which takes longest.
    begun : callable, optional
        Called before each bag with its number from 0, how many there are, and its name.

    Raises
    ------
    ParameterError
        A place does not exist, or has no bag.
    """
    shift = shift or Shift()
    found = _named([_Found(bag, path) for path in paths for bag in find_bags(path)])
    trials: list[AnalysedTrial] = []
    problems: dict[str, list[str]] = {}
    seen: dict[tuple[Path, bytes], str] = {}
    for number, bag in enumerate(found):
        if begun:
            begun(number, len(found), bag.name)
        parts = _cut(bag.path)
        complaints = list(parts.problems)
        for place, stretch in enumerate(parts.stretches):
            name = bag.name if place == 0 else f"{bag.name} #{place + 1}"
            first = seen.setdefault((bag.source, _digest(stretch)), name)
            if first != name:
                # Taken for another trial it would make every interval too short.
                complaints.append(f"has the same samples as {first}, and is left out")
                continue
            measures = measure(stretch, shift, perceptual=perceptual)
            trials.append(AnalysedTrial(name, bag.source, measures))
        if complaints:
            problems[bag.name] = complaints
    return Analysis(trials, problems, shift, len(found))


def _cut(path: Path) -> Cut:
    """Return a bag's stretches; none, and why, where it cannot be read."""
    try:
        return cut(read_bag(path))
    except ParameterError as error:
        return Cut([], [str(error)])


def _digest(stretch: Stretch) -> bytes:
    """Return what two stretches have in common if all their samples are the same."""
    digest = hashlib.blake2b(digest_size=16)
    for name, values in sorted(stretch.signals.items()):
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
