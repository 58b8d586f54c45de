# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Comparison of two controllers or runs: paired trials and tests of the differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from haptic_accel.analysis.frames import trials
from haptic_accel.analysis.loading import Analysis
from haptic_accel.core.evaluation.statistics import PairedDifference, paired_difference
from haptic_accel.core.parameters import ParameterError

RUNS = "runs"
"""Comparison of the trials at a first and a second path."""

CONTROLLERS = "controller:"
"""Prefix of two controller names separated by a comma."""


_TESTED = ("effect", "t", "p_t", "p_wilcoxon", "verdict")
"""Fields of `PairedDifference` with the same name in tables and files."""


@dataclass(frozen=True)
class Comparison:
    """Result of comparing two controllers or runs.

    Attributes
    ----------
    first, second : str
        Names of the two sides.
    pairs : DataFrame
        A row for each two trials that differ only in the compared property: ``key``, their common
        properties; ``surface``; NRMSE of each side in percent, ``first`` and ``second``.
    unpaired : list of str
        Names of trials on either side without a counterpart or an error.
    differences : dict of PairedDifference
        Difference of the NRMSE in percent, second minus first, over ``all`` pairs. For several
        surfaces, also over each surface's pairs.
    """

    first: str
    second: str
    pairs: pd.DataFrame
    unpaired: list[str]
    differences: dict[str, PairedDifference]

    @property
    def frame(self) -> pd.DataFrame:
        """Table with a row for the difference over all surfaces, and one for each."""
        return pd.DataFrame(
            {
                "first": self.first,
                "second": self.second,
                "surface": surface,
                "pairs": found.n,
                "difference_percent": found.mean.value,
                "low_percent": found.mean.low,
                "high_percent": found.mean.high,
                **{name: getattr(found, name) for name in _TESTED},
            }
            for surface, found in self.differences.items()
        )


def check_comparison(comparison: str, paths: Sequence[Path]) -> None:
    """Reject an impossible comparison before reading bags.

    Raises
    ------
    ParameterError
        The comparison is neither ``runs`` nor ``controller:A,B``, or there are not two runs.
    """
    if comparison == RUNS:
        if len(paths) != 2:
            raise ParameterError(
                f"compare: needs two bags or folders to compare, not {len(paths)}"
            )
        return
    names = comparison.removeprefix(CONTROLLERS).split(",")
    right = comparison.startswith(CONTROLLERS) and len(names) == 2 and all(names)
    if not right or names[0] == names[1]:
        raise ParameterError(
            f"compare = {comparison!r}: leave out to compare two bags or folders, or give two"
            f" controllers: {CONTROLLERS}A,B"
        )


def compared(analysis: Analysis, comparison: str, paths: Sequence[Path] = ()) -> Comparison:
    """Pair trials and test the difference of their errors.

    Two trials form a pair if they have the same surface, grip, and seed or recording; for two runs
    also the same controller. Several of the same kind are paired in their order. If each run has
    one trial, these trials form a pair.

    Parameters
    ----------
    analysis : Analysis
    comparison : str
        ``runs``, or ``controller:A,B``.
    paths : sequence of Path
        Paths given by the user; for ``runs``, the two to compare.

    Raises
    ------
    ParameterError
        The comparison does not exist.
    """
    check_comparison(comparison, paths)
    frame = trials(analysis)
    key = frame.surface + ", grip " + frame.grip + ", " + frame["pair"]
    if comparison == RUNS:
        sources = np.array([str(trial.source) for trial in analysis.trials])
        names = [str(path) for path in paths]
        sides = [frame.assign(key=key + ", " + frame.controller)[sources == n] for n in names]
        if all(len(side) == 1 for side in sides):
            sides = [side.assign(key="the only trial") for side in sides]
    else:
        names = comparison.removeprefix(CONTROLLERS).split(",")
        sides = [frame.assign(key=key)[frame.controller == name] for name in names]
    errors = [_errors(side, name) for side, name in zip(sides, ("first", "second"), strict=True)]
    pairs = errors[0].merge(errors[1].drop(columns="surface"), on="key").dropna()
    paired = {*pairs.trial_first, *pairs.trial_second}
    surfaces = list(dict.fromkeys(pairs.surface)) if pairs.surface.nunique() > 1 else []
    parts = {"all": pairs} | {surface: pairs[pairs.surface == surface] for surface in surfaces}
    unpaired = [name for side in sides for name in side.trial if name not in paired]
    differences = {
        surface: paired_difference(part["first"].tolist(), part["second"].tolist())
        for surface, part in parts.items()
    }
    return Comparison(names[0], names[1], pairs, unpaired, differences)


def _errors(side: pd.DataFrame, name: str) -> pd.DataFrame:
    """Return trials and errors of one side; repeated keys have a number appended."""
    again = side.groupby("key").cumcount() + 1
    numbered = [k if n == 1 else f"{k} ({n})" for k, n in zip(side.key, again, strict=True)]
    return pd.DataFrame(
        {
            "key": numbered,
            "surface": side.surface.tolist(),
            f"trial_{name}": side.trial.tolist(),
            name: side.get("nrmse_percent", pd.Series(dtype=float)).tolist(),
        }
    )


def compare(analysis: Analysis, comparison: str, paths: Sequence[Path] = ()) -> pd.DataFrame:
    """Test two controllers or runs; return a row for all surfaces, and one for each.

    Parameters as for `compared`.
    """
    return compared(analysis, comparison, paths).frame
