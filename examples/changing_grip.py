# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A grip that changes
===================

People change their grip while they explore. Learn how fast `adaptive` follows a new hand, and what
`inverse` loses, which keeps to the hand that was identified.
"""

# %%
# Two changes of a hand, and 6 s of strokes over plywood at 100 mm/s and 1 N as the tool's
# acceleration.

from dataclasses import replace

import numpy as np
from matplotlib import pyplot

from haptic_accel import HandleParameters, Texture, preset_file, read_texture, run_trial

rate, duration = 1000.0, 6.0  # Hz, s
average = HandleParameters()
light = replace(average, m_h=0.09, k_u=800.0, b_u=6.0)  # kg, N/m, N s/m
firm = replace(average, m_h=0.17, k_u=2800.0, b_u=18.0)
grips = [(2.0, light), (4.0, firm)]

ones = np.ones(round(duration * rate))
plywood = read_texture(preset_file("texture", "plywood"))
tool = Texture(plywood, rate, seed=1).block(0.1 * ones, 1.0 * ones)

# %%
# The error in windows of 0.2 s. A grip that changes under load jolts the handle, which no
# controller avoids; `adaptive` is back some tenths of a second later.

_, axes = pyplot.subplots(figsize=(8, 4), layout="constrained")
window = 200
starts = range(400, len(tool) - window, window // 4)
for name in ("dynamic", "inverse", "adaptive"):
    trial = run_trial(name, "ideal", duration=duration, recording=tool, grips=grips)
    errors = [trial.evaluate(each, each + window).nrmse_percent for each in starts]
    axes.plot([(each + window) / rate for each in starts], errors, label=name)
    parts = [trial.evaluate(each, each + 1000).nrmse_percent for each in (1000, 3000, 5000)]
    print(f"{name}: " + ", ".join(f"{part:.0f} %" for part in parts))
for time, handle in grips:
    axes.axvline(time, color="black", linewidth=0.6)
    axes.text(time - 0.05, 52.0, f"m_h = {handle.m_h:g} kg from here", ha="right")
axes.set(xlabel="end of the window (s)", ylabel="error (NRMSE, %)", ylim=(0, 60))
axes.legend(loc="upper left", bbox_to_anchor=(0, 0.85))

pyplot.show()
