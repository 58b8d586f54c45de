# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS nodes: they move data between topics, devices and the core."""

import os

from haptic_accel import lazy_names
from haptic_accel.core.process import BLAS_THREADS

# A node computes on one thread. BLAS threads spin while they wait for each other, and a spinning
# real-time thread may keep the others off a core indefinitely.
for _variable in BLAS_THREADS:
    os.environ.setdefault(_variable, "1")

__getattr__, __dir__ = lazy_names(__name__, __file__)
