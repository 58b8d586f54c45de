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

"""Discrete model of the handle, as written by an identification and used by a plant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from haptic_accel.core.document import read_json_document
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.parameters import Specification


@dataclass(frozen=True)
class DiscreteModel:
    """Stable transfer function in z with a delay.

    Attributes
    ----------
    sections : ndarray, shape (n, 6)
        Second-order sections, rows b0 b1 b2 a0 a1 a2 with a0 = 1; from N to m/s^2.
    rate : float
        Samples per second.
    delay_samples : int
        Whole samples of delay before the sections.
    """

    sections: FloatArray
    rate: float
    delay_samples: int

    def response(self, frequency: npt.ArrayLike) -> ComplexArray:
        """Return the complex response at frequencies in Hz, m/s^2 per N."""
        z = np.exp(2j * np.pi * np.asarray(frequency, dtype=np.float64) / self.rate)
        response = z**-self.delay_samples
        for section in self.sections:
            response = response * np.polyval(section[:3], z) / np.polyval(section[3:], z)
        return np.asarray(response)


def read_discrete_model(path: Path) -> DiscreteModel:
    """Read the discrete model from the metrics of an identification.

    Parameters
    ----------
    path : Path
        JSON file written by ``haptic-accel identify --json``.

    Raises
    ------
    ParameterError
        The file cannot be read, or contains no stable discrete model.
    """
    content = read_json_document(path).at("discrete_model")
    rate, delay = content.at("rate_hz").number(), content.at("delay_samples")
    sections = content.at("sections")
    rows = sections.array()
    if (
        rows.ndim != 2
        or rows.shape[1] != 6
        or not np.isfinite(rows).all()
        or np.any(rows[:, 3] != 1)
    ):
        sections.wrong("must be rows of six numbers, the fourth of them 1")
    if not all(np.abs(np.roots(row[3:])).max(initial=0.0) < 1.0 for row in rows):
        sections.wrong("must be stable")
    return DiscreteModel(rows, rate, delay.checked(1, Specification("delay", "", 0)))
