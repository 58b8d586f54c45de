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

"""Linear mechanics, advanced exactly by whole time steps."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import product


class LinearSystem:
    """Linear system x' = A x + B u, advanced exactly by whole time steps.

    The inputs are constant between calls, like the output of a digital controller. The result is
    therefore independent of the division of an interval.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    step : float
        Smallest step, s.
    longest : int
        Maximum number of steps with a precomputed transition.
    """

    def __init__(self, a: FloatArray, b: FloatArray, step: float, longest: int) -> None:
        # Imported here, as scipy.linalg is slow to import, and most nodes have no rig.
        from scipy.linalg import expm

        states, inputs = b.shape
        exponent = np.zeros((states + inputs, states + inputs))
        exponent[:states, :states] = a
        exponent[:states, states:] = b
        one = expm(exponent * step)
        power = np.eye(states + inputs)
        transitions = []
        for _ in range(longest):
            power = power @ one
            transitions.append(power[:states].T)
        # Columns of all transitions, one below the other.
        self._transitions = np.concatenate(transitions)
        self._longest = longest
        self._joint = np.zeros(states + inputs)
        self._factors = self._joint[:, np.newaxis]
        self._products, self._after = np.empty((states + inputs, states)), np.empty(states)
        self.state = self._joint[:states]
        """State, shape (n,): a view that may be written."""
        self.inputs = self._joint[states:]
        """Inputs, shape (m,): a view that may be written."""

    def step_response(self, index: int) -> FloatArray:
        """Return the state's response to one unit of an input, held over a number of steps.

        Parameters
        ----------
        index : int
            Index of the input.

        Returns
        -------
        ndarray, shape (longest, n)
            State after 1, 2, ... steps.
        """
        return self._transitions[len(self.state) + index :: len(self._joint)].copy()

    def advance(self, steps: int) -> None:
        """Advance the state by a number of steps with constant inputs."""
        while steps > 0:
            block = min(steps, self._longest)
            self.state[:] = self.after(block)
            steps -= block

    def after(self, steps: int) -> FloatArray:
        """Return the state after a number of steps, at most `longest`, without advancing.

        The result is valid until the next call.
        """
        first = (steps - 1) * len(self._joint)
        product(self._transitions, first, self._factors, self._products, self._after)
        return self._after
