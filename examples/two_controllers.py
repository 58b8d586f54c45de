# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Two controllers on one surface
==============================

A hand strokes raised text; the paper's controller and `adaptive` drive the handle's actuator. The
same seed gives both the same hand, noise and texture.
"""

# %%
# Each trial runs in lockstep on the rig of the paper.

from matplotlib import pyplot

from haptic_accel import run_trial

names = ["dynamic", "adaptive"]
trials = [run_trial(name, surface="text", duration=5.0, seed=1) for name in names]

# %%
# Desired and actual acceleration, where the former is largest.

_, rows = pyplot.subplots(2, sharey=True, figsize=(8, 5), layout="constrained")
for trial, axes in zip(trials, rows, strict=True):
    trial.plot(axes)

# %%
# The error, and the share of the vibration whose strength a hand could not tell.

for trial in trials:
    print(f"{trial.controller}: {trial.nrmse():.0f} %, {trial.indistinguishable():.0%}")

pyplot.show()
