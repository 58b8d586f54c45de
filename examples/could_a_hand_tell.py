# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Could a hand tell?
==================

An error of 40 % may be felt or not. Learn what the two measures of this package say: the NRMSE,
which counts every difference, and the share of the vibration whose strength a hand could not tell
from the desired one.
"""

# %%
# Copies of a desired acceleration: weaker or stronger ones, and late ones.

import numpy as np
from matplotlib import pyplot

from haptic_accel import align, indistinguishable, nrmse, run_trial

trials = {
    name: run_trial(name, surface="text", duration=4.0, seed=1)
    for name in ("none", "constant", "dynamic", "adaptive")
}
desired, rate = trials["adaptive"].desired_acceleration, trials["adaptive"].rate
gains = np.linspace(0.4, 1.6, 41)
late = np.arange(0, 11)  # samples
copies = {
    "gain of a copy": (gains, [(desired, gain * desired) for gain in gains]),
    "delay of a copy (ms)": (1e3 * late / rate, [align(desired, desired, n)[::-1] for n in late]),
}

_, panels = pyplot.subplots(1, 2, sharey=True, figsize=(9, 4), layout="constrained")
for axes, (name, (values, pairs)) in zip(panels, copies.items(), strict=True):
    axes.plot(values, [100.0 * nrmse(*pair) for pair in pairs], label="NRMSE")
    shares = [100.0 * indistinguishable(*pair, rate) for pair in pairs]
    axes.plot(values, shares, label="indistinguishable")
    axes.set(xlabel=name)
just_noticeable = 2.2  # dB, Israr et al. (2006)
for sign in (-1, 1):
    panels[0].axvline(10.0 ** (sign * just_noticeable / 20.0), color="black", linewidth=0.6)
panels[0].set_ylabel("measure (%)")
panels[1].legend()

# %%
# Lines mark the smallest difference that people notice, 2.2 dB. A copy that is late by 2 ms has a
# large NRMSE, although every strength is right; a quiet false tone in a loud texture has a small
# NRMSE and may be felt. So report both measures, as here of four controllers:

for name, trial in trials.items():
    share = trial.indistinguishable()
    print(f"{name}: NRMSE {trial.nrmse():.0f} %, {share:.0%} indistinguishable")

pyplot.show()
