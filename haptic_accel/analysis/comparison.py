"""Whether two controllers, or two runs, differ: trials paired, differences tested."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from haptic_accel.analysis.loading import AnalysedTrial
from haptic_accel.analysis.tables import FIGURES
from haptic_accel.core.evaluation.statistics import PairedDifference, paired_difference
from haptic_accel.core.parameters import ParameterError

RUNS = "runs"
"""Compare what the first and the second place hold."""

CONTROLLERS = "controller:"
"""Before two names of controllers with a comma between."""

_COMPARED = "nrmse_percent"


@dataclass(frozen=True)
class Pair:
    """Two trials that differ in what is compared alone.

    Attributes
    ----------
    key : str
        What they have in common, in words.
    first, second : AnalysedTrial
    """

    key: str
    first: AnalysedTrial
    second: AnalysedTrial

    @property
    def errors(self) -> tuple[float, float]:
        """NRMSE of both in percent."""
        of = FIGURES[_COMPARED].of
        return of(self.first.measures), of(self.second.measures)


@dataclass(frozen=True)
class Comparison:
    """What came of it.

    Attributes
    ----------
    first, second : str
        What is compared.
    pairs : list of Pair
    unpaired : list of str
        Names of trials on either side that have no counterpart, or no error.
    overall : PairedDifference
        Of NRMSE in percent, second minus first, over all pairs.
    by_surface : dict
        The same for each surface, where there is more than one.
    """

    first: str
    second: str
    pairs: list[Pair]
    unpaired: list[str]
    overall: PairedDifference
    by_surface: dict[str, PairedDifference]


def check_comparison(wanted: str, places: Sequence[Path]) -> None:
    """Refuse a comparison that cannot be, before anything is read.

    Raises
    ------
    ParameterError
        It has another form than ``runs`` or ``controller:A,B``, or runs are not two.
    """
    if wanted == RUNS:
        if len(places) != 2:
            raise ParameterError(
                f"compare: needs two bags or folders to compare, not {len(places)}"
            )
        return
    names = wanted.removeprefix(CONTROLLERS).split(",")
    right = wanted.startswith(CONTROLLERS) and len(names) == 2 and all(names)
    if not right or names[0] == names[1]:
        raise ParameterError(
            f"compare = {wanted!r}: must be nothing, for two bags or folders, or"
            f" {CONTROLLERS}A,B with two controllers"
        )


def compare(trials: Sequence[AnalysedTrial], wanted: str, places: Sequence[Path]) -> Comparison:
    """Pair trials and test the difference of their errors.

    Trials are a pair if they are of the same surface, grip, and seed or recording; those of two
    runs also of the same controller. Several of one kind are paired in their order. Where each of
    two runs is a single trial, these are the pair.

    Parameters
    ----------
    trials : sequence of AnalysedTrial
    wanted : str
        ``runs``, or ``controller:A,B``.
    places : sequence of Path
        What the user named; with ``runs``, the two that are compared.
    """
    if wanted == RUNS:
        names = [str(place) for place in places]
        sides = [[t for t in trials if t.source == place] for place in places]
    else:
        names = wanted.removeprefix(CONTROLLERS).split(",")
        sides = [[t for t in trials if t.controller == name] for name in names]
    alone = wanted == RUNS and all(len(side) == 1 for side in sides)
    first, second = (_by_key(side, wanted == RUNS, alone) for side in sides)
    pairs = [Pair(key, first[key], second[key]) for key in first if key in second]
    whole = [pair for pair in pairs if all(map(math.isfinite, pair.errors))]
    paired = {id(trial) for pair in whole for trial in (pair.first, pair.second)}
    return Comparison(
        names[0],
        names[1],
        whole,
        [trial.name for side in sides for trial in side if id(trial) not in paired],
        _difference(whole),
        _by_surface(whole),
    )


def _by_key(
    trials: Sequence[AnalysedTrial], with_controller: bool, alone: bool
) -> dict[str, AnalysedTrial]:
    found: dict[str, AnalysedTrial] = {}
    for trial in trials:
        stretch = trial.measures.stretch
        words = [trial.surface, f"grip {stretch.condition.grip}", *stretch.pair]
        words += [trial.controller] if with_controller else []
        key = "the only trial" if alone else ", ".join(words)
        again = next(n for n in range(1, len(trials) + 1) if _numbered(key, n) not in found)
        found[_numbered(key, again)] = trial
    return found


def _numbered(key: str, number: int) -> str:
    return key if number == 1 else f"{key} ({number})"


def _difference(pairs: Sequence[Pair]) -> PairedDifference:
    errors = [pair.errors for pair in pairs]
    return paired_difference([a for a, _ in errors], [b for _, b in errors])


def _by_surface(pairs: Sequence[Pair]) -> dict[str, PairedDifference]:
    surfaces = list(dict.fromkeys(pair.first.surface for pair in pairs))
    if len(surfaces) < 2:
        return {}
    return {s: _difference([p for p in pairs if p.first.surface == s]) for s in surfaces}
