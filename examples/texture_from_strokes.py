# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A texture from strokes
======================

A texture model gives vibration at any speed and force, not only at those of a recording. Learn how
strokes become such a model, and whether its spectra are right at speeds in between.
"""

# %%
# The strokes are made of a texture that ships with the package, so the truth is known. Yours come
# from a CSV file with speed, force and acceleration, or from a bag.

import numpy as np
from matplotlib import pyplot

from haptic_accel import Provenance, Texture, preset_file, read_texture
from haptic_accel.kits.textures import Recording, build, described

rate = 1000.0  # Hz
known = read_texture(preset_file("texture", "vinyl"))
fastest = np.random.default_rng(1).uniform(0.04, 0.22, 30)  # m/s, of a stroke of 1 s
time = np.arange(0.0, len(fastest), 1.0 / rate)  # s
speed = fastest[time.astype(int)] * np.sqrt(np.abs(np.sin(np.pi * time)))
force = 1.3 + 0.9 * np.sin(0.7 * time)  # N
acceleration = Texture(known, rate, seed=1).block(speed, force)  # m/s²

# %%
# The report tells how well a model of half of the strokes predicts the other half, and compares it
# with a texture that is the same at all speeds and forces.

recording = Recording("strokes", rate, speed, force, acceleration)
built = build("vinyl again", [recording], Provenance("strokes over vinyl", "Apache-2.0"))
print(*described(built), sep="\n")

# %%
# Known and built spectra and levels at 1 N, at three speeds. The levels differ by some per cent.
# Narrow peaks merge, and what is a hundred times weaker than the peak is too strong.

frequency = np.linspace(0.0, rate / 2, 501)  # Hz
_, axes = pyplot.subplots(figsize=(7, 4.5), layout="constrained")
for number, each in enumerate((0.05, 0.1, 0.2)):
    name = f"{1e3 * each:.0f} mm/s"
    spectra = [model.spectrum(each, 1.0, frequency) for model in (known, built.model)]
    axes.semilogy(frequency, spectra[0], color=f"C{number}", label=name)
    axes.semilogy(frequency, spectra[1], "--", color=f"C{number}")
    levels = [np.sqrt(np.mean(spectrum) * rate / 2) for spectrum in spectra]
    print(f"{name}: {levels[0]:.2f} m/s² RMS, built {levels[1]:.2f}")
axes.set(xlabel="frequency (Hz)", ylabel="power density ((m/s²)²/Hz)")
axes.legend(title="known; dashed: built")

pyplot.show()
