# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a delay costs
==================

Converter, amplifier and coil delay a force by a fraction of a millisecond. Learn how much error
this causes, how much of it a controller avoids that knows the delay, and what is gained if the
handle may follow a sample later.
"""

# %%
# The bound holds for every causal linear filter. `design_inverse` designs one such filter, and
# `predict` tells its error on a plant, also on another than it was designed for.

import numpy as np
from matplotlib import pyplot

from haptic_accel import (
    Goal,
    HandleParameters,
    MountParameters,
    Plant,
    causal_bound,
    design_inverse,
    predict,
)

rate = 1000.0  # Hz
delays = np.linspace(0.0, 1e-3, 6)  # s
budgets = (1, 2)  # samples by which the handle may follow


def plant(delay: float) -> Plant:
    """Return the handle of the paper's rig with another delay in s."""
    return Plant(HandleParameters(), MountParameters(287.0, 0.105), delay).coupled()


_, (errors, gains) = pyplot.subplots(1, 2, figsize=(9, 4), layout="constrained")
for budget, colour in zip(budgets, ("C0", "C1"), strict=True):
    goal = Goal(granted_delay=budget)
    bound = [causal_bound(plant(each), rate, granted_delay=budget) for each in delays]
    known = [predict(design_inverse(plant(each), rate, goal), plant(each)) for each in delays]
    unaware = design_inverse(plant(0.0), rate, goal)
    unknown = [predict(unaware, plant(each)).nrmse_percent for each in delays]
    named = f"{budget} ms"
    errors.plot(1e3 * delays, unknown, ":", color=colour, label=f"{named}, delay not known")
    errors.plot(1e3 * delays, [each.nrmse_percent for each in known], color=colour, label=named)
    errors.plot(1e3 * delays, bound, "o", color=colour, mfc="none", label=f"{named}, bound")
    gains.semilogx(known[2].frequency, known[2].gain, color=colour, label=named)
    print(f"{named}: {known[2].nrmse_percent:.1f} % at 0.4 ms, bound {bound[2]:.1f} %")
errors.set(xlabel="delay of the hardware (ms)", ylabel="error (NRMSE, %)", ylim=(0, 100))
errors.legend(title="handle may follow by", fontsize="small")
gains.set(xlabel="frequency (Hz)", ylabel="handle / desired acceleration (no unit)")
gains.set(xlim=(10, 500), ylim=(0, 3), title="delay of 0.4 ms, known")
gains.legend(title="handle may follow by")

# %%
# So identify the delay before you buy a faster amplifier, and grant a second sample. The error
# does not grow steadily then: a sampled plant with a delay of a fraction of a sample can have a
# zero outside the unit circle (Åström, Hagander, Sternby, 1984), which no causal filter inverts.
# The latency of the graph is no such delay: it is a known number of samples.

pyplot.show()
