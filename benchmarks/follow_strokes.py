# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Build textures from strokes over shipped ones, and compare both along other strokes.

``python benchmarks/follow_strokes.py [TEXTURE ...]`` prints, for windows of 0.25 s, how far the
RMS of the built model is off that of the known one, and how far a constant texture is.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
from scipy import signal

from haptic_accel import FloatArray, Provenance, Texture, TextureModel, preset_file, read_texture
from haptic_accel.kits.textures import Recording, build
from haptic_accel.kits.textures.building import BAND, Built

TEXTURES = ("plywood", "text", "vinyl")

RATE = 1000.0
SECONDS = 20.0
"""Duration of the strokes that a model is built from, and of those that it is compared on, s."""

STROKES = 0.3, 1.2
"""Range of the duration of a stroke, s."""

LIGHTEST = 0.15
"""Smallest force relative to the largest."""

FORCE_CORNER = 0.8
"""Corner frequency of the changes of force, Hz."""

WINDOW = 250
"""Number of samples in a window: 0.25 s."""

STEP = 10
"""Samples between spectra along strokes."""

QUIET = 0.1
"""RMS relative to the largest window below which windows are left out."""


class Along(NamedTuple):
    """Errors of RMS along strokes, by window: logarithms of ratios, shape (n,).

    Attributes
    ----------
    built, constant : ndarray
        Built model, and constant texture of the mean spectrum, over the known model.
    distance, constant_distance : float
        Mean log-spectral distances of both from the known model, dB.
    """

    built: FloatArray
    constant: FloatArray
    distance: float
    constant_distance: float


def strokes(known: TextureModel, seed: int) -> Recording:
    """Return a recording of strokes to and fro, each up to its own speed, under varied force."""
    random = np.random.default_rng(seed)
    samples = round(SECONDS * RATE)
    speed = np.empty(0)
    while len(speed) < samples:
        length = int(random.uniform(*STROKES) * RATE)
        top = random.uniform(0.25, 1.0) * known.speeds.max()
        speed = np.append(speed, top * np.sin(np.pi * np.arange(length) / length) ** 0.7)
    speed = speed[:samples]
    slow = signal.butter(2, FORCE_CORNER, fs=RATE, output="sos")
    changes = signal.sosfiltfilt(slow, random.standard_normal(samples))
    middle, range_ = (1 + LIGHTEST) / 2, 1 - LIGHTEST
    force = np.clip(middle + range_ / 3 * changes / changes.std(), LIGHTEST, 1.0)
    force *= known.forces.max()
    acceleration = Texture(known, RATE, seed).block(speed, force)
    return Recording(f"strokes {seed}", RATE, speed, force, acceleration)


def compared(known: TextureModel, built: TextureModel, seed: int) -> Along:
    """Compare two models along strokes that neither was built from."""
    over = strokes(known, seed)
    frequency = np.linspace(*BAND, 108)

    def densities(model: TextureModel) -> FloatArray:
        points = zip(over.speed[::STEP].tolist(), over.force[::STEP].tolist(), strict=True)
        found = np.array([model.spectrum(*each, frequency) for each in points])
        return np.asarray(found.reshape(-1, WINDOW // STEP, len(frequency)).mean(axis=1))

    true, own = densities(known), densities(built)
    loud = np.sqrt(true.mean(axis=1))
    kept = loud > QUIET * loud.max()
    true, own, mean = true[kept], own[kept], true.mean(axis=0)

    def apart(model: FloatArray) -> tuple[FloatArray, float]:
        level = np.log(model.mean(axis=-1) / true.mean(axis=-1)) / 2
        decibels = 10 * np.log10(model / true)
        return level, float(np.sqrt(np.mean(decibels**2, axis=1)).mean())

    (built_level, distance), (constant_level, constant_distance) = apart(own), apart(mean)
    return Along(built_level, constant_level, distance, constant_distance)


def learnt(known: TextureModel, seed: int) -> Built:
    """Return a model built from strokes over a known texture."""
    return build(known.name, [strokes(known, seed)], Provenance())


def main(names: list[str]) -> None:
    """Print the errors for some textures, with two pairs of strokes each."""
    for name in names:
        known = read_texture(preset_file("texture", name))
        for seed in (1, 2):
            built = learnt(known, seed)
            along = compared(known, built.model, 100 + seed)
            typical, constant = (
                100 * np.expm1(np.sqrt(np.mean(each**2))) for each in (along.built, along.constant)
            )
            within = 100 * np.mean(np.abs(np.expm1(along.built)) <= 0.2)
            print(
                f"{name}, strokes {seed}: RMS typically off by {typical:.0f} %, within 20 % in"
                f" {within:.0f} % of the windows, spectrum {along.distance:.1f} dB; constant"
                f" texture {constant:.0f} % and {along.constant_distance:.1f} dB"
            )


if __name__ == "__main__":
    main(sys.argv[1:] or list(TEXTURES))
