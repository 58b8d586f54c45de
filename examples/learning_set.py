# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From a bag to a learning set
============================

Learning sets have some 30 frames a second, vibration a thousand samples. Learn how a set of
LeRobot keeps it, as a window for each frame, and what resampling costs.
"""

# %%
# A bag of a lockstep trial, and its set. `haptic-accel export --format lerobot` does the same.

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from matplotlib import pyplot

from haptic_accel import indistinguishable, read_bag, resampled, run_trial
from haptic_accel.kits.export import LeRobotWriter

folder = TemporaryDirectory()
dataset = Path(folder.name)
run_trial("adaptive", surface="text", duration=4.0, bag=dataset / "text")
written = LeRobotWriter(dataset, fps=30)
written.add("text", read_bag(dataset / "text"))
written.close()

# %%
# LeRobot is not needed to read it: frames are rows of a Parquet file.

frames = pd.read_parquet(dataset / "data/chunk-000/file-000.parquet")
windows = np.stack(frames["observation.state"])[:, 6:-1]  # behind position and velocity
print(windows.shape, "frames, samples; 960 Hz")

# %%
# One after the other, the windows are the signal as it was recorded.

series = pd.read_parquet(dataset / "series/text/tool_acceleration.parquet")
episodes = pd.read_parquet(dataset / "meta/episodes/chunk-000/file-000.parquet")
begin = json.loads(episodes["haptic_accel"][0])["begin_ns"]
recorded = series["z"][series["stamp"].astype("int64") >= begin].to_numpy()

_, axes = pyplot.subplots(figsize=(9, 4), layout="constrained")
for frame in range(60, 63):
    times = (frame + np.arange(32) / 32) / 30
    axes.plot(times, windows[frame], ".-", label=f"window of frame {frame}")
axes.plot(np.arange(2000, 2101) / 1000, recorded[2000:2101], "k", linewidth=0.6, label="recorded")
axes.legend()
axes.set(xlabel="time (s)", ylabel="acceleration of the tool (m/s²)")

# %%
# A lower rate of the windows loses what is above half of it. A hand could tell:

for rate in (960.0, 480.0, 240.0):
    back = resampled(resampled(recorded, 1000.0, rate), rate, 1000.0)[: len(recorded)]
    print(f"{rate:g} Hz: {indistinguishable(recorded, back, 1000.0):.0%} indistinguishable")

pyplot.show()
