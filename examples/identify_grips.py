# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Identify a handle in two grips
==============================

A sine sweep of force and the answer of the accelerometer tell mass, stiffness and damping of a
handle and the hand that holds it. Learn how to get these parameters with their intervals, and
whether two grips differ by more than that.
"""

# %%
# The paper's sweep, in lockstep: two trials for each grip of a simulated hand. Your own trials
# come from `haptic-accel identify`.

from matplotlib import pyplot

from haptic_accel import (
    GripParameters,
    MasterRigParameters,
    SweepParameters,
    held,
    identify_handle,
    run_identification,
)

sweep = SweepParameters()
rigs = {name: MasterRigParameters(grip=GripParameters(posture=name)) for name in ("pinch", "hook")}
recorded = {name: run_identification(rig, sweep, trials=2) for name, rig in rigs.items()}

# %%
# Actuator and sensor are known; the rest is fitted. This rig has no dry friction, so none is
# sought, which saves a minute.

free = ("b_s", "m_h", "k_u", "b_u", "delay")
sensor = rigs["pinch"].accelerometer
found = identify_handle(recorded, sweep, sensor.range, sensor.bandwidth, free=free)
print(*(found.doubts or ["no doubts"]), sep="\n")

_, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
for number, (name, grip) in enumerate(found.grips.items()):
    measured = grip.responses[0]
    model = grip.fit.response(measured.frequency, measured.rate)
    axes.loglog(measured.frequency, abs(measured.response), ".", ms=3, color=f"C{number}")
    axes.loglog(measured.frequency, abs(model), color=f"C{number}", label=f"{name}, model")
axes.set(xlabel="frequency (Hz)", ylabel="acceleration / force (m/s²/N)")
axes.legend(title="dots: one trial")

# %%
# Intervals of 95 % around the fitted values, relative to the true values of the simulated hand.

_, axes = pyplot.subplots(figsize=(7, 3), layout="constrained")
for number, (name, grip) in enumerate(found.grips.items()):
    true = held(rigs[name].handle, rigs[name].grip, seed=0)
    names = free[:-1]
    ratio = [100.0 * (grip.fit.value(each) / getattr(true, each) - 1.0) for each in names]
    # 95 % of normal errors are within 1.96 standard errors.
    errors = {each: 1.96 * grip.fit.standard_errors[each] for each in names}
    bars = [100.0 * errors[each] / getattr(true, each) for each in names]
    places = [place + 0.2 * number for place in range(len(names))]
    axes.errorbar(places, ratio, bars, fmt="o", capsize=4, label=name)
    print(name, *(f"{each} = {grip.fit.value(each):.4g} ± {errors[each]:.1g}" for each in names))
axes.axhline(0.0, color="black", linewidth=0.6)
axes.set_xticks(range(len(names)), names)
axes.set(xlabel="parameter", ylabel="deviation from the truth (%)")
axes.legend()

pyplot.show()
