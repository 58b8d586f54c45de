# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Prediction of lost samples from earlier ones (loss concealment)."""

from __future__ import annotations

from collections import deque

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick.kernels import INFINITE

HISTORY = 64
"""Number of samples for the prediction; older samples are from other parts of the texture."""

ORDER = 12
"""Order of the prediction: enough for a few resonances of surface and tool."""

RIDGE = 1e-3
"""Relative increase of the power at lag 0, equivalent to white noise 30 dB below the signal. It
keeps the prediction stable and makes it fade out."""


class LossConcealment:
    """Store the last samples of a signal, and predict missing ones.

    An autoregressive model is fitted to the last samples (autocorrelation method). The prediction
    never grows and returns to the mean.
    """

    def __init__(self) -> None:
        self._samples: deque[float] = deque(maxlen=HISTORY)

    def put(self, sample: float) -> None:
        """Add a sample; infinity and NaN count as zero."""
        self._samples.append(sample if -INFINITE < sample < INFINITE else 0.0)

    def predict(self, count: int) -> list[float]:
        """Predict, store and return the next samples; from few samples predict the mean.

        Examples
        --------
        >>> bridge = LossConcealment()
        >>> for sample in np.sin(0.5 * np.arange(64)):
        ...     bridge.put(float(sample))
        >>> bool(abs(bridge.predict(1)[0] - np.sin(0.5 * 64)) < 0.05)
        True
        """
        samples = np.array(self._samples)
        if not len(samples):
            return [0.0] * count
        mean = float(samples.mean())
        coefficients = _coefficients(samples - mean)
        newest_first = (samples[::-1] - mean)[: len(coefficients)]
        predicted = []
        for _ in range(count):
            following = float(coefficients @ newest_first)
            newest_first = np.append(following, newest_first)[: len(coefficients)]
            value = mean + following
            predicted.append(value)
            self.put(value)
        return predicted


def _coefficients(samples: FloatArray) -> FloatArray:
    """Return the weights of the last samples, newest first, for predicting the next one."""
    order = min(ORDER, len(samples) // 2)
    if order == 0:
        return np.zeros(0)
    lags = np.correlate(samples, samples, "full")[len(samples) - 1 :][: order + 1]
    if lags[0] <= np.finfo(float).tiny:
        return np.zeros(order)
    lags[0] *= 1 + RIDGE
    index = np.arange(order)
    return np.linalg.solve(lags[abs(index[:, None] - index)], lags[1:])
