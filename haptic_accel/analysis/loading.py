"""Analyses every trial in some bags, one bag after the other."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_accel.analysis.metrics import AnalysedTrial, Shift, measure
from haptic_accel.analysis.segments import VECTORS, Cut, Segment, cut
from haptic_accel.bags.folder import find_bags
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import RigParameters


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

    @property
    def after(self) -> str:
        """Time after which errors were taken, in words."""
        return self.shift.words(trial.segment for trial in self.trials)


def analyse(
    paths: Sequence[Path],
    shift: Shift | None = None,
    *,
    perceptual: bool = True,
    rig: RigParameters | None = None,
    rate: float | None = None,
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
        By default, each trial's latency and granted delay.
    perceptual : bool
        Score ST-SIM and SPQI, which takes longest.
    rig, rate
        Of bags that do not describe themselves, see `cut`.
    begun : callable, optional
        Called before each bag with its number from 0, the number of bags, and its name.

    Raises
    ------
    ParameterError
        A place does not exist, or has no bag, or a bag states what rig or rate would replace.
    """
    shift = shift or Shift()
    found = {bag.resolve(): (bag, path) for path in paths for bag in find_bags(path)}
    names = _names([bag for bag, _ in found.values()])
    trials: list[AnalysedTrial] = []
    problems: dict[str, list[str]] = {}
    seen: dict[tuple[Path, object, bytes], str] = {}
    excerpts: dict[object, float] = {}
    for number, (name, (bag, source)) in enumerate(zip(names, found.values(), strict=True)):
        if begun:
            begun(number, len(found), name)
        try:
            recorded = read_bag(bag, VECTORS)
        except ParameterError as error:
            parts = Cut([], [str(error)])
        else:
            parts = cut(recorded, rig, rate)
        complaints = list(parts.problems)
        for segment in parts.segments:
            own = name if segment.number == 1 else f"{name} #{segment.number}"
            first = seen.setdefault((source, segment.condition, _digest(segment)), own)
            if first == own:
                pair = (segment.condition.surface, segment.condition.grip, segment.pair)
                begin = excerpts.get(pair)
                trial = measure(segment, own, source, shift, perceptual=perceptual, begin=begin)
                trials.append(trial)
                if trial.portrait:
                    excerpts.setdefault(pair, trial.portrait.begin)
            else:
                # Taken for another trial it would make every interval too short.
                complaints.append(f"has the same samples as {first}, and is left out")
        if complaints:
            problems[name] = complaints
    return Analysis(trials, problems, shift, len(found))


def _digest(segment: Segment) -> bytes:
    """Return what two segments have in common if all their samples are the same."""
    digest = hashlib.blake2b(digest_size=16)
    for name, values in sorted(segment.signals.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values).data)
    return digest.digest()


def _names(bags: Sequence[Path]) -> list[str]:
    """Return for each bag the shortest name that distinguishes it from all others."""
    counts = Counter(bag.name for bag in bags)
    common = os.path.commonpath([bag.resolve().parent for bag in bags] or [Path()])
    return [
        bag.name if counts[bag.name] == 1 else os.path.relpath(bag.resolve(), common)
        for bag in bags
    ]
