# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Textures built from strokes of a hand, against the textures that were stroked."""

from __future__ import annotations

import numpy as np
import pytest
from follow_strokes import TEXTURES, compared, learnt

from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.texture_files import read_texture
from nightly import rest_slow


@pytest.mark.parametrize("name", rest_slow(TEXTURES))
def test_a_texture_learnt_from_strokes_follows_speed_and_force_within_windows(name: str) -> None:
    known = read_texture(preset_file("texture", name))
    built = learnt(known, seed=7)
    along = compared(known, built.model, seed=77)
    assert len(along.built) >= 60
    assert np.mean(np.abs(np.expm1(along.built)) <= 0.2) >= 0.9
    assert np.sqrt(np.mean(along.built**2)) < np.log(1.2)
    # Better than the mean spectrum over the same strokes, which no recording tells as exactly.
    assert along.distance < 0.6 * along.constant_distance
    assert built.following.better
