# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bags as data frames
===================

Experiments end in bags. Learn how to read them as tables for your own statistics: the error of
each trial, a paired test, the error by frequency band, and the coherence, which tells how much of
the error a linear filter could repair.
"""

# %%
# `haptic-accel experiment --lockstep` records a bag for each condition; this is its part without
# report, for two controllers and three users. Bags of a live graph are read in the same way.

from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib import pyplot

from haptic_accel import run_trial
from haptic_accel.analysis import bands, compare, load, signals, spectra, trials

folder = TemporaryDirectory()
bags = Path(folder.name)
for controller in ("dynamic", "adaptive"):
    for seed in (1, 2, 3):
        bag = bags / f"{controller}_{seed}"
        trial = run_trial(controller, surface="text", duration=3.0, seed=seed, bag=bag)
        print(f"{bag.name}: {trial.nrmse():.0f} %")

# %%
# A row for each trial, with units in the names of the columns; the difference of the controllers,
# user by user; and the samples of one bag.

analysis = load(bags)
table = trials(analysis)
print(table.groupby("controller")[["nrmse_percent", "bound_percent", "travel_mm"]].mean().round(1))
tested = compare(analysis, "controller:dynamic,adaptive").iloc[0]
print(f"{tested.difference_percent:.0f} points, p = {tested.p_t:.1g} in {tested.pairs} pairs")
print(signals(bags / "adaptive_1").agg(["std", "min", "max"]).round(2).T)

# %%
# Where the coherence is near 1 and the error is large, a better linear controller would help.

_, (errors, coherence) = pyplot.subplots(1, 2, figsize=(9, 4), layout="constrained")
by_band = bands(analysis).groupby(["band", "controller"], sort=False)["nrmse_percent"].mean()
by_band.unstack(sort=False).plot.bar(ax=errors, rot=30)
errors.set(xlabel="band", ylabel="error, mean of three users (NRMSE, %)")
lines = spectra(analysis).merge(table[["trial", "controller"]], on="trial")
for name, own in lines.groupby("controller", sort=False):
    mean = own.groupby("frequency_Hz").coherence.mean()
    coherence.plot(mean.index, mean, label=name)
coherence.set(xlabel="frequency (Hz)", ylabel="coherence (0 to 1)", ylim=(0, 1.02))
coherence.legend(title="controller")
folder.cleanup()

pyplot.show()
