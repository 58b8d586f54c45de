# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Your own recording under the tool
=================================

You have recorded the acceleration of a tool, and want to feel it. Learn how a CSV file becomes a
surface, and how well a handle would reproduce it, before anything is built.
"""

# %%
# This script makes the file itself: a tool that slides over a ratchet, at 5 kHz. Yours has a
# column `acceleration` in m/s², and any rate.

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib import pyplot

from haptic_accel import run_trial

rate = 5000.0  # Hz
time = np.arange(0.0, 3.0, 1.0 / rate)  # s
since_click = time % 0.07  # s
clicks = 12.0 * np.exp(-60.0 * since_click) * np.sin(2 * np.pi * 140.0 * since_click)
noise = np.random.default_rng(1).normal(0.0, 0.3, len(time))

folder = TemporaryDirectory()
file = Path(folder.name) / "ratchet.csv"
np.savetxt(file, clicks + noise, fmt="%.4f", header="acceleration", comments="")

# %%
# The file takes the place of a surface, and is repeated. It is resampled to the 1 kHz of the loop,
# so what lies above 500 Hz is lost.

names = ("constant", "inverse", "adaptive")
trials = [run_trial(name, surface=file, recording_rate=rate, duration=4.0) for name in names]
folder.cleanup()

_, rows = pyplot.subplots(3, sharey=True, figsize=(8, 7), layout="constrained")
for trial, axes in zip(trials, rows, strict=True):
    trial.plot(axes)
    axes.set_title(f"{trial.controller}: NRMSE {trial.nrmse():.0f} %")
    share, peak = trial.indistinguishable(), np.abs(trial.actuator_force).max()
    print(f"{trial.controller}: {share:.0%} indistinguishable, {peak:.1f} N at most")

pyplot.show()
