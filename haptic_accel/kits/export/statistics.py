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

"""Statistics of a learning set's features, as LeRobot has them: of episodes, and of all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)

_REDUCTIONS: dict[str, Any] = {"min": np.min, "max": np.max, "count": np.sum}

Statistics = dict[str, npt.NDArray[Any]]
"""Values of one feature by name, in the shape of the feature; ``count`` has shape (1,)."""


def statistics(array: npt.NDArray[Any]) -> Statistics:
    """Return the statistics of a feature over its frames, shape (n, ...).

    Examples
    --------
    >>> found = statistics(np.array([0.0, 1.0, 2.0, 5.0]))
    >>> [found[name].tolist() for name in ("max", "mean", "q50", "count")]
    [[5.0], [2.0], [1.5], [4]]
    """
    array = array if array.ndim > 1 else array[:, np.newaxis]
    quantiles = np.quantile(array, QUANTILES, axis=0)
    return {
        "min": array.min(axis=0),
        "max": array.max(axis=0),
        "mean": array.mean(axis=0, dtype=np.float64),
        "std": array.std(axis=0, dtype=np.float64),
        "count": np.array([len(array)]),
        **{f"q{round(100 * q):02d}": row for q, row in zip(QUANTILES, quantiles, strict=True)},
    }


def combined(episodes: Sequence[Mapping[str, Statistics]]) -> dict[str, Statistics]:
    """Return the statistics of all episodes by feature.

    Quantiles are means of those of the episodes, as LeRobot computes them.
    """
    return {
        key: {name: _combined(name, [own[key] for own in episodes]) for name in episodes[0][key]}
        for key in episodes[0]
    }


def _combined(name: str, each: Sequence[Statistics]) -> npt.NDArray[Any]:
    values = np.array([own[name] for own in each])
    weights = [float(own["count"][0]) for own in each]
    if name in _REDUCTIONS:
        return np.asarray(_REDUCTIONS[name](values, axis=0))
    if name != "std":
        return np.asarray(np.average(values, axis=0, weights=weights))
    means = np.array([own["mean"] for own in each])
    spread = means - np.average(means, axis=0, weights=weights)
    return np.asarray(np.sqrt(np.average(values**2 + spread**2, axis=0, weights=weights)))
