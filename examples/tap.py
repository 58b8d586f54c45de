# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A tap, with six controllers
===========================

A tool that lands on wood rings for a tenth of a second. Learn what each controller makes of it in
the hand: nothing, a tap of another strength, or the tap of the tool.
"""

# %%
# The virtual slave lowers its tool onto the bench of the scene `workshop`. The same seed gives all
# controllers the same hand and noise, on the rig of the paper.

import numpy as np
from matplotlib import pyplot

from haptic_accel import run_trial

names = ("none", "constant", "dynamic", "inverse", "feedback", "adaptive")
trials = [
    run_trial(name, slave="virtual", surface="workshop", duration=1.5, seed=1) for name in names
]

# %%
# The tap begins where the scene first pushes the tool. The actual acceleration is shifted back by
# the known delay. `adaptive` has learnt nothing yet: before the first contact there is no force.

touching = np.abs(trials[0].arms["slave/contact_force"]).max(axis=1) > 0.0
first = int(touching.argmax()) - 20
last = first + 140

_, panels = pyplot.subplots(2, 3, sharex=True, sharey=True, figsize=(9, 5), layout="constrained")
for trial, axes in zip(trials, panels.flat, strict=True):
    desired, actual = trial.compared(first, last)
    time = 1e3 * np.arange(len(desired)) / trial.rate
    axes.plot(time, desired, label="desired")
    axes.plot(time, actual, linewidth=0.9, label="actual")
    error = trial.evaluate(first, last).nrmse_percent
    axes.set_title(f"{trial.controller}: {error:.0f} %")
    force = np.abs(trial.actuator_force[first:last]).max()
    print(f"{trial.controller}: error {error:.0f} %, {force:.1f} N at most")
panels[0, 0].legend()
for axes in panels[1]:
    axes.set_xlabel("time (ms)")
for axes in panels[:, 0]:
    axes.set_ylabel("acceleration (m/s²)")

pyplot.show()
