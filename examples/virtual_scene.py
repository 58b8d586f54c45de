# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Strokes over a scene of your own
================================

Without a robot, the slave's tool touches a scene that you describe in a file. Learn how to write
one, where the tool went in it, and what it gave to the hand.
"""

# %%
# A bench with the texture of plywood, and a flat dome of rubber on it, 3 mm high: the top of a
# sphere. Lengths are in m.

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib import pyplot

from haptic_accel import read_scene, run_trial

text = """
materials:
  wood:
    stiffness: 3000.0
    texture: plywood
    tap: [{frequency: 150.0, decay: 90.0, amplitude: 150.0}]
  rubber: {stiffness: 1000.0, damping: 8.0, friction: 0.4}
objects:
  bench: {shape: plane, material: wood}
  dome: {shape: sphere, material: rubber, radius: 0.1, position: [0.04, 0.0, -0.097]}
"""
folder = TemporaryDirectory()
file = Path(folder.name) / "dome.yaml"
file.write_text(text)
scene = read_scene(file)
trial = run_trial("adaptive", slave="virtual", surface=file, duration=5.0, seed=1)
folder.cleanup()

# %%
# Path of the tool in the section y = 0, force of the scene on it, and acceleration. The soft dome
# gives way to the tool, and has no texture: the vibration pauses on it. Where the tool leaves the
# dome, it meets the bench.

where = trial.arms["slave/measured_cp"]
_, (side, pressing, felt) = pyplot.subplots(3, figsize=(8, 8), layout="constrained")
for name, outlines in scene.section((-0.02, 0.1), (-0.002, 0.011)).items():
    for line in outlines:
        side.plot(*(1e3 * line.T), color="C7" if name == "bench" else "C1", label=name)
side.plot(1e3 * where[:, 0], 1e3 * where[:, 2], linewidth=0.7, label="tool")
side.legend()
side.set(xlabel="x (mm)", ylabel="z (mm)")
pressing.plot(trial.time, trial.arms["slave/contact_force"][:, 2])
pressing.set(xlabel="time (s)", ylabel="force on the tool, z (N)")
felt.plot(trial.time, trial.tool_acceleration, linewidth=0.6)
felt.set(xlabel="time (s)", ylabel="acceleration (m/s²)")
print(f"{np.ptp(where[:, 0]) * 1e3:.0f} mm of strokes, error {trial.nrmse():.0f} %")

pyplot.show()
