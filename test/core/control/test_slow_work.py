# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a controller and its supervision compute between two samples, counted in values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.control.compensation import Compensation, CompensationParameters

TRANSFORMED = 3.5
"""Most values transformed after a sample, for each Hz of the rate; see docs/real_time.md."""

CONVOLVED = 0.37
"""Most values convolved after a sample, for each Hz of the rate: a hop, and the model's memory."""

SETTLED = 0.5
"""Time after which no window is the first, s."""


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
def test_the_work_of_adaptive_after_a_sample_is_bounded(
    rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    transformed, convolved = [0], [0]

    def counted(compute: Callable[..., Any], counts: list[int]) -> Callable[..., Any]:
        def count(values: Any, *given: Any, **named: Any) -> Any:
            rows, length = np.asarray(values).reshape(-1, np.shape(values)[-1]).shape
            longer = given[0] if given and isinstance(given[0], int) else length
            counts[-1] += rows * longer
            return compute(values, *given, **named)

        return count

    for name in ("rfft", "irfft"):
        monkeypatch.setattr(np.fft, name, counted(getattr(np.fft, name), transformed))
    compensation = Compensation(CompensationParameters(controller="adaptive"), rate)
    monkeypatch.setattr(np, "convolve", counted(np.convolve, convolved))
    random, handle = np.random.default_rng(1), 0.0
    transformed.clear()
    convolved.clear()
    for index, tool in enumerate(random.normal(0.0, 3.0, round(1.5 * rate)).tolist()):
        desired, _ = compensation.process((0.0, 0.0, tool), (0.0, 0.0, handle))
        handle = desired[2] + float(random.normal(0.0, 0.02))
        if index < SETTLED * rate:
            transformed[:], convolved[:] = [0], [0]
        transformed.append(0)
        convolved.append(0)
        compensation.adapt()
    assert 0 < max(transformed) <= TRANSFORMED * rate
    assert 0 < max(convolved) <= CONVOLVED * rate
