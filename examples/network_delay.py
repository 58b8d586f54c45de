# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Two arms over a network
=======================

A spring between two hosts is a good coupling until the network delays it: then it pushes energy
into the arms. Learn how the passive coupling prevents this, and what it costs. ``two_arms`` is in
the folder ``benchmarks`` of the source.
"""

# %%
# A hand presses the master, and the slave touches a wall of 3 kN/m, 5 mm below its start. The
# network takes 6 ms each way, give or take 1 ms, and loses a tenth of the packets.

import numpy as np
from matplotlib import pyplot
from two_arms import TwoArms, free, press, stroke, wall

from haptic_accel import ChannelParameters, PassiveParameters

network = ChannelParameters(delay=6e-3, jitter=1e-3, loss=0.1)
_, (heights, energy) = pyplot.subplots(2, sharex=True, figsize=(8, 6), layout="constrained")
for law in ("spring", "passive"):
    motion = list(TwoArms(PassiveParameters(law=law), network, press, wall()).move(3.0))
    time = np.arange(len(motion)) / 1e3  # s, at 1 kHz
    heights.plot(time, [1e3 * at.slave[2] for at in motion], label=law)
    energy.plot(time, [1e3 * at.given for at in motion], label=law)
    print(f"{law}: {1e3 * max(at.given for at in motion):.1f} mJ at most from the motors")
heights.axhline(-5.0, color="black", linewidth=0.6)
heights.set(ylabel="height of the slave (mm)")
heights.legend()
energy.axhline(4.0, color="black", linewidth=0.6)
energy.set_yscale("symlog", linthresh=10.0)
energy.set(xlabel="time (s)", ylabel="energy from the motors (mJ)")

# %%
# The line at 4 mJ is what the passive coupling may give at most, on any network. It pays with
# stiffness: in free strokes of 80 mm the slave lags further, the later the packets come. Both arms
# engage in the first second.

_, axes = pyplot.subplots(figsize=(8, 4), layout="constrained")
for delay in (5e-3, 50e-3, 150e-3):  # s
    arms = TwoArms(PassiveParameters(), ChannelParameters(delay), stroke, free)
    motion = list(arms.move(3.0))
    apart = [1e3 * (at.master[0] - at.slave[0]) for at in motion]
    axes.plot(time, apart, label=f"{1e3 * delay:.0f} ms")
axes.set(xlabel="time (s)", ylabel="slave behind master, x (mm)", xlim=(0.9, 3.0))
axes.legend(title="one way")

pyplot.show()
