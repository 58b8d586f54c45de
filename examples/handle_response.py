# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The handle and its parameters
=============================

What the actuator can do depends on how the handle answers a force. Learn what a grip and the mount
of the accelerometer change, and at which frequencies each parameter of the model acts.
"""

# %%
# Eq. (1) to (3) of the paper with Table I, held in two grips; and with the mount and the delay of
# the paper's rig.

from dataclasses import replace

import numpy as np
from matplotlib import pyplot

from haptic_accel import GripParameters, HandleParameters, MountParameters, Plant, held

rate = 1000.0  # Hz
frequency = np.geomspace(5.0, 450.0, 500)  # Hz
table_1 = HandleParameters()
plants = {
    f"{posture} grip": Plant(held(table_1, GripParameters(posture=posture), seed=0))
    for posture in ("pinch", "hook")
}
plants["average grip, elastic mount"] = Plant(table_1, MountParameters(287.0, 0.105), 68e-6)

_, (size, angle) = pyplot.subplots(2, sharex=True, figsize=(7, 6), layout="constrained")
for name, plant in plants.items():
    response = plant.response(frequency, rate)
    size.loglog(frequency, np.abs(response), label=name)
    angle.semilogx(frequency, np.degrees(np.unwrap(np.angle(response))))
    highest = np.abs(response).argmax()
    print(f"{name}: {np.abs(response[highest]):.0f} m/s² per N at {frequency[highest]:.0f} Hz")
size.set(ylabel="acceleration / force (m/s²/N)")
size.legend()
angle.set(xlabel="frequency (Hz)", ylabel="phase (degrees)")

# %%
# Each parameter a fifth larger. Stiffness and damping of the grip (k_u, b_u) and of the actuator
# (k_s, b_s), and its mass (m_a), act below 100 Hz. Above, only the mass of handle and hand (m_h)
# is left: get it right first.

_, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
average = Plant(table_1).response(frequency, rate)
for name in ("m_h", "k_u", "b_u", "m_a", "k_s", "b_s"):
    larger = replace(table_1, **{name: 1.2 * getattr(table_1, name)})
    ratio = Plant(larger).response(frequency, rate) / average
    axes.semilogx(frequency, 20.0 * np.log10(np.abs(ratio)), label=name)
axes.set(xlabel="frequency (Hz)", ylabel="change of the response (dB)")
axes.legend(title="20 % more", ncols=2)

pyplot.show()
