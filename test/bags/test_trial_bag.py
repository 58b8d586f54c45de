# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of lockstep trials, read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from haptic_accel.bags.reading import read_bag
from haptic_accel.bags.trial_bag import write_trial
from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes
from haptic_accel.core.trial import Trial

RATE = 1000.0


@pytest.mark.parametrize("axes", [ACTUATOR_AXES, Axes(("x", "z")), ALL_AXES])
def test_a_trial_is_read_as_it_was_written(tmp_path: Path, axes: Axes) -> None:
    shape = (50,) if len(axes.names) == 1 else (50, len(axes.names))
    signals = [np.random.default_rng(seed).normal(size=shape) for seed in range(4)]
    trial = Trial("vinyl", "inverse", RATE, np.arange(50) / RATE, *signals, axes=axes)
    write_trial(tmp_path / "bag", trial, {}, 10**9)
    bag = read_bag(tmp_path / "bag")
    assert bag.axes == axes
    for topic, written in zip(topics.ANALYSED, signals, strict=True):
        found, seen = bag.signals[topic.name].on_grid(10**9, RATE, 50, bag.axes)
        assert np.array_equal(found, written)
        assert seen.all()
