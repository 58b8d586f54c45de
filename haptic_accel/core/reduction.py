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

"""Reduction of vibration in three axes to one signal for a single actuator.

People tell every such signal from the original in three axes (Lee, Tombak, Park, Kuchenbecker,
IEEE Transactions on Haptics 15(3), 2022), but keep its strength and spectrum apart.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from haptic_accel.core.model import FloatArray


def total(acceleration: FloatArray) -> FloatArray:
    """Return the sum of the components; opposite ones cancel.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
    """
    return np.asarray(acceleration.sum(axis=1))


def principal(acceleration: FloatArray) -> FloatArray:
    """Return the component along the direction of the largest variance.

    The direction has a positive largest component, so that the sign does not depend on the method.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)

    Examples
    --------
    >>> import numpy as np
    >>> principal(np.outer([5.0, -5.0, 0.0], [0.6, 0.0, 0.8])).round(9)
    array([ 5., -5.,  0.])
    """
    moving = acceleration - acceleration.mean(axis=0)
    direction = np.linalg.eigh(moving.T @ moving)[1][:, -1]
    return np.asarray(acceleration @ (direction * np.sign(direction[np.abs(direction).argmax()])))


def magnitude(acceleration: FloatArray) -> FloatArray:
    """Return the length of the vector, which is never negative: an oscillation has it twice.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
    """
    return np.asarray(np.linalg.norm(acceleration, axis=1))


def dft321(acceleration: FloatArray) -> FloatArray:
    """Return a signal with the spectral power of all axes together, and the phase of their sum.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
        The whole recording: the method is not causal.

    Notes
    -----
    Landin, Romano, McMahan, Kuchenbecker, "Dimensional reduction of high-frequency accelerations
    for haptic rendering", EuroHaptics 2010. The inverse transform is real: its magnitude in place
    of it would rectify the signal.

    Examples
    --------
    >>> import numpy as np
    >>> dft321(np.array([[3.0, 0.0, 4.0], [-3.0, 0.0, -4.0]])).round(9)
    array([ 5., -5.])
    """
    spectra = np.fft.rfft(acceleration, axis=0)
    phase = np.angle(spectra.sum(axis=1))
    combined = np.linalg.norm(spectra, axis=1) * np.exp(1j * phase)
    return np.asarray(np.fft.irfft(combined, len(acceleration)))


REDUCTIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "dft321": dft321,
    "principal": principal,
    "sum": total,
    "magnitude": magnitude,
}
"""Reductions of a whole recording by name; each takes shape (n, 3) and returns shape (n,)."""
